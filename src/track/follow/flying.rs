//! What flew in a video, and which of it is the ball.

use std::collections::BTreeMap;

use super::Kept;
use super::arcs::{Arc, EVEN, Seen, chain};

/// What it gains an arc that a network sees a ball in a frame of it, and what it costs that it sees none there; of small ones
/// that costs less, for networks miss them.
const SEEN: f64 = 3.0;
const NOT_SEEN: f64 = 2.0;
const SMALL_NOT_SEEN: f64 = 0.3;
/// Frames in a row that the network says the same of where an arc is cut.
const RUN: usize = 3;
/// Radius below which a ball is small, px.
const SMALL: f64 = 3.0;
/// How much of an arc's gain changes the odds that it is the ball by e.
const GAIN_SPREAD: f64 = 6.0;

/// Something that flies, in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Followed {
    /// Number of its arc.
    pub arc: usize,
    /// Middle of it, or of the streak that it left, px.
    pub image: [f64; 2],
    /// Half the width of that, px.
    pub radius_px: f64,
    /// Half its length, px.
    pub reach_px: f64,
}

/// A frame of a video that was followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowedFrame {
    /// When it was taken, s.
    pub time: f64,
    /// Whether it shows the frame before again.
    pub repeated: bool,
    /// The ball, where it is seen.
    pub ball: Option<Followed>,
    /// Probability that this is the ball; 0 without one.
    pub confidence: f64,
}

/// All that flew in a video.
pub struct Flying {
    kept: Vec<Kept>,
    seen: Vec<Seen>,
    arcs: Vec<Arc>,
    /// Numbers of the frames of which `seen` tells.
    numbers: Vec<usize>,
    cuts: Vec<usize>,
    /// Whether a network sees a ball, by arc and frame.
    told: BTreeMap<(usize, usize), bool>,
}

impl Flying {
    pub(super) fn new(kept: Vec<Kept>, seen: Vec<Seen>, arcs: Vec<Arc>, cuts: &[usize]) -> Self {
        let numbers: Vec<usize> =
            kept.iter().enumerate().filter(|(_, kept)| !kept.repeated).map(|(number, _)| number).collect();
        let cuts = cuts.iter().map(|&place| numbers[place]).collect();
        Self { kept, seen, arcs, numbers, cuts, told: BTreeMap::new() }
    }

    /// Frames, to within one, from which on most of the picture is another: a cut, or the camera moved.
    pub fn cuts(&self) -> &[usize] {
        &self.cuts
    }

    /// What flies in a frame: of each a network may say whether it is a ball ([`Self::tell`]).
    pub fn in_frame(&self, frame: usize) -> Vec<Followed> {
        let Ok(place) = self.numbers.binary_search(&frame) else { return vec![] };
        let member = |arc: &Arc| arc.members.binary_search_by_key(&place, |member| member.0).ok();
        let here = self.arcs.iter().enumerate().filter_map(|(number, arc)| Some((number, arc.members[member(arc)?])));
        here.map(|(number, member)| self.followed(number, member)).collect()
    }

    /// Takes a network's word on one of [`Self::in_frame`].
    pub fn tell(&mut self, frame: usize, followed: &Followed, is_ball: bool) {
        self.told.insert((followed.arc, frame), is_ball);
    }

    /// The ball, frame by frame.
    pub fn frames(&self) -> Vec<FollowedFrame> {
        let frame =
            |kept: &Kept| FollowedFrame { time: kept.time, repeated: kept.repeated, ball: None, confidence: 0.0 };
        let mut frames: Vec<FollowedFrame> = self.kept.iter().map(frame).collect();
        let pieces: Vec<(usize, Arc)> = (self.arcs.iter().enumerate())
            .flat_map(|(number, arc)| self.pieces(number, arc).into_iter().map(move |piece| (number, piece)))
            .collect();
        let arcs: Vec<Arc> = pieces.iter().map(|(_, piece)| piece.clone()).collect();
        for index in chain(&self.seen, &arcs) {
            let (number, arc) = &pieces[index];
            let whole: f64 =
                arcs.iter().filter(|piece| piece.number == arc.number).map(|piece| piece.gain.max(0.0)).sum();
            let confidence = 1.0 / (1.0 + (-(whole - EVEN) / GAIN_SPREAD).exp());
            for &member in &arc.members {
                let frame = &mut frames[self.numbers[member.0]];
                // Where two arcs share frames, the network's word decides.
                let before = frame.ball.map(|ball| self.gain(ball.arc, member.0, ball.radius_px));
                let ball = self.followed(*number, member);
                if before.is_none_or(|before| self.gain(*number, member.0, ball.radius_px) >= before) {
                    (frame.ball, frame.confidence) = (Some(ball), confidence);
                }
            }
        }
        frames
    }

    /// What the network's word on an arc is worth in a frame of those that are not repeated.
    fn gain(&self, arc: usize, place: usize, radius_px: f64) -> f64 {
        match self.told.get(&(arc, self.numbers[place])) {
            None => 0.0,
            Some(true) => SEEN,
            Some(false) if radius_px < SMALL => -SMALL_NOT_SEEN,
            Some(false) => -NOT_SEEN,
        }
    }

    /// An arc, cut where the network begins or ceases to see a ball for some frames: a ball's arc may end where its shadow's
    /// goes on.
    fn pieces(&self, number: usize, arc: &Arc) -> Vec<Arc> {
        let gains: Vec<f64> = arc
            .members
            .iter()
            .map(|&(place, index)| self.gain(number, place, self.seen[place].blobs[index].radius))
            .collect();
        let lasts = |from: usize, good: bool| {
            let run = gains[from..].iter().take(RUN);
            run.len() == RUN && run.clone().all(|&gain| gain != 0.0 && (gain > 0.0) == good)
        };
        let cut = |index: usize| {
            index > 0 && [true, false].iter().any(|&good| lasts(index, good) && (gains[index - 1] > 0.0) != good)
        };
        let cuts: Vec<bool> = (0..gains.len()).map(cut).collect();
        let mut pieces = arc.pieces(&cuts, &gains);
        pieces.iter_mut().for_each(|piece| piece.gain -= self.doubt(number, piece));
        pieces
    }

    /// What a part of an arc loses whose things are large enough to be seen as balls and are not: that it flies speaks for it
    /// only as far as the network sees it.
    fn doubt(&self, number: usize, piece: &Arc) -> f64 {
        let told = piece.members.iter().filter_map(|&(place, index)| {
            let large = self.seen[place].blobs[index].radius >= SMALL;
            self.told.get(&(number, self.numbers[place])).filter(|_| large)
        });
        let (count, seen) =
            told.fold((0.0, 0.0), |(count, seen), &told| (count + 1.0, seen + f64::from(u8::from(told))));
        let unseen = 1.0 - (seen + 1.0) / (count + 2.0);
        if count > 0.0 { piece.gain.max(0.0) * count / piece.members.len() as f64 * unseen } else { 0.0 }
    }

    fn followed(&self, arc: usize, (frame, index): (usize, usize)) -> Followed {
        let blob = &self.seen[frame].blobs[index];
        Followed { arc, image: blob.at, radius_px: blob.radius, reach_px: blob.reach }
    }
}
