//! A long track cut where the ball was not seen for long, or where it was hit.

use std::ops::Range;

use nalgebra::Point2;

use super::Observation;
use super::estimate::{CLEAR, MOST_POWER, PolynomialPiece};
use crate::observation::{noise_of, trusted};

/// Longest time without the ball within a segment, s.
const PAUSE: f64 = 0.6;
/// Labels from which on a segment is cut at the sharpest bend that it has by then: the time that a fit takes grows with them.
const LONG: usize = 400;
/// Fewest labels of a segment that can be fitted.
const FEWEST: usize = 5;
/// Labels on either side of a bend that show it.
const BESIDE: usize = 8;
/// Least noise of labels, px: what compression leaves.
const LEAST_SIGMA: f64 = 0.1;

/// The parts of a track, by index, that can be fitted one by one: each begins and ends with a label. A flight is never cut.
pub(super) fn segments(observations: &[Observation]) -> Vec<Range<usize>> {
    let seen: Vec<usize> = (0..observations.len()).filter(|&index| observations[index].image.is_some()).collect();
    let labels: Vec<(f64, Point2<f64>)> =
        seen.iter().filter_map(|&index| Some((observations[index].time, observations[index].image?))).collect();
    let sigma = noise_of(&trusted(observations)).max(LEAST_SIGMA);
    let mut found = Vec::new();
    let mut start = 0;
    for next in 1..=seen.len() {
        if next < seen.len() && labels[next].0 - labels[next - 1].0 <= PAUSE {
            continue;
        }
        let cuts = cuts(&labels[start..next], sigma).into_iter().map(|cut| start + cut);
        let ends: Vec<usize> = [start].into_iter().chain(cuts).chain([next]).collect();
        let parts = ends.windows(2).filter(|part| part[1] - part[0] >= FEWEST);
        found.extend(parts.map(|part| seen[part[0]]..seen[part[1] - 1] + 1));
        start = next;
    }
    found
}

/// Where labels without a pause are cut: at the sharpest bend among the first [`LONG`], or the first one after them.
fn cuts(labels: &[(f64, Point2<f64>)], sigma: f64) -> Vec<usize> {
    let mut cuts = Vec::new();
    let mut start = 0;
    while labels.len() - start > LONG {
        let within = start + BESIDE..start + LONG;
        let sharpest = within.map(|cut| (cut, bend(labels, cut, sigma))).max_by(|a, b| a.1.total_cmp(&b.1));
        let later = || (start + LONG..labels.len() - BESIDE).find(|&cut| bend(labels, cut, sigma) > CLEAR);
        let Some(cut) = sharpest.filter(|it| it.1 > CLEAR).map(|it| it.0).or_else(later) else { break };
        cuts.push(cut);
        start = cut;
    }
    cuts
}

/// How much better two smooth pieces fit the labels beside a cut than one does, in squared standard deviations.
fn bend(labels: &[(f64, Point2<f64>)], cut: usize, sigma: f64) -> f64 {
    let (from, to) = (cut.saturating_sub(BESIDE), (cut + BESIDE).min(labels.len()));
    let cost = |labels: &[_]| PolynomialPiece::of(labels, sigma, MOST_POWER).map(|piece| piece.cost);
    match (cost(&labels[from..to]), cost(&labels[from..cut]), cost(&labels[cut..to])) {
        (Some(one), Some(before), Some(after)) => one - before - after,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(count: usize, rate: f64, at: impl Fn(f64) -> Option<[f64; 2]>) -> Vec<Observation> {
        let observation = |index: usize| {
            let time = index as f64 / rate;
            Observation { time, image: at(time).map(Point2::from), radius: None }
        };
        (0..count).map(observation).collect()
    }

    #[test]
    fn a_track_is_cut_where_the_ball_is_away_for_long() {
        let seen = |index: usize| (3..20).contains(&index) || (24..40).contains(&index) || (80..84).contains(&index);
        let track = track(100, 25.0, |time| seen((time * 25.0).round() as usize).then_some([1.0, 2.0]));
        // four frames without the ball are no pause; four labels are no segment
        assert_eq!(segments(&track), vec![Range { start: 3, end: 40 }]);
        assert!(segments(&[]).is_empty());
    }

    #[test]
    fn a_flight_is_never_cut() {
        // Two and a half seconds in the air at 240 frames a second, px of a camera at 10 m.
        let flight = |t: f64| [100.0 + 200.0 * t, 900.0 - 850.0 * t + 340.0 * t * t];
        let shaken = |t: f64| {
            let [x, y] = flight(t);
            Some([x + 0.4 * (t * 9431.0).sin(), y + 0.4 * (t * 7919.0).cos()])
        };
        assert_eq!(segments(&track(600, 240.0, shaken)), vec![Range { start: 0, end: 600 }]);
    }

    #[test]
    fn a_long_rally_is_cut_at_hits() {
        // Bounced every 0.8 s, at 60 frames a second.
        let bounced = |t: f64| {
            let since = t % 0.8;
            Some([50.0 + 20.0 * t, 500.0 - 400.0 * since + 500.0 * since * since])
        };
        let found = segments(&track(1200, 60.0, bounced));
        assert!(found.len() >= 3 && found.iter().all(|part| part.len() <= LONG), "{found:?}");
        assert_eq!((found[0].start, found[found.len() - 1].end), (0, 1200));
        for pair in found.windows(2) {
            assert_eq!(pair[0].end, pair[1].start);
            assert!(pair[1].start % 48 <= 1 || pair[1].start % 48 == 47, "{found:?}");
        }
    }
}
