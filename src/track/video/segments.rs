//! A long track cut where the ball was not seen for long.

use std::ops::Range;

use super::super::Observation;

/// Longest time without the ball within a segment, s.
const PAUSE: f64 = 0.6;
/// Most frames of a segment: the time that a fit takes grows with them.
const LONGEST: usize = 400;
/// Fewest labels of a segment: of less nothing can be said.
const FEWEST: usize = 5;

/// The parts of a track, by index, that can be fitted one by one: each begins and ends with a label.
pub fn segments(observations: &[Observation]) -> Vec<Range<usize>> {
    let seen: Vec<usize> = (0..observations.len()).filter(|&index| observations[index].image.is_some()).collect();
    let mut found = Vec::new();
    let mut start = 0;
    for next in 1..=seen.len() {
        let ends = next == seen.len()
            || observations[seen[next]].time - observations[seen[next - 1]].time > PAUSE
            || seen[next] - seen[start] >= LONGEST;
        if ends {
            if next - start >= FEWEST {
                found.push(seen[start]..seen[next - 1] + 1);
            }
            start = next;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_is_cut_where_the_ball_is_away_for_long() {
        let seen = |index: usize| (3..20).contains(&index) || (24..40).contains(&index) || (80..84).contains(&index);
        let observation = |index: usize| Observation {
            time: index as f64 / 25.0,
            image: seen(index).then(|| nalgebra::Point2::new(1.0, 2.0)),
            radius: None,
        };
        let track: Vec<Observation> = (0..100).map(observation).collect();
        // four frames without the ball are no pause; four labels are no segment
        assert_eq!(segments(&track), vec![Range { start: 3, end: 40 }]);
        let long: Vec<Observation> =
            (0..1000).map(|i| Observation { image: Some([1.0, 2.0].into()), ..observation(i) }).collect();
        assert_eq!(segments(&long), [0..400, 400..800, 800..1000]);
        assert!(segments(&[]).is_empty());
    }
}
