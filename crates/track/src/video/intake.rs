//! Frames as they come: which of them show the one before again, and when they were taken.

use std::collections::VecDeque;
use std::sync::Arc;

use super::config::RepeatsConfig;
use super::planes::{self, Planes, Spare};
use super::repeats::Clock;
use gravisight_geometry::image::Picture;
use gravisight_geometry::statistics::median;

/// Frames on their way in.
pub(super) struct Intake {
    config: RepeatsConfig,
    /// Frames that wait for the next ones, and the planes of the last frame of all.
    coming: VecDeque<Coming>,
    latest: Option<Arc<Planes>>,
    /// When the frames were taken, and whether the last one that was taken in is a repeated one.
    clock: Clock,
    repeated: bool,
    /// The last frame that was not a repeated one, and the fraction of the pixels that changed much in it.
    before: Option<Arc<Planes>>,
    strong: f64,
    /// Fractions of the pixels that changed from frame to frame, lately.
    changed: Vec<f64>,
}

/// A frame of which is not known yet whether it is a repeated one.
struct Coming {
    picture: Picture,
    planes: Arc<Planes>,
    time: f64,
    /// Its differences from the frame before, and the fraction of the pixels that changed much.
    since: Option<Vec<u8>>,
    strong: f64,
}

/// A frame that was taken in.
pub(super) struct Taken {
    /// Index in the video of the first frame whose time it changes, its own at the latest.
    pub first_changed: usize,
    /// Its picture; none where that is the one before again.
    pub new: Option<NewPicture>,
}

/// A picture that is not the one before.
pub(super) struct NewPicture {
    pub picture: Picture,
    pub planes: Arc<Planes>,
    /// Its differences from the last such picture.
    pub since: Option<Vec<u8>>,
}

impl Intake {
    /// Without any frame yet.
    pub fn new(config: RepeatsConfig) -> Self {
        let (coming, clock) = (VecDeque::new(), Clock::new(config));
        Self { config, coming, latest: None, clock, repeated: false, before: None, strong: 0.0, changed: vec![] }
    }

    /// Adds the next frame, by its time in the file, s.
    pub fn add(&mut self, picture: Picture, planes: Planes, time: f64, spare: &mut Spare) {
        let planes = Arc::new(planes);
        let since = self.latest.replace(planes.clone()).map(|before| before.difference(&planes, spare));
        let strong = since.as_deref().map_or(0.0, |since| planes::fraction_above(since, self.config.strong_change));
        self.coming.push_back(Coming { picture, planes, time, since, strong });
    }

    /// Frames that wait.
    pub fn waiting(&self) -> usize {
        self.coming.len()
    }

    /// Whether enough frames have come after the first one that waits.
    pub fn is_due(&self) -> bool {
        self.coming.len() > self.config.frames_after
    }

    /// Takes in the first frame that waits.
    pub fn take(&mut self, spare: &mut Spare) -> Option<Taken> {
        let Coming { picture, planes, time, mut since, mut strong } = self.coming.pop_front()?;
        // Between it and the last that was another there may be repeated ones.
        if self.repeated
            && let Some(before) = &self.before
        {
            since.into_iter().for_each(|bytes| spare.give(bytes));
            let differences = before.difference(&planes, spare);
            strong = planes::fraction_above(&differences, self.config.strong_change);
            since = Some(differences);
        }
        let after = self.coming.iter().map(|coming| coming.strong).fold(0.0, f64::max);
        let usual = self.strong.min(after);
        let is_still = usual * (planes.width * planes.height) as f64 >= self.config.strong_pixels
            && strong < self.config.strong_fraction * usual;
        self.repeated = since.as_ref().is_some_and(|since| self.is_repeated(since, is_still));
        let first_changed = self.clock.add(time, self.repeated);
        if self.repeated {
            since.into_iter().for_each(|bytes| spare.give(bytes));
            return Some(Taken { first_changed, new: None });
        }
        self.strong = strong;
        self.before = Some(planes.clone());
        Some(Taken { first_changed, new: Some(NewPicture { picture, planes, since }) })
    }

    /// When a frame was taken, s, by its index in the video: of those that the last [`Self::take`] changed.
    pub fn time(&self, number: usize) -> f64 {
        self.clock.time(number)
    }

    /// Whether a frame that differs so from the one before shows it again; it does where it `is_still`.
    fn is_repeated(&mut self, differences: &[u8], is_still: bool) -> bool {
        let fraction = planes::fraction_above(differences, self.config.least_change);
        let usual = median(self.changed.iter().copied()).unwrap_or(0.0);
        let repeated = is_still || self.changed.len() > 2 && fraction < self.config.fraction * usual;
        if !repeated {
            self.changed.push(fraction);
            if self.changed.len() > self.config.usual_frames {
                self.changed.remove(0);
            }
        }
        repeated
    }
}
