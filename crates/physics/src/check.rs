//! What a scene's numbers may be.

use super::scene::{Bounds, Contact, Scene};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::volume::radius_refusal;

/// Largest number a scene can hold (SI units): beyond it, products overflow.
const MAX_ENTRY: f64 = 1e9;

impl Scene {
    /// Whether every number is finite and in its range; `what` names the scene in errors.
    ///
    /// # Errors
    /// [`Error::Value`] with the field.
    pub fn check(&self, what: &str) -> Result<()> {
        let finite = |field: String, values: &[f64]| match values
            .iter()
            .find(|value| value.is_nan() || value.abs() > MAX_ENTRY)
        {
            Some(bad) => Err(Error::value(what, field, format!("must be a number up to ±{MAX_ENTRY:e}, not {bad}"))),
            None => Ok(()),
        };
        let within = |field: String, value: f64, low: f64, high: f64, words: &str| {
            finite(field.clone(), &[value])?;
            match (low..=high).contains(&value) {
                true => Ok(()),
                false => Err(Error::value(what, field, format!("must be {words}, not {value}"))),
            }
        };
        let positive =
            |field: String, value: f64| within(field, value, f64::MIN_POSITIVE, MAX_ENTRY, "greater than zero");
        let not_negative = |field: String, value: f64| within(field, value, 0.0, MAX_ENTRY, "zero or greater");
        finite("gravity".into(), &self.gravity)?;
        let ball = &self.ball;
        positive("ball.radius".into(), ball.radius)?;
        if let Some(reason) = radius_refusal(ball.radius) {
            return Err(Error::value(what, "ball.radius", reason));
        }
        positive("ball.mass".into(), ball.mass)?;
        not_negative("ball.drag_coefficient".into(), ball.drag_coefficient)?;
        finite("ball.lift_coefficient".into(), &[ball.lift_coefficient])?;
        not_negative("ball.air_density".into(), ball.air_density)?;
        finite("ball.spin".into(), &ball.spin)?;
        not_negative("ball.spin_decay".into(), ball.spin_decay)?;
        let optional =
            [("spin_sigma", ball.spin_sigma), ("drag_sigma", ball.drag_sigma), ("speed_max", ball.speed_max)];
        for (field, value) in optional {
            value.map_or(Ok(()), |value| positive(format!("ball.{field}"), value))?;
        }
        within("ball.inertia_factor".into(), ball.inertia_factor, 1e-3, 1.0, "between 0.001 and 1")?;
        match self.contact {
            Contact::Penalty { c, beta, beta_box } => {
                not_negative("contact.c".into(), c)?;
                positive("contact.beta".into(), beta)?;
                positive("contact.beta_box".into(), beta_box)?;
            }
            Contact::Spring { stiffness } => positive("contact.stiffness".into(), stiffness)?,
            Contact::Bounce { restitution, friction, restitution_sigma, friction_sigma } => {
                for (field, sigma) in [("restitution_sigma", restitution_sigma), ("friction_sigma", friction_sigma)] {
                    sigma.map_or(Ok(()), |sigma| positive(format!("contact.{field}"), sigma))?;
                }
                within("contact.restitution".into(), restitution, 0.0, 1.0, "between 0 and 1")?;
                not_negative("contact.friction".into(), friction)?;
            }
        }
        if let Some(floor) = &self.floor {
            finite("floor.height".into(), &[floor.height])?;
        }
        for (index, wall) in self.walls.iter().enumerate() {
            finite(format!("walls[{index}].point"), &wall.point)?;
            finite(format!("walls[{index}].normal"), &wall.normal)?;
            let length = wall.normal.iter().map(|n| n * n).sum::<f64>().sqrt();
            positive(format!("walls[{index}].normal (its length)"), length)?;
        }
        for (index, cuboid) in self.boxes.iter().enumerate() {
            finite(format!("boxes[{index}].position"), &cuboid.position)?;
            finite(format!("boxes[{index}].yaw"), &[cuboid.yaw])?;
            if let Some(rotation) = cuboid.rotation {
                let refuse = |reason: &str| Err(Error::value(what, format!("boxes[{index}].rotation"), reason));
                if cuboid.yaw != 0.0 {
                    return refuse("and `yaw` are both given; keep one");
                }
                if !rotation.is_proper() {
                    return refuse(
                        "must be a rotation: a quaternion [w, x, y, z], or a 3×3 matrix (rows) of determinant 1 whose columns are \
                         of length 1 and perpendicular",
                    );
                }
            }
            for half in cuboid.half_size {
                positive(format!("boxes[{index}].half_size"), half)?;
            }
        }
        for (index, [from, to]) in self.lines.iter().enumerate() {
            finite(format!("lines[{index}]"), &[*from, *to].concat())?;
        }
        finite("net".into(), &self.net.concat())?;
        if let Some(Bounds { low, high }) = self.bounds {
            finite("bounds".into(), &[low, high].concat())?;
            if (0..3).any(|axis| low[axis] >= high[axis]) {
                let reason = format!("must have every number of `low` below that of `high`, not {low:?} and {high:?}");
                return Err(Error::value(what, "bounds", reason));
            }
        }
        if let Some(spring) = &self.spring {
            not_negative("spring.stiffness".into(), spring.stiffness)?;
            finite("spring.anchor".into(), &spring.anchor)?;
        }
        Ok(())
    }
}
