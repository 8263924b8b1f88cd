//! Frames that a recording has lost or shows twice: the ball jumps along its path, and goes on as before.

use nalgebra::Point2;

use super::change_points::{MOST, PolynomialPiece};

/// Labels on each side of a gap that tell how the ball moves.
const REACHES: [usize; 2] = [12, 20];
/// Fewest on each side.
const FEWEST: usize = 5;
/// By how many frames times are moved: in steps, then in finer ones.
const SHIFTS: [f64; 2] = [-1.5, 4.5];
const STEP: f64 = 0.5;
const FINE: f64 = 0.1;
/// A gap's time is changed if that lowers the cost of the labels around it by more than this, in squared standard deviations, and if their
/// mean cost is then below this level.
const LEAST_COST_REDUCTION: f64 = 15.0;
const LEVEL: f64 = 3.0;

/// Lost frames, or repeated ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drop {
    /// Index of the first label after it.
    pub label: usize,
    /// Frames that are missing before it; negative: shown twice.
    pub frames: i32,
}

/// Drops of the clock of `labels` (s, px), known to `sigma` px, of which two frames are `interval` s apart.
pub fn drops(labels: &[(f64, Point2<f64>)], interval: f64, sigma: f64) -> Vec<Drop> {
    let mut labels = labels.to_vec();
    let mut found: Vec<Drop> = vec![];
    // The clearest first: what is near it looks different afterwards.
    while found.len() < labels.len() / FEWEST {
        let places =
            (FEWEST..labels.len().saturating_sub(FEWEST - 1)).flat_map(|label| REACHES.map(|reach| (label, reach)));
        let candidates = places.filter_map(|(label, reach)| {
            let around = label.saturating_sub(reach)..(label + reach).min(labels.len());
            let cost = |shift: f64| {
                let mut moved = labels[around.clone()].to_vec();
                moved[label - around.start..].iter_mut().for_each(|(time, _)| *time += shift);
                let rising = moved.windows(2).all(|pair| pair[0].0 <= pair[1].0 + 1e-9);
                rising.then(|| PolynomialPiece::of(&moved, sigma, MOST).map(|piece| piece.cost)).flatten()
            };
            let as_it_is = cost(0.0)?;
            let cheapest = |from: f64, to: f64, step: f64| {
                let shifts = (0..=((to - from) / step).round() as usize).map(|at| from + step * at as f64);
                let costs = shifts.filter_map(|frames| Some((frames, cost(frames * interval)?)));
                costs.min_by(|a, b| a.1.total_cmp(&b.1))
            };
            let (coarse, least) = cheapest(SHIFTS[0], SHIFTS[1], STEP)?;
            let (frames, least) = if as_it_is - least > LEAST_COST_REDUCTION / 2.0 {
                cheapest(coarse - STEP, coarse + STEP, FINE)?
            } else {
                (coarse, least)
            };
            let good = as_it_is - least > LEAST_COST_REDUCTION && least < LEVEL * around.len() as f64;
            let frames = frames.round() as i32;
            (good && frames != 0).then_some((as_it_is - least, Drop { label, frames }))
        });
        let Some((_, drop)) = candidates.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        labels[drop.label..].iter_mut().for_each(|(time, _)| *time += f64::from(drop.frames) * interval);
        found.push(drop);
    }
    found.sort_by_key(|drop| drop.label);
    found
}
