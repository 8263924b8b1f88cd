//! Association: the sequence of tracklets that belongs to one ball.

use super::config::TrackerConfig;
use super::tracklets::{Candidates, alike};
use gravisight_geometry::statistics::median;

/// Most frames between a tracklet and its continuation, and the largest distance between their ends: px, and steps.
const BETWEEN: usize = 8;
const MEETS_PX: f64 = 12.0;
const MEETS_STEP: f64 = 1.5;
/// Frames after a segment's end within which the ball is still as large as there, the ratio of the radii up to which it is, and the
/// blobs at either end that tell.
const SOON: usize = 12;
const AS_LARGE: f64 = 2.2;
const AT_END: usize = 3;
/// Frames that two tracklets may share at no cost: one's last and the other's first.
const FREE_OVERLAP: usize = 1;

/// A part of a tracklet that may be the ball.
#[derive(Debug, Clone)]
pub(super) struct TrackletSegment {
    /// Frames and blobs' numbers, ascending.
    pub members: Vec<(usize, usize)>,
    /// Log-odds that it is the ball.
    pub log_odds: f64,
    /// Whether a motion network was queried.
    pub verified: bool,
    /// Whether its own log-odds confirm a track.
    pub confirms: bool,
}

impl TrackletSegment {
    fn first(&self) -> usize {
        self.members[0].0
    }

    fn last(&self) -> usize {
        self.members[self.members.len() - 1].0
    }

    /// Probability that this is the ball.
    pub fn confidence(&self) -> f64 {
        1.0 / (1.0 + (-self.log_odds).exp())
    }

    /// Probability that it is the ball, less the probability that it is not.
    fn margin(&self) -> f64 {
        2.0 * self.confidence() - 1.0
    }

    /// Expected number of its frames that show the ball, less those that do not.
    fn score(&self) -> f64 {
        self.members.len() as f64 * self.margin()
    }

    /// Whether a ball can fly this and then the other: in a few frames they may be apart, for tracklets end where others take over.
    fn goes_before(&self, other: &Self, frames: &[Candidates]) -> bool {
        let most = 1 + self.members.len().min(other.members.len()) / 3;
        self.first() < other.first() && self.last() < other.last() && self.apart(other, frames) <= most
    }

    /// Frames in which two are in different places.
    fn apart(&self, other: &Self, frames: &[Candidates]) -> usize {
        let is_elsewhere = |&&(frame, index): &&(usize, usize)| {
            let there = other.members.binary_search_by_key(&frame, |member| member.0);
            there.is_ok_and(|there| {
                let [a, b] = [index, other.members[there].1].map(|index| &frames[frame].blobs[index]);
                (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) > a.radius.min(b.radius)
            })
        };
        self.members.iter().filter(is_elsewhere).count()
    }

    /// What the scores of two lose together, since a ball is in one place: the lower of their scores in the frames of both.
    fn overlap_penalty(&self, later: &Self) -> f64 {
        let shared = (self.last() + 1).saturating_sub(later.first());
        let each = |segment: &Self| segment.score() / (segment.last() - segment.first() + 1) as f64;
        shared.saturating_sub(FREE_OVERLAP) as f64 * each(self).min(each(later))
    }

    /// Whether the other, which begins soon after this ends, is as large as this then: a ball is not suddenly nearer.
    fn is_as_large(&self, later: &Self, frames: &[Candidates]) -> bool {
        let radius = |members: &[(usize, usize)]| {
            median(members.iter().map(|&(frame, index)| frames[frame].blobs[index].radius)).unwrap_or(f64::NAN)
        };
        let end = radius(&self.members[self.members.len().saturating_sub(AT_END)..]);
        let start = radius(&later.members[..later.members.len().min(AT_END)]);
        (AS_LARGE.recip()..AS_LARGE).contains(&(start / end))
    }

    /// Whether the other begins where and when this ends.
    fn meets(&self, later: &Self, frames: &[Candidates]) -> bool {
        let blob = |(frame, index): (usize, usize)| &frames[frame].blobs[index];
        let between = later.first().saturating_sub(self.last());
        let (end, start) = (blob(self.members[self.members.len() - 1]), blob(later.members[0]));
        let before = blob(self.members[self.members.len() - 2]);
        let step = (end.at[0] - before.at[0]).hypot(end.at[1] - before.at[1]);
        let off = (end.at[0] - start.at[0]).hypot(end.at[1] - start.at[1]);
        let near = MEETS_PX + MEETS_STEP * step * between.max(1) as f64;
        self.goes_before(later, frames) && between <= BETWEEN && off <= near && alike(end, start)
    }
}

/// The segments that one ball can fly: those with the highest total score, ascending. The segments before and after one support it.
pub(super) fn chain(
    frames: &[Candidates],
    config: &TrackerConfig,
    mut segments: Vec<TrackletSegment>,
) -> Vec<TrackletSegment> {
    segments.sort_by_key(TrackletSegment::last);
    // Without a motion network a shadow has the log-odds of its ball, and would divide them.
    if segments.iter().any(|segment| segment.verified) {
        exclude(frames, &mut segments);
    }
    support(frames, config.continuation, &mut segments);
    segments.retain(|segment| segment.confidence() >= config.min_confidence);
    // Of each segment: the score of the best chain that ends with it, and the segment before it there. Of each and those before it:
    // the best end.
    let mut best: Vec<(f64, Option<usize>)> = Vec::with_capacity(segments.len());
    let mut ends: Vec<usize> = Vec::with_capacity(segments.len());
    for (place, segment) in segments.iter().enumerate() {
        let apart = segments[..place].partition_point(|other| other.last() + SOON < segment.first());
        let near = (apart..place).filter(|&other| {
            segments[other].goes_before(segment, frames) && segments[other].is_as_large(segment, frames)
        });
        let before = near.chain(apart.checked_sub(1).map(|last| ends[last]));
        let options = before.map(|other| (best[other].0 - segments[other].overlap_penalty(segment), Some(other)));
        let (score, from) = options.fold((0.0, None), |best, option| if option.0 > best.0 { option } else { best });
        best.push((score + segment.score(), from));
        let end = ends.last().filter(|&&end| best[end].0 >= best[place].0);
        ends.push(end.copied().unwrap_or(place));
    }
    let mut at = ends.last().copied();
    let mut chosen = Vec::new();
    while let Some(place) = at {
        chosen.push(place);
        at = best[place].1;
    }
    chosen.reverse();
    let chosen: Vec<TrackletSegment> = chosen.into_iter().map(|place| segments[place].clone()).collect();
    let tracks = chosen.chunk_by(|one, next| next.first() <= one.last() + SOON);
    tracks.filter(|track| track.iter().any(|segment| segment.confirms)).flatten().cloned().collect()
}

/// Lowers the log-odds of segments by those of their rivals: one ball flies, in one place. Where several segments are in different places
/// at once, each is the ball with the odds `eᴸ / (1 + Σ eᴿ)`. In each frame only the greatest rival counts.
fn exclude(frames: &[Candidates], segments: &mut [TrackletSegment]) {
    let mut rivals: Vec<Vec<f64>> =
        segments.iter().map(|segment| vec![f64::NEG_INFINITY; segment.last() - segment.first() + 1]).collect();
    // Of each place in the list, the first frame of all segments from there on.
    let mut earliest: Vec<usize> = segments.iter().map(TrackletSegment::first).collect();
    for place in (1..earliest.len()).rev() {
        earliest[place - 1] = earliest[place - 1].min(earliest[place]);
    }
    for (place, one) in segments.iter().enumerate() {
        for (other_place, other) in segments.iter().enumerate().skip(place + 1) {
            if earliest[other_place] >= one.last() {
                break;
            }
            let both = one.first().max(other.first())..one.last().min(other.last()) + 1;
            let shared =
                one.members.iter().filter(|member| other.members.binary_search_by_key(&member.0, |it| it.0).is_ok());
            if both.len() < 2 || 2 * one.apart(other, frames) < shared.count() {
                continue;
            }
            for frame in both {
                for (own, rival) in [(place, other), (other_place, one)] {
                    let most = &mut rivals[own][frame - segments[own].first()];
                    *most = most.max(rival.log_odds);
                }
            }
        }
    }
    for (segment, rivals) in segments.iter_mut().zip(rivals) {
        let sum: f64 = rivals.iter().map(|&rival| rival.exp().ln_1p()).sum();
        segment.log_odds -= sum / rivals.len() as f64;
    }
}

/// Adds to the log-odds of segments (by their last frames, ascending) the support of the segments before and after each: `continuation` if
/// that one is surely the ball, and nothing if it probably is not.
fn support(frames: &[Candidates], continuation: f64, segments: &mut [TrackletSegment]) {
    // Of the segment before each, and of the one after.
    let mut most = vec![[0.0_f64; 2]; segments.len()];
    for (place, later) in segments.iter().enumerate() {
        let near = segments[..place].partition_point(|segment| segment.last() + BETWEEN < later.first());
        for other in near..place {
            let earlier = &segments[other];
            if earlier.meets(later, frames) {
                most[place][0] = most[place][0].max(earlier.margin());
                most[other][1] = most[other][1].max(later.margin());
            }
        }
    }
    for (segment, [before, after]) in segments.iter_mut().zip(most) {
        segment.log_odds += continuation * (before + after);
    }
}

#[cfg(test)]
mod tests {
    use super::super::blobs::Blob;
    use super::*;

    const BLOB: Blob = Blob { at: [0.0; 2], radius: 5.0, reach: 5.0, direction: 0.0, is_ball: true, sigma: 1.0 };

    /// In each of forty frames a ball, another blob far from it, and a third twelve times as large.
    fn frames() -> Vec<Candidates> {
        let frame = |frame: usize| {
            let x = 10.0 * frame as f64;
            let other = Blob { at: [x, 300.0], ..BLOB };
            let blobs = vec![Blob { at: [x, 100.0], ..BLOB }, other, Blob { radius: 60.0, ..other }];
            Candidates { time: frame as f64 / 30.0, blobs }
        };
        (0..40).map(frame).collect()
    }

    fn segment(frames: std::ops::Range<usize>, blob: usize) -> TrackletSegment {
        TrackletSegment {
            members: frames.map(|frame| (frame, blob)).collect(),
            log_odds: 3.0,
            verified: false,
            confirms: true,
        }
    }

    /// First frames and blobs of what is chosen.
    fn chosen(segments: Vec<TrackletSegment>) -> Vec<(usize, usize)> {
        chain(&frames(), &TrackerConfig::default(), segments).iter().map(|segment| segment.members[0]).collect()
    }

    #[test]
    fn tracklets_that_share_the_ball_are_chained_and_others_are_not() {
        assert_eq!(chosen(vec![segment(0..18, 0), segment(7..40, 0)]), [(0, 0), (7, 0)]);
        assert_eq!(chosen(vec![segment(0..18, 1), segment(7..40, 0)]), [(7, 0)]);
    }

    #[test]
    fn a_ball_is_not_suddenly_nearer() {
        assert_eq!(chosen(vec![segment(0..9, 1), segment(11..40, 0)]), [(0, 1), (11, 0)]);
        assert_eq!(chosen(vec![segment(0..9, 2), segment(11..40, 0)]), [(11, 0)]);
        // after a while it may be
        assert_eq!(chosen(vec![segment(0..9, 2), segment(25..40, 0)]), [(0, 2), (25, 0)]);
    }
}
