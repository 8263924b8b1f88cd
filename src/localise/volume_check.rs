//! Whether a detection can be the ball: by the volume in which the ball's centre can be, and its radius.

use gravisight_geometry::camera::{Camera, Detection};
use gravisight_geometry::volume::Volume;

/// Tolerance of the depth, in its standard deviations.
const TOLERANCE_SIGMAS: f64 = 2.5;

/// Where a ball of known size can be.
pub(crate) struct VolumeCheck<'a> {
    /// The camera of the picture.
    pub camera: &'a Camera,
    /// The ball's radius, m.
    pub ball_radius: f64,
    /// Where its centre can be.
    pub volume: Volume,
}

/// Why a detection cannot be the ball.
enum VolumeRefusal {
    /// No ball of this radius has such an outline.
    Outline,
    /// Its ray does not pass through the volume.
    Ray,
    /// By its size it would be at `depth`; on its ray the volume is from `near` to `far`, m.
    Depth { depth: f64, near: f64, far: f64 },
}

impl VolumeRefusal {
    fn reason(&self) -> String {
        match *self {
            Self::Outline => "no ball of this radius has such an outline".into(),
            Self::Ray => "its line of sight does not pass through that volume".into(),
            Self::Depth { depth, near, far } => {
                let range = match far.is_finite() {
                    true => format!("from {near:.1} to {far:.1} m"),
                    false => format!("from {near:.1} m onwards"),
                };
                format!(
                    "a ball of that apparent size would be {depth:.1} m away, but on its line of sight the volume is {range}"
                )
            }
        }
    }
}

impl VolumeCheck<'_> {
    /// Partitions `detections` into those that can be the ball and those that cannot, the latter with the reason in words.
    pub(super) fn partition(&self, detections: Vec<Detection>) -> (Vec<Detection>, Vec<(Detection, String)>) {
        let (mut passed, mut refused) = (vec![], vec![]);
        for detection in detections {
            match self.refusal(&detection) {
                None => passed.push(detection),
                Some(refusal) => refused.push((detection, refusal.reason())),
            }
        }
        (passed, refused)
    }

    /// Why `detection` cannot be the ball; [`None`] where it can.
    fn refusal(&self, detection: &Detection) -> Option<VolumeRefusal> {
        let outline = &detection.outline;
        let Some([near, far]) = self.camera.depths_within(&self.volume, &outline.centre) else {
            return Some(VolumeRefusal::Ray);
        };
        let Ok(centre) = self.camera.ball_from_outline(outline, self.ball_radius) else {
            return Some(VolumeRefusal::Outline);
        };
        let spread = (TOLERANCE_SIGMAS * detection.log_sigma).exp();
        let depth = centre.z;
        (depth / spread > far || depth * spread < near).then_some(VolumeRefusal::Depth { depth, near, far })
    }
}
