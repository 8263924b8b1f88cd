//! Stacks of frames around what moves in a labelled video: what the motion network learns from.

use nalgebra::Point2;

use super::super::examples::stack_record;
use crate::localise::Localiser;
use gravisight_geometry::camera::Detection;
use gravisight_geometry::error::Result;
use gravisight_geometry::image::Picture;
use gravisight_track::{BallTracker, FrameId, Query};

/// Distance of a candidate's centre from the ball's within which it is the ball, px: labels made by hand are good to 2 px.
const NEAR_PX: f64 = 4.0;
/// Other candidates of a frame that are kept besides those that lie on paths of a ball: every so manieth.
const OTHERS_EVERY: usize = 16;
/// Of the candidates on such paths that are no ball, one of so many is kept.
const WANTED_EVERY: usize = 2;
/// Every how manieth frame the detector proposes balls in.
const PROPOSED_EVERY: usize = 4;
/// Frames that a candidate waits for those after it, and for its own to be compared with the next.
const MARGIN: usize = 4;

/// The balls of a frame, px, with their radii where those are known; none of a frame that has no labels.
pub type BallsOfFrame = Option<Vec<(Point2<f64>, Option<f64>)>>;

/// What a stack is cut about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// A candidate on a path that may be a ball's.
    Tracklet,
    /// A ball that the detector proposes.
    Proposal,
    /// Any other candidate.
    Other,
}

/// Cuts stacks from the frames of a video, one after the other, at the candidates that the tracker itself proposes.
#[derive(Default)]
pub struct StackCutter {
    follower: BallTracker,
    /// Frames whose candidates have been cut, and candidates so far.
    done: usize,
    count: usize,
}

/// A stack as a record of a file of stacks, the frame of its middle, and whether that is a ball's.
pub struct CutStack {
    /// Its pictures and its ball.
    pub record: Vec<u8>,
    /// Index of the frame in the video.
    pub frame: usize,
    /// Whether the ball is in the middle.
    pub is_ball: bool,
}

impl StackCutter {
    /// Takes the next frame, of `time` s: the stacks that are whole by now. `labels` gives the balls of a frame by its index; the detector of
    /// `localiser`, if there is one, proposes further candidates.
    ///
    /// # Errors
    /// As [`BallTracker::watch`] and [`Localiser::propose`].
    pub async fn add(
        &mut self,
        picture: Picture,
        time: f64,
        localiser: Option<&Localiser>,
        labels: &dyn Fn(usize) -> BallsOfFrame,
    ) -> Result<Vec<CutStack>> {
        self.follower.watch(picture, time)?;
        self.take(MARGIN, localiser, labels).await
    }

    /// There are no more frames: the stacks that are left.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub async fn end(
        &mut self,
        localiser: Option<&Localiser>,
        labels: &dyn Fn(usize) -> BallsOfFrame,
    ) -> Result<Vec<CutStack>> {
        self.follower.end();
        self.take(0, localiser, labels).await
    }

    async fn take(
        &mut self,
        margin: usize,
        localiser: Option<&Localiser>,
        labels: &dyn Fn(usize) -> BallsOfFrame,
    ) -> Result<Vec<CutStack>> {
        let follower = &mut self.follower;
        let of_tracklets = follower.queries().into_iter();
        let mut queries: Vec<(Query, Source)> = of_tracklets.map(|query| (query, Source::Tracklet)).collect();
        let newest = follower.newest().map_or(0, |frame| frame.0);
        while self.done + margin <= newest {
            let frame = FrameId(self.done);
            let proposals = match (localiser, follower.held(frame)) {
                (Some(localiser), Some(picture)) if self.done.is_multiple_of(PROPOSED_EVERY) => {
                    localiser.propose(picture, None).await?
                }
                _ => vec![],
            };
            proposals.iter().for_each(|ball| follower.propose(frame, *ball));
            let source = |query: &Query| {
                let is_it = |ball: &Detection| {
                    let at = ball.outline.centre;
                    (at.x - query.image[0]).hypot(at.y - query.image[1]) < ball.outline.radius / 2.0
                };
                if proposals.iter().any(is_it) { Source::Proposal } else { Source::Other }
            };
            queries.extend(follower.candidates(frame).into_iter().map(|query| (query, source(&query))));
            self.done += 1;
        }
        let mut stacks = vec![];
        for (query, source) in queries {
            let frame = follower.number(&query);
            let (Some(balls), Some(stack)) = (labels(frame), follower.stack(&query)) else { continue };
            let distance = |at: Point2<f64>| (at.x - query.image[0]).hypot(at.y - query.image[1]);
            let nearest = balls.into_iter().min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
            let ball = nearest.map(|(ball, radius)| {
                let [x, y] = stack.stack_from_frame([ball.x, ball.y]);
                let radius = radius.unwrap_or(query.radius_px);
                ([x, y, radius * stack.magnification], distance(ball) < NEAR_PX.max(radius))
            });
            let is_ball = ball.is_some_and(|(_, is_ball)| is_ball);
            self.count += 1;
            let every = match source {
                Source::Tracklet => WANTED_EVERY,
                Source::Proposal => 1,
                Source::Other => OTHERS_EVERY,
            };
            // The ball's are among the candidates anyway.
            if (is_ball && source == Source::Tracklet) || (!is_ball && !self.count.is_multiple_of(every)) {
                continue;
            }
            stacks.push(CutStack { record: stack_record(&stack.pictures, ball.map(|(ball, _)| ball)), frame, is_ball });
        }
        Ok(stacks)
    }
}
