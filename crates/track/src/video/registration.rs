//! The registration of each frame to the first view: patches of what stands still, found again, and the homography that most of
//! them agree on.
//!
//! A camera that turns and zooms about its centre changes its picture by a homography. Patches are taken from a key frame; a new key frame
//! takes over where too few of them are left in view, and an older one where it is in view again, so that errors do not add up on the
//! way back.

use nalgebra::{Matrix3, Vector2};
use rayon::prelude::*;

use super::config::RegistrationConfig;
use super::homography::{change_through, consensus};
use super::patches::{HALF, Patch, REDUCED, Reduced, texture};
use super::planes::Planes;
use super::view::{View, displacement, mapped};

/// Finds the views of frames that come one after the other.
pub(super) struct Registration {
    config: RegistrationConfig,
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

impl Registration {
    /// With `first` as the first view; none where it shows too little that can be found again.
    pub fn of(first: &Planes, config: RegistrationConfig) -> Option<Self> {
        let key = Key::of(first, Matrix3::identity(), &config)?;
        let (last, step) = (Matrix3::identity(), Matrix3::identity());
        Some(Self { config, keys: vec![key], current: 0, size: [first.width, first.height], last, step })
    }

    /// The view of the next frame; none where too little is found again. It holds once it is accepted.
    pub fn view(&self, now: &Planes) -> Option<View> {
        let config = &self.config;
        let reach = if self.step == Matrix3::identity() { config.reach_still } else { config.reach };
        let key = &self.keys[self.current];
        let tried = key.registered(now, &(self.step * self.last * key.first_from_key), reach, config);
        let last = self.last * key.first_from_key;
        let tried = tried.or_else(|| key.registered(now, &last, config.reach, config));
        let (frame_from_key, sigma) = tried.or_else(|| key.coarse(now, &last, config))?;
        View::new(frame_from_key * key.key_from_first, sigma)
    }

    /// Takes the view of the next frame. `is_lost`: what the key frame in use shows is not found in it.
    pub fn accept(&mut self, now: &Planes, frame_from_first: &Matrix3<f64>, is_lost: bool) {
        let config = &self.config;
        let moved = displacement(frame_from_first, self.size);
        self.step = match self.last.try_inverse() {
            Some(first_from_last) if moved >= config.reach_still as f64 / 2.0 => frame_from_first * first_from_last,
            _ => Matrix3::identity(),
        };
        self.last = *frame_from_first;
        if is_lost {
            self.add_key(now);
        } else {
            self.choose_key(now);
        }
    }

    /// Makes a key frame of this one.
    fn add_key(&mut self, now: &Planes) {
        if let Some(key) = Key::of(now, self.last, &self.config) {
            self.keys.push(key);
            self.current = self.keys.len() - 1;
        }
    }

    /// Another picture came in between: patches are searched where they were at first.
    pub fn start_again(&mut self) {
        (self.current, self.last, self.step) = (0, Matrix3::identity(), Matrix3::identity());
    }

    /// Lets another key frame take over where the camera has left this one, or is back at an older one.
    fn choose_key(&mut self, now: &Planes) {
        let width = self.size[0] as f64;
        let away = |key: &Key| displacement(&(self.last * key.first_from_key), self.size) / width;
        if let Some(older) = self.keys[..self.current].iter().position(|key| away(key) < self.config.returned) {
            self.current = older;
            return;
        }
        let key = &self.keys[self.current];
        let frame_from_key = self.last * key.first_from_key;
        let in_view = key.patches.iter().filter(|patch| self.is_inside(mapped(&frame_from_key, patch.xy()))).count();
        if (in_view as f64) < self.config.least_in_view * key.patches.len() as f64 || away(key) > self.config.farthest {
            if let Some(later) = self.keys.iter().position(|key| away(key) < self.config.returned) {
                self.current = later;
            } else {
                self.add_key(now);
            }
        }
    }

    fn is_inside(&self, [x, y]: [f64; 2]) -> bool {
        (0.0..self.size[0] as f64).contains(&x) && (0.0..self.size[1] as f64).contains(&y)
    }
}

impl Key {
    fn of(planes: &Planes, key_from_first: Matrix3<f64>, config: &RegistrationConfig) -> Option<Self> {
        let (width, height) = (planes.width, planes.height);
        let ([columns, rows], step) = (config.cells, config.step);
        let mut patches = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let bounds = |cell: usize, cells: usize, side: usize| {
                    let margin = HALF + 1;
                    (side * cell / cells).max(margin)..(side * (cell + 1) / cells).min(side.saturating_sub(margin + 1))
                };
                let places = bounds(row, rows, height)
                    .step_by(step)
                    .flat_map(|y| bounds(column, columns, width).step_by(step).map(move |x| [x, y]));
                let best = places.map(|at| (at, texture(planes, at))).max_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((at, texture)) = best
                    && texture >= config.texture
                {
                    patches.push(Patch::of(planes, at));
                }
            }
        }
        let first_from_key = key_from_first.try_inverse()?;
        let reduced = Reduced::of(planes);
        (patches.len() >= config.fewest).then_some(Self { patches, key_from_first, first_from_key, reduced })
    }

    /// The homography to a frame from this one near a `predicted` one, and the deviation of the places that it maps, px.
    fn registered(
        &self,
        now: &Planes,
        predicted: &Matrix3<f64>,
        reach: usize,
        config: &RegistrationConfig,
    ) -> Option<(Matrix3<f64>, f64)> {
        let inside = |[x, y]: [f64; 2]| (0.0..now.width as f64).contains(&x) && (0.0..now.height as f64).contains(&y);
        let in_view =
            self.patches.iter().map(|patch| (patch, mapped(predicted, patch.xy()))).filter(|(_, at)| inside(*at));
        let in_view: Vec<(&Patch, [f64; 2])> = in_view.collect();
        let found: Vec<[Vector2<f64>; 2]> = in_view
            .par_iter()
            .filter_map(|(patch, at)| patch.found(now, Vector2::from(*at), reach as i64, config))
            .collect();
        if found.len() < config.fewest {
            return None;
        }
        let (motion, agreeing) = consensus(&found, config)?;
        let enough = (config.agree * found.len() as f64)
            .max(config.agree_of_all * in_view.len() as f64)
            .max(config.fewest as f64);
        if (agreeing as f64) < enough {
            return None;
        }
        let agree = |[at, moved]: &&[Vector2<f64>; 2]| (motion.of(at) - moved).norm() < 2.0 * config.near;
        let agreeing: Vec<[Vector2<f64>; 2]> = found.iter().filter(agree).copied().collect();
        let (change, sigma) = change_through(&agreeing, [now.width, now.height], config)?;
        Some((change * predicted, sigma))
    }

    /// The same of a frame that may be far away, by a shift of the whole picture.
    fn coarse(
        &self,
        now: &Planes,
        predicted: &Matrix3<f64>,
        config: &RegistrationConfig,
    ) -> Option<(Matrix3<f64>, f64)> {
        let reduced = Reduced::of(now);
        let middle = mapped(predicted, [now.width as f64 / 2.0, now.height as f64 / 2.0]);
        let expected = [middle[0] - now.width as f64 / 2.0, middle[1] - now.height as f64 / 2.0];
        let shift = self.reduced.shift_to(&reduced, expected.map(|px| (px / REDUCED as f64).round() as i64), config)?;
        let shift = shift.map(|cells| (cells * REDUCED as i64) as f64);
        let shifted = Matrix3::new(1.0, 0.0, shift[0], 0.0, 1.0, shift[1], 0.0, 0.0, 1.0);
        self.registered(now, &shifted, config.reach, config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The view of the next frame, which is taken.
    fn taken(registration: &mut Registration, now: &Planes) -> Option<View> {
        let view = registration.view(now)?;
        registration.accept(now, &view.frame_from_first, false);
        Some(view)
    }

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
        let mut registration = Registration::of(&still, RegistrationConfig::default()).unwrap();
        // Largest distance between where a point of the first view is and where the registration puts it, px.
        let off = |view: Option<View>, shift: [f64; 2], zoom: f64| {
            let view = view.unwrap();
            let points = [[40.0, 30.0], [160.0, 100.0], [250.0, 160.0]];
            let truth =
                |[x, y]: [f64; 2]| [(x - 160.0 + shift[0]) * zoom + 160.0, (y - 100.0 + shift[1]) * zoom + 100.0];
            let off = points.map(|at| {
                let ([x, y], [u, v]) = (mapped(&view.frame_from_first, at), truth(at));
                (x - u).hypot(y - v)
            });
            off.into_iter().fold(0.0, f64::max)
        };
        assert!(off(taken(&mut registration, &still), [0.0; 2], 1.0) < 0.1);
        // A cloud before the sun.
        assert!(off(taken(&mut registration, &seen([0.4, -0.3], 1.0, -20)), [0.4, -0.3], 1.0) < 0.3);
        for step in 1..=20 {
            let shift = [4.0 * f64::from(step), f64::from(step)];
            let error = off(taken(&mut registration, &seen(shift, 1.0, 0)), shift, 1.0);
            assert!(error < 0.7, "{error} px at step {step}");
        }
        for step in (0..20).rev() {
            taken(&mut registration, &seen([4.0 * f64::from(step), f64::from(step)], 1.0, 0));
        }
        assert!(off(taken(&mut registration, &still), [0.0; 2], 1.0) < 0.15);
        let zoomed =
            (1..=5).map(|step| taken(&mut registration, &seen([0.0, 0.0], 1.0 + 0.01 * f64::from(step), 0))).last();
        assert!(off(zoomed.unwrap(), [0.0; 2], 1.05) < 0.5);
        // A sudden swing.
        taken(&mut registration, &seen([0.0, 0.0], 1.0, 0));
        assert!(off(taken(&mut registration, &seen([25.0, 14.0], 1.0, 0)), [25.0, 14.0], 1.0) < 0.5);
    }

    #[test]
    fn what_moves_before_it_is_no_moving_camera() {
        let still = seen([0.0, 0.0], 1.0, 0);
        let mut registration = Registration::of(&still, RegistrationConfig::default()).unwrap();
        let mut occluded = seen([0.0, 0.0], 1.0, 0);
        let elsewhere = seen([90.0, 40.0], 1.0, 0);
        // Two fifths of the picture are people who walk.
        for row in 0..occluded.height {
            let part = row * occluded.width..row * occluded.width + 128;
            occluded.levels[0][part.clone()].copy_from_slice(&elsewhere.levels[0][part]);
        }
        assert!(displacement(&taken(&mut registration, &occluded).unwrap().frame_from_first, [320, 200]) < 0.2);
        let plain = Planes { width: 320, height: 200, levels: [vec![90; 64_000], vec![90; 64_000]] };
        assert!(taken(&mut registration, &plain).is_none());
        assert!(Registration::of(&plain, RegistrationConfig::default()).is_none());
    }
}
