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
mod evidence;
mod gravity;
mod hypotheses;
mod planes;
mod queries;
mod registration;
mod repeats;
mod slow;
mod stack;
#[cfg(test)]
mod tests;
mod tracklets;
mod view;

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use self::blobs::Blob;
use self::clutter::Clutter;
pub use self::config::TrackerConfig;
pub use self::hypotheses::{CameraMotion, FollowedFrame, Hypotheses, TrackedBlob, TrackletFeatures};
use self::planes::{Background, FIRST_FRAMES, Planes, Spare, contrast_of};
pub use self::queries::Query;
use self::queries::{Held, Verdicts};
use self::registration::Registration;
use self::repeats::Clock;
#[cfg(not(target_arch = "wasm32"))]
pub use self::stack::STACK_SIDE;
pub use self::stack::Stack;
use self::tracklets::{Candidates, TrackletSearch};
use self::view::{View, displacement, is_still, scale};
use nalgebra::Matrix3;

use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::statistics::median;

/// Smallest radius that is looked for, px, and the largest, as a fraction of the picture's shorter side.
const LEAST_RADIUS: f64 = 1.0;
const MOST_RADIUS: f64 = 1.0 / 8.0;
/// Distance of two blobs' middles, in radii, within which they are one.
const SAME: f64 = 0.7;
/// Pixels that differ from the frame before, as a fraction of the usual count, below which a frame repeats that one.
const REPEATED: f64 = 0.02;
/// A frame that is repeated and then encoded again differs a little everywhere and hardly anywhere much: change of a level that it does not
/// reach, the fraction of the pixels that do all the same of those in the frames before and after it (on broadcasts of 25 frames a second shown as
/// 30: up to 0.06, other frames from 0.7 on), and fewest of those.
const STRONG_CHANGE: u8 = 12;
const REPEATED_STRONG: f64 = 0.15;
const FEWEST_STRONG: f64 = 50.0;
/// Frames after one that tell whether it is repeated.
const AFTER: usize = 2;
/// Fraction of a picture's pixels that differ from the background where the camera moved, or another took over.
const MOVED: f64 = 0.35;
/// Such frames in a row after which the background is made anew.
const MOVING_FRAMES: usize = 3;
/// Change of a level that is counted to find repeated frames, and frames that tell how much usually changes.
const LEAST_CHANGE: u8 = 2;
const USUAL_FRAMES: usize = 50;
/// Mean displacement of the picture from which a frame counts as another view than the first, px.
const ELSEWHERE_PX: f64 = 1.5;
/// Displacement, as a fraction of the width, and change of size from which on frames are stabilised about another one.
const CANVAS_MOVED: f64 = 0.25;
const CANVAS_SCALED: f64 = 1.3;
/// Frames between searches for the first view while another one is shown.
const RETURN_EVERY: usize = 4;
/// Half the range of the levels about a pixel is what a registration that is half a pixel off makes of an edge: fraction of it that a
/// difference must exceed while the camera moves.
const EDGE_TOLERANCE: f64 = 0.5;
/// Log-likelihood ratio of a tracklet from which its blobs seed no other.
const STRONG_LOG_RATIO: f64 = 20.0;
/// Fewest frames of which a background is made.
const FEWEST_FRAMES: usize = 5;

/// Follows the ball through frames that come one after the other.
pub struct BallTracker {
    config: TrackerConfig,
    /// Frames that wait for the next ones, and the planes of the last frame of all.
    coming: VecDeque<Coming>,
    latest: Option<Arc<Planes>>,
    /// When the frames were taken.
    clock: Clock,
    /// Fraction of the pixels that changed much in the last frame that is not repeated.
    strong: f64,
    /// Frames that wait for a background, with their times.
    waiting: Vec<(Stabilised, f64)>,
    background: Option<Background>,
    /// The last frame that was not a repeated one.
    before: Option<Arc<Planes>>,
    now: Option<Now>,
    kept: Vec<Kept>,
    /// Blobs of the frames that are not repeated, and where they keep being.
    seen: Vec<Candidates>,
    clutter: Clutter,
    /// Fractions of the pixels that changed from frame to frame, lately.
    changed: Vec<f64>,
    /// Frames in a row that hardly show the background.
    moving: usize,
    /// From where on the background was another, of `seen`.
    cuts: Vec<usize>,
    /// Of the frames to the first view, if that can be found again; and to the first after a cut, while that view is shown.
    registration: Option<Registration>,
    other: Option<Registration>,
    /// Whether another view than the registered one is shown, since a cut.
    is_cut: bool,
    /// In whose pixels frames are stabilised: those of the first view, until the camera has moved far.
    canvas: View,
    /// The last stabilised frame, and the one before [`Self::now`].
    stabilised: Option<Stabilised>,
    previous: Option<Arc<Planes>>,
    /// Of each frame that is not repeated, its view, and whether the camera looks elsewhere than at first.
    views: Vec<View>,
    elsewhere: Vec<Option<CameraMotion>>,
    size: [usize; 2],
    /// The last frames that are not repeated.
    held: VecDeque<Held>,
    /// The networks' answers about the blobs.
    verdicts: Verdicts,
    spare: Spare,
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

/// A frame that waits for the next one.
struct Now {
    planes: Arc<Planes>,
    time: f64,
    /// Its differences from the frame before.
    since: Option<Vec<u8>>,
    /// Whether it is as it was taken.
    as_taken: bool,
}

/// A frame in the canvas's pixels.
#[derive(Clone)]
struct Stabilised {
    planes: Arc<Planes>,
    /// Whether it is the frame as it was taken.
    as_taken: bool,
}

/// What a frame was like besides its blobs.
#[derive(Clone, Copy)]
struct Kept {
    time: f64,
    repeated: bool,
}

impl Default for BallTracker {
    fn default() -> Self {
        Self::new()
    }
}

impl BallTracker {
    /// Without any frame yet.
    pub fn new() -> Self {
        Self {
            config: TrackerConfig::default(),
            coming: VecDeque::new(),
            latest: None,
            clock: Clock::default(),
            strong: 0.0,
            waiting: vec![],
            background: None,
            before: None,
            now: None,
            kept: vec![],
            seen: vec![],
            clutter: Clutter::default(),
            changed: vec![],
            moving: 0,
            cuts: vec![],
            registration: None,
            other: None,
            is_cut: false,
            canvas: View::FIRST,
            stabilised: None,
            previous: None,
            views: vec![],
            elsewhere: vec![],
            size: [0; 2],
            held: VecDeque::new(),
            verdicts: Verdicts::default(),
            spare: Spare::default(),
        }
    }

    /// Without any frame yet, with numbers of one's own.
    pub fn with_config(config: TrackerConfig) -> Self {
        Self { config, ..Self::new() }
    }

    /// Takes the next frame, of `time` s.
    ///
    /// # Errors
    /// [`Error::Data`] for a frame of another size than the first.
    pub fn watch(&mut self, picture: Picture, time: f64) -> Result<()> {
        let planes = Arc::new(Planes::of(picture.rgb(), &mut self.spare));
        let size = [planes.width, planes.height];
        if self.latest.is_none() {
            self.size = size;
        }
        if size != self.size {
            let [[width, height], [first_width, first_height]] = [size, self.size];
            let reason = format!(
                "is {width}×{height} px, but the first is {first_width}×{first_height} px: all frames of a \
                         video must have one size"
            );
            return Err(Error::Data { what: format!("frame {}", self.kept.len() + self.coming.len()), reason });
        }
        let since = self.latest.replace(planes.clone()).map(|before| before.difference(&planes, &mut self.spare));
        let strong = since.as_deref().map_or(0.0, |since| planes::fraction_above(since, STRONG_CHANGE));
        self.coming.push_back(Coming { picture, planes, time, since, strong });
        if self.coming.len() > AFTER {
            self.take();
        }
        Ok(())
    }

    /// Takes the first of the coming frames.
    fn take(&mut self) {
        let Some(Coming { picture, planes, time, mut since, mut strong }) = self.coming.pop_front() else { return };
        // Between it and the last that was another there may be repeated ones.
        if self.kept.last().is_some_and(|last| last.repeated)
            && let Some(before) = &self.before
        {
            since.into_iter().for_each(|bytes| self.spare.give(bytes));
            let differences = before.difference(&planes, &mut self.spare);
            strong = planes::fraction_above(&differences, STRONG_CHANGE);
            since = Some(differences);
        }
        let after = self.coming.iter().map(|coming| coming.strong).fold(0.0, f64::max);
        let usual = self.strong.min(after);
        let is_still =
            usual * (self.size[0] * self.size[1]) as f64 >= FEWEST_STRONG && strong < REPEATED_STRONG * usual;
        let repeated = since.as_ref().is_some_and(|since| self.is_repeated(since, is_still));
        let first_changed = self.clock.add(time, repeated);
        let time = self.clock.time(self.kept.len());
        self.kept.push(Kept { time, repeated });
        self.change_times(first_changed);
        if repeated {
            since.into_iter().for_each(|bytes| self.spare.give(bytes));
            return;
        }
        self.strong = strong;
        self.hold(picture);
        self.before = Some(planes.clone());
        let (frame, since) = self.stabilise(planes, since);
        if self.background.is_some() {
            self.step(frame, time, since);
            return;
        }
        self.waiting.push((frame, time));
        if self.waiting.len() == FIRST_FRAMES {
            self.begin();
        }
    }

    /// Gives the frames before the newest, from the `first` one on, the times that the clock has for them now.
    fn change_times(&mut self, first: usize) {
        let before = self.kept.len() - 1;
        if first >= before {
            return;
        }
        for (index, kept) in self.kept.iter_mut().enumerate().take(before).skip(first) {
            kept.time = self.clock.time(index);
        }
        let shown: Vec<f64> = self.kept[..before].iter().filter(|kept| !kept.repeated).map(|kept| kept.time).collect();
        let seen = self.seen.iter_mut().map(|seen| &mut seen.time);
        let later = self.now.iter_mut().map(|now| &mut now.time).chain(self.waiting.iter_mut().map(|(_, time)| time));
        seen.chain(later).zip(shown).for_each(|(time, taken)| *time = taken);
    }

    /// Whether a frame that differs so from the one before shows it again; it does where it `is_still`.
    fn is_repeated(&mut self, differences: &[u8], is_still: bool) -> bool {
        let fraction = planes::fraction_above(differences, LEAST_CHANGE);
        let usual = median(self.changed.iter().copied()).unwrap_or(0.0);
        let repeated = is_still || self.changed.len() > 2 && fraction < REPEATED * usual;
        if !repeated {
            self.changed.push(fraction);
            if self.changed.len() > USUAL_FRAMES {
                self.changed.remove(0);
            }
        }
        repeated
    }

    /// Looks at the frames that waited for a background.
    fn begin(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        let planes: Vec<Arc<Planes>> = waiting.iter().map(|(frame, _)| frame.planes.clone()).collect();
        self.background = Background::of(&planes);
        drop(planes);
        (self.now, self.previous) = (None, None);
        for (frame, time) in waiting {
            let since = self.now.as_ref().map(|now| now.planes.difference(&frame.planes, &mut self.spare));
            self.step(frame, time, since);
        }
    }

    /// Looks at the frame before this one, which is its next; `since` is their difference.
    fn step(&mut self, next: Stabilised, time: f64, since: Option<Vec<u8>>) {
        let until = self.now.is_some().then_some(since).flatten();
        if let Some(now) = self.now.take() {
            self.look(&now, until.as_deref());
            now.since.into_iter().for_each(|bytes| self.spare.give(bytes));
            if let Some(planes) = self.previous.replace(now.planes).and_then(Arc::into_inner) {
                planes.levels.into_iter().for_each(|bytes| self.spare.give(bytes));
            }
        }
        match self.background {
            Some(_) => {
                let Stabilised { planes, as_taken } = next;
                self.now = Some(Now { planes, time, since: until, as_taken });
            }
            // The look found another camera's picture: this frame is the first that waits for a new background.
            None => self.waiting.push((next, time)),
        }
    }

    /// The blobs of a frame that has one before and one after it; without either they are what differs from the background.
    fn look(&mut self, now: &Now, until: Option<&[u8]>) {
        let Some(background) = &mut self.background else { return };
        let mut differences = background.follow(&now.planes, &mut self.spare);
        let tolerance = (!now.as_taken).then(|| background.edges(EDGE_TOLERANCE, &mut self.spare));
        let contrast = contrast_of(now.since.as_deref().or(until).unwrap_or(&differences));
        let shorter = self.size[0].min(self.size[1]) as f64;
        let radii = [LEAST_RADIUS, MOST_RADIUS * shorter];
        if let Some(tolerance) = &tolerance {
            planes::subtract(&mut differences, tolerance);
        }
        if planes::fraction_above(&differences, contrast) > MOVED {
            self.moving += 1;
            self.seen.push(Candidates { time: now.time, blobs: vec![] });
            if self.moving >= MOVING_FRAMES {
                self.lose_background();
            }
            return;
        }
        self.moving = 0;
        let width = self.size[0];
        let mut found = blobs::blobs(&differences, width, contrast, radii);
        if let (Some(since), Some(until)) = (&now.since, until) {
            let moves = |blob: &Blob| {
                let steps = [-0.7, 0.0, 0.7];
                let at = |x: f64, y: f64| {
                    let (x, y) = (x.round().max(0.0) as usize, y.round().max(0.0) as usize);
                    y * width + x.min(width - 1)
                };
                steps.iter().flat_map(|u| steps.iter().map(move |v| (u, v))).any(|(u, v)| {
                    let index = at(blob.at[0] + u * blob.radius, blob.at[1] + v * blob.radius);
                    since.get(index).is_some_and(|&it| it > contrast)
                        || until.get(index).is_some_and(|&it| it > contrast)
                })
            };
            found.retain(moves);
            let mut both = planes::less_of(since, until, &mut self.spare);
            if let Some(tolerance) = &tolerance {
                planes::subtract(&mut both, tolerance);
            }
            for blob in blobs::blobs(&both, width, contrast, radii) {
                let known = |other: &Blob| {
                    let off = (other.at[0] - blob.at[0]).hypot(other.at[1] - blob.at[1]);
                    off < SAME * blob.radius.max(1.5) && other.radius < 1.5 * blob.radius
                };
                if !found.iter().any(known) {
                    found.push(blob);
                }
            }
            self.spare.give(both);
        }
        self.spare.give(differences);
        tolerance.into_iter().for_each(|bytes| self.spare.give(bytes));
        let canvas = self.canvas;
        if canvas != View::FIRST {
            found.iter_mut().for_each(|blob| *blob = blob.mapped(&canvas.first_from_frame));
        }
        let seen = Candidates { time: now.time, blobs: found };
        self.clutter.add(&seen);
        self.seen.push(seen);
    }

    /// A frame as the canvas shows it, and its differences from the frame before as that shows that; `since` are those of the frames as
    /// they were taken.
    fn stabilise(&mut self, planes: Arc<Planes>, since: Option<Vec<u8>>) -> (Stabilised, Option<Vec<u8>>) {
        let view = self.view(&planes);
        self.views.push(view);
        let away = view.frame_from_first * self.canvas.first_from_frame;
        let middle = self.size.map(|side| side as f64 / 2.0);
        let size = scale(&away, middle);
        if displacement(&away, self.size) > CANVAS_MOVED * self.size[0] as f64
            || !(CANVAS_SCALED.recip()..CANVAS_SCALED).contains(&size)
        {
            self.move_canvas(view, &planes);
        }
        let frame_from_canvas = view.frame_from_first * self.canvas.first_from_frame;
        let as_taken = is_still(&frame_from_canvas, self.size);
        let before = self.stabilised.take();
        let stabilised = match as_taken {
            true => planes,
            false => {
                let beyond = before.as_ref().map(|before| &*before.planes);
                Arc::new(planes.warped(&frame_from_canvas, beyond, &mut self.spare))
            }
        };
        let since = match &before {
            Some(before) if !(as_taken && before.as_taken) => {
                since.into_iter().for_each(|bytes| self.spare.give(bytes));
                Some(before.planes.difference(&stabilised, &mut self.spare))
            }
            _ => since,
        };
        let stabilised = Stabilised { planes: stabilised, as_taken };
        self.stabilised = Some(stabilised.clone());
        (stabilised, since)
    }

    /// The view of the next frame, by what stands still in it.
    fn view(&mut self, planes: &Planes) -> View {
        if self.registration.is_none() && self.views.len() < FIRST_FRAMES {
            self.registration = Registration::of(planes);
        }
        let due = !self.is_cut || self.views.len().is_multiple_of(RETURN_EVERY);
        let found = self.registration.as_mut().filter(|_| due).and_then(|registration| registration.view(planes));
        if let Some(view) = found {
            (self.is_cut, self.other) = (false, None);
            let moved = displacement(&view.frame_from_first, self.size);
            self.elsewhere.push((moved > ELSEWHERE_PX).then_some(CameraMotion::Moved(moved)));
            return view;
        }
        let last = self.views.last().copied().unwrap_or(View::FIRST);
        if self.is_cut {
            self.elsewhere.push(Some(CameraMotion::Cut));
            return self.other.as_mut().and_then(|other| other.view(planes)).unwrap_or(last);
        }
        // Too little is found again: of a camera that stood still, because something is before it.
        let is_still = is_still(&last.frame_from_first, self.size);
        self.elsewhere.push((!is_still).then_some(CameraMotion::Cut));
        last
    }

    /// Stabilises about another view from now on.
    fn move_canvas(&mut self, view: View, planes: &Planes) {
        let old_from_new = self.canvas.frame_from_first * view.first_from_frame;
        self.canvas = view;
        let mut moved = |old: &Planes| Arc::new(old.warped(&old_from_new, Some(planes), &mut self.spare));
        if let Some(background) = &mut self.background {
            background.replace(&mut moved);
        }
        self.waiting
            .iter_mut()
            .for_each(|(frame, _)| *frame = Stabilised { planes: moved(&frame.planes), as_taken: false });
        self.previous = self.previous.take().map(|previous| moved(&previous));
        if let Some(now) = &mut self.now {
            (now.planes, now.as_taken) = (moved(&now.planes), false);
        }
        if let Some(stabilised) = &mut self.stabilised {
            *stabilised = Stabilised { planes: moved(&stabilised.planes), as_taken: false };
        }
        if let (Some(now), Some(previous)) = (&mut self.now, &self.previous) {
            now.since = Some(previous.difference(&now.planes, &mut self.spare));
        }
    }

    /// The background is no longer what the last frames show: it is made anew. Where these are not registered, they are another picture.
    fn lose_background(&mut self) {
        let from = self.seen.len() - MOVING_FRAMES;
        (self.background, self.moving) = (None, 0);
        let is_registered = |view: &Option<CameraMotion>| matches!(view, Some(CameraMotion::Moved(_)));
        if self.elsewhere[from..].iter().all(is_registered) {
            return;
        }
        self.cuts.push(from);
        if let Some(registration) = &mut self.registration {
            registration.start_again();
            self.elsewhere[from..].fill(Some(CameraMotion::Cut));
            self.is_cut = true;
            self.other = self.stabilised.as_ref().and_then(|last| Registration::of(&last.planes));
        }
        self.canvas = View::FIRST;
    }

    /// The homography to each frame from the first view; a repeated frame has that of the frame that it repeats.
    #[doc(hidden)]
    pub fn views_from_first(&self) -> Vec<Matrix3<f64>> {
        let mut shown = 0;
        let view = |kept: &Kept| {
            shown += usize::from(!kept.repeated);
            self.views.get(shown.saturating_sub(1)).map_or_else(Matrix3::identity, |view| view.frame_from_first)
        };
        self.kept.iter().map(view).collect()
    }

    /// No frame comes soon: those that waited for it are taken.
    pub fn settle(&mut self) {
        while !self.coming.is_empty() {
            self.take();
        }
    }

    /// There are no more frames: the last ones are looked at, which waited for the next.
    pub fn end(&mut self) {
        self.settle();
        if self.background.is_none() && self.waiting.len() >= FEWEST_FRAMES {
            self.begin();
        }
        if let Some(now) = self.now.take() {
            self.look(&now, None);
        }
        // Frames that nothing could be compared with.
        self.seen.extend(self.waiting.drain(..).map(|(_, time)| Candidates { time, blobs: vec![] }));
    }

    /// What flew in the frames that were watched until [`Self::end`]. `seeds` are frames and places (px) in which a person saw it:
    /// what flies through them is the ball. Of several in one frame the last counts.
    ///
    /// # Errors
    /// [`Error::Value`] for a seed in a frame that was not watched, or outside the picture.
    pub fn hypotheses(&self, seeds: &[(usize, [f64; 2])]) -> Result<Hypotheses<'_>> {
        // By the frames that are not repeated, as they were given.
        let mut chosen = BTreeMap::new();
        for &(frame, at) in seeds {
            chosen.insert(self.place_of_seed(frame, at)?, (frame, at));
        }
        let own = chosen.iter().map(|(&place, &(_, at))| (place, self.views[place].first(at))).collect();
        let search = self.search(0, 1.0, STRONG_LOG_RATIO, &own);
        let tracklets = search.tracklets();
        let is_used = |frame, seed| {
            tracklets.iter().any(|tracklet| tracklet.seeded && search.goes_through(tracklet, frame, seed))
        };
        let unused = chosen.iter().filter(|&(&frame, _)| !is_used(frame, own[&frame])).map(|(_, seed)| *seed).collect();
        let frames = (self.views.as_slice(), self.elsewhere.as_slice());
        let hypotheses = Hypotheses::new(&self.kept, &self.seen, tracklets, &self.verdicts, &self.cuts, frames);
        Ok(hypotheses.with_config(self.config).with_unused(unused))
    }

    /// Tracklets are searched from a frame on, of those that are not repeated.
    fn search<'a>(
        &'a self,
        from: usize,
        displacement_fraction: f64,
        strong_log_ratio: f64,
        seeds: &'a BTreeMap<usize, [f64; 2]>,
    ) -> TrackletSearch<'a> {
        let [width, height] = self.size.map(|side| side as f64);
        TrackletSearch {
            config: &self.config,
            frames: &self.seen[from..],
            all: &self.seen,
            from,
            clutter: &self.clutter,
            area: width * height,
            displacement_fraction,
            strong_log_ratio,
            seeds,
            density_cache: RefCell::default(),
        }
    }

    /// The frame of a seed among those that are not repeated.
    fn place_of_seed(&self, frame: usize, [x, y]: [f64; 2]) -> Result<usize> {
        let [width, height] = self.size.map(|side| side as f64);
        let refuse = |reason: String| Err(Error::value("track", "seed", reason));
        if frame >= self.kept.len() {
            return refuse(format!("is in frame {frame}, but the last frame is {}", self.kept.len().saturating_sub(1)));
        }
        if !((0.0..width).contains(&x) && (0.0..height).contains(&y)) {
            return refuse(format!("({x}, {y}) px is outside the picture of {width}×{height} px"));
        }
        Ok(self.kept[..=frame].iter().filter(|kept| !kept.repeated).count().saturating_sub(1))
    }
}
