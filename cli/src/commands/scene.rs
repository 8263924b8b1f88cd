//! `gravisight scene`.

use anyhow::Result;
use clap::Args;
use gravisight::Scene;

use super::print_line;

/// Print the scene of a sport, to use or edit; without a name, list the available scenes.
#[derive(Args)]
pub struct Arguments {
    /// Name of the scene.
    #[arg(value_name = "NAME")]
    name: Option<String>,
}

pub fn run(arguments: Arguments) -> Result<()> {
    match arguments.name {
        Some(name) => print_line(serde_json::to_string_pretty(&Scene::named(&name)?)?)?,
        None => Scene::names().into_iter().try_for_each(print_line)?,
    }
    Ok(())
}
