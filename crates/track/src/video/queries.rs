//! Queries for the networks while frames come: blobs of objects that seem to fly, and predicted positions where none is seen.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Matrix3;

use super::BallTracker;
use super::blobs::Blob;
use super::config::QueriesConfig;
use super::evidence::{Evidence, log_odds};
use super::stack::{NEIGHBOURS, Stack};
use super::state::{BlobId, FrameId};
use super::tracklets::{Tracklet, TrackletSearch, alike};
use super::view::{FirstView, FramePixels, Place};
use gravisight_geometry::camera::Detection;
use gravisight_geometry::image::Picture;

static NO_SEEDS: BTreeMap<FrameId, Place<FirstView>> = BTreeMap::new();

/// What was queried, and what is to be.
#[derive(Default)]
pub(super) struct Schedule {
    /// Candidates that were queried.
    queried: BTreeSet<BlobId>,
    /// Candidates that were measured first, and for which the motion network was queried afterwards.
    queried_for_motion: BTreeSet<BlobId>,
    /// Predicted positions of tracklets that were queried.
    predicted: Vec<(FrameId, Place<FramePixels>)>,
    /// Balls that were found in frames whose candidates are not known yet.
    found: Vec<(FrameId, Detection)>,
    /// The tracklets that are queried now.
    round: Option<Round>,
    /// Frames in which tracklets have been searched.
    searched: usize,
}

/// Tracklets that are verified.
struct Round {
    /// The first frame in which they were searched.
    from: FrameId,
    tracklets: Vec<Tracklet>,
}

/// A position for the networks to check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    frame: FrameId,
    /// None where nothing stands out from the background.
    blob: Option<BlobId>,
    /// Where the ball may be in the frame, px.
    pub image: [f64; 2],
    /// About how large it is, px.
    pub radius_px: f64,
    /// How far its centre may be from there, px.
    pub reach_px: f64,
    /// Whether it was measured already: only the motion network is queried.
    pub measured: bool,
}

impl Query {
    /// The frame that it is about.
    pub fn frame(&self) -> FrameId {
        self.frame
    }

    /// Whether it is about something that moves.
    pub fn is_of_blob(&self) -> bool {
        self.blob.is_some()
    }
}

impl BallTracker {
    /// The queries for the networks: call it after each frame, and after [`Self::end`], until there are none. Answering is optional;
    /// unanswered queries lower accuracy.
    pub fn queries(&mut self) -> Vec<Query> {
        if self.schedule.round.is_none() {
            let (segmented, searched) = (self.state.segmented(), self.schedule.searched);
            let ended = self.foreground.is_idle();
            if segmented < searched + self.config.queries.step && !(ended && segmented > searched) {
                return vec![];
            }
            self.schedule.searched = segmented;
            for (frame, ball) in std::mem::take(&mut self.schedule.found) {
                self.propose(frame, ball);
            }
            let from = self.window();
            self.schedule.predicted.retain(|(frame, _)| *frame >= from);
            let tracklets = self.search_last(from).tracklets();
            self.schedule.round = Some(Round { from, tracklets });
        }
        let Some(round) = self.schedule.round.take() else { return vec![] };
        let mut queries = Vec::new();
        for tracklet in &round.tracklets {
            let seen = self.query_members(&tracklet.members, &mut queries);
            if seen >= self.config.queries.fewest_seen {
                let beyond = self.beyond(round.from, tracklet);
                self.schedule.predicted.extend(beyond.iter().map(|query| (query.frame, Place::new(query.image))));
                queries.extend(beyond);
            }
        }
        queries.retain(|query| self.picture(query).is_some());
        if !queries.is_empty() {
            self.schedule.round = Some(round);
        }
        queries
    }

    /// Adds the queries about a tracklet's candidates; returns in how many of them the detector saw a ball.
    fn query_members(&mut self, members: &[BlobId], queries: &mut Vec<Query>) -> usize {
        let QueriesConfig { every, most_per_ball, .. } = self.config.queries;
        let answers = || members.iter().map(|&member| self.state.evidence(member)).filter(Evidence::is_queried);
        let seen = answers().filter(Evidence::is_ball).count();
        let is_ball = seen > 0 && most_per_ball * seen >= answers().count();
        // Most of what moves is no ball: a few queries show that.
        let mut last = None;
        for (number, &member) in members.iter().enumerate() {
            if self.schedule.queried.contains(&member) {
                last = Some(number);
                // Of what the detector proposed, the motion network knows nothing yet.
                if self.state.motion(member).is_none() && self.schedule.queried_for_motion.insert(member) {
                    queries.push(self.query(member, true));
                }
            } else if is_ball || last.is_none_or(|last| number >= last + every) {
                last = Some(number);
                self.schedule.queried.insert(member);
                queries.push(self.query(member, false));
            }
        }
        seen
    }

    /// The query about a candidate.
    fn query(&self, blob: BlobId, measured: bool) -> Query {
        let frame = self.state.frame_of(blob);
        let Blob { at, radius, reach, .. } = self.state.blob(blob).in_frame(&self.state.frame(frame).view);
        Query { frame, blob: Some(blob), image: at.xy, radius_px: radius, reach_px: reach, measured }
    }

    /// A search in the last frames, from one on.
    fn search_last(&self, from: FrameId) -> TrackletSearch<'_> {
        self.search(from, self.config.queries.displacement, self.config.tracklets.min_gain, &NO_SEEDS)
    }

    /// The first of the last frames, in which tracklets are searched.
    fn window(&self) -> FrameId {
        FrameId(self.state.segmented().saturating_sub(self.config.queries.window))
    }

    /// Whether a network sees the ball in one of the last tracklets.
    pub fn sees_ball(&self) -> bool {
        let blobs = self.state.frames()[self.window().0..].iter().flat_map(|frame| &frame.blobs);
        blobs.filter(|&&blob| self.state.evidence(blob).is_ball()).count() >= self.config.queries.fewest_seen
    }

    /// Where the ball of a tracklet may be in the frames before and after it, of those that are searched.
    fn beyond(&self, from: FrameId, tracklet: &Tracklet) -> Vec<Query> {
        let QueriesConfig { beyond, most_unsure, unsure_reach, predicted_px, .. } = self.config.queries;
        let search = self.search_last(from);
        let frames: Vec<usize> = tracklet.members.iter().map(|&member| self.state.frame_of(member).0).collect();
        let (first, last) = (frames[0], frames[frames.len() - 1]);
        let before = first.saturating_sub(beyond).max(from.0)..first;
        let after = last + 1..(last + 1 + beyond).min(self.state.segmented());
        let within = (first..last).filter(|frame| frames.binary_search(frame).is_err());
        let queries = before.chain(within).chain(after).map(FrameId).filter_map(|frame| {
            let (at, unsure, radius) = search.leads(tracklet, frame)?;
            let view = &self.state.frame(frame).view;
            let at = view.frame(&at);
            let larger = view.scale(&at).recip();
            let [unsure, radius_px] = [unsure, radius].map(|px| px * larger);
            let inside = (0..2).all(|axis| (0.0..self.state.size[axis] as f64).contains(&at.xy[axis]));
            let is_near = |(other, place): &(FrameId, Place<FramePixels>)| {
                *other == frame && place.distance(&at) < radius_px.max(predicted_px)
            };
            let reach_px = radius_px + unsure_reach * unsure;
            let query = Query { frame, blob: None, image: at.xy, radius_px, reach_px, measured: false };
            let is_new = !self.schedule.predicted.iter().any(is_near);
            (inside && unsure < most_unsure * radius_px && is_new).then_some(query)
        });
        queries.collect()
    }

    /// The picture of a query's frame; none where it is too old.
    pub fn picture(&self, query: &Query) -> Option<&Picture> {
        self.held(query.frame)
    }

    /// The last frame.
    pub fn newest(&self) -> Option<FrameId> {
        self.pictures.newest()
    }

    /// The picture of a frame; none where it is too old.
    pub fn held(&self, frame: FrameId) -> Option<&Picture> {
        self.pictures.of(frame)
    }

    /// All candidates of a frame.
    pub fn candidates(&self, frame: FrameId) -> Vec<Query> {
        let blobs = self.state.frames().get(frame.0).map_or(&[][..], |frame| &frame.blobs);
        blobs.iter().map(|&blob| self.query(blob, false)).collect()
    }

    /// The index in the video of the frame that a query is about.
    pub fn number(&self, query: &Query) -> usize {
        self.state.frame(query.frame).number
    }

    /// The stack about a blob; none where its frame is too old.
    pub fn stack(&self, query: &Query) -> Option<Stack> {
        let own = self.held(query.frame)?;
        let own_view = &self.state.frame(query.frame).view;
        let frames = std::array::from_fn(|index| {
            let frame = FrameId((query.frame.0 + index).saturating_sub(NEIGHBOURS));
            // At either end of the video there is no other: as if nothing moved.
            match self.held(frame) {
                Some(picture) => (picture, self.state.frame(frame).view.frame_from_first * own_view.first_from_frame),
                None => (own, Matrix3::identity()),
            }
        });
        Some(Stack::of(query.image, query.radius_px, &frames))
    }

    /// Whether a blob of this probability by the motion network is to be measured.
    pub fn is_worth_measuring(&self, probability: f64) -> bool {
        probability > self.config.evidence.measured_from
    }

    /// Takes the motion network's probability that the blob of a query is a ball.
    pub fn tell_motion(&mut self, query: &Query, probability: f64) {
        if let Some(blob) = query.blob {
            self.state.add_motion(blob, log_odds(probability, &self.config.evidence));
        }
    }

    /// Takes the detector's answer: the ball that it measures there (`Localiser::detect_near`), if it sees one.
    pub fn tell(&mut self, query: &Query, ball: Option<Detection>) {
        match query.blob {
            Some(blob) => self.state.add_evidence(blob, Evidence::of(ball, &self.config.evidence)),
            None => ball.into_iter().for_each(|ball| self.found(query.frame, ball)),
        }
    }

    /// Takes a ball that the detector proposes in a frame, however unlikely: differences between frames split a large ball into its edges, so it
    /// becomes a candidate of its own size.
    pub fn propose(&mut self, frame: FrameId, ball: Detection) {
        let config = self.config.evidence;
        if ball.confidence >= config.seen_alone {
            return self.found(frame, ball);
        }
        if ball.confidence < config.proposed_from {
            return;
        }
        if frame.0 >= self.state.segmented() {
            return self.schedule.found.push((frame, ball));
        }
        let seen = self.state.frame(frame);
        let own = Blob::of_detection(&ball, &self.config.blobs).in_first(&seen.view);
        let is_it = |blob: &Blob<FirstView>| {
            let is_near = blob.at.distance(&own.at) < config.same_place * own.radius;
            is_near && alike(blob, &own, self.config.tracklets.alike)
        };
        let known = seen.candidates().find(|(_, blob)| is_it(blob)).map(|(id, _)| id);
        if known.is_some_and(|blob| self.state.evidence(blob).is_queried()) {
            return;
        }
        let blob = known.unwrap_or_else(|| self.state.add_candidate(frame, own));
        self.schedule.queried.insert(blob);
        self.state.add_evidence(blob, Evidence::of(Some(ball), &config));
    }

    /// Whether a ball that the detector found in a frame is at none of the places at which it found one in another frame (`others`).
    pub fn has_moved(&self, frame: FrameId, ball: &Detection, other: FrameId, others: &[Detection]) -> bool {
        let first = |frame: FrameId, ball: &Detection| {
            Blob::of_detection(ball, &self.config.blobs).in_first(&self.state.frame(frame).view)
        };
        let own = first(frame, ball);
        let same = self.config.evidence.same_place * own.radius;
        !others.iter().any(|ball| first(other, ball).at.distance(&own.at) < same)
    }

    /// Takes a ball that a network found in a frame, whether anything moves there or not.
    pub fn found(&mut self, frame: FrameId, ball: Detection) {
        let (config, blobs_config) = (self.config.evidence, &self.config.blobs);
        if ball.confidence < config.seen_alone {
            return;
        }
        if frame.0 >= self.state.segmented() {
            return self.schedule.found.push((frame, ball));
        }
        let seen = self.state.frame(frame);
        let own = Blob::of_detection(&ball, blobs_config).in_first(&seen.view);
        // What moves within it is a part of it.
        let is_part = |blob: &Blob<FirstView>| {
            blob.at.distance(&own.at) < (config.part * own.radius).max(config.part_least)
                && blob.radius < config.part_radius * own.radius
        };
        let mut parts: Vec<(BlobId, f64)> =
            seen.candidates().filter(|(_, blob)| is_part(blob)).map(|(id, blob)| (id, blob.radius)).collect();
        parts.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut parts = parts.into_iter().map(|(id, _)| id);
        let blob = parts.next().unwrap_or_else(|| self.state.add_candidate(frame, own));
        parts.for_each(|part| self.state.absorb(part));
        self.schedule.queried.insert(blob);
        self.state.add_evidence(blob, Evidence::of(Some(ball), &config));
    }
}
