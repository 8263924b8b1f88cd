//! The true times of frames in a video whose rate was raised by showing every n-th frame again.

use super::config::RepeatsConfig;
use gravisight_geometry::statistics::median;

/// The true times of a video's frames: those in the file, and where a cadence holds, those of the camera.
#[derive(Debug)]
pub(super) struct Clock {
    config: RepeatsConfig,
    /// Time in the file, s, and whether the frame repeats the one before.
    frames: Vec<(f64, bool)>,
    /// First frame of those that the cadence holds for, or is searched in.
    from: usize,
    cadence: Option<Cadence>,
    /// The last repeat that the cadence expected.
    confirmed: usize,
}

impl Clock {
    /// Without any frame yet.
    pub fn new(config: RepeatsConfig) -> Self {
        Self { config, frames: vec![], from: 0, cadence: None, confirmed: 0 }
    }

    /// Adds the next frame, by its time in the file, s. Returns the first frame whose true time this changes, its own at the latest.
    pub fn add(&mut self, time: f64, repeated: bool) -> usize {
        let index = self.frames.len();
        self.frames.push((time, repeated));
        if let Some(cadence) = self.cadence {
            let interval = time - self.frames[index - 1].0;
            let expected = cadence.is_repeated(index - self.from);
            let lost = index - self.confirmed > self.config.most_unrecognised * cadence.every;
            if !cadence.is_interval(interval, self.config.uneven) || repeated && !expected || lost {
                // A cut, another rate: it held up to its last repeat.
                (self.cadence, self.from) = (None, self.confirmed + 1);
                return self.from;
            }
            if repeated {
                self.confirmed = index;
            }
            return index;
        }
        if !repeated {
            return index;
        }
        self.cadence = Cadence::of(&self.frames[self.from..], &self.config);
        if self.cadence.is_some() {
            self.confirmed = index;
            return self.from;
        }
        let own = &self.frames[self.from..];
        if own.iter().filter(|frame| frame.1).count() >= self.config.cadence_repeats {
            // Its first repeat has no part in a cadence.
            self.from += own.iter().position(|frame| frame.1).map_or(0, |first| first + 1);
        }
        index
    }

    /// When a frame was taken, s, by its index: of those that the last [`Self::add`] changed. A repeat is between the frame that it
    /// repeats and the next.
    pub fn time(&self, index: usize) -> f64 {
        match self.cadence.filter(|_| index >= self.from) {
            Some(cadence) => cadence.time(index - self.from),
            None => self.frames[index].0,
        }
    }
}

/// Every how many frames one is shown again, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cadence {
    every: usize,
    phase: usize,
    /// Time of the first frame, and from one shown frame to the next, s.
    start: f64,
    interval: f64,
}

impl Cadence {
    /// Of frames at these times, s, some of them repeated; none where they are too few, or repeated without a cadence.
    fn of(frames: &[(f64, bool)], config: &RepeatsConfig) -> Option<Self> {
        let repeated: Vec<usize> = (0..frames.len()).filter(|&index| frames[index].1).collect();
        if repeated.len() < config.cadence_repeats {
            return None;
        }
        let gaps: Vec<usize> = repeated.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let every = median(gaps.iter().map(|&gap| gap as f64))? as usize;
        let intervals = || frames.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let interval = median(intervals())?;
        // One that is not recognised makes a gap of two.
        let is_regular = every > 1 && gaps.iter().all(|gap| gap % every == 0);
        let cadence = Self { every, phase: repeated[0] % every.max(1), start: frames[0].0, interval };
        (is_regular && intervals().all(|interval| cadence.is_interval(interval, config.uneven))).then_some(cadence)
    }

    /// Whether this is the time from one shown frame to the next, s, to within an `uneven` part.
    fn is_interval(&self, interval: f64, uneven: f64) -> bool {
        (interval - self.interval).abs() < uneven * self.interval
    }

    /// The first frame that is repeated.
    fn first(&self) -> usize {
        if self.phase == 0 { self.every } else { self.phase }
    }

    fn is_repeated(&self, index: usize) -> bool {
        index >= self.first() && (index - self.first()).is_multiple_of(self.every)
    }

    /// When the frame of an index was taken, s; a repeated one between the one that it repeats and the next.
    fn time(&self, index: usize) -> f64 {
        // Repeated ones among the frames 1 to `index`.
        let before = if index < self.first() { 0 } else { (index - self.first()) / self.every + 1 };
        let pace = self.interval * self.every as f64 / (self.every - 1) as f64;
        self.start + pace * ((index - before) as f64 + if self.is_repeated(index) { 0.5 } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: &[usize] = &[];

    /// True times of frames at these times, of which some are repeated.
    fn times(shown: impl Iterator<Item = f64>, repeated: &[usize]) -> Vec<f64> {
        let mut clock = Clock::new(RepeatsConfig::default());
        let mut times = vec![];
        for (index, time) in shown.enumerate() {
            times.push(time);
            let first = clock.add(time, repeated.contains(&index));
            times.iter_mut().enumerate().skip(first).for_each(|(changed, time)| *time = clock.time(changed));
        }
        times
    }

    fn at_thirty(frames: usize) -> impl Iterator<Item = f64> {
        (0..frames).map(|index| index as f64 / 30.0)
    }

    #[test]
    fn twenty_five_a_second_shown_as_thirty_get_their_true_times() {
        // One of them is not recognised.
        let times = times(at_thirty(60), &[3, 9, 15, 27, 33, 39, 45, 51, 57]);
        let mut source = 0;
        for (index, time) in times.iter().enumerate() {
            if index % 6 == 3 {
                assert!((time - (source as f64 - 0.5) / 25.0).abs() < 1e-9, "{index}");
            } else {
                assert!((time - source as f64 / 25.0).abs() < 1e-9, "{index}");
                source += 1;
            }
        }
    }

    #[test]
    fn without_a_rhythm_times_are_what_they_are() {
        for repeated in [NONE, &[3, 9, 15], &[3, 9, 14, 25, 33]] {
            assert_eq!(times(at_thirty(60), repeated), at_thirty(60).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_cadence_that_ends_is_not_held_on_to() {
        // Thirty real frames a second from frame 61 on.
        let times = times(at_thirty(120), &(0..10).map(|repeat| 5 + 6 * repeat).collect::<Vec<_>>());
        assert!((times[58] - times[57] - 0.04).abs() < 1e-9, "{}", times[58] - times[57]);
        for (index, pair) in times.windows(2).enumerate().skip(61) {
            assert!((pair[1] - pair[0] - 1.0 / 30.0).abs() < 1e-9, "frame {index}: {pair:?}");
        }
        assert!(times.windows(2).all(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn after_a_cut_the_cadence_has_the_phase_of_the_new_shot() {
        let phase = |index: usize| if index < 50 { 5 } else { 2 };
        let repeated: Vec<usize> = (0..120).filter(|&index| index % 6 == phase(index)).collect();
        let times = times(at_thirty(120), &repeated);
        let taken: Vec<f64> = (50..120).filter(|&index| index % 6 != 2).map(|index| times[index]).collect();
        let off = taken.windows(2).map(|pair| (pair[1] - pair[0] - 0.04).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "{off}");
        assert!(times.windows(2).all(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn another_rate_of_the_file_ends_the_cadence() {
        let shown = || (0..60).map(|index| index as f64 / 30.0).chain((0..60).map(|index| 2.0 + index as f64 / 60.0));
        let repeated: Vec<usize> = (0..60).filter(|index| index % 6 == 5).collect();
        let times = times(shown(), &repeated);
        let expected: Vec<f64> = shown().collect();
        assert_eq!(times[61..], expected[61..]);
    }

    #[test]
    fn repeats_at_the_beginning_that_belong_to_no_cadence_do_not_hide_it() {
        let repeated: Vec<usize> = [1, 2].into_iter().chain((0..20).map(|repeat| 9 + 6 * repeat)).collect();
        let times = times(at_thirty(120), &repeated);
        assert!((times[50] - times[49] - 0.04).abs() < 1e-9);
    }
}
