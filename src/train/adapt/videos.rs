//! Videos on their way to patches, stacks and frames to score on.

use std::collections::{BTreeMap, BTreeSet};

use super::labels::{FlightLabel, flight_labels};
use super::patches::cut;
use super::score::Scored;
use super::stacks::{BallsOfFrame, CutStack, StackCutter};
use super::{AdaptFlights, Adapter, is_held_out};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::random::mixed;
use gravisight_track::TrackedVideo;

/// Frames of a video whose patches are kept at most.
const FRAMES: usize = 150;
/// Whole frames of a video that are kept at most, to score on: 6 MB each at 1080p.
const SCORED: usize = 16;

/// A video whose frames are being looked at for the second time.
pub(super) struct Video {
    labels: BTreeMap<usize, FlightLabel>,
    cutter: StackCutter,
    frame: usize,
    /// Frames that were tracked.
    frames: usize,
    /// Time of the last frame, s.
    time: f64,
    /// Whose pixels the sizes by physics are in, until the first frame tells its own.
    camera: Option<Camera>,
    /// One labelled frame of so many becomes patches.
    every: usize,
    seen: usize,
    /// Frames to score on.
    scored: BTreeSet<usize>,
    /// Number of its first flight among all videos'.
    first: usize,
}

impl Adapter {
    /// Begins with a video that was `tracked`: the flights that teach. Its frames follow once more, by [`Self::add`]. `seeds` are frames and places
    /// (px) in which a person saw the ball. With `ball`, the camera (of the pictures' aspect) and the ball's radius (m), the sizes are learned from
    /// the distances that physics finds.
    ///
    /// # Errors
    /// [`Error::Value`] for frames that are not all of the video's in order, while some frames of the video before are missing, and after
    /// the first [`Self::step`].
    pub fn begin(
        &mut self,
        tracked: &TrackedVideo,
        seeds: &[(usize, [f64; 2])],
        ball: Option<(&Camera, f64)>,
    ) -> Result<AdaptFlights> {
        if self.video.as_ref().is_some_and(|video| video.frame > 0) {
            self.check_whole()?;
        }
        if self.stages.is_some() {
            return Err(Error::value(
                "adapt",
                "video",
                "was added after the first step; add all videos before the first step",
            ));
        }
        if let Some((index, other)) = (0..).zip(&tracked.frames).find(|(index, frame)| frame.frame != *index) {
            let reason =
                format!("must list all frames of the video in order, but entry {index} is frame {}", other.frame);
            return Err(Error::value("tracked video", "frames", reason));
        }
        // Of the video before no frame was given: this one takes its place.
        if self.video.take().is_some_and(|video| video.frame == 0) {
            self.stacks.pop();
        }
        let labels = flight_labels(tracked, seeds, ball);
        let flights = labels.values().map(|label| label.flight + 1).max().unwrap_or(0);
        let (frames, every) = (labels.len(), labels.len().div_ceil(FRAMES).max(1));
        let first = self.flights;
        let scored = to_score(&labels, first);
        self.stacks.push(vec![]);
        self.video = Some(Video {
            labels,
            cutter: StackCutter::default(),
            frame: 0,
            frames: tracked.frames.len(),
            time: f64::NEG_INFINITY,
            camera: ball.map(|(camera, _)| camera.clone()),
            every,
            seen: 0,
            scored,
            first,
        });
        Ok(AdaptFlights { flights, frames })
    }

    /// Refuses a video with flights whose frames were not all given.
    pub(super) fn check_whole(&self) -> Result<()> {
        match &self.video {
            Some(Video { labels, frame, frames, .. }) if !labels.is_empty() => {
                let reason = format!("has only {frame} of {frames} frames; add the missing frames, then call `end`");
                Err(Error::value("adapt", "video", reason))
            }
            _ => Ok(()),
        }
    }

    /// Takes the next frame of the video, of `time` s.
    ///
    /// # Errors
    /// [`Error::Value`] without [`Self::begin`], and for a time that is not later than that of the frame before; [`Error::CameraMismatch`] for a camera of another shape;
    /// as [`crate::localise::Localiser::localise`].
    pub async fn add(&mut self, picture: Picture, time: f64) -> Result<()> {
        let Some(video) = &mut self.video else {
            return Err(Error::value("adapt", "frame", "was added before `begin`"));
        };
        if !(time > video.time && time.is_finite()) {
            let reason = match video.frame {
                0 => format!("of frame 0 must be a finite number, not {time}"),
                frame => format!("of frame {frame} must be later than {} s, not {time} s", video.time),
            };
            return Err(Error::value("adapt", "time", reason));
        }
        if let Some(camera) = &video.camera {
            let [here, there] = [camera.for_picture(picture.size())?.size(), camera.size()];
            let scale = f64::from(here.width) / f64::from(there.width);
            let labels = video.labels.values_mut().filter(|label| label.by_physics);
            labels.for_each(|label| label.outline.radius *= scale);
            video.camera = None;
        }
        video.time = time;
        if let Some(&FlightLabel { outline, flight, by_physics }) = video.labels.get(&video.frame) {
            if video.seen % video.every == 0 {
                let seed = mixed(self.options.seed, self.stacks.len() as u64, video.frame as u64);
                let found = cut(&self.localiser, &picture, (&outline, video.first + flight), seed).await?;
                self.patches.extend(found);
            }
            if video.scored.contains(&video.frame) {
                let (picture, flight) = (picture.clone(), video.first + flight);
                self.scored.push(Scored { picture, ball: outline, by_physics, flight });
            }
            video.seen += 1;
        }
        video.frame += 1;
        let Video { labels, cutter, first, .. } = video;
        let balls = balls_of(labels);
        let stacks = cutter.add(picture, time, Some(&self.localiser), &balls).await?;
        keep(&mut self.stacks, stacks, labels, *first);
        Ok(())
    }

    /// Bytes of all pictures that are kept, of all videos.
    pub fn picture_bytes(&self) -> usize {
        let patches = self.patches.iter().map(|patch| patch.rgb.len());
        let scored = self.scored.iter().map(|frame| frame.picture.rgb().len());
        let stacks = self.stacks.iter().flatten().map(|(stack, _)| stack.record.len());
        patches.chain(scored).chain(stacks).sum()
    }

    /// The video has no more frames.
    ///
    /// # Errors
    /// [`Error::Data`] where frames that were tracked are missing; as [`Self::add`].
    pub async fn end(&mut self) -> Result<()> {
        let Some(Video { labels, mut cutter, first, frame, frames, .. }) = self.video.take() else { return Ok(()) };
        if !labels.is_empty() && frame != frames {
            // Nothing of the video stays.
            self.patches.retain(|patch| patch.flight < first);
            self.scored.retain(|scored| scored.flight < first);
            self.stacks.pop();
            let reason = format!("{frame} frames were given, but {frames} were tracked: give all of them, in order");
            return Err(Error::Data { what: "video".into(), reason });
        }
        let balls = balls_of(&labels);
        let stacks = cutter.end(Some(&self.localiser), &balls).await?;
        keep(&mut self.stacks, stacks, &labels, first);
        self.flights += labels.values().map(|label| label.flight + 1).max().unwrap_or(0);
        self.frames += labels.len();
        Ok(())
    }
}

/// The frames of a video to score on, of those flights that may be held out: about as many of each, over all of its length. Its first flight has
/// the number `first`.
fn to_score(labels: &BTreeMap<usize, FlightLabel>, first: usize) -> BTreeSet<usize> {
    let mut flights: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (&frame, label) in labels {
        // Whether it is the second of two is known once all videos were seen.
        if [2, 3].iter().any(|&all| is_held_out(first + label.flight, all)) {
            flights.entry(label.flight).or_default().push(frame);
        }
    }
    let each = (SCORED / flights.len().max(1)).max(1);
    let middles = |frames: &Vec<usize>| -> Vec<usize> {
        let count = each.min(frames.len());
        (0..count).map(|part| frames[(2 * part + 1) * frames.len() / (2 * count)]).collect()
    };
    flights.values().step_by(flights.len().div_ceil(SCORED).max(1)).flat_map(middles).collect()
}

/// The balls of the labelled frames.
fn balls_of(labels: &BTreeMap<usize, FlightLabel>) -> impl Fn(usize) -> BallsOfFrame + '_ {
    |frame| labels.get(&frame).map(|label| vec![(label.outline.centre, Some(label.outline.radius))])
}

/// Keeps stacks of labelled frames with the flight that each is of.
fn keep(
    all: &mut [Vec<(CutStack, usize)>],
    stacks: Vec<CutStack>,
    labels: &BTreeMap<usize, FlightLabel>,
    first: usize,
) {
    if let Some(of_video) = all.last_mut() {
        let flight = |stack: &CutStack| Some(first + labels.get(&stack.frame)?.flight);
        of_video.extend(stacks.into_iter().filter_map(|stack| flight(&stack).map(|flight| (stack, flight))));
    }
}
