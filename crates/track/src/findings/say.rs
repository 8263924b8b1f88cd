//! Words for numbers and names.

use gravisight_physics::Surface;

/// With a capital letter and a full stop.
pub(super) fn sentence(text: &str) -> String {
    let mut letters = text.trim().chars();
    let first: String = letters.next().map_or(String::new(), |first| first.to_uppercase().collect());
    let ends = text.trim_end().ends_with(['.', '?', '!']);
    format!("{first}{}{}", letters.as_str(), if ends { "" } else { "." })
}

/// The same inside a sentence.
pub(super) fn inside_sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first: String = letters.next().map_or(String::new(), |first| first.to_lowercase().collect());
    format!("{first}{}", letters.as_str())
}

/// `1 bounce`, `3 bounces`.
pub(super) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// A length in the unit in which people would say it.
pub(super) fn length(metres: f64) -> String {
    match metres {
        _ if !metres.is_finite() => "unknown".into(),
        metres if metres < 0.0995 => format!("{:.1} cm", 100.0 * metres),
        metres if metres < 0.995 => format!("{:.0} cm", 100.0 * metres),
        metres => format!("{metres:.1} m"),
    }
}

/// What is touched; people count from one.
pub(super) fn surface(surface: Surface) -> String {
    match surface {
        Surface::Floor => "the floor".into(),
        Surface::Wall(index) => format!("wall {}", index + 1),
        Surface::Box(index) => format!("box {}", index + 1),
    }
}
