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

impl Possible<'_> {
    /// Parts `readings` into those that can be the ball and those that cannot: the latter with the reason, in words.
    pub(super) fn part(&self, readings: Vec<Reading>) -> (Vec<Reading>, Vec<(Reading, String)>) {
        let (mut possible, mut refused) = (vec![], vec![]);
        for reading in readings {
            match self.against(&reading) {
                None => possible.push(reading),
                Some(reason) => refused.push((reading, reason)),
            }
        }
        (possible, refused)
    }

    /// Why `reading` cannot be the ball; none where it can.
    fn against(&self, reading: &Reading) -> Option<String> {
        let outline = &reading.outline;
        let Ok(centre) = self.camera.ball_from_outline(outline, self.ball_radius) else {
            return Some("no ball of this radius has such an outline".into());
        };
        let Some([near, far]) = self.camera.depths_within(&self.volume, &outline.centre) else {
            return Some("its line of sight does not pass where the ball can be".into());
        };
        let spread = (SIGMAS * reading.log_sigma).exp();
        let range = || match far.is_finite() {
            true => format!("between {near:.1} and {far:.1} m"),
            false => format!("at least {near:.1} m"),
        };
        if centre.z / spread > far || centre.z * spread < near {
            return Some(format!(
                "a ball that looks so large would be {:.1} m away, where it can be {}",
                centre.z,
                range()
            ));
        }
        None
    }
}
