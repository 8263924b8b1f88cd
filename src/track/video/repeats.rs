//! The true times of frames in a video whose rate was raised by showing every n-th frame again.

use crate::statistics::median;

/// Repeated frames that make a cadence, at least, and by how much of an interval times that are even may differ.
const FEWEST: usize = 4;
const UNEVEN: f64 = 0.2;

/// Every how many frames one is shown again, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cadence {
    every: usize,
    phase: usize,
    /// Time of the first frame, and from one shown frame to the next, s.
    start: f64,
    interval: f64,
}

impl Cadence {
    /// Of frames at these times, s, of which some are repeated; none where they are too few, or repeated without a cadence.
    pub fn of(frames: &[(f64, bool)]) -> Option<Self> {
        let repeated: Vec<usize> = (0..frames.len()).filter(|&index| frames[index].1).collect();
        if repeated.len() < FEWEST {
            return None;
        }
        let gaps: Vec<usize> = repeated.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let every = median(gaps.iter().map(|&gap| gap as f64))? as usize;
        let intervals = || frames.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let interval = median(intervals())?;
        let is_even = intervals().all(|it| (it - interval).abs() < UNEVEN * interval);
        // One that is not recognised makes a gap of two.
        let is_regular = every > 1 && gaps.iter().all(|gap| gap % every == 0);
        (is_even && is_regular).then(|| Self { every, phase: repeated[0] % every, start: frames[0].0, interval })
    }

    /// When the frame of an index was taken, s; a repeated one between the one that it repeats and the next.
    pub fn time(&self, index: usize) -> f64 {
        let Self { every, phase, start, interval } = *self;
        // Repeated ones among the frames 1 to `index`.
        let first = if phase == 0 { every } else { phase };
        let before = if index < first { 0 } else { (index - first) / every + 1 };
        let is_repeated = index >= first && (index - first).is_multiple_of(every);
        let pace = interval * every as f64 / (every - 1) as f64;
        start + pace * ((index - before) as f64 + if is_repeated { 0.5 } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(repeated: &[usize]) -> Vec<(f64, bool)> {
        (0..60).map(|index| (index as f64 / 30.0, repeated.contains(&index))).collect()
    }

    #[test]
    fn twenty_five_a_second_shown_as_thirty_are_told_their_times() {
        // One of them is not recognised.
        let cadence = Cadence::of(&frames(&[3, 9, 15, 27, 33])).unwrap();
        let mut source = 0;
        for index in 0..60 {
            if index % 6 == 3 {
                assert!((cadence.time(index) - (source as f64 - 0.5) / 25.0).abs() < 1e-9, "{index}");
            } else {
                assert!((cadence.time(index) - source as f64 / 25.0).abs() < 1e-9, "{index}");
                source += 1;
            }
        }
    }

    #[test]
    fn without_a_rhythm_times_are_what_they_are() {
        assert_eq!(Cadence::of(&frames(&[3, 9, 15])), None);
        assert_eq!(Cadence::of(&frames(&[3, 9, 14, 25, 33])), None);
    }
}
