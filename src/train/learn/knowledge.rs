//! What a run knows besides its network, where forecasts teach.

use std::collections::BTreeMap;

use super::super::examples::FrameId;
use super::super::recipe::Recipe;
use super::laws::LearnedLaws;

/// Where the network found the ball when it last saw a frame, px of the clip's picture.
pub type OwnTrack = BTreeMap<FrameId, [f64; 2]>;

/// What a run knows besides its network.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Knowledge {
    /// What the network found.
    pub own: OwnTrack,
    /// Physics that is learned.
    pub laws: LearnedLaws,
}

impl Knowledge {
    /// Of a run's start.
    pub fn first(recipe: &Recipe) -> Self {
        Self { own: OwnTrack::new(), laws: LearnedLaws::new(&recipe.future.learn) }
    }

    /// As text, from which it is read to the bit: the laws' steps, a line a law (logarithm of its factor, moments), then a
    /// line a frame (clip, frame, x, y).
    pub fn text(&self) -> String {
        let (steps, laws) = self.laws.numbers();
        let law = |[log_factor, first, second]: &[f64; 3]| format!("{log_factor} {first} {second}\n");
        let frame = |([clip, frame], [x, y]): (&FrameId, &[f64; 2])| format!("{clip} {frame} {x} {y}\n");
        let laws: String = laws.iter().map(law).collect();
        format!("{steps}\n{laws}{}", self.own.iter().map(frame).collect::<String>())
    }

    /// From its text, of a run by `recipe`; none where that is no such text.
    pub fn from_text(recipe: &Recipe, text: &str) -> Option<Self> {
        fn words<T: std::str::FromStr, const N: usize>(line: &str) -> Option<[T; N]> {
            let words: Option<Vec<T>> = line.split(' ').map(|word| word.parse().ok()).collect();
            words?.try_into().ok()
        }
        let mut lines = text.lines();
        let steps = lines.next()?.parse().ok()?;
        let Self { mut own, laws } = Self::first(recipe);
        let numbers: Option<Vec<[f64; 3]>> = lines.by_ref().take(laws.count()).map(words).collect();
        for line in lines {
            let [clip, frame, x, y] = words::<f64, 4>(line)?;
            own.insert([clip as usize, frame as usize], [x, y]);
        }
        Some(Self { own, laws: laws.with_numbers((steps, numbers?))? })
    }
}
