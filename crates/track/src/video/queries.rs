//! Queries for the networks while frames come: blobs of objects that seem to fly, and predicted positions where none is seen.

use std::collections::{BTreeMap, BTreeSet};

use super::BallTracker;
use super::blobs::Blob;
use super::evidence::Evidence;
use super::stack::{NEIGHBOURS, Stack};
use super::tracklets::Tracklet;
use nalgebra::Matrix3;

use gravisight_geometry::camera::Detection;
use gravisight_geometry::image::Picture;

/// Frames that are held, and those among them that tracklets are searched in.
const HELD: usize = 24;
const WINDOW: usize = 16;
/// Fraction of its least displacement that a tracklet must reach in those.
const SHORT_DISPLACEMENT: f64 = 0.25;
/// Frames after which tracklets are searched again.
const STEP: usize = 8;
/// One blob of so many of a tracklet is queried, until a ball is detected in one of so many.
const QUERY_EVERY: usize = 3;
const MOST_PER_BALL: usize = 3;
/// Most such queries, for the tracklets with the highest log-likelihood ratio, while a ball is known.
const MOST_PROBES: usize = 8;
/// Frames beyond a tracklet's ends in which its predicted positions are queried, and in how many of its blobs a network must have detected
/// a ball for that.
const BEYOND: usize = 4;
const FEWEST_SEEN: usize = 3;
/// Confidence of the detector from which it sees a ball where nothing stands out from the background.
const SEEN_ALONE: f64 = 0.5;
/// Probability by the motion network from which a blob is measured, and the least that counts (the largest is as far from 1).
const MEASURED_FROM: f64 = 0.05;
pub(super) const LEAST_PROBABILITY: f64 = 5e-4;
/// Distance of a blob's middle from what a network finds, in radii, and ratio of the radii, up to which it is a part of it.
const PART: f64 = 0.9;
const ALIKE: f64 = 1.4;
/// Least standard deviation of the place of what a network finds, px.
const LEAST_SIGMA: f64 = 0.3;
static NO_SEEDS: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
/// Largest standard deviation of a predicted position that is queried, radii.
const MOST_UNSURE: f64 = 4.0;

/// A frame's picture, until it is too old.
pub(super) struct Held {
    /// Of the frames that are not repeated.
    place: usize,
    picture: Picture,
}

/// The networks' answers, by frame (of those that are not repeated) and blob.
#[derive(Default)]
pub(super) struct Verdicts {
    /// The detector's answers.
    detector: BTreeMap<(usize, usize), Evidence>,
    /// Log-odds that a blob is a ball, by the motion network.
    motion: BTreeMap<(usize, usize), f64>,
    /// Blobs that were measured first, and for which the motion network was queried afterwards.
    queried_for_motion: BTreeSet<(usize, usize)>,
    /// Balls that were found in frames whose blobs are not known yet.
    found: Vec<(usize, Detection)>,
    /// What was queried: blobs, and the predicted positions of tracklets, by frame.
    queried: BTreeSet<(usize, usize)>,
    predicted: Vec<(usize, [f64; 2])>,
    /// The tracklets that are queried now.
    round: Option<Round>,
    /// Frames in which tracklets have been searched.
    searched: usize,
}

/// Tracklets that are verified.
struct Round {
    /// The frame that theirs are counted from.
    from: usize,
    tracklets: Vec<Tracklet>,
    /// Queries that are left for those in which no ball is detected yet.
    probes: usize,
}

impl Verdicts {
    /// The detector's answer about a blob.
    pub fn of(&self, member: (usize, usize)) -> Evidence {
        self.detector.get(&member).copied().unwrap_or(Evidence::Unqueried)
    }

    /// Whether the motion network answers.
    pub fn has_motion(&self) -> bool {
        !self.motion.is_empty()
    }

    /// Log-odds that a blob is a ball, by the motion network.
    pub fn motion(&self, member: (usize, usize)) -> Option<f64> {
        self.motion.get(&member).copied()
    }
}

/// A position for the networks to check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Query {
    place: usize,
    /// None where nothing stands out from the background.
    blob: Option<usize>,
    /// Where the ball may be, px.
    pub image: [f64; 2],
    /// About how large it is, px.
    pub radius_px: f64,
    /// How far its centre may be from there, px.
    pub reach_px: f64,
    /// Whether it was measured already: only the motion network is queried.
    pub measured: bool,
}

impl Query {
    /// Whether it is about something that moves.
    pub fn is_of_blob(&self) -> bool {
        self.blob.is_some()
    }
}

#[cfg(test)]
impl Query {
    /// The frame, of those that are not repeated.
    pub(super) fn frame(&self) -> usize {
        self.place
    }
}

impl BallTracker {
    /// Takes the next frame's picture, and forgets the oldest.
    pub(super) fn hold(&mut self, picture: Picture) {
        let place = self.held.back().map_or(0, |last| last.place + 1);
        self.held.push_back(Held { place, picture });
        if self.held.len() > HELD {
            self.held.pop_front();
        }
    }

    /// The queries for the networks: call it after each frame, and after [`Self::end`], until there are none. Answering is optional;
    /// unanswered queries lower accuracy.
    pub fn queries(&mut self) -> Vec<Query> {
        if self.verdicts.round.is_none() {
            let ended = self.now.is_none() && self.waiting.is_empty();
            let due =
                self.seen.len() >= self.verdicts.searched + STEP || (ended && self.seen.len() > self.verdicts.searched);
            if !due {
                return vec![];
            }
            self.verdicts.searched = self.seen.len();
            for (place, ball) in std::mem::take(&mut self.verdicts.found) {
                self.found(place, ball);
            }
            let from = self.seen.len().saturating_sub(WINDOW);
            self.verdicts.predicted.retain(|&(place, _)| place >= from);
            let tracklets = self.search(from, SHORT_DISPLACEMENT, self.config.min_gain, &NO_SEEDS).tracklets();
            let probes = if self.sees_ball() { MOST_PROBES } else { usize::MAX };
            self.verdicts.round = Some(Round { from, tracklets, probes });
        }
        let Some(Round { from, tracklets, mut probes }) = self.verdicts.round.take() else { return vec![] };
        let mut queries = Vec::new();
        for tracklet in &tracklets {
            let members: Vec<(usize, usize)> =
                tracklet.members.iter().map(|&(frame, blob)| (from + frame, blob)).collect();
            let answers = || members.iter().map(|&member| self.verdicts.of(member)).filter(Evidence::is_queried);
            let seen = answers().filter(Evidence::is_ball).count();
            let is_ball = seen > 0 && MOST_PER_BALL * seen >= answers().count();
            // Most of what moves is no ball: a few queries show that.
            let mut last = None;
            for (number, &member) in members.iter().enumerate() {
                let (place, blob) = member;
                if self.verdicts.queried.contains(&member) {
                    last = Some(number);
                    let measured = self.verdicts.of(member).is_ball();
                    if measured
                        && self.verdicts.motion(member).is_none()
                        && self.verdicts.queried_for_motion.insert(member)
                    {
                        let Blob { at, radius, reach, .. } =
                            self.seen[place].blobs[blob].mapped(&self.views[place].frame_from_first);
                        let query =
                            Query { place, blob: Some(blob), image: at, radius_px: radius, reach_px: reach, measured };
                        queries.push(query);
                    }
                } else if is_ball || (probes > 0 && last.is_none_or(|last| number >= last + QUERY_EVERY)) {
                    last = Some(number);
                    probes -= usize::from(!is_ball);
                    self.verdicts.queried.insert(member);
                    let Blob { at, radius, reach, .. } =
                        self.seen[place].blobs[blob].mapped(&self.views[place].frame_from_first);
                    queries.push(Query {
                        place,
                        blob: Some(blob),
                        image: at,
                        radius_px: radius,
                        reach_px: reach,
                        measured: false,
                    });
                }
            }
            if seen >= FEWEST_SEEN {
                let beyond = self.beyond(from, tracklet);
                self.verdicts.predicted.extend(beyond.iter().map(|it| (it.place, it.image)));
                queries.extend(beyond);
            }
        }
        queries.retain(|it| self.picture(it).is_some());
        if !queries.is_empty() {
            self.verdicts.round = Some(Round { from, tracklets, probes });
        }
        queries
    }

    /// Whether a network sees the ball in one of the last tracklets.
    pub fn sees_ball(&self) -> bool {
        let from = self.seen.len().saturating_sub(WINDOW);
        self.verdicts.detector.range((from, 0)..).filter(|(_, evidence)| evidence.is_ball()).count() >= FEWEST_SEEN
    }

    /// Where the ball of a tracklet may be in the frames before and after it.
    fn beyond(&self, from: usize, tracklet: &Tracklet) -> Vec<Query> {
        let search = self.search(from, SHORT_DISPLACEMENT, self.config.min_gain, &NO_SEEDS);
        let (first, last) = (tracklet.members[0].0, tracklet.members[tracklet.members.len() - 1].0);
        let before = first.saturating_sub(BEYOND)..first;
        let after = last + 1..(last + 1 + BEYOND).min(search.frames.len());
        let within =
            (first..last).filter(|frame| tracklet.members.binary_search_by_key(frame, |member| member.0).is_err());
        let queries = before.chain(within).chain(after).filter_map(|frame| {
            let (at, unsure, radius) = search.leads(tracklet, frame)?;
            let view = &self.views[from + frame];
            let image = view.frame(at);
            let larger = view.scale(image).recip();
            let [unsure, radius_px] = [unsure, radius].map(|px| px * larger);
            let inside = (0..2).all(|axis| (0.0..self.size[axis] as f64).contains(&image[axis]));
            let near = |&(place, at): &(usize, [f64; 2])| {
                place == from + frame && (at[0] - image[0]).hypot(at[1] - image[1]) < radius_px.max(2.0)
            };
            let query = Query {
                place: from + frame,
                blob: None,
                image,
                radius_px,
                reach_px: radius_px + 2.0 * unsure,
                measured: false,
            };
            (inside && unsure < MOST_UNSURE * radius_px && !self.verdicts.predicted.iter().any(near)).then_some(query)
        });
        queries.collect()
    }

    /// The picture of a query's frame; none where it is too old.
    pub fn picture(&self, query: &Query) -> Option<&Picture> {
        self.held(query.place)
    }

    /// The number of the last frame among those that are not repeated.
    pub fn newest(&self) -> Option<usize> {
        self.held.back().map(|held| held.place)
    }

    /// The picture of a frame, by its number among those that are not repeated; none where it is too old.
    pub fn held(&self, place: usize) -> Option<&Picture> {
        self.held.iter().find(|held| held.place == place).map(|held| &held.picture)
    }

    /// All candidates of a frame, by its number among those that are not repeated.
    pub fn candidates(&self, place: usize) -> Vec<Query> {
        let Some(seen) = self.seen.get(place) else { return vec![] };
        let query = |(blob, it): (usize, &Blob)| {
            let Blob { at, radius, reach, .. } = it.mapped(&self.views[place].frame_from_first);
            Query { place, blob: Some(blob), image: at, radius_px: radius, reach_px: reach, measured: false }
        };
        seen.blobs.iter().enumerate().map(query).collect()
    }

    /// The index in the video of the frame that a query is about.
    pub fn number(&self, query: &Query) -> usize {
        let shown = self.kept.iter().enumerate().filter(|(_, kept)| !kept.repeated);
        shown.map(|(number, _)| number).nth(query.place).unwrap_or(self.kept.len())
    }

    /// The stack about a blob; none where its frame is too old.
    pub fn stack(&self, query: &Query) -> Option<Stack> {
        let own = self.held(query.place)?;
        let own_view = &self.views[query.place];
        let frames = std::array::from_fn(|index| {
            let place = (query.place + index).saturating_sub(NEIGHBOURS);
            // At either end of the video, and after a cut, there is no other: as if nothing moved.
            match (self.held(place), self.views.get(place)) {
                (Some(picture), Some(view)) => (picture, view.frame_from_first * own_view.first_from_frame),
                _ => (own, Matrix3::identity()),
            }
        });
        Some(Stack::of(query.image, query.radius_px, &frames))
    }

    /// Whether a blob of this probability by the motion network is to be measured.
    pub fn is_worth_measuring(probability: f64) -> bool {
        probability > MEASURED_FROM
    }

    /// Takes the motion network's probability that the blob of a query is a ball.
    pub fn tell_motion(&mut self, query: &Query, probability: f64) {
        let probability = probability.clamp(LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY);
        if let Some(blob) = query.blob {
            self.verdicts.motion.insert((query.place, blob), (probability / (1.0 - probability)).ln());
        }
    }

    /// Takes the detector's answer: the ball that it measures there (`Localiser::detect_near`), if it sees one.
    pub fn tell(&mut self, query: &Query, ball: Option<Detection>) {
        match query.blob {
            Some(blob) => {
                let evidence = Evidence::of(ball);
                if let Some(ball) = evidence.ball() {
                    let own = blob_of(ball).mapped(&self.views[query.place].first_from_frame);
                    let blob = &mut self.seen[query.place].blobs[blob];
                    *blob = blob.measured_as(own);
                }
                self.verdicts.detector.insert((query.place, blob), evidence);
            }
            None => ball.into_iter().for_each(|ball| self.found(query.place, ball)),
        }
    }

    /// Takes a ball that a network found in a frame (by its number among those that are not repeated), whether anything moves
    /// there or not.
    pub fn found(&mut self, place: usize, ball: Detection) {
        if ball.confidence < SEEN_ALONE {
            return;
        }
        let Some(seen) = self.seen.get_mut(place) else {
            return self.verdicts.found.push((place, ball));
        };
        let own = blob_of(&ball).mapped(&self.views[place].first_from_frame);
        let Blob { at, radius, .. } = own;
        // What moves within it is a part of it.
        let is_part = |blob: &Blob| {
            (blob.at[0] - at[0]).hypot(blob.at[1] - at[1]) < (PART * radius).max(1.0) && blob.radius < ALIKE * radius
        };
        let mut parts: Vec<usize> = (0..seen.blobs.len()).filter(|&blob| is_part(&seen.blobs[blob])).collect();
        if parts.is_empty() {
            seen.blobs.push(own);
            parts.push(seen.blobs.len() - 1);
        }
        for blob in parts {
            seen.blobs[blob] = seen.blobs[blob].measured_as(own);
            self.verdicts.queried.insert((place, blob));
            self.verdicts.detector.insert((place, blob), Evidence::of(Some(ball)));
        }
    }
}

/// A ball that a network measured.
fn blob_of(ball: &Detection) -> Blob {
    let radius = ball.outline.radius;
    Blob {
        at: ball.outline.centre.coords.into(),
        radius,
        reach: radius,
        direction: 0.0,
        is_ball: true,
        sigma: ball.sigma_px().max(LEAST_SIGMA),
    }
}
