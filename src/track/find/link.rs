//! Which candidate of each frame is the ball: the path through a clip that is best on the whole.

use super::evidence::Candidate;
use crate::contour::Circle;

/// Most frames a path may leap over without seeing the ball and still go on.
const LONGEST_GAP: usize = 10;
/// What a frame without the ball costs a path that could have gone on.
const UNSEEN: f64 = 0.6;
/// What it costs to lose the ball and find it anywhere.
const RESTART: f64 = 4.0;
/// Deviation from constant velocity that is ordinary, px and shares of the radius, for each frame that passed.
const TURN_PX: f64 = 0.7;
const TURN_SHARE: f64 = 0.15;
/// Most that a turn costs: balls bounce.
const TURN_MOST: f64 = 3.0;
/// Speed from which it costs, radii a frame (a fast ball crosses several of its diameters).
const SPEED: f64 = 4.0;
/// Change of the radius in a frame that is ordinary, as a share.
const GROWTH: f64 = 0.06;

/// Two candidates, one after the other on a path.
struct Step {
    /// Where the path came from; none where it starts.
    from: Option<Place>,
    /// Best sum of gains of a path that ends with this step.
    gain: f64,
}

/// A step into a candidate.
#[derive(Clone, Copy)]
struct Place {
    frame: usize,
    candidate: usize,
    /// Which of the steps into it.
    step: usize,
}

/// The best candidate of each frame, by index; none where the ball is not seen.
pub(super) fn best_path(frames: &[Vec<Candidate>]) -> Vec<Option<usize>> {
    // steps[frame][candidate]: the ways to come to it
    let mut steps: Vec<Vec<Vec<Step>>> = Vec::with_capacity(frames.len());
    // The best end of a path in each frame or before.
    let mut ends: Vec<Option<(f64, Place)>> = Vec::with_capacity(frames.len());
    for (frame, candidates) in frames.iter().enumerate() {
        let last = ends.last().copied().flatten();
        let ways: Vec<Vec<Step>> =
            candidates.iter().map(|candidate| steps_into(frames, &steps, last, frame, candidate)).collect();
        let mut best = last;
        for (candidate, ways) in ways.iter().enumerate() {
            for (step, way) in ways.iter().enumerate() {
                if way.gain > best.map_or(0.0, |(gain, _)| gain) {
                    best = Some((way.gain, Place { frame, candidate, step }));
                }
            }
        }
        steps.push(ways);
        ends.push(best);
    }
    let mut path = vec![None; frames.len()];
    let mut at = ends.last().copied().flatten().map(|(_, place)| place);
    while let Some(place) = at {
        path[place.frame] = Some(place.candidate);
        at = steps[place.frame][place.candidate][place.step].from;
    }
    path
}

/// All ways to come to `candidate` of frame `now`; `last` is the best end of a path before.
fn steps_into(
    frames: &[Vec<Candidate>],
    steps: &[Vec<Vec<Step>>],
    last: Option<(f64, Place)>,
    now: usize,
    candidate: &Candidate,
) -> Vec<Step> {
    let mut into = vec![Step { from: None, gain: candidate.gain }];
    into.extend(last.map(|(gain, place)| Step { from: Some(place), gain: gain + candidate.gain - RESTART }));
    for gap in 1..=LONGEST_GAP.min(now) {
        let frame = now - gap;
        for (index, earlier) in frames[frame].iter().enumerate() {
            let reach = candidate.gain - UNSEEN * (gap - 1) as f64 - step_cost(earlier, candidate, gap);
            let ways = steps[frame][index].iter().enumerate().map(|(step, way)| {
                let turn = way.from.map_or(0.0, |first| {
                    let three = [&frames[first.frame][first.candidate], earlier, candidate];
                    turn_cost(three, [frame - first.frame, gap])
                });
                (way.gain - turn, step)
            });
            let best = ways.max_by(|(a, _), (b, _)| a.total_cmp(b));
            into.extend(
                best.map(|(gain, step)| Step {
                    from: Some(Place { frame, candidate: index, step }),
                    gain: gain + reach,
                }),
            );
        }
    }
    into
}

/// Cost of the way between two candidates: its speed and the radius' change.
fn step_cost(from: &Candidate, to: &Candidate, gap: usize) -> f64 {
    let (a, b) = (&from.outline.circle, &to.outline.circle);
    let size = (a.radius * b.radius).sqrt();
    let speed = (a.x - b.x).hypot(a.y - b.y) / (gap as f64 * SPEED * size);
    let growth = (a.radius / b.radius).ln() / (GROWTH * (gap as f64).sqrt());
    0.5 * (1.0 + speed * speed).ln() + 0.5 * (1.0 + growth * growth).ln()
}

/// Cost of a change of velocity from the first way to the second, over so many frames.
fn turn_cost([first, second, third]: [&Candidate; 3], [before, after]: [usize; 2]) -> f64 {
    // What lies before a frame where the ball was lost tells no velocity.
    if before > LONGEST_GAP {
        return 0.0;
    }
    let [a, b, c] = [first, second, third].map(|candidate| candidate.outline.circle);
    let square = turn([&a, &b, &c], [before as f64, after as f64]).powi(2);
    TURN_MOST * square / (square + 2.0 * TURN_MOST)
}

/// How far the third circle is from where constant velocity leads, in ordinary deviations.
pub(super) fn turn([a, b, c]: [&Circle; 3], [before, after]: [f64; 2]) -> f64 {
    let off = [(c.x - b.x) - (b.x - a.x) * after / before, (c.y - b.y) - (b.y - a.y) * after / before];
    off[0].hypot(off[1]) / ((TURN_PX + TURN_SHARE * b.radius) * after)
}
