//! What is known of where the ball can be, against what the network proposes.

use super::size::Reading;
use crate::camera::Camera;
use crate::volume::Volume;

/// A place is not refused where it is nearer to what is possible than so many of its standard deviations.
const SIGMAS: f64 = 2.5;

/// Where a ball of known size can be.
pub(crate) struct Possible<'a> {
    /// The camera of the picture.
    pub camera: &'a Camera,
    /// The ball's radius, m.
    pub ball_radius: f64,
    /// Where its centre can be.
    pub volume: Volume,
}

/// Why a place cannot be the ball.
enum Impossible {
    /// No ball of this radius has such an outline.
    Outline,
    /// Its line of sight does not pass where the ball can be.
    Sight,
    /// A ball that looks so large would be at `depth`, where it can be from `near` to `far`, m.
    Depth { depth: f64, near: f64, far: f64 },
}

impl Impossible {
    fn words(&self) -> String {
        match *self {
            Self::Outline => "no ball of this radius has such an outline".into(),
            Self::Sight => "its line of sight does not pass where the ball can be".into(),
            Self::Depth { depth, near, far } => {
                let range = match far.is_finite() {
                    true => format!("between {near:.1} and {far:.1} m"),
                    false => format!("at least {near:.1} m"),
                };
                format!("a ball that looks so large would be {depth:.1} m away, where it can be {range}")
            }
        }
    }
}

impl Possible<'_> {
    /// Parts `readings` into those that can be the ball and those that cannot: the latter with the reason, in words.
    pub(super) fn part(&self, readings: Vec<Reading>) -> (Vec<Reading>, Vec<(Reading, String)>) {
        let (mut possible, mut refused) = (vec![], vec![]);
        for reading in readings {
            match self.against(&reading) {
                None => possible.push(reading),
                Some(reason) => refused.push((reading, reason.words())),
            }
        }
        (possible, refused)
    }

    /// Why `reading` cannot be the ball; none where it can.
    fn against(&self, reading: &Reading) -> Option<Impossible> {
        let outline = &reading.outline;
        let Some([near, far]) = self.camera.depths_within(&self.volume, &outline.centre) else {
            return Some(Impossible::Sight);
        };
        let Ok(centre) = self.camera.ball_from_outline(outline, self.ball_radius) else {
            return Some(Impossible::Outline);
        };
        let spread = (SIGMAS * reading.log_sigma).exp();
        let depth = centre.z;
        (depth / spread > far || depth * spread < near).then_some(Impossible::Depth { depth, near, far })
    }
}
