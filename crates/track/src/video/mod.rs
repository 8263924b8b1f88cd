//! A ball through a video: what moves, and of that what flies.
//!
//! ```text
//! frames ─► differences (background, frame before, frame after) ─► blobs ─► tracklets ─► the ball's chain of tracklets
//!                                                                    ▲         │
//!                                     what a network sees there, and where they lead
//! ```
//!
//! Frames come one after the other; the last ones are held, so that a network can look at what seems to fly in them
//! ([`BallTracker::queries`]). Without a network, too: a camera that stands still, and a ball that is small and flies; a shadow flies
//! as well as a ball.

mod association;
mod blobs;
mod clutter;
mod config;
mod court;
mod evidence;
mod fall;
mod foreground;
mod gravity;
mod homography;
mod hypotheses;
mod intake;
mod parts;
mod patches;
mod pictures;
mod planes;
mod queries;
mod registration;
mod repeats;
mod slow;
mod stabiliser;
mod stack;
mod state;
#[cfg(test)]
mod tests;
mod tracklets;
mod view;

use std::cell::RefCell;
use std::collections::BTreeMap;

pub use self::config::{
    AssociationConfig, BackgroundConfig, BlobsConfig, ClutterConfig, EvidenceConfig, FallConfig, FlightConfig,
    GravityConfig, QueriesConfig, RadiiConfig, RegistrationConfig, RepeatsConfig, SlowConfig, TrackerConfig,
    TrackletsConfig, WeightsConfig,
};
use self::court::CourtViews;
use self::foreground::{Foreground, Seen};
pub(crate) use self::hypotheses::{Alternatives, Candidate};
pub use self::hypotheses::{
    Followed, FollowedFrame, Hypotheses, OtherFrame, OtherTrack, TrackedBlob, TrackletFeatures,
};
use self::intake::{Intake, NewPicture, Taken};
use self::pictures::Pictures;
use self::planes::{Planes, Spare};
pub use self::queries::Query;
use self::queries::Schedule;
use self::stabiliser::{Stabilised, Stabiliser};
pub use self::stack::{STACK_SIDE, Stack};
pub use self::state::FrameId;
use self::state::State;
use self::tracklets::TrackletSearch;
pub use self::view::CameraMotion;
use self::view::FirstView;
pub(crate) use self::view::Place;
use nalgebra::Matrix3;

use gravisight_geometry::camera::{Camera, CourtFollower};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;

/// Follows the ball through frames that come one after the other.
pub struct BallTracker {
    config: TrackerConfig,
    /// All that is known of the video.
    state: State,
    /// The last frames, in different stages: those that may be repeated ones, their views, what differs from the background.
    intake: Intake,
    stabiliser: Stabiliser,
    foreground: Foreground,
    pictures: Pictures,
    /// What the networks are asked.
    schedule: Schedule,
    spare: Spare,
}

impl Default for BallTracker {
    fn default() -> Self {
        Self::with_config(TrackerConfig::default())
    }
}

impl BallTracker {
    /// Without any frame yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Without any frame yet, with numbers of one's own.
    pub fn with_config(config: TrackerConfig) -> Self {
        // Frames come before their candidates, and stacks hold the frames before and after.
        let held = config.queries.window + 8;
        Self {
            state: State::new(&config),
            intake: Intake::new(config.repeats),
            stabiliser: Stabiliser::new(config.registration, config.background.first_frames),
            foreground: Foreground::new(config.background, config.blobs),
            pictures: Pictures::holding(held.max(config.slow.most_frames + 1)),
            schedule: Schedule::default(),
            spare: Spare::default(),
            config,
        }
    }

    /// Finds the camera of each frame by a court's lines, too: before the first frame. `camera` is that of the first frame.
    pub fn see_court(&mut self, court: CourtFollower, camera: Camera) {
        self.stabiliser.see_court(CourtViews::new(court, camera));
    }

    /// Takes the next frame, of `time` s.
    ///
    /// # Errors
    /// [`Error::Data`] for a frame of another size than the first.
    pub fn watch(&mut self, picture: Picture, time: f64) -> Result<()> {
        let planes = Planes::of(picture.rgb(), &mut self.spare);
        let (size, number) = ([planes.width, planes.height], self.state.shown() + self.intake.waiting());
        if number == 0 {
            self.state.size = size;
        }
        if size != self.state.size {
            let [[width, height], [first_width, first_height]] = [size, self.state.size];
            let reason = format!(
                "is {width}×{height} px, but the first is {first_width}×{first_height} px: all frames of a \
                         video must have one size"
            );
            return Err(Error::Data { what: format!("frame {number}"), reason });
        }
        self.intake.add(picture, planes, time, &mut self.spare);
        if self.intake.is_due() {
            self.take();
        }
        Ok(())
    }

    /// Takes the first of the frames that wait.
    fn take(&mut self) {
        let Some(Taken { first_changed, new }) = self.intake.take(&mut self.spare) else { return };
        let number = self.state.shown();
        (first_changed..number).for_each(|number| self.state.set_time(number, self.intake.time(number)));
        let time = self.intake.time(number);
        let Some(NewPicture { picture, planes, since }) = new else { return self.state.add_repeat(time) };
        let (view, elsewhere) = self.stabiliser.view(&planes, &self.state);
        let frame = self.state.add_frame(time, view, elsewhere);
        self.pictures.add(frame, picture);
        if let Some(old_from_new) = self.stabiliser.move_canvas(&view, &planes, &mut self.spare) {
            self.foreground.move_canvas(&old_from_new, &planes, &mut self.spare);
        }
        let (stabilised, since) = self.stabiliser.stabilise(&view, planes, since, &mut self.spare);
        if self.foreground.has_background() {
            return self.step(stabilised, since);
        }
        self.foreground.wait(stabilised);
        self.begin(false);
    }

    /// Looks at the frames that waited for a background.
    fn begin(&mut self, is_end: bool) {
        for frame in self.foreground.begin(is_end) {
            let since = self.foreground.since(&frame, &mut self.spare);
            self.step(frame, since);
        }
    }

    /// Looks at the frame before this one, which is its next; `since` is their difference.
    fn step(&mut self, next: Stabilised, since: Option<Vec<u8>>) {
        let since = since.filter(|_| self.foreground.has_frame());
        self.look(since.as_deref());
        self.foreground.keep(next, since);
    }

    /// Adds the candidates of the frame that waits for its next one; `until` is the difference of the two.
    fn look(&mut self, until: Option<&[u8]>) {
        match self.foreground.look(until, &mut self.spare) {
            Some(Seen::Blobs(blobs)) => {
                let canvas = self.stabiliser.canvas();
                self.state.add_candidates(blobs.iter().map(|blob| blob.in_first(canvas)).collect());
            }
            Some(Seen::Other { lost }) => {
                self.state.skip_candidates();
                if lost {
                    self.change_background();
                }
            }
            None => {}
        }
    }

    /// Makes the background anew. Where the frames that do not show the old one are not registered, they are another picture.
    fn change_background(&mut self) {
        let from = FrameId(self.state.segmented() - self.config.background.moving_frames);
        let is_registered = |frame: &state::Frame| matches!(frame.elsewhere, Some(CameraMotion::Moved(_)));
        if self.state.frames()[from.0..].iter().all(is_registered) {
            return;
        }
        self.state.add_cut(from);
        if self.stabiliser.cut() {
            self.state.lose_views(from);
        }
    }

    /// The homography to each frame from the first view; a repeated frame has that of the frame that it repeats.
    #[doc(hidden)]
    pub fn views_from_first(&self) -> Vec<Matrix3<f64>> {
        (0..self.state.shown())
            .map(|number| self.state.frame(self.state.shown_in(number)).view.frame_from_first)
            .collect()
    }

    /// No frame comes soon: those that waited for it are taken.
    pub fn settle(&mut self) {
        while self.intake.waiting() > 0 {
            self.take();
        }
    }

    /// There are no more frames: the last ones are looked at, which waited for the next.
    pub fn end(&mut self) {
        self.settle();
        self.begin(true);
        self.look(None);
        // Frames that nothing could be compared with.
        (0..self.foreground.give_up()).for_each(|_| self.state.skip_candidates());
    }

    /// What flew in the frames that were watched until [`Self::end`]. `seeds` are frames and places (px) in which a person saw it:
    /// what flies through them is the ball. Of several in one frame the last counts.
    ///
    /// # Errors
    /// [`Error::Value`] for a seed in a frame that was not watched, or outside the picture.
    pub fn hypotheses(&self, seeds: &[(usize, [f64; 2])]) -> Result<Hypotheses<'_>> {
        // As they were given, by frame.
        let mut chosen = BTreeMap::new();
        for &(number, at) in seeds {
            chosen.insert(self.frame_of_seed(number, at)?, (number, at));
        }
        let own = |(&frame, &(_, at)): (&FrameId, &(usize, [f64; 2]))| {
            (frame, self.state.frame(frame).view.first(&Place::new(at)))
        };
        let own = chosen.iter().map(own).collect();
        let search = self.search(FrameId(0), 1.0, self.config.tracklets.strong_gain, &own);
        let tracklets = search.tracklets();
        let is_used = |frame: FrameId| {
            tracklets.iter().any(|tracklet| tracklet.seeded && search.goes_through(tracklet, frame, &own[&frame]))
        };
        let unused = chosen.iter().filter(|&(&frame, _)| !is_used(frame)).map(|(_, seed)| *seed).collect();
        Ok(Hypotheses::new(self.config, &self.state, tracklets, unused))
    }

    /// A search for tracklets from a frame on.
    fn search<'a>(
        &'a self,
        from: FrameId,
        displacement_fraction: f64,
        strong_log_ratio: f64,
        seeds: &'a BTreeMap<FrameId, Place<FirstView>>,
    ) -> TrackletSearch<'a> {
        TrackletSearch {
            config: &self.config.tracklets,
            flight: &self.config.flight,
            clutter: &self.config.clutter,
            state: &self.state,
            from,
            displacement_fraction,
            strong_log_ratio,
            seeds,
            density_cache: RefCell::default(),
        }
    }

    /// The frame that a seed's frame of the video shows.
    fn frame_of_seed(&self, number: usize, [x, y]: [f64; 2]) -> Result<FrameId> {
        let [width, height] = self.state.size.map(|side| side as f64);
        let refuse = |reason: String| Err(Error::value("track", "seed", reason));
        let shown = self.state.shown();
        if number >= shown {
            return refuse(format!("is in frame {number}, but the last frame is {}", shown.saturating_sub(1)));
        }
        if !((0.0..width).contains(&x) && (0.0..height).contains(&y)) {
            return refuse(format!("({x}, {y}) px is outside the picture of {width}×{height} px"));
        }
        Ok(self.state.shown_in(number))
    }
}
