//! A hypothesis: which contacts and hits there are, and the numbers that describe the flights between them.

use std::sync::Arc;

use nalgebra::Vector3;

use gravisight_physics::{Column, FORCES, part};

/// How a segment begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begin {
    /// With the track.
    Start,
    /// By a contact with the obstacle of this index.
    Bounce(usize),
    /// At the frame after an interval in which it touches something for a while, in the state to which the forecaster leads it from the
    /// frame before.
    LastingContact,
    /// By something that the scene does not hold: a racket, a foot, the net's cord.
    Hit,
}

/// A free flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    pub begin: Begin,
    /// When it begins, s.
    pub time: f64,
    /// Position, velocity and spin then, after the contact or hit.
    pub state: Column,
}

/// Numbers that describe a segment: its time, position, velocity, spin.
pub const OF_SEGMENT: usize = 10;
/// Numbers that all segments share: logarithms of the forces' scales and of the apparent size's.
pub const SHARED: usize = FORCES + 1;

/// Segments that are searched while the others stay.
pub type Span = std::ops::Range<usize>;

/// A trajectory over some frames of a track.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    pub segments: Vec<Segment>,
    /// Logarithms of the forces' sizes over the scene's.
    pub log_scales: [f64; FORCES],
    /// Logarithm of the distances by the apparent size over the true ones.
    pub log_size: f64,
    /// Standard deviation of the labels, px.
    pub noise: f64,
    /// First and last frame.
    pub first: usize,
    pub last: usize,
    /// When each frame of the track was taken, s.
    pub times: Arc<Vec<f64>>,
}

impl Segment {
    pub fn position(&self) -> Vector3<f64> {
        part(&self.state, 0)
    }

    pub fn velocity(&self) -> Vector3<f64> {
        part(&self.state, 1)
    }
}

impl Trajectory {
    /// Whether its segments begin one after the other, each between its first frame and its last.
    pub fn is_in_order(&self) -> bool {
        let rising = self.segments.windows(2).all(|pair| pair[1].time > pair[0].time);
        let is_within = |last: &Segment| last.time < self.times[self.last] || last.begin == Begin::LastingContact;
        rising && (self.segments.len() == 1 || self.segments.last().is_some_and(is_within))
    }

    /// The frames of a segment, and where they end.
    pub fn frames(&self, segment: usize) -> std::ops::Range<usize> {
        let all = &self.times[self.first..=self.last];
        let from = match segment {
            0 => 0,
            _ => all.partition_point(|&time| time < self.segments[segment].time),
        };
        let to = match self.segments.get(segment + 1) {
            Some(next) => all.partition_point(|&time| time < next.time),
            None => all.len(),
        };
        self.first + from..self.first + to.max(from)
    }

    /// Until when a segment flies freely, s: to the next one's beginning, or to the last frame before a contact that lasts.
    pub fn end_of_flight(&self, segment: usize) -> f64 {
        match self.segments.get(segment + 1) {
            Some(next) if next.begin == Begin::LastingContact => self.times[self.frames(segment + 1).start - 1],
            Some(next) => next.time,
            None => self.times[self.last],
        }
    }

    /// All segments.
    pub fn all(&self) -> Span {
        0..self.segments.len()
    }

    pub fn hits(&self) -> usize {
        self.segments.iter().filter(|segment| segment.begin == Begin::Hit).count()
    }

    /// The same, moved by a step of the numbers of a span of segments, and of the shared ones.
    pub fn moved(&self, span: &Span, segments: &[nalgebra::SVector<f64, OF_SEGMENT>], shared: &[f64; SHARED]) -> Self {
        let mut out = self.clone();
        for (segment, step) in out.segments[span.clone()].iter_mut().zip(segments) {
            // Frames are taken when they are.
            segment.time += if segment.begin == Begin::LastingContact { 0.0 } else { step[0] };
            segment.state.iter_mut().zip(step.iter().skip(1)).for_each(|(value, by)| *value += by);
        }
        out.log_scales.iter_mut().zip(shared).for_each(|(value, by)| *value += by);
        out.log_size += shared[FORCES];
        out
    }
}
