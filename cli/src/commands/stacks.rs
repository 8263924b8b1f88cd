//! `gravisight stacks`: the motion network's training data.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use gravisight::internal::{BallTracker, FrameId, Query, TrackPoint, stack_record, write_whole};
use gravisight::parts::Detection;
use gravisight::{Localiser, Track};

use nalgebra::Point2;

use super::print_line;
use crate::footage::Footage;

/// Distance of a candidate's centre from the ball's within which it is the ball, px: labels made by hand are good to 2 px.
const NEAR_PX: f64 = 4.0;
/// Other candidates of a frame that are kept besides those that lie on paths of a ball: every so manieth.
const OTHERS_EVERY: usize = 16;
/// Of the candidates on such paths that are no ball, one of so many is kept.
const WANTED_EVERY: usize = 2;

/// Every how manieth frame the detector proposes balls in.
const PROPOSED_EVERY: usize = 4;

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

/// Cut labelled footage into the stacks of frames on which a model's motion network is trained.
#[derive(Args)]
pub struct Arguments {
    /// A video (needs ffmpeg) or a folder of frames.
    #[arg(value_name = "VIDEO")]
    input: PathBuf,
    /// The ball in its frames (Frame,Visibility,X,Y, optionally Radius), one file for each ball; frames that lack a line in a file are left out.
    #[arg(value_name = "LABELS.CSV", required = true)]
    labels: Vec<PathBuf>,
    /// File to write (`*.stacks`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also cut about the balls that this model's detector proposes, as `track` does (path of its card, or `any`).
    #[arg(long, value_name = "M")]
    model: Option<PathBuf>,
    /// Frames per second [default: the video's].
    #[arg(long, value_name = "F")]
    fps: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// What is wrong with the input, in words.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { input, labels, out, model, fps } = arguments;
    let localiser = model.map(|model| crate::model::open(Some(&model), &gravisight::Device::flex())).transpose()?;
    let of_ball = |path: &PathBuf| {
        let points = Track::from_file(path)?.points.into_iter();
        Ok(points.map(|point| (point.frame as usize, point)).collect())
    };
    let labels = labels.iter().map(of_ball).collect::<Result<Vec<HashMap<usize, TrackPoint>>>>()?;
    let stacks = cut(&input, &labels, localiser.as_ref(), fps).with_context(|| input.display().to_string())?;
    write_whole(Path::new(&out), &stacks.concat())?;
    Ok(print_line(format_args!("{} stacks in {}", stacks.len(), out.display()))?)
}

/// The records of the stacks of a video, with the labels of each of its balls by frame.
fn cut(
    input: &Path,
    labels: &[HashMap<usize, TrackPoint>],
    localiser: Option<&Localiser>,
    fps: Option<f64>,
) -> Result<Vec<Vec<u8>>> {
    let footage = Footage::open(&[input.to_path_buf()], fps)?;
    let times = footage.times().to_vec();
    let mut follower = BallTracker::new();
    let (mut stacks, mut done, mut count) = (vec![], 0, 0);
    let mut take = |follower: &mut BallTracker, stacks: &mut Vec<Vec<u8>>, margin: usize| -> Result<()> {
        let of_tracklets = follower.queries().into_iter();
        let mut queries: Vec<(Query, Source)> = of_tracklets.map(|query| (query, Source::Tracklet)).collect();
        let newest = follower.newest().map_or(0, |frame| frame.0);
        while done + margin <= newest {
            let frame = FrameId(done);
            let proposals = match (localiser, follower.held(frame)) {
                (Some(localiser), Some(picture)) if done % PROPOSED_EVERY == 0 => {
                    pollster::block_on(localiser.propose(picture, None))?
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
            done += 1;
        }
        for (query, source) in queries {
            let number = follower.number(&query);
            let seen = labels.iter().map(|ball| ball.get(&number)).collect::<Option<Vec<&TrackPoint>>>();
            let (Some(seen), Some(stack)) = (seen, follower.stack(&query)) else { continue };
            let distance = |at: Point2<f64>| (at.x - query.image[0]).hypot(at.y - query.image[1]);
            let balls = seen.into_iter().filter_map(|label| Some((label.image()?, label.radius)));
            let nearest = balls.min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
            let ball = nearest.map(|(ball, radius)| {
                let [x, y] = stack.stack_from_frame([ball.x, ball.y]);
                let radius = radius.unwrap_or(query.radius_px);
                ([x, y, radius * stack.magnification], distance(ball) < NEAR_PX.max(radius))
            });
            let is_ball = ball.is_some_and(|(_, is_ball)| is_ball);
            count += 1;
            let every = match source {
                Source::Tracklet => WANTED_EVERY,
                Source::Proposal => 1,
                Source::Other => OTHERS_EVERY,
            };
            // The ball's are among the candidates anyway.
            if (is_ball && source == Source::Tracklet) || (!is_ball && count % every != 0) {
                continue;
            }
            stacks.push(stack_record(&stack.pictures, ball.map(|(ball, _)| ball)));
        }
        Ok(())
    };
    footage.each(0..times.len(), &mut |frame, picture| {
        follower.watch(picture, times[frame])?;
        take(&mut follower, &mut stacks, MARGIN)
    })?;
    follower.end();
    take(&mut follower, &mut stacks, 0)?;
    Ok(stacks)
}

/// Frames that a candidate waits for those after it, and for its own to be compared with the next.
const MARGIN: usize = 4;
