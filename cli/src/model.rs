//! `--model`.

use std::iter;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gravisight::internal::{ANY, SD_L};
use gravisight::{Card, Device, Localiser};

/// Path of the card of `--model M`: M itself, M with `.json`, or beside M's `.safetensors`.
pub fn card_path(model: &Path) -> PathBuf {
    match model.extension().and_then(|extension| extension.to_str()) {
        Some("json") => model.to_path_buf(),
        Some("safetensors") => model.with_extension("json"),
        _ => {
            let mut name = model.as_os_str().to_owned();
            name.push(".json");
            name.into()
        }
    }
}

/// The files of `--model M`: its card, and the weights that the card names.
pub fn files(model: &Path) -> Vec<PathBuf> {
    let card = card_path(model);
    let text = std::fs::read_to_string(&card).unwrap_or_default();
    let read: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    let weights = read["weights"].as_str().map(|weights| card.with_file_name(weights));
    iter::once(card).chain(weights).collect()
}

/// The built-in models by name: for any ball of known radius, and of the paper's rendered scenes.
const BUILT_IN: [(&str, (&str, &[u8])); 2] = [("any", ANY), ("sd-l", SD_L)];

/// The built-in model of `--model M`: that of this name where no file has it, and `any` without the option.
pub fn built_in(model: Option<&Path>) -> Option<(&'static str, &'static [u8])> {
    let Some(model) = model else { return Some(ANY) };
    let named = BUILT_IN.iter().find(|(name, _)| model.as_os_str() == *name);
    named.filter(|_| !card_path(model).exists()).map(|(_, built_in)| *built_in)
}

/// Loads `--model`, or a built-in one.
pub fn open(model: Option<&Path>, device: &Device) -> Result<Localiser> {
    let (card, weights) = read(model)?;
    let name = match built_in(model) {
        Some(_) => "built-in model".into(),
        None => model.map_or_else(PathBuf::new, |model| card_path(model).with_file_name(&card.weights)),
    };
    Localiser::new(card, weights, device).with_context(|| name.display().to_string())
}

/// The card and the weights of `--model`, or of a built-in one.
pub fn read(model: Option<&Path>) -> Result<(Card, Vec<u8>)> {
    let Some(model) = model.filter(|model| built_in(Some(model)).is_none()) else {
        let (card, weights) = built_in(model).unwrap_or(ANY);
        return Ok((Card::from_json(card, "built-in model")?, weights.to_vec()));
    };
    Ok(Card::with_weights(&card_path(model))?)
}
