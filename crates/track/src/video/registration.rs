//! The registration of each frame to the first view: patches of what stands still, found again, and the homography that most of
//! them agree on.
//!
//! A camera that turns and zooms about its centre changes its picture by a homography. Patches are taken from a key frame; a new key frame
//! takes over where too few of them are left in view, and an older one where it is in view again, so that errors do not add up on the
//! way back.

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2};
use rayon::prelude::*;

use super::planes::Planes;
use super::view::{View, displacement, mapped};

/// Half a patch's side, px, and how far from its predicted place it is searched; where the camera stood still before, it is searched less far.
const HALF: usize = 7;
const REACH: i64 = 6;
const REACH_STILL: i64 = 3;
/// Cells along the picture's sides in which one patch each is chosen, and px between places that are tried.
const CELLS: [usize; 2] = [12, 8];
const STEP: usize = 6;
/// Least gradient (root mean square, levels a px) in a patch's weakest direction.
const TEXTURE: f64 = 4.0;
/// Largest mean difference of a patch that is found again, as a fraction of its own contrast, and what noise may add, levels.
const ALIKE: f64 = 0.5;
const NOISE: f64 = 3.0;
/// Fewest patches that make a homography, and the fraction of those found, and of those in view, that has to agree.
const FEWEST: usize = 8;
const AGREE: f64 = 0.5;
const AGREE_OF_ALL: f64 = 0.3;
/// Distance within which a patch agrees with the others, px.
const NEAR: f64 = 1.0;
/// Pairs of patches of which a motion is tried.
const TRIES: usize = 80;
/// Fraction of a key frame's patches in view, and mean displacement as a fraction of the width, at which another key frame takes over.
const LEAST_IN_VIEW: f64 = 0.6;
const FARTHEST: f64 = 0.12;
/// The same displacement within which an older key frame takes over again.
const RETURNED: f64 = 0.06;
/// Standard deviation of a patch's place, px, and of what a camera that turns and zooms changes besides a similarity from one frame to the
/// next: aspect and shear, and the perspective terms, of coordinates in half widths.
const PLACE_SIGMA: f64 = 0.3;
const SHEAR_SIGMA: f64 = 0.002;
const PERSPECTIVE_SIGMA: f64 = 0.003;
/// Rounds of the robust fit.
const ROUNDS: usize = 3;
/// Factor by which a plane is reduced for the coarse search, and how far that goes, as a fraction of the width.
const REDUCED: usize = 8;
const COARSE_REACH: f64 = 0.2;

/// Finds the views of frames that come one after the other.
pub(super) struct Registration {
    keys: Vec<Key>,
    /// Index of the key frame that is in use.
    current: usize,
    size: [usize; 2],
    /// The last view, frame from first, and the change to it from the one before.
    last: Matrix3<f64>,
    step: Matrix3<f64>,
}

/// A key frame.
struct Key {
    patches: Vec<Patch>,
    key_from_first: Matrix3<f64>,
    first_from_key: Matrix3<f64>,
    reduced: Reduced,
}

struct Patch {
    at: [usize; 2],
    values: Vec<i32>,
    /// Mean distance of the values from their mean.
    contrast: f64,
}

/// A shift with a rotation and a scale: `at + rotation · at + shift`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Motion {
    rotation: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Motion {
    const NONE: Self = Self { rotation: Matrix2::new(0.0, 0.0, 0.0, 0.0), shift: Vector2::new(0.0, 0.0) };

    fn of(&self, at: &Vector2<f64>) -> Vector2<f64> {
        self.rotation * at + self.shift
    }

    /// That of two places; [`None`] where they are too near each other.
    fn through([a, moved_a]: [Vector2<f64>; 2], [b, moved_b]: [Vector2<f64>; 2]) -> Option<Self> {
        let (from, to) = (b - a, moved_b - moved_a);
        let square = from.norm_squared();
        if square < 100.0 * (HALF * HALF) as f64 {
            return None;
        }
        // The similarity that maps `from` to `from + to`, less the identity: scaled cosine and sine of its angle.
        let (cosine, sine) = (from.dot(&to) / square, from.perp(&to) / square);
        let rotation = Matrix2::new(cosine, -sine, sine, cosine);
        Some(Self { rotation, shift: moved_a - rotation * a })
    }
}

impl Registration {
    /// With `first` as the first view; none where it shows too little that can be found again.
    pub fn of(first: &Planes) -> Option<Self> {
        let key = Key::of(first, Matrix3::identity())?;
        let (last, step) = (Matrix3::identity(), Matrix3::identity());
        Some(Self { keys: vec![key], current: 0, size: [first.width, first.height], last, step })
    }

    /// The view of the next frame; none where too little is found again.
    pub fn view(&mut self, now: &Planes) -> Option<View> {
        let reach = if self.step == Matrix3::identity() { REACH_STILL } else { REACH };
        let key = &self.keys[self.current];
        let tried = key.registered(now, &(self.step * self.last * key.first_from_key), reach);
        let tried = tried.or_else(|| key.registered(now, &(self.last * key.first_from_key), REACH));
        let (frame_from_key, sigma) = tried.or_else(|| key.coarse(now, &(self.last * key.first_from_key)))?;
        let frame_from_first = frame_from_key * key.key_from_first;
        let view = View::new(frame_from_first, sigma)?;
        self.step = if displacement(&frame_from_first, self.size) < f64::from(REACH_STILL as i32) / 2.0 {
            Matrix3::identity()
        } else {
            frame_from_first * self.last.try_inverse()?
        };
        self.last = frame_from_first;
        self.choose_key(now, &frame_from_key);
        Some(view)
    }

    /// Another picture came in between: patches are searched where they were at first.
    pub fn start_again(&mut self) {
        (self.current, self.last, self.step) = (0, Matrix3::identity(), Matrix3::identity());
    }

    /// Lets another key frame take over where the camera has left this one, or is back at an older one.
    fn choose_key(&mut self, now: &Planes, frame_from_key: &Matrix3<f64>) {
        let width = self.size[0] as f64;
        let away = |key: &Key| displacement(&(self.last * key.first_from_key), self.size) / width;
        if let Some(older) = self.keys[..self.current].iter().position(|key| away(key) < RETURNED) {
            self.current = older;
            return;
        }
        let key = &self.keys[self.current];
        let in_view = key.patches.iter().filter(|patch| self.is_inside(mapped(frame_from_key, patch.xy()))).count();
        if (in_view as f64) < LEAST_IN_VIEW * key.patches.len() as f64 || away(key) > FARTHEST {
            if let Some(later) = self.keys.iter().position(|key| away(key) < RETURNED) {
                self.current = later;
            } else if let Some(key) = Key::of(now, self.last) {
                self.keys.push(key);
                self.current = self.keys.len() - 1;
            }
        }
    }

    fn is_inside(&self, [x, y]: [f64; 2]) -> bool {
        (0.0..self.size[0] as f64).contains(&x) && (0.0..self.size[1] as f64).contains(&y)
    }
}

impl Key {
    fn of(planes: &Planes, key_from_first: Matrix3<f64>) -> Option<Self> {
        let (width, height) = (planes.width, planes.height);
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
                let best = places.map(|at| (at, texture(planes, at))).max_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((at, texture)) = best
                    && texture >= TEXTURE
                {
                    patches.push(Patch::of(planes, at));
                }
            }
        }
        let first_from_key = key_from_first.try_inverse()?;
        let reduced = Reduced::of(planes);
        (patches.len() >= FEWEST).then_some(Self { patches, key_from_first, first_from_key, reduced })
    }

    /// The homography to a frame from this one near a `predicted` one, and the deviation of the places that it maps, px.
    fn registered(&self, now: &Planes, predicted: &Matrix3<f64>, reach: i64) -> Option<(Matrix3<f64>, f64)> {
        let inside = |[x, y]: [f64; 2]| (0.0..now.width as f64).contains(&x) && (0.0..now.height as f64).contains(&y);
        let in_view =
            self.patches.iter().map(|patch| (patch, mapped(predicted, patch.xy()))).filter(|(_, at)| inside(*at));
        let in_view: Vec<(&Patch, [f64; 2])> = in_view.collect();
        let found: Vec<[Vector2<f64>; 2]> =
            in_view.par_iter().filter_map(|(patch, at)| patch.found(now, Vector2::from(*at), reach)).collect();
        if found.len() < FEWEST {
            return None;
        }
        let (motion, agreeing) = consensus(&found)?;
        let enough = (AGREE * found.len() as f64).max(AGREE_OF_ALL * in_view.len() as f64).max(FEWEST as f64);
        if (agreeing as f64) < enough {
            return None;
        }
        let agree = |[at, moved]: &&[Vector2<f64>; 2]| (motion.of(at) - moved).norm() < 2.0 * NEAR;
        let agreeing: Vec<[Vector2<f64>; 2]> = found.iter().filter(agree).copied().collect();
        let (change, sigma) = change_through(&agreeing, [now.width, now.height])?;
        Some((change * predicted, sigma))
    }

    /// The same of a frame that may be far away, by a shift of the whole picture.
    fn coarse(&self, now: &Planes, predicted: &Matrix3<f64>) -> Option<(Matrix3<f64>, f64)> {
        let reduced = Reduced::of(now);
        let middle = mapped(predicted, [now.width as f64 / 2.0, now.height as f64 / 2.0]);
        let expected = [middle[0] - now.width as f64 / 2.0, middle[1] - now.height as f64 / 2.0];
        let shift = self.reduced.shift_to(&reduced, expected.map(|px| (px / REDUCED as f64).round() as i64))?;
        let shift = shift.map(|cells| (cells * REDUCED as i64) as f64);
        let shifted = Matrix3::new(1.0, 0.0, shift[0], 0.0, 1.0, shift[1], 0.0, 0.0, 1.0);
        self.registered(now, &shifted, REACH)
    }
}

/// A plane's brightness, reduced.
struct Reduced {
    width: usize,
    height: usize,
    values: Vec<i32>,
}

impl Reduced {
    fn of(planes: &Planes) -> Self {
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
    fn shift_to(&self, other: &Self, expected: [i64; 2]) -> Option<[i64; 2]> {
        let reach = (COARSE_REACH * self.width as f64) as i64;
        let shifts = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x + expected[0], y + expected[1]]));
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
                here.iter().zip(there).map(|(a, b)| i64::from((a - b).abs().min(40))).sum::<i64>()
            };
            Some(rows.step_by(2).map(line).sum::<i64>() as f64 / (tall * wide) as f64)
        };
        let found = shifts.filter_map(|shift| Some((shift, difference(shift)?)));
        found.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(shift, _)| shift)
    }
}

/// The homography that moves places as found (`[at, moved]`), of a picture of `size`, and the deviation of places that it maps, px.
fn change_through(found: &[[Vector2<f64>; 2]], size: [usize; 2]) -> Option<(Matrix3<f64>, f64)> {
    let half = size[0] as f64 / 2.0;
    let middle = Vector2::new(half, size[1] as f64 / 2.0);
    let mut change = SVector::<f64, 8>::zeros();
    let mut square = 0.0;
    for round in 0..ROUNDS {
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        // Aspect, shear and perspective are known to be small.
        let priors = [([(1, 1.0), (5, -1.0)], SHEAR_SIGMA), ([(2, 1.0), (4, 1.0)], SHEAR_SIGMA)];
        for (terms, sigma) in priors {
            for (row, a) in terms {
                terms.iter().for_each(|&(column, b)| normal[(row, column)] += a * b / (sigma * sigma));
            }
        }
        normal[(6, 6)] += PERSPECTIVE_SIGMA.powi(-2);
        normal[(7, 7)] += PERSPECTIVE_SIGMA.powi(-2);
        square = 0.0;
        for [at, moved] in found {
            let (place, moved) = ((at - middle) / half, moved / half);
            let (u, v) = (place.x, place.y);
            let rows = [[1.0, u, v, 0.0, 0.0, 0.0, u * u, v * u], [0.0, 0.0, 0.0, 1.0, u, v, u * v, v * v]];
            let rows = rows.map(SVector::<f64, 8>::from);
            let off = [0, 1].map(|axis| (moved[axis] - rows[axis].dot(&change)) * half / PLACE_SIGMA);
            let off = off[0].hypot(off[1]);
            square += off * off;
            let weight = if round == 0 { 1.0 } else { 2.0 / off.max(2.0) } * (half / PLACE_SIGMA).powi(2);
            for (axis, row) in rows.iter().enumerate() {
                normal += row * row.transpose() * weight;
                right += row * (weight * moved[axis]);
            }
        }
        change = normal.cholesky()?.solve(&right);
    }
    let [a, b, c, d, e, f, g, h] = change.into();
    let change = Matrix3::new(1.0 + b, c, a, e, 1.0 + f, d, -g, -h, 1.0);
    let from = Matrix3::new(1.0 / half, 0.0, -middle.x / half, 0.0, 1.0 / half, -middle.y / half, 0.0, 0.0, 1.0);
    let change = from.try_inverse()? * change * from;
    // Eight numbers are found of two a place.
    let numbers = 2.0 * found.len() as f64;
    let residual = (square / (numbers - 8.0).max(1.0)).sqrt() * PLACE_SIGMA;
    Some((change / change[(2, 2)], residual.max(PLACE_SIGMA) * (8.0 / numbers).sqrt()))
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

    fn xy(&self) -> [f64; 2] {
        self.at.map(|at| at as f64)
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

    /// The place at which it is predicted, and how far from there it is found.
    fn found(&self, planes: &Planes, predicted: Vector2<f64>, reach: i64) -> Option<[Vector2<f64>; 2]> {
        let expected = predicted.map(|at| at.round() as i64);
        let off = |x: i64, y: i64| self.difference(planes, [expected.x + x, expected.y + y]);
        let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
        let best = places.filter_map(|(x, y)| Some(((x, y), off(x, y)?))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let ((x, y), least) = best;
        // At the search's edge it is perhaps farther away still.
        if !self.is_alike(least) || x.abs() == reach || y.abs() == reach {
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
        let mut registration = Registration::of(&still).unwrap();
        // Largest distance between where a point of the first view is and where the registration puts it, px.
        let off = |view: Option<View>, shift: [f64; 2], zoom: f64| {
            let view = view.unwrap();
            let points = [[40.0, 30.0], [160.0, 100.0], [250.0, 160.0]];
            let truth =
                |[x, y]: [f64; 2]| [(x - 160.0 + shift[0]) * zoom + 160.0, (y - 100.0 + shift[1]) * zoom + 100.0];
            let off = points.map(|at| {
                let ([x, y], [u, v]) = (view.frame(at), truth(at));
                (x - u).hypot(y - v)
            });
            off.into_iter().fold(0.0, f64::max)
        };
        assert!(off(registration.view(&still), [0.0; 2], 1.0) < 0.1);
        // A cloud before the sun.
        assert!(off(registration.view(&seen([0.4, -0.3], 1.0, -20)), [0.4, -0.3], 1.0) < 0.3);
        for step in 1..=20 {
            let shift = [4.0 * f64::from(step), f64::from(step)];
            let error = off(registration.view(&seen(shift, 1.0, 0)), shift, 1.0);
            assert!(error < 0.7, "{error} px at step {step}");
        }
        for step in (0..20).rev() {
            registration.view(&seen([4.0 * f64::from(step), f64::from(step)], 1.0, 0));
        }
        assert!(off(registration.view(&still), [0.0; 2], 1.0) < 0.15);
        let zoomed = (1..=5).map(|step| registration.view(&seen([0.0, 0.0], 1.0 + 0.01 * f64::from(step), 0))).last();
        assert!(off(zoomed.unwrap(), [0.0; 2], 1.05) < 0.5);
        // A sudden swing.
        registration.view(&seen([0.0, 0.0], 1.0, 0));
        assert!(off(registration.view(&seen([25.0, 14.0], 1.0, 0)), [25.0, 14.0], 1.0) < 0.5);
    }

    #[test]
    fn what_moves_before_it_is_no_moving_camera() {
        let still = seen([0.0, 0.0], 1.0, 0);
        let mut registration = Registration::of(&still).unwrap();
        let mut occluded = seen([0.0, 0.0], 1.0, 0);
        let elsewhere = seen([90.0, 40.0], 1.0, 0);
        // Two fifths of the picture are people who walk.
        for row in 0..occluded.height {
            let part = row * occluded.width..row * occluded.width + 128;
            occluded.levels[0][part.clone()].copy_from_slice(&elsewhere.levels[0][part]);
        }
        assert!(displacement(&registration.view(&occluded).unwrap().frame_from_first, [320, 200]) < 0.2);
        let plain = Planes { width: 320, height: 200, levels: [vec![90; 64_000], vec![90; 64_000]] };
        assert!(registration.view(&plain).is_none());
        assert!(Registration::of(&plain).is_none());
    }
}
