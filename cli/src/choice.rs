//! Options whose values are names of the library's things: name, help and value, declared once.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// A name, what `--help` says of it, and the value that it stands for.
pub type Choice<T> = (&'static str, &'static str, T);

/// A parser of these names.
pub fn one_of<T: Clone + Send + Sync + 'static>(choices: &'static [Choice<T>]) -> impl TypedValueParser<Value = T> {
    let possible = choices.iter().map(|(name, help, _)| match help.is_empty() {
        true => PossibleValue::new(name),
        false => PossibleValue::new(name).help(help),
    });
    let value = |name: String| match choices.iter().find(|choice| choice.0 == name) {
        Some((.., value)) => Ok(value.clone()),
        None => Err(format!("`{name}` is not one of the possible values")),
    };
    PossibleValuesParser::new(possible).try_map(value)
}
