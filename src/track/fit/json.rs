//! A fit as FORMATS.md's `fit --json` says it.

use serde_json::{Value, json};

use super::{Fit, FittedFrame, Parameter};

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

impl Fit {
    /// The fit as a JSON object; metres, seconds and pixels.
    pub fn as_json(&self) -> Value {
        let frame = |frame: &FittedFrame| {
            let covariance: Vec<Vec<f64>> =
                frame.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
            let mut fields = json!({"t": frame.time, "world": <[f64; 3]>::from(frame.state.position.coords),
                "velocity": <[f64; 3]>::from(frame.state.velocity), "speed": frame.state.velocity.norm(),
                "sigma": frame.sigma(), "covariance": covariance,
                "residual_px": frame.residual_px.map(<[f64; 2]>::from), "outlier": frame.outlier});
            if let Some(reason) = &frame.refused {
                fields["refused"] = json!(reason);
            }
            fields
        };
        let impacts = self.impacts.iter().map(|impact| {
            json!({"t": impact.time, "surface": impact.surface.to_string(),
                "world": <[f64; 3]>::from(impact.position), "speed": impact.speed})
        });
        let estimates = self.estimates.iter().map(|estimate| {
            let value = json!({"value": estimate.value, "sigma": estimate.sigma});
            (estimate.parameter.name().to_string(), value)
        });
        json!({"frames": self.frames.iter().map(frame).collect::<Vec<_>>(), "noise_px": self.noise_px,
            "rms_px": self.rms_px, "explained": self.explained, "impacts": impacts.collect::<Vec<_>>(),
            "estimates": Value::Object(estimates.collect()), "spin": self.spin})
    }
}
