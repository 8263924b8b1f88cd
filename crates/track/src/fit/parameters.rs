//! What of a scene a fit estimates beside the trajectory.

use crate::config::Parameter;
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::{Contact, Forecaster};

/// Standard deviations of a restitution, and of the logarithm of a drag, that are to be found without knowing them before.
const UNKNOWN_RESTITUTION: f64 = 0.3;
const UNKNOWN_DRAG: f64 = 1.0;
/// Drag coefficient of a smooth sphere (Achenbach 1972), from which the search for one starts where the scene has none.
const SPHERE: f64 = 0.45;

/// `forecaster` in a scene that knows little of these.
///
/// # Errors
/// [`Error::Fit`] for a restitution that the scene's contact has not.
pub(super) fn without_knowing(forecaster: &Forecaster, parameters: &[Parameter]) -> Result<Forecaster> {
    let mut scene = forecaster.scene().clone();
    for parameter in parameters {
        match (parameter, &mut scene.contact) {
            (Parameter::Spin, _) => scene.ball.spin = [0.0; 3],
            (Parameter::Drag, _) => {
                let own = scene.ball.drag_coefficient;
                scene.ball.drag_coefficient = if own == 0.0 { SPHERE } else { own };
                scene.ball.drag_sigma = Some(UNKNOWN_DRAG);
            }
            (Parameter::Restitution, Contact::Bounce { restitution_sigma, .. }) => {
                *restitution_sigma = Some(UNKNOWN_RESTITUTION);
            }
            (Parameter::Restitution, _) => {
                let reason = "restitution can be estimated with the contact model `bounce` only; change scene.json";
                return Err(Error::Fit { reason: reason.into() });
            }
        }
    }
    forecaster.in_scene(&scene)
}
