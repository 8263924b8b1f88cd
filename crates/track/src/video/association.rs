//! Association: the sequence of tracklets that belongs to one ball.

use super::config::{AssociationConfig, TrackerConfig};
use super::state::{BlobId, FrameId, State};
use super::tracklets::alike;
use gravisight_geometry::statistics::median;

/// A part of a tracklet that may be the ball.
#[derive(Debug, Clone)]
pub(super) struct TrackletSegment {
    /// One a frame at most, by frame.
    pub members: Vec<BlobId>,
    /// The frames of the first and the last of them.
    pub frames: [FrameId; 2],
    /// Log-odds that it is the ball.
    pub log_odds: f64,
    /// Whether its own log-odds confirm a track.
    pub confirms: bool,
}

impl TrackletSegment {
    fn first(&self) -> usize {
        self.frames[0].0
    }

    fn last(&self) -> usize {
        self.frames[1].0
    }

    /// Its candidate in a frame.
    fn in_frame(&self, frame: FrameId, state: &State) -> Option<BlobId> {
        let found = self.members.binary_search_by_key(&frame, |&member| state.frame_of(member));
        found.ok().map(|place| self.members[place])
    }

    /// Probability that this is the ball.
    pub fn confidence(&self) -> f64 {
        1.0 / (1.0 + (-self.log_odds).exp())
    }

    /// Probability that it is the ball, less the probability that it is not.
    fn margin(&self) -> f64 {
        2.0 * self.confidence() - 1.0
    }

    /// Its frames, weighted by the odds that they show the ball; beyond a hundred to one, odds are not known.
    fn weight(&self) -> f64 {
        self.members.len() as f64 * self.log_odds.exp().min(100.0)
    }

    /// Expected number of its frames that show the ball, less those that do not.
    fn score(&self) -> f64 {
        self.members.len() as f64 * self.margin()
    }

    /// Whether a ball can fly this and then the other: in a few frames they may be apart, for tracklets end where others take over.
    fn goes_before(&self, other: &Self, state: &State) -> bool {
        let most = 1 + self.members.len().min(other.members.len()) / 3;
        self.first() < other.first() && self.last() < other.last() && self.apart(other, state) <= most
    }

    /// Frames in which two are in different places.
    fn apart(&self, other: &Self, state: &State) -> usize {
        let is_elsewhere = |&&member: &&BlobId| {
            other.in_frame(state.frame_of(member), state).is_some_and(|there| {
                let [a, b] = [member, there].map(|member| state.blob(member));
                a.at.distance(&b.at) > a.radius.min(b.radius)
            })
        };
        self.members.iter().filter(is_elsewhere).count()
    }

    /// Whether both cannot be one ball's: they are in different places in most of the frames of both.
    fn is_rival_of(&self, other: &Self, state: &State) -> bool {
        let both = (self.last().min(other.last()) + 1).saturating_sub(self.first().max(other.first()));
        let shared = self.members.iter().filter(|&&member| other.in_frame(state.frame_of(member), state).is_some());
        let goes_on = self.goes_before(other, state) || other.goes_before(self, state);
        both >= 2 && !goes_on && 2 * self.apart(other, state) >= shared.count()
    }

    /// What the scores of two lose together, since a ball is in one place: the lower of their scores in the frames of both.
    fn overlap_penalty(&self, later: &Self, free: usize) -> f64 {
        let shared = (self.last() + 1).saturating_sub(later.first());
        let each = |segment: &Self| segment.score() / (segment.last() - segment.first() + 1) as f64;
        shared.saturating_sub(free) as f64 * each(self).min(each(later))
    }

    /// Whether it shares a candidate with another, or is where that is in most of the frames of both.
    fn is_beside(&self, other: &Self, state: &State) -> bool {
        let shared = self.members.iter().filter(|&&member| other.in_frame(state.frame_of(member), state).is_some());
        let (shared, apart) = (shared.count(), self.apart(other, state));
        self.members.iter().any(|member| other.members.contains(member)) || shared > 2 * apart
    }

    /// Whether the other, which begins soon after this ends, is as large as this then: a ball is not suddenly nearer.
    fn is_as_large(&self, later: &Self, state: &State, config: &AssociationConfig) -> bool {
        let radius =
            |members: &[BlobId]| median(members.iter().map(|&member| state.blob(member).radius)).unwrap_or(f64::NAN);
        let end = radius(&self.members[self.members.len().saturating_sub(config.at_end)..]);
        let start = radius(&later.members[..later.members.len().min(config.at_end)]);
        (config.as_large.recip()..config.as_large).contains(&(start / end))
    }

    /// Whether the other begins where and when this ends.
    fn meets(&self, later: &Self, state: &State, config: &TrackerConfig) -> bool {
        let AssociationConfig { between: most_between, meets_px, meets_step, .. } = config.association;
        let between = later.first().saturating_sub(self.last());
        let [end, before] = [1, 2].map(|back| state.blob(self.members[self.members.len() - back]));
        let start = state.blob(later.members[0]);
        let (step, off) = (end.at.distance(&before.at), end.at.distance(&start.at));
        let near = meets_px + meets_step * step * between.max(1) as f64;
        self.goes_before(later, state)
            && between <= most_between
            && off <= near
            && alike(end, start, config.tracklets.alike)
    }
}

/// The tracks of balls, the likeliest first, each the segments that one ball can fly, ascending: the one with the highest total score, the best of
/// what is left beside it, and so on. The segments before and after one support it.
pub(super) fn tracks(
    state: &State,
    config: &TrackerConfig,
    mut segments: Vec<TrackletSegment>,
) -> Vec<Vec<TrackletSegment>> {
    segments.sort_by_key(TrackletSegment::last);
    // Without a motion network a shadow has the log-odds of its ball, and would divide them.
    if state.has_motion() {
        exclude(state, config.association.second_ball, &mut segments);
    }
    support(state, config, &mut segments);
    segments.retain(|segment| segment.confidence() >= config.association.min_confidence);
    let mut tracks = vec![];
    while tracks.len() < config.association.most_tracks {
        let track = chain(state, config, &segments);
        if track.is_empty() {
            break;
        }
        segments.retain(|segment| !track.iter().any(|own| segment.is_beside(own, state)));
        let confirmed = track.chunk_by(|one, next| next.first() <= one.last() + config.association.soon);
        let confirmed = confirmed.filter(|track| track.iter().any(|segment| segment.confirms)).flatten().cloned();
        tracks.push(confirmed.collect());
    }
    tracks.retain(|track: &Vec<TrackletSegment>| !track.is_empty());
    // A short track that is surely a ball's goes before a long one that may be.
    let weight = |track: &Vec<TrackletSegment>| track.iter().map(TrackletSegment::weight).sum::<f64>();
    tracks.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    tracks
}

/// The segments (by their last frames, ascending) that one ball can fly with the highest total score.
fn chain(state: &State, config: &TrackerConfig, segments: &[TrackletSegment]) -> Vec<TrackletSegment> {
    let association = &config.association;
    // Of each segment: the score of the best chain that ends with it, and the segment before it there. Of each and those before it:
    // the best end.
    let mut best: Vec<(f64, Option<usize>)> = Vec::with_capacity(segments.len());
    let mut ends: Vec<usize> = Vec::with_capacity(segments.len());
    for (place, segment) in segments.iter().enumerate() {
        let apart = segments[..place].partition_point(|other| other.last() + association.soon < segment.first());
        let near = (apart..place).filter(|&other| {
            segments[other].goes_before(segment, state) && segments[other].is_as_large(segment, state, association)
        });
        let near = near.map(|other| {
            let jump = if segments[other].meets(segment, state, config) { 0.0 } else { association.jump };
            (other, jump + segments[other].overlap_penalty(segment, association.free_overlap))
        });
        let before = near.chain(apart.checked_sub(1).map(|last| (ends[last], 0.0)));
        let options = before.map(|(other, cost)| (best[other].0 - cost, Some(other)));
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
    chosen.into_iter().rev().map(|place| segments[place].clone()).collect()
}

/// Lowers the log-odds of segments by those of their rivals, which are in different places at once: seldom do two balls fly at once. Where a segment is
/// the ball, its likeliest rival, of log-odds `R`, either is none or is a second ball, which has the probability `second`: that costs the smaller of `R`
/// and `-ln second`.
fn exclude(state: &State, second: f64, segments: &mut [TrackletSegment]) {
    let mut likeliest = vec![0.0_f64; segments.len()];
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
            if one.is_rival_of(other, state) {
                likeliest[place] = likeliest[place].max(other.log_odds);
                likeliest[other_place] = likeliest[other_place].max(one.log_odds);
            }
        }
    }
    for (segment, rival) in segments.iter_mut().zip(likeliest) {
        segment.log_odds -= rival.min(-second.ln());
    }
}

/// Adds to the log-odds of segments (by their last frames, ascending) the support of the segments before and after each: `continuation` if
/// that one is surely the ball, and nothing if it probably is not.
fn support(state: &State, config: &TrackerConfig, segments: &mut [TrackletSegment]) {
    // Of the segment before each, and of the one after.
    let mut most = vec![[0.0_f64; 2]; segments.len()];
    for (place, later) in segments.iter().enumerate() {
        let near =
            segments[..place].partition_point(|segment| segment.last() + config.association.between < later.first());
        for other in near..place {
            let earlier = &segments[other];
            if earlier.meets(later, state, config) {
                most[place][0] = most[place][0].max(earlier.margin());
                most[other][1] = most[other][1].max(later.margin());
            }
        }
    }
    for (segment, [before, after]) in segments.iter_mut().zip(most) {
        segment.log_odds += config.association.continuation * (before + after);
    }
}

#[cfg(test)]
mod tests {
    use super::super::blobs::Blob;
    use super::super::view::{FirstView, Place};
    use super::*;

    /// In each of forty frames a ball, another blob far from it, and a third twelve times as large.
    fn state() -> State {
        let blob = |x: f64, y: f64, radius: f64| Blob::<FirstView> {
            at: Place::new([x, y]),
            radius,
            reach: 5.0,
            direction: 0.0,
            is_ball: true,
            sigma: 1.0,
        };
        let frame = |frame: usize| {
            let x = 10.0 * frame as f64;
            (frame as f64 / 30.0, vec![blob(x, 100.0, 5.0), blob(x, 300.0, 5.0), blob(x, 300.0, 60.0)])
        };
        State::of([640, 480], (0..40).map(frame))
    }

    /// First frames and blobs of what is chosen of segments: the frames and the number of the blob in them.
    fn chosen(segments: &[(std::ops::Range<usize>, usize)]) -> Vec<(usize, usize)> {
        let state = state();
        let segment = |(frames, blob): &(std::ops::Range<usize>, usize)| TrackletSegment {
            members: frames.clone().map(|frame| state.frames()[frame].blobs[*blob]).collect(),
            frames: [FrameId(frames.start), FrameId(frames.end - 1)],
            log_odds: 3.0,
            confirms: true,
        };
        let tracks = tracks(&state, &TrackerConfig::default(), segments.iter().map(segment).collect());
        let chosen = tracks.into_iter().next().unwrap_or_default();
        let first = |segment: &TrackletSegment| {
            let frame = segment.first();
            let number = state.frames()[frame].blobs.iter().position(|blob| *blob == segment.members[0]).unwrap();
            (frame, number)
        };
        chosen.iter().map(first).collect()
    }

    #[test]
    fn tracklets_that_share_the_ball_are_chained_and_others_are_not() {
        assert_eq!(chosen(&[(0..18, 0), (7..40, 0)]), [(0, 0), (7, 0)]);
        assert_eq!(chosen(&[(0..18, 1), (7..40, 0)]), [(7, 0)]);
    }

    #[test]
    fn a_ball_is_not_suddenly_nearer() {
        assert_eq!(chosen(&[(0..9, 1), (11..40, 0)]), [(0, 1), (11, 0)]);
        assert_eq!(chosen(&[(0..9, 2), (11..40, 0)]), [(11, 0)]);
        // after a while it may be
        assert_eq!(chosen(&[(0..9, 2), (25..40, 0)]), [(0, 2), (25, 0)]);
    }
}
