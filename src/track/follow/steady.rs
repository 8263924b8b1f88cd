//! Whether the camera still looks where it did at first: patches of what stood still then, found again.
//!
//! Metres hold for the view that was calibrated, which is the first. A slow pan is no cut: the background follows it, and arcs are
//! found as if nothing were; only what stands still tells.

use nalgebra::{Matrix2, Vector2};

use super::planes::Planes;

/// Half a patch's side, px, and how far it is searched.
const HALF: usize = 7;
const REACH: i64 = 6;
/// Cells along the picture's sides in which one patch each is chosen, and px between places that are tried.
const CELLS: [usize; 2] = [12, 8];
const STEP: usize = 6;
/// Least gradient (root mean square, levels a px) in a patch's weakest direction.
const TEXTURE: f64 = 4.0;
/// Largest mean difference of a patch that is found again, as a share of its own contrast, and what noise may add, levels.
const ALIKE: f64 = 0.5;
const NOISE: f64 = 3.0;
/// Fewest patches that say anything, and the share of those found that has to agree.
const FEWEST: usize = 8;
const AGREE: f64 = 0.6;
/// Distance within which a patch agrees with the others, px.
const NEAR: f64 = 1.0;
/// Pairs of patches of which a motion is tried.
const TRIES: usize = 80;
/// Mean distance that what stands still may move in the picture, px.
const STILL: f64 = 1.5;

/// What of a view is found again.
pub(super) struct Steady {
    patches: Vec<Patch>,
    width: usize,
    height: usize,
    /// The last motion that was found: patches are searched about where it puts them.
    motion: Motion,
}

struct Patch {
    at: [usize; 2],
    values: Vec<i32>,
    /// Mean distance of the values from their mean.
    contrast: f64,
}

/// A shift with a turn and a scale: `at + turn · at + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Motion {
    turn: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Motion {
    const NONE: Self = Self { turn: Matrix2::new(0.0, 0.0, 0.0, 0.0), shift: Vector2::new(0.0, 0.0) };

    fn of(&self, at: &Vector2<f64>) -> Vector2<f64> {
        self.turn * at + self.shift
    }

    /// That of two places; [`None`] where they are too near each other.
    fn through([a, moved_a]: [Vector2<f64>; 2], [b, moved_b]: [Vector2<f64>; 2]) -> Option<Self> {
        let (from, to) = (b - a, moved_b - moved_a);
        let square = from.norm_squared();
        if square < 100.0 * (HALF * HALF) as f64 {
            return None;
        }
        // The similarity that maps `from` to `from + to`, less the identity.
        let (scale, turn) = (from.dot(&to) / square, from.perp(&to) / square);
        let turn = Matrix2::new(scale, -turn, turn, scale);
        Some(Self { turn, shift: moved_a - turn * a })
    }
}

/// Where the camera looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum View {
    /// Where it did at first.
    First,
    /// Elsewhere: what stands still is so far away from where it was, px.
    Moved(f64),
    /// Too little is found again to say so.
    Unknown,
}

impl Steady {
    /// What can be found again in the view of these frames, of which the first is one that others should show as well.
    pub fn of(frames: &[&Planes]) -> Option<Self> {
        let [first, others @ ..] = frames else { return None };
        let (width, height) = (first.width, first.height);
        let mut patches = Vec::new();
        for row in 0..CELLS[1] {
            for column in 0..CELLS[0] {
                let bounds = |cell: usize, cells: usize, side: usize| {
                    let margin = HALF + 1;
                    (side * cell / cells).max(margin)..(side * (cell + 1) / cells).min(side.saturating_sub(margin + 1))
                };
                let places = bounds(row, CELLS[1], height)
                    .step_by(STEP)
                    .flat_map(|y| bounds(column, CELLS[0], width).step_by(STEP).map(move |x| [x, y]));
                let best = places.map(|at| (at, texture(first, at))).max_by(|a, b| a.1.total_cmp(&b.1));
                let Some((at, texture)) = best else { continue };
                if texture < TEXTURE {
                    continue;
                }
                let patch = Patch::of(first, at);
                // What moves already in these frames stands not still.
                let stays = |other: &&Planes| {
                    patch.difference(other, [at[0] as i64, at[1] as i64]).is_some_and(|off| patch.is_alike(off))
                };
                if others.iter().all(stays) {
                    patches.push(patch);
                }
            }
        }
        (patches.len() >= FEWEST).then_some(Self { patches, width, height, motion: Motion::NONE })
    }

    /// Where the camera looks in a frame.
    pub fn view(&mut self, now: &Planes) -> View {
        if (now.width, now.height) != (self.width, self.height) {
            return View::Unknown;
        }
        let found: Vec<[Vector2<f64>; 2]> =
            self.patches.iter().filter_map(|patch| patch.found(now, &self.motion)).collect();
        if found.len() < FEWEST {
            return View::Unknown;
        }
        let Some((motion, agreeing)) = consensus(&found) else { return View::Unknown };
        if (agreeing as f64) < AGREE * found.len() as f64 || 3 * agreeing < self.patches.len() {
            return View::Unknown;
        }
        self.motion = motion;
        let mean =
            self.patches.iter().map(|patch| motion.of(&patch.place()).norm()).sum::<f64>() / self.patches.len() as f64;
        if mean < STILL { View::First } else { View::Moved(mean) }
    }

    /// Another picture came in between: patches are searched where they were at first.
    pub fn start_again(&mut self) {
        self.motion = Motion::NONE;
    }
}

/// The motion for which most places speak, and how many do.
fn consensus(found: &[[Vector2<f64>; 2]]) -> Option<(Motion, usize)> {
    let agreeing = |motion: &Motion| found.iter().filter(|[at, moved]| (motion.of(at) - moved).norm() < NEAR).count();
    // Numbers that look random, and are the same each time.
    let mut state = 1_u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % found.len()
    };
    let tried = (0..TRIES).filter_map(|_| Motion::through(found[draw()], found[draw()]));
    let motion = tried.chain([Motion::NONE]).max_by_key(|motion| agreeing(motion))?;
    Some((motion, agreeing(&motion)))
}

impl Patch {
    fn of(planes: &Planes, at: [usize; 2]) -> Self {
        let mut values = Vec::with_capacity((2 * HALF + 1).pow(2));
        for y in at[1] - HALF..=at[1] + HALF {
            let row = &planes.levels[0][y * planes.width..];
            values.extend(row[at[0] - HALF..=at[0] + HALF].iter().map(|&value| i32::from(value)));
        }
        let mean = values.iter().sum::<i32>() / values.len() as i32;
        values.iter_mut().for_each(|value| *value -= mean);
        let contrast = values.iter().map(|value| value.abs()).sum::<i32>() as f64 / values.len() as f64;
        Self { at, values, contrast }
    }

    fn place(&self) -> Vector2<f64> {
        Vector2::new(self.at[0] as f64, self.at[1] as f64)
    }

    fn is_alike(&self, difference: f64) -> bool {
        difference < ALIKE * self.contrast + NOISE
    }

    /// Mean difference from what is about a place, each less its mean; [`None`] where that is not within the picture.
    fn difference(&self, planes: &Planes, [x, y]: [i64; 2]) -> Option<f64> {
        let half = HALF as i64;
        if x < half || y < half || x + half >= planes.width as i64 || y + half >= planes.height as i64 {
            return None;
        }
        let side = 2 * HALF + 1;
        let first = (y - half) as usize * planes.width + (x - half) as usize;
        let rows = || (0..side).map(|row| &planes.levels[0][first + row * planes.width..][..side]);
        let sum: i32 = rows().flatten().map(|&value| i32::from(value)).sum();
        let mean = sum / (side * side) as i32;
        let off: i32 = rows()
            .zip(self.values.chunks_exact(side))
            .map(|(row, values)| {
                row.iter().zip(values).map(|(&now, was)| (i32::from(now) - mean - was).abs()).sum::<i32>()
            })
            .sum();
        Some(f64::from(off) / (side * side) as f64)
    }

    /// Where it was, and how far from there it is now.
    fn found(&self, planes: &Planes, motion: &Motion) -> Option<[Vector2<f64>; 2]> {
        let expected = motion.of(&self.place()).map(|off| off.round() as i64);
        let off = |x: i64, y: i64| {
            self.difference(planes, [self.at[0] as i64 + expected.x + x, self.at[1] as i64 + expected.y + y])
        };
        let places = (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| (x, y)));
        let best = places.filter_map(|(x, y)| Some(((x, y), off(x, y)?))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let ((x, y), least) = best;
        // At the search's edge it is perhaps farther away still.
        if !self.is_alike(least) || x.abs() == REACH || y.abs() == REACH {
            return None;
        }
        let between = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) if before + after > 2.0 * least => {
                (0.5 * (before - after) / (before + after - 2.0 * least)).clamp(-0.5, 0.5)
            }
            _ => 0.0,
        };
        let part = [between(off(x - 1, y), off(x + 1, y)), between(off(x, y - 1), off(x, y + 1))];
        let moved = Vector2::new((expected.x + x) as f64 + part[0], (expected.y + y) as f64 + part[1]);
        Some([self.place(), moved])
    }
}

/// The gradient (root mean square, levels a px) about a place in the direction in which it is weakest.
fn texture(planes: &Planes, [x, y]: [usize; 2]) -> f64 {
    let level = |x: usize, y: usize| f64::from(planes.levels[0][y * planes.width + x]);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for y in (y - HALF..=y + HALF).step_by(2) {
        for x in (x - HALF..=x + HALF).step_by(2) {
            let [dx, dy] =
                [level(x + 1, y) - level(x - 1, y), level(x, y + 1) - level(x, y - 1)].map(|twice| twice / 2.0);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
    }
    let (middle, off) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    ((middle - off).max(0.0) / (HALF + 1).pow(2) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of noise that is smooth over some pixels, seen by a camera that has turned, moved and zoomed a little.
    fn seen(shift: [f64; 2], zoom: f64, brighter: i32) -> Planes {
        let (width, height) = (320, 200);
        let level = |x: f64, y: f64| {
            let waves =
                [(0.31, 0.17, 0.0), (-0.23, 0.29, 1.0), (0.11, -0.37, 2.0), (0.41, 0.07, 3.0), (-0.05, 0.45, 4.0)];
            let sum: f64 =
                waves.iter().map(|(a, b, phase)| (a * x + b * y + phase + (0.013 * x * y / 10.0).sin()).sin()).sum();
            (128.0 + 22.0 * sum) as i32
        };
        let at = |index: usize| {
            let (x, y) = ((index % width) as f64 - 160.0, (index / width) as f64 - 100.0);
            (level(x / zoom - shift[0], y / zoom - shift[1]) + brighter).clamp(0, 255) as u8
        };
        let levels: Vec<u8> = (0..width * height).map(at).collect();
        Planes { width, height, levels: [levels.clone(), levels] }
    }

    #[test]
    fn a_slow_pan_and_a_zoom_are_followed_and_the_way_back_too() {
        let still = seen([0.0, 0.0], 1.0, 0);
        let mut steady = Steady::of(&[&still, &seen([0.0, 0.0], 1.0, 4)]).unwrap();
        assert_eq!(steady.view(&still), View::First);
        // A cloud before the sun.
        assert_eq!(steady.view(&seen([0.4, -0.3], 1.0, -20)), View::First);
        for step in 1..=10 {
            let view = steady.view(&seen([4.0 * f64::from(step), f64::from(step)], 1.0, 0));
            let way = f64::from(step) * 17.0_f64.sqrt();
            assert!(matches!(view, View::Moved(px) if (px - way).abs() < 0.3), "{view:?} of {way}");
        }
        for step in (0..10).rev() {
            steady.view(&seen([4.0 * f64::from(step), f64::from(step)], 1.0, 0));
        }
        assert_eq!(steady.view(&still), View::First);
        let zoomed = (1..=5).map(|step| steady.view(&seen([0.0, 0.0], 1.0 + 0.01 * f64::from(step), 0))).last();
        assert!(matches!(zoomed, Some(View::Moved(px)) if (3.0..7.0).contains(&px)), "{zoomed:?}");
    }

    #[test]
    fn what_moves_before_it_is_no_moving_camera() {
        let still = seen([0.0, 0.0], 1.0, 0);
        let mut steady = Steady::of(&[&still]).unwrap();
        let mut crowd = seen([0.0, 0.0], 1.0, 0);
        let elsewhere = seen([90.0, 40.0], 1.0, 0);
        // Two fifths of the picture are people who walk.
        for row in 0..crowd.height {
            let part = row * crowd.width..row * crowd.width + 128;
            crowd.levels[0][part.clone()].copy_from_slice(&elsewhere.levels[0][part]);
        }
        assert_eq!(steady.view(&crowd), View::First);
        assert_eq!(steady.view(&elsewhere), View::Unknown);
        let plain = Planes { width: 320, height: 200, levels: [vec![90; 64_000], vec![90; 64_000]] };
        assert!(Steady::of(&[&plain]).is_none());
    }
}
