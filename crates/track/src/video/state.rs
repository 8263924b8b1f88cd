//! What is known of a video: its frames, the candidates in them, and what the networks answered about those.
//!
//! Frames and candidates are only ever added, so their numbers stay theirs. What a candidate is believed to be follows from the blob that was
//! segmented and from the answers about it; neither is overwritten.

use super::blobs::Blob;
use super::clutter::Clutter;
use super::config::{BlobsConfig, TrackerConfig};
use super::evidence::Evidence;
use super::view::{CameraMotion, FirstView, View};

/// A frame: its index among those that do not show the one before again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct FrameId(pub usize);

impl FrameId {
    /// Frames from an earlier one (or the same) to this.
    pub fn since(self, earlier: Self) -> usize {
        self.0 - earlier.0
    }
}

/// A candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct BlobId(usize);

/// A frame that does not show the one before again.
#[derive(Debug)]
pub(super) struct Frame {
    /// Its index in the video.
    pub number: usize,
    /// When it was taken, s.
    pub time: f64,
    pub view: View,
    /// Where the camera looks, if not where it did at first.
    pub elsewhere: Option<CameraMotion>,
    /// Its candidates, in the order in which they were added, and what each is believed to be: side by side, for they are compared often.
    pub blobs: Vec<BlobId>,
    measured: Vec<Blob<FirstView>>,
    /// Whether it is a part of another candidate: an edge of a large ball.
    absorbed: Vec<bool>,
}

/// A frame of the video.
#[derive(Debug)]
enum Shown {
    New(FrameId),
    /// A frame that was shown before, and when, s.
    Again(FrameId, f64),
}

/// A blob of a frame that may be the ball.
#[derive(Debug)]
struct Candidate {
    frame: FrameId,
    /// Its index among the candidates of its frame.
    place: usize,
    /// As it was segmented, or as a network found it where nothing was.
    raw: Blob<FirstView>,
    /// The detector's answers about it, in the order in which they came: the last one holds.
    answers: Vec<Evidence>,
    /// Log-odds that it is a ball, by the motion network.
    motion: Option<f64>,
}

impl Frame {
    /// Its candidates that are no part of another, and what each is believed to be.
    pub fn candidates(&self) -> impl Iterator<Item = (BlobId, &Blob<FirstView>)> {
        let all = self.blobs.iter().copied().zip(&self.measured).zip(&self.absorbed);
        all.filter(|(_, absorbed)| !**absorbed).map(|(candidate, _)| candidate)
    }
}

impl Candidate {
    /// What it is believed to be, of a frame of this view: as the detector measured it where it did.
    fn measured(&self, view: &View, config: &BlobsConfig) -> Blob<FirstView> {
        let balls = self.answers.iter().filter_map(Evidence::ball);
        balls.fold(self.raw, |blob, ball| blob.measured_as(Blob::of_detection(ball, config).in_first(view), config))
    }
}

/// All that is known of a video.
pub(super) struct State {
    config: BlobsConfig,
    /// Of its pictures, px.
    pub size: [usize; 2],
    shown: Vec<Shown>,
    frames: Vec<Frame>,
    /// Frames whose candidates are known: the first so many.
    segmented: usize,
    candidates: Vec<Candidate>,
    clutter: Clutter,
    /// Frames from which on the background is another.
    cuts: Vec<FrameId>,
}

impl State {
    /// Without any frame yet.
    pub fn new(config: &TrackerConfig) -> Self {
        Self {
            config: config.blobs,
            size: [0; 2],
            shown: vec![],
            frames: vec![],
            segmented: 0,
            candidates: vec![],
            clutter: Clutter::new(config.clutter),
            cuts: vec![],
        }
    }

    /// Adds the video's next frame, which does not show the one before again.
    pub fn add_frame(&mut self, time: f64, view: View, elsewhere: Option<CameraMotion>) -> FrameId {
        let frame = FrameId(self.frames.len());
        self.frames.push(Frame {
            number: self.shown.len(),
            time,
            view,
            elsewhere,
            blobs: vec![],
            measured: vec![],
            absorbed: vec![],
        });
        self.shown.push(Shown::New(frame));
        frame
    }

    /// Adds the video's next frame, which shows the one before again.
    pub fn add_repeat(&mut self, time: f64) {
        let before = FrameId(self.frames.len().saturating_sub(1));
        self.shown.push(Shown::Again(before, time));
    }

    /// Frames of the video, with those that are shown again.
    pub fn shown(&self) -> usize {
        self.shown.len()
    }

    /// When a frame of the video was taken, s, and whether it shows the one before again.
    pub fn shown_at(&self, number: usize) -> (f64, bool) {
        match self.shown[number] {
            Shown::New(frame) => (self.frame(frame).time, false),
            Shown::Again(_, time) => (time, true),
        }
    }

    /// The frame that a frame of the video shows.
    pub fn shown_in(&self, number: usize) -> FrameId {
        match self.shown[number] {
            Shown::New(frame) | Shown::Again(frame, _) => frame,
        }
    }

    /// Corrects when a frame of the video was taken, s.
    pub fn set_time(&mut self, number: usize, taken: f64) {
        match &mut self.shown[number] {
            Shown::New(frame) => self.frames[frame.0].time = taken,
            Shown::Again(_, time) => *time = taken,
        }
    }

    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    pub fn frame(&self, frame: FrameId) -> &Frame {
        &self.frames[frame.0]
    }

    /// Adds the candidates of the first frame whose candidates are not known yet.
    pub fn add_candidates(&mut self, blobs: Vec<Blob<FirstView>>) {
        self.clutter.add(&blobs);
        let frame = FrameId(self.segmented);
        self.segmented += 1;
        for blob in blobs {
            self.add_candidate(frame, blob);
        }
    }

    /// Leaves the first frame whose candidates are not known yet without any: it cannot be compared with a background.
    pub fn skip_candidates(&mut self) {
        self.segmented += 1;
    }

    /// Frames whose candidates are known: the first so many.
    pub fn segmented(&self) -> usize {
        self.segmented
    }

    /// Adds a candidate to a frame.
    pub fn add_candidate(&mut self, frame: FrameId, raw: Blob<FirstView>) -> BlobId {
        let blob = BlobId(self.candidates.len());
        let Frame { blobs, measured, absorbed, .. } = &mut self.frames[frame.0];
        self.candidates.push(Candidate { frame, place: blobs.len(), raw, answers: vec![], motion: None });
        blobs.push(blob);
        measured.push(raw);
        absorbed.push(false);
        blob
    }

    /// Declares a candidate a part of another: it is none of its own.
    pub fn absorb(&mut self, blob: BlobId) {
        let Candidate { frame, place, .. } = self.candidates[blob.0];
        self.frames[frame.0].absorbed[place] = true;
    }

    /// The frame of a candidate.
    pub fn frame_of(&self, blob: BlobId) -> FrameId {
        self.candidates[blob.0].frame
    }

    /// When a candidate was there, s.
    pub fn time_of(&self, blob: BlobId) -> f64 {
        self.frame(self.frame_of(blob)).time
    }

    /// What a candidate is believed to be.
    pub fn blob(&self, blob: BlobId) -> &Blob<FirstView> {
        let Candidate { frame, place, .. } = &self.candidates[blob.0];
        &self.frames[frame.0].measured[*place]
    }

    /// What the detector answered about a candidate.
    pub fn evidence(&self, blob: BlobId) -> Evidence {
        self.candidates[blob.0].answers.last().copied().unwrap_or(Evidence::Unqueried)
    }

    /// Log-odds that a candidate is a ball, by the motion network.
    pub fn motion(&self, blob: BlobId) -> Option<f64> {
        self.candidates[blob.0].motion
    }

    /// Whether the motion network answered about any candidate.
    pub fn has_motion(&self) -> bool {
        self.candidates.iter().any(|candidate| candidate.motion.is_some())
    }

    /// Takes the detector's answer about a candidate.
    pub fn add_evidence(&mut self, blob: BlobId, evidence: Evidence) {
        let candidate = &mut self.candidates[blob.0];
        candidate.answers.push(evidence);
        let frame = &mut self.frames[candidate.frame.0];
        frame.measured[candidate.place] = candidate.measured(&frame.view, &self.config);
    }

    /// Takes the motion network's log-odds that a candidate is a ball.
    pub fn add_motion(&mut self, blob: BlobId, log_odds: f64) {
        self.candidates[blob.0].motion = Some(log_odds);
    }

    /// Where something always moves.
    pub fn clutter(&self) -> &Clutter {
        &self.clutter
    }

    /// Frames from which on the background is another.
    pub fn cuts(&self) -> &[FrameId] {
        &self.cuts
    }

    /// Adds a cut before a frame.
    pub fn add_cut(&mut self, frame: FrameId) {
        self.cuts.push(frame);
    }

    /// Declares the frames from one on to show another view, which nothing relates to the first one.
    pub fn lose_views(&mut self, from: FrameId) {
        self.frames[from.0..].iter_mut().for_each(|frame| frame.elsewhere = Some(CameraMotion::Cut));
    }
}

/// Candidates of some frames.
pub(super) struct BlobSet {
    /// The first candidate that can be in it.
    first: usize,
    contains: Vec<bool>,
}

impl BlobSet {
    /// None of the candidates of the frames from one on.
    pub fn from(state: &State, from: FrameId) -> Self {
        let first = state.frames[from.0..].iter().flat_map(|frame| &frame.blobs).map(|blob| blob.0).min();
        let first = first.unwrap_or(state.candidates.len());
        Self { first, contains: vec![false; state.candidates.len() - first] }
    }

    pub fn contains(&self, blob: BlobId) -> bool {
        self.contains[blob.0 - self.first]
    }

    pub fn insert(&mut self, blob: BlobId) {
        self.contains[blob.0 - self.first] = true;
    }
}

#[cfg(test)]
impl State {
    /// Of a still camera's frames at these times, s, with these candidates.
    pub fn of(size: [usize; 2], frames: impl IntoIterator<Item = (f64, Vec<Blob<FirstView>>)>) -> Self {
        let mut state = Self { size, ..Self::new(&TrackerConfig::default()) };
        for (time, blobs) in frames {
            state.add_frame(time, View::FIRST, None);
            state.add_candidates(blobs);
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::super::view::Place;
    use super::*;
    use gravisight_geometry::camera::{Detection, Outline};

    #[test]
    fn a_candidate_keeps_its_number_and_is_believed_to_be_what_was_measured_last() {
        let raw = |x: f64| Blob {
            at: Place::new([x, 50.0]),
            radius: 3.0,
            reach: 9.0,
            direction: 0.3,
            is_ball: false,
            sigma: 1.0,
        };
        let mut state = State::of([640, 480], (0..3).map(|frame| (f64::from(frame), vec![raw(0.0), raw(100.0)])));
        let blob = state.frame(FrameId(0)).blobs[1];
        let of = |ball: Option<Detection>| Evidence::of(ball, &TrackerConfig::default().evidence);
        let ball = |radius: f64| {
            let outline = Outline { centre: [102.0, 51.0].into(), radius };
            of(Some(Detection { outline, log_sigma: 0.1, confidence: 0.9 }))
        };
        for evidence in [ball(4.0), ball(5.0), of(None)] {
            state.add_evidence(blob, evidence);
        }
        let added = state.add_candidate(FrameId(0), raw(200.0));
        assert_eq!(state.frame(FrameId(0)).blobs[1..], [blob, added]);
        assert_eq!((state.frame_of(blob), state.frame_of(added)), (FrameId(0), FrameId(0)));
        let believed = state.blob(blob);
        assert_eq!((believed.at.xy, believed.radius, believed.reach), ([102.0, 51.0], 5.0, 9.0));
        assert!(believed.is_ball && !state.evidence(blob).is_ball());
        assert_eq!(state.candidates[blob.0].raw, raw(100.0));
    }
}
