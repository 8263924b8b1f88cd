//! Frequent mistakes in labels, tried where physics explains too few clips.

use super::super::recipe::FitConfig;
use super::{TaughtClip, teach};
use gravisight_clips::Clip;
use gravisight_geometry::error::{Error, Result};

/// Clips that each mistake is tried on.
const DIAGNOSED: usize = 3;

/// A mistake in how labels were written.
#[derive(Debug, Clone, Copy)]
enum LabelMistake {
    Swapped,
    Faster,
    Slower,
    Upward,
}

impl LabelMistake {
    const ALL: [Self; 4] = [Self::Swapped, Self::Faster, Self::Slower, Self::Upward];

    fn corrected(self, clip: &Clip) -> Clip {
        let mut clip = clip.clone();
        let height = f64::from(clip.camera.size().height);
        for frame in &mut clip.frames {
            match self {
                Self::Swapped => frame.image = frame.image.map(|[x, y]| [y, x]),
                Self::Faster => frame.t /= 2.0,
                Self::Slower => frame.t *= 2.0,
                Self::Upward => frame.image = frame.image.map(|[x, y]| [x, height - 1.0 - y]),
            }
        }
        clip
    }

    fn hint(self) -> &'static str {
        match self {
            Self::Swapped => "x and y of the labels are exchanged",
            Self::Faster => {
                "the true frame rate is twice the stated one (times `t` are twice as long as they should be)"
            }
            Self::Slower => "the true frame rate is half the stated one (times `t` are half as long as they should be)",
            Self::Upward => "y of the labels counts from the bottom instead of the top",
        }
    }
}

/// Refuses clips of which physics explains less than half, with the mistake that explains most of them, if
/// one does.
///
/// # Errors
/// [`Error::Data`].
pub fn check_taught(clips: &[Clip], taught: &[TaughtClip], config: &FitConfig, what: &str) -> Result<()> {
    let left_out: Vec<(&Clip, &str)> =
        clips.iter().zip(taught).filter_map(|(clip, taught)| Some((clip, taught.left_out.as_deref()?))).collect();
    let explained = clips.len() - left_out.len();
    if 2 * explained >= clips.len() {
        return Ok(());
    }
    let tried: Vec<&Clip> = left_out.iter().take(DIAGNOSED).map(|&(clip, _)| clip).collect();
    let fits = |mistake: LabelMistake| {
        tried.iter().filter(|clip| teach(&mistake.corrected(clip), config).left_out.is_none()).count()
    };
    let hint = LabelMistake::ALL.into_iter().map(|mistake| (fits(mistake), mistake)).max_by_key(|&(count, _)| count);
    let advice = match hint {
        Some((count, mistake)) if 2 * count > tried.len() => {
            format!("{count} of the {} tried would be explained if {}", tried.len(), mistake.hint())
        }
        _ => {
            let (clip, reason) = left_out[0];
            format!("check camera, scene and labels; the first that is not explained, clip `{}`: {reason}", clip.id)
        }
    };
    let reason = format!("the scene's physics explains {explained} of {} clips; {advice}", clips.len());
    Err(Error::Data { what: what.into(), reason })
}
