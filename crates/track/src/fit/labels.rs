//! Labels that are left out: repeated frames, and those of another ball.

use nalgebra::Point2;

use crate::observation::{Observation, noise_of, trusted};
use gravisight_geometry::statistics::median;

/// Steps between labels of a repeated frame and of those beside it, as fractions of the usual step, and fewest repeated frames.
const STILL: f64 = 0.03;
const MOVES: f64 = 0.4;
const FEWEST_REPEATS: usize = 3;
/// Label noise from which on labels may belong to two balls: a fraction of the picture's width, and at least this many px. Both are above the
/// noise of usual labels.
const ROUGH: f64 = 2e-3;
const LEAST_ROUGH: f64 = 3.0;
/// Labels between two of the same ball, at most.
const REACH: usize = 8;
/// How far a label may be from the extrapolation of the two before it: a fraction of the width, and a fraction of the step from the last one.
const START_FREE: f64 = 2e-3;
const BEND: f64 = 0.3;
/// Cost of a change of direction, in labels.
const DIRECTION_CHANGE: f64 = 3.0;

/// Frames that show the one before again: a video whose rate was raised.
pub(super) struct Repeats {
    /// Their indices.
    pub frames: Vec<usize>,
    /// When the others were taken, s, where frames are repeated regularly: evenly over the track. Of all frames, rising.
    pub times: Option<Vec<f64>>,
}

/// Repeated frames of a moving ball; none where there are too few to tell.
pub(super) fn repeats(observations: &[Observation]) -> Option<Repeats> {
    let step = |index: usize| Some((observations[index].image? - observations[index - 1].image?).norm());
    let steps: Vec<Option<f64>> = (1..observations.len()).map(step).collect();
    let usual = median(steps.iter().flatten().copied())?;
    let moves = |index: usize| steps.get(index).copied().flatten().is_some_and(|step| step > MOVES * usual);
    let still = |index: usize| steps[index].is_some_and(|step| step < STILL * usual);
    let frames: Vec<usize> = (1..steps.len().saturating_sub(1))
        .filter(|&index| still(index) && moves(index - 1) && moves(index + 1))
        .map(|index| index + 1)
        .collect();
    if frames.len() < FEWEST_REPEATS || usual == 0.0 {
        return None;
    }
    let gaps: Vec<usize> = frames.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let every = median(gaps.iter().map(|&gap| gap as f64))? as usize;
    // A label may be missing where a frame is repeated.
    let regular = gaps.iter().all(|gap| gap % every == 0);
    let times = regular.then(|| {
        let last = observations.len() - 1;
        let phase = frames[0] % every;
        let repeated = |index: usize| index > 0 && index % every == phase;
        let new = (1..=last).filter(|&index| !repeated(index)).count() as f64;
        let pace = (observations[last].time - observations[0].time) / new.max(1.0);
        let mut shown = 0.0;
        let time = |index: usize| {
            shown += if index == 0 || repeated(index) { 0.0 } else { 1.0 };
            observations[0].time + pace * (shown + if repeated(index) { 0.5 } else { 0.0 })
        };
        (0..=last).map(time).collect()
    });
    Some(Repeats { frames, times })
}

/// Indices of labels that lie on a different path from most, such as another ball's. Empty if all labels are near one smooth path, or if
/// most of them are on none. `width` of the picture, px.
pub(super) fn strays(observations: &[Observation], width: f64) -> Vec<usize> {
    let noise = noise_of(&trusted(observations));
    if noise < (ROUGH * width).max(LEAST_ROUGH) {
        return vec![];
    }
    let seen: Vec<(usize, f64, Point2<f64>)> =
        observations.iter().enumerate().filter_map(|(index, it)| Some((index, it.time, it.image?))).collect();
    let kept = longest_path(&seen, width);
    let mut without = observations.to_vec();
    let strays: Vec<usize> = seen.iter().map(|it| it.0).filter(|index| !kept.contains(index)).collect();
    strays.iter().for_each(|&index| without[index].image = None);
    let clear = 2 * kept.len() > seen.len() && noise_of(&without) < noise / 2.0;
    if clear { strays } else { vec![] }
}

/// Indices of the largest set of labels that can belong to one ball. Each label continues the two before it, or changes direction at a
/// price. Dynamic programming over pairs of consecutive labels.
fn longest_path(seen: &[(usize, f64, Point2<f64>)], width: f64) -> Vec<usize> {
    // Of each label and each of those before it: labels so far, less prices, and how far back the one before that is.
    let mut best: Vec<[(f64, usize); REACH]> = vec![[(f64::NEG_INFINITY, 0); REACH]; seen.len()];
    for end in 0..seen.len() {
        for back in 1..=REACH.min(end) {
            let middle = end - back;
            let (_, time, at) = seen[end];
            let ((_, from_time, from), lasting) = (seen[middle], time - seen[middle].1);
            best[end][back - 1] = (2.0, 0);
            for before in 1..=REACH.min(middle) {
                let (_, start_time, start) = seen[middle - before];
                let velocity = (from - start) / (from_time - start_time);
                let free = (START_FREE * width).max(LEAST_ROUGH) + BEND * velocity.norm() * lasting;
                let off = (from + velocity * lasting - at).norm();
                let price = match off < free {
                    true => 0.0,
                    // A bounce or a hit changes the direction, and the speed by no more than this.
                    false if (at - from).norm() < 2.0 * velocity.norm() * lasting + START_FREE * width => {
                        DIRECTION_CHANGE
                    }
                    false => continue,
                };
                let score = best[middle][before - 1].0 + 1.0 - price;
                if score > best[end][back - 1].0 {
                    best[end][back - 1] = (score, before);
                }
            }
        }
    }
    let ends = (0..seen.len()).flat_map(|end| (1..=REACH.min(end)).map(move |back| (end, back)));
    let Some((mut end, mut back)) = ends.max_by(|a, b| best[a.0][a.1 - 1].0.total_cmp(&best[b.0][b.1 - 1].0)) else {
        return vec![];
    };
    let mut kept = vec![seen[end].0];
    while back > 0 {
        let before = best[end][back - 1].1;
        end -= back;
        kept.push(seen[end].0);
        back = before;
    }
    kept.reverse();
    kept
}
