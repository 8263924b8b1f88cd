//! Whether a run fits the memory.

use super::super::examples::Source;
use super::super::recipe::{Phase, Recipe};
use crate::model::Pen;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;

/// Refuses a run that does not fit the memory that is free now, where the system says how much that is. Pictures for validation
/// take `scored` bytes. A GPU steps in its own memory, and WebGPU does not say how much there is.
pub(super) fn check_memory(recipe: &Recipe, pen: &Pen, source: &Source, scored: usize, on_cpu: bool) -> Result<()> {
    let [frames, empty] = source.picture_bytes();
    match free_memory() {
        Some(free) => check_against(free, recipe, pen, Kept { frames, empty, scored }, on_cpu),
        None => Ok(()),
    }
}

/// Bytes of decoded pictures.
#[derive(Clone, Copy)]
pub(super) struct Kept {
    /// To learn from.
    pub(super) frames: usize,
    /// Scenes without their ball.
    pub(super) empty: usize,
    /// To be scored.
    pub(super) scored: usize,
}

/// The same where `free` bytes are.
pub(super) fn check_against(free: usize, recipe: &Recipe, pen: &Pen, kept: Kept, on_cpu: bool) -> Result<()> {
    let of_phase = |phase: &Phase| {
        let size = phase.crop.map_or(recipe.input, Size::square);
        pen.training_bytes(phase.batch, size)
    };
    let step = if on_cpu { recipe.phases.iter().map(of_phase).max().unwrap_or(0) } else { 0 };
    // Kept as they are; scaled to the network's input at every look.
    let most = recipe.cache_mb << 20;
    let empty = if recipe.empty_fraction > 0.0 { kept.empty } else { 0 };
    let pictures = kept.frames.min(most) + kept.scored.min(most) + empty;
    if step + pictures <= free {
        return Ok(());
    }
    let gb = |bytes: usize| bytes as f64 / 1e9;
    let reason = format!(
        "a step takes about {:.1} GB and kept pictures {:.1} GB, but {:.1} GB are free; take a smaller `batch`, `crop` or \
         `cache_mb`",
        gb(step),
        gb(pictures),
        gb(free)
    );
    Err(Error::Data { what: "memory".into(), reason })
}

/// Memory that programs may still take, bytes; where Linux says it.
fn free_memory() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kilobytes: usize = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes << 10)
}
