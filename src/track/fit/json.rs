//! A fit as FORMATS.md's `fit --json` says it.

use serde_json::{Value, json};

use super::{Fit, FittedFrame, Flight, Parameter};
use crate::camera::Camera;

/// By how much times that are one may differ, s: rounding.
const SAME_TIME: f64 = 1e-9;

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

impl Flight {
    /// Speed at its start and its standard deviation, m/s; none where they are not known: it is not explained, or may as well
    /// stand still.
    pub fn known_speed(&self) -> Option<[f64; 2]> {
        let [speed, sigma] = self.speed;
        (self.explained && sigma < speed).then_some(self.speed)
    }
}

impl Fit {
    /// Whether what happens at a time (s) belongs to explained flights alone; of a hit both count, the flight that it ends and
    /// the one that it begins.
    pub fn is_explained_at(&self, time: f64) -> bool {
        let mut own =
            self.flights.iter().filter(|it| (it.start - SAME_TIME..=it.end + SAME_TIME).contains(&time)).peekable();
        match own.peek() {
            Some(_) => own.all(|flight| flight.explained),
            None => self.near(time).is_some_and(|frame| self.is_explained(frame)),
        }
    }

    /// Whether a frame of it belongs to an explained flight.
    pub fn is_explained(&self, frame: &FittedFrame) -> bool {
        self.flights.get(frame.flight).is_some_and(|flight| flight.explained)
    }

    /// 1-σ (m) of the positions that are known, ascending: those of explained flights, as far as σ is below the distance from the
    /// `camera` that saw them.
    pub fn known_sigmas(&self, camera: &Camera) -> Vec<f64> {
        let distance = |frame: &FittedFrame| camera.camera_from_world(&frame.state.position).coords.norm();
        let known = self.frames.iter().filter(|frame| self.is_explained(frame) && frame.sigma() < distance(frame));
        let mut sigmas: Vec<f64> = known.map(FittedFrame::sigma).collect();
        sigmas.sort_by(f64::total_cmp);
        sigmas
    }

    /// 1-σ of the position in the frame next to a time (s), m.
    pub fn sigma_at(&self, time: f64) -> Option<f64> {
        self.near(time).map(FittedFrame::sigma)
    }

    /// The frame next to a time, s.
    pub(super) fn near(&self, time: f64) -> Option<&FittedFrame> {
        self.frames.iter().min_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()))
    }

    /// What to think of it, in a sentence.
    pub fn verdict(&self) -> String {
        let count = |number: usize, what: &str| format!("{number} {what}{}", if number == 1 { "" } else { "s" });
        let parts =
            [count(self.flights.len(), "flight"), count(self.hits.len(), "hit"), count(self.impacts.len(), "bounce")]
                .join(", ");
        let wrong =
            self.flights.iter().enumerate().filter_map(|(index, flight)| {
                Some(format!("flight {} is not: {}", index + 1, flight.reason.as_ref()?))
            });
        let wrong: Vec<String> = wrong.collect();
        match wrong.is_empty() {
            true => format!("explained: {parts}"),
            false if wrong.len() == self.flights.len() && wrong.len() == 1 => {
                format!("not explained: {}", self.flights[0].reason.as_deref().unwrap_or_default())
            }
            false => format!("not all explained: {parts}; {}", wrong.join("; ")),
        }
    }

    /// The fit as a JSON object; metres, seconds and pixels.
    pub fn as_json(&self) -> Value {
        let frame = |frame: &FittedFrame| {
            let covariance: Vec<Vec<f64>> =
                frame.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
            let mut fields = json!({"t": frame.time, "world": <[f64; 3]>::from(frame.state.position.coords),
                "velocity": <[f64; 3]>::from(frame.state.velocity), "speed": frame.state.velocity.norm(),
                "sigma": frame.sigma(), "covariance": covariance,
                "residual_px": frame.residual_px.map(<[f64; 2]>::from), "outlier": frame.outlier, "flight": frame.flight,
                "explained": self.is_explained(frame)});
            if let Some(reason) = &frame.refused {
                fields["refused"] = json!(reason);
            }
            fields
        };
        let impacts = self.impacts.iter().zip(&self.within_lines).map(|(impact, within)| {
            json!({"t": impact.time, "surface": impact.surface.to_string(),
                "world": <[f64; 3]>::from(impact.position), "speed": impact.speed, "within_lines": within,
                "explained": self.is_explained_at(impact.time)})
        });
        let flights = self.flights.iter().map(|flight| {
            json!({"start": flight.start, "end": flight.end, "speed_start": flight.speed[0], "speed_sigma": flight.speed[1],
                "spin": flight.spin, "spin_sigma": flight.spin_sigma, "explained": flight.explained, "reason": flight.reason})
        });
        let hits = self.hits.iter().map(|hit| {
            json!({"time": hit.time, "frame": hit.frame, "world": <[f64; 3]>::from(hit.position.coords),
                "explained": self.is_explained_at(hit.time)})
        });
        let estimates = self.estimates.iter().map(|estimate| {
            let value = json!({"value": estimate.value, "sigma": estimate.sigma});
            (estimate.parameter.name().to_string(), value)
        });
        json!({"frames": self.frames.iter().map(frame).collect::<Vec<_>>(), "noise_px": self.noise_px,
            "rms_px": self.rms_px, "explained": self.explained, "impacts": impacts.collect::<Vec<_>>(),
            "flights": flights.collect::<Vec<_>>(), "hits": hits.collect::<Vec<_>>(), "notes": self.notes, "verdict": self.verdict(),
            "estimates": Value::Object(estimates.collect()), "spin": self.spin, "config": self.config})
    }
}
