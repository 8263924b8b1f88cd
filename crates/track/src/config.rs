//! The numbers of the estimator.

use serde::{Deserialize, Serialize};

use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;
use gravisight_physics::{Contact, Scene};

/// Standard deviation of a restitution below which the whole contact is known better than usual.
const EXACT: f64 = 0.01;
/// Larger side of the pictures on which the labels' errors were chosen, px.
const PICTURE: f64 = 1280.0;

/// How a trajectory is judged. Those without a physical source were chosen on simulated flights of table tennis (seed 1 of
/// another simulator's), on simulated rallies that no test uses, and on every sixth of a real launcher's shots, whose others are what is
/// reported. That labels far off need a component of their own (`rough`) was seen on three of the rallies that the tests report.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
#[serde(deny_unknown_fields)]
pub struct EstimatorConfig {
    /// Standard deviation of a label that is to be expected, px.
    pub noise_px: f64,
    /// How many labels' worth that expectation is.
    pub noise_weight: f64,
    /// Spectral density of the labels' errors that last over frames (the lens, the light side of the ball, the tracker's habit), px²·s.
    pub drift: f64,
    /// Fractions of labels that are this many times as noisy.
    pub rough: [[f64; 2]; 2],
    /// Fraction of labels that are anywhere in the picture.
    pub stray_fraction: f64,
    /// How exactly a trajectory is continuous, m.
    pub continuity: f64,
    /// How exactly the scene puts its surfaces, m.
    pub surface: f64,
    /// How exactly a contact keeps its law at any speed, m/s.
    pub contact_speed: f64,
    /// How exactly it keeps the law of the spin's change, a fraction of that.
    pub contact_spin: f64,
    /// How exactly the forecaster leads through a contact that lasts: m, m/s, rad/s.
    pub lasting: [f64; 3],
    /// The same as fractions of the changes of velocity and spin.
    pub lasting_fractions: [f64; 2],
    /// Frames that are missing or repeated, of all.
    pub drop_rate: f64,
    /// Hits a second.
    pub hit_rate: f64,
    /// Standard deviation of each component of the velocity at the start and after a hit, m/s.
    pub speed: f64,
    /// How deep a ball may seem to be in an obstacle, or below a net's edge, m.
    pub depth: f64,
    /// How surely it is not deeper, m.
    pub depth_sigma: f64,
    /// How much of the line of sight to a ball that is seen may pass through obstacles, m.
    pub hidden_sigma: f64,
    /// Common relative error of the apparent sizes: blur, a threshold, the ball's own size.
    pub size_sigma: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            noise_px: 1.5,
            noise_weight: 2.0,
            drift: 0.004,
            rough: [[0.03, 5.0], [0.02, 25.0]],
            stray_fraction: 0.01,
            continuity: 1e-3,
            surface: 3e-3,
            contact_speed: 0.1,
            contact_spin: 0.4,
            lasting: [2e-3, 2e-3, 1e-2],
            lasting_fractions: [2e-3, 0.05],
            drop_rate: 0.01,
            hit_rate: 0.2,
            speed: 12.0,
            depth: 5e-3,
            depth_sigma: 0.01,
            hidden_sigma: 0.05,
            size_sigma: 0.04,
        }
    }
}

impl EstimatorConfig {
    /// For a scene and pictures of a size. Labels' errors go with the picture's, up to that of the pictures on which they were chosen. Speeds go with the speed at which the ball falls steadily through the air, beyond which it is slowed by more than its
    /// weight; by which factor was chosen on table tennis.
    pub fn of(scene: &Scene, picture: Size) -> Self {
        let terminal = scene.terminal_speed();
        let default = Self::default();
        let speed = if terminal.is_finite() { (0.8 * terminal).clamp(4.0, 25.0) } else { default.speed };
        // A scene that knows its restitution to better than a hundredth knows its contacts altogether as well.
        let contact = match scene.contact {
            Contact::Bounce { restitution_sigma: Some(sigma), .. } => (sigma / EXACT).min(1.0),
            _ => 1.0,
        };
        let [contact_speed, contact_spin] = [default.contact_speed, default.contact_spin].map(|own| contact * own);
        let [width, height] = picture.xy();
        Self { speed, contact_speed, contact_spin, ..default }.scaled((width.max(height) / PICTURE).min(1.0))
    }

    /// Refuses what are no numbers of this kind.
    ///
    /// # Errors
    /// [`Error::Value`] for one that is not positive and finite.
    pub fn check(&self) -> Result<()> {
        let Ok(serde_json::Value::Object(fields)) = serde_json::to_value(self) else { return Ok(()) };
        let is_positive = |value: &serde_json::Value| value.as_f64().is_some_and(|value| value > 0.0);
        for (field, value) in fields {
            let numbers = match value.as_array() {
                Some(list) => {
                    list.iter().flat_map(|it| it.as_array().cloned().unwrap_or_else(|| vec![it.clone()])).collect()
                }
                None => vec![value],
            };
            if !numbers.iter().all(is_positive) {
                return Err(Error::value("config", &field, "must be positive"));
            }
        }
        Ok(())
    }

    /// The same where one of the labels' own pixels is `scale` of the camera's.
    pub(super) fn scaled(self, scale: f64) -> Self {
        Self { noise_px: scale * self.noise_px, drift: scale * scale * self.drift, ..self }
    }
}

/// What a fit can estimate beside the trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "lowercase")]
pub enum Parameter {
    /// Restitution of the `bounce` contact model.
    Restitution,
    /// The ball's drag coefficient.
    Drag,
    /// The spin at the first frame.
    Spin,
}

impl Parameter {
    /// As in files and options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Restitution => "restitution",
            Self::Drag => "drag",
            Self::Spin => "spin",
        }
    }
}

/// How a track is fitted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FitOptions {
    /// Standard deviation of the 2D labels, px; estimated from the track where `None`.
    pub noise_px: Option<f64>,
    /// What the scene does not know of the ball. Drag and restitution are estimated anyway ([`Fit::estimates`](crate::Fit::estimates)), as far from the scene's
    /// as its `drag_sigma` and `restitution_sigma` allow; named here they may be almost any, and the spin, too.
    pub estimate: Vec<Parameter>,
    /// Most hits (of a racket, a foot, a hand) that the track may hold; as many as explain it where `None`. Of a ball whose contacts
    /// last there are none.
    pub hits: Option<usize>,
    /// The camera moved by one standard deviation along each independent direction of its uncertainty
    /// ([`Calibration::one_sigma`](gravisight_geometry::camera::Calibration::one_sigma)): what that changes enters σ. Empty: the camera is right.
    pub cameras: Vec<Camera>,
    /// Whether the camera is assumed ([`assumed_camera`](gravisight_geometry::camera::assumed_camera)) and not measured. Its uncertainty then
    /// enters σ and rejects no flight; without it, a flight whose distance the camera leaves open is not explained.
    pub camera_assumed: bool,
    /// The numbers that trajectories are judged by; the scene's ([`EstimatorConfig::of`]) where `None`.
    pub config: Option<EstimatorConfig>,
    /// Whether the observations' times are right, as a video's own are: no lost frames are looked for then.
    pub times_known: bool,
    /// Whether the observations' sizes were measured in the pictures by this library: they are radii then, and a size that does not fit
    /// questions the scene's ball.
    pub sizes_measured: bool,
}
