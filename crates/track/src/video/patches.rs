//! Patches of what stands still, found again in other frames; and whole pictures, reduced.

use nalgebra::Vector2;

use super::config::RegistrationConfig;
use super::planes::Planes;

/// Half a patch's side, px: patches of another size would need another texture, contrast and noise.
pub(super) const HALF: usize = 7;
/// Factor by which a plane is reduced for the coarse search, and how far that goes, as a fraction of the width.
pub(super) const REDUCED: usize = 8;

/// A square of a key frame's brightness.
pub(super) struct Patch {
    at: [usize; 2],
    values: Vec<i32>,
    /// Mean distance of the values from their mean.
    contrast: f64,
}

impl Patch {
    pub fn of(planes: &Planes, at: [usize; 2]) -> Self {
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

    pub fn xy(&self) -> [f64; 2] {
        self.at.map(|at| at as f64)
    }

    fn is_alike(&self, difference: f64, config: &RegistrationConfig) -> bool {
        difference < config.alike * self.contrast + config.noise
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

    /// The place at which it is predicted, and how far from there it is found.
    pub fn found(
        &self,
        planes: &Planes,
        predicted: Vector2<f64>,
        reach: i64,
        config: &RegistrationConfig,
    ) -> Option<[Vector2<f64>; 2]> {
        let expected = predicted.map(|at| at.round() as i64);
        let off = |x: i64, y: i64| self.difference(planes, [expected.x + x, expected.y + y]);
        let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
        let best = places.filter_map(|(x, y)| Some(((x, y), off(x, y)?))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let ((x, y), least) = best;
        // At the search's edge it is perhaps farther away still.
        if !self.is_alike(least, config) || x.abs() == reach || y.abs() == reach {
            return None;
        }
        let between = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) if before + after > 2.0 * least => {
                // The sum of absolute differences is a cone, not a parabola.
                let (most, less) = (before.max(after) - least, before - after);
                (0.5 * less / most).clamp(-0.5, 0.5)
            }
            _ => 0.0,
        };
        let part = [between(off(x - 1, y), off(x + 1, y)), between(off(x, y - 1), off(x, y + 1))];
        let found = Vector2::new((expected.x + x) as f64 + part[0], (expected.y + y) as f64 + part[1]);
        Some([predicted, found - predicted])
    }
}

/// The gradient (root mean square, levels a px) about a place in the direction in which it is weakest.
pub(super) fn texture(planes: &Planes, [x, y]: [usize; 2]) -> f64 {
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

/// A plane's brightness, reduced.
pub(super) struct Reduced {
    width: usize,
    height: usize,
    values: Vec<i32>,
}

impl Reduced {
    pub fn of(planes: &Planes) -> Self {
        let (width, height) = (planes.width / REDUCED, planes.height / REDUCED);
        let mut values = vec![0; width * height];
        for (row, values) in values.chunks_exact_mut(width.max(1)).enumerate() {
            for line in 0..REDUCED {
                let line = &planes.levels[0][(row * REDUCED + line) * planes.width..][..width * REDUCED];
                for (value, pixels) in values.iter_mut().zip(line.chunks_exact(REDUCED)) {
                    *value += pixels.iter().map(|&pixel| i32::from(pixel)).sum::<i32>();
                }
            }
        }
        values.iter_mut().for_each(|value| *value /= (REDUCED * REDUCED) as i32);
        Self { width, height, values }
    }

    /// The shift by which most of `other` is this, near an expected one, cells.
    pub fn shift_to(&self, other: &Self, expected: [i64; 2], config: &RegistrationConfig) -> Option<[i64; 2]> {
        let reach = (config.coarse_reach * self.width as f64) as i64;
        let shifts = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x + expected[0], y + expected[1]]));
        let most = i32::from(config.coarse_most);
        let difference = |[x, y]: [i64; 2]| {
            let rows = y.max(0)..(self.height as i64).min(self.height as i64 + y);
            let columns = x.max(0)..(self.width as i64).min(self.width as i64 + x);
            let (tall, wide) = (rows.end - rows.start, columns.end - columns.start);
            if 2 * tall < self.height as i64 || 2 * wide < self.width as i64 {
                return None;
            }
            let line = |row: i64| {
                let there = &other.values[row as usize * self.width + columns.start as usize..][..wide as usize];
                let here =
                    &self.values[(row - y) as usize * self.width + (columns.start - x) as usize..][..wide as usize];
                // Some of it moves, which must not decide.
                here.iter().zip(there).map(|(a, b)| i64::from((a - b).abs().min(most))).sum::<i64>()
            };
            Some(rows.step_by(2).map(line).sum::<i64>() as f64 / (tall * wide) as f64)
        };
        let found = shifts.filter_map(|shift| Some((shift, difference(shift)?)));
        found.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(shift, _)| shift)
    }
}
