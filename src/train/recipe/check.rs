//! What a configuration may not say.

use super::parts::STARTS;
use super::{Augmentation, FutureConfig, HeatmapLoss, Recipe, Supervision, Velocity};
use crate::model::{MOTION_SIDE, VERIFIER_SIDE, check_input};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::size::Size;

impl Recipe {
    /// Refuses values that cannot train.
    ///
    /// # Errors
    /// [`Error::Value`] with the field.
    pub fn check(&self) -> Result<()> {
        let refuse = |field: &str, reason: String| Err(Error::value("run configuration", field, reason));
        if self.phases.is_empty() {
            return refuse("phases", "needs at least one [[phases]]".into());
        }
        check_input(&self.architecture(1.0), self.input, &self.normalisation, "run configuration")?;
        let multiple = self.architecture(1.0).input_multiple();
        if self.name.is_empty() || self.name.contains(['/', '\\']) {
            return refuse("name", format!("must be a file name, not `{}`", self.name));
        }
        let largest = self.input.width.min(self.input.height);
        for (index, phase) in self.phases.iter().enumerate() {
            let field = |name: &str| format!("phases[{index}].{name}");
            if phase.steps == 0 || phase.batch == 0 {
                return refuse(&field("steps/batch"), "must be positive".into());
            }
            if !(phase.learning_rate.is_finite() && phase.learning_rate > 0.0) {
                return refuse(&field("learning_rate"), format!("must be positive, not {}", phase.learning_rate));
            }
            if !(0.0..=phase.learning_rate).contains(&phase.final_learning_rate) {
                let reason = format!("must be from 0 to the learning rate, not {}", phase.final_learning_rate);
                return refuse(&field("final_learning_rate"), reason);
            }
            if let Some(side) = phase.crop.filter(|&side| side == 0 || side % multiple != 0 || side > largest) {
                let reason = format!("must be a multiple of {multiple} up to {largest}, not {side}");
                return refuse(&field("crop"), reason);
            }
        }
        if !(0.0..1.0).contains(&self.ema_decay) {
            return refuse("ema_decay", format!("must be in [0, 1), not {}", self.ema_decay));
        }
        if self.checkpoint_every == 0 || self.validate_every == 0 || self.validate_frames == 0 {
            return refuse("checkpoint_every/validate_every/validate_frames", "must be positive".into());
        }
        for (field, value) in [
            ("depth_weight", self.depth_weight),
            ("depth_transition", self.depth_transition),
            ("clip_norm", self.clip_norm),
            ("prior_depth", self.prior_depth.unwrap_or(1.0)),
            ("fit.noise_px", self.fit.noise_px.unwrap_or(1.0)),
            ("fit.half_weight_sigma", self.fit.half_weight_sigma),
            ("fit.largest_sigma", self.fit.largest_sigma),
            ("heatmap_loss.sigma", self.heatmap_loss().sigma()),
            ("adam_epsilon", self.adam_epsilon),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(field, format!("must be positive, not {value}"));
            }
        }
        let Augmentation { brightness, colour, noise, blur, flip, shift, roll_degrees, zoom } = self.augmentation;
        for (field, value) in [
            ("augmentation.brightness", f64::from(brightness)),
            ("augmentation.colour", f64::from(colour)),
            ("augmentation.noise", f64::from(noise)),
            ("augmentation.flip", flip),
            ("augmentation.zoom", zoom),
            ("augmentation.roll_degrees / 180", roll_degrees / 180.0),
            ("weight_decay", self.weight_decay),
            ("labelled_fraction", self.labelled_fraction),
            ("fit.largest_outlier_fraction", self.fit.largest_outlier_fraction),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return refuse(field, format!("must be from 0 to 1, not {value}"));
            }
        }
        if !(0.0..=0.25).contains(&blur) {
            return refuse("augmentation.blur", format!("must be from 0 to 0.25, not {blur}"));
        }
        if shift > largest / 4 {
            return refuse("augmentation.shift", format!("must be at most a quarter of the input, not {shift} px"));
        }
        if !(0.0..=0.5).contains(&self.empty_fraction) {
            return refuse("empty_fraction", format!("must be from 0 to 0.5, not {}", self.empty_fraction));
        }
        if !(0.0..=100.0).contains(&self.label_noise_px) {
            return refuse("label_noise_px", format!("must be from 0 to 100 px, not {}", self.label_noise_px));
        }
        if !(0.0..=45.0).contains(&self.camera_off_degrees) {
            return refuse("camera_off_degrees", format!("must be from 0 to 45, not {}", self.camera_off_degrees));
        }
        if self.clips_per_camera == Some(0) {
            return refuse("clips_per_camera", "must be at least 1".into());
        }
        if !(self.centre_weight.is_finite() && self.centre_weight >= 0.0) {
            return refuse("centre_weight", format!("must not be negative, but is {}", self.centre_weight));
        }
        if self.supervision.is_rendered() && !self.architecture(1.0).depth.is_size() {
            return refuse(
                "network",
                "must measure apparent size with supervision \"rendered\" or \"candidates\": use \"compact-size\" or \
                 \"verifier\""
                    .into(),
            );
        }
        let (channels, needed) = (self.architecture(1.0).input_channels(), self.supervision.input_channels());
        if channels != needed {
            let (views, asked) = (channels / 3, needed / 3);
            let name = match self.supervision {
                Supervision::Candidates => "\"verifier\"",
                Supervision::Motion => "\"motion\"",
                _ => "another network",
            };
            let reason =
                format!("takes {views} view(s) of each picture, but the supervision gives {asked}; use {name}");
            return refuse("network", reason);
        }
        if self.supervision.is_rendered() && matches!(self.heatmap_loss(), HeatmapLoss::Mse { .. }) {
            return refuse(
                "heatmap_loss",
                "must be \"cross_entropy\" with supervision \"rendered\" or \"candidates\"".into(),
            );
        }
        let crops =
            [(Supervision::Candidates, VERIFIER_SIDE, "candidates"), (Supervision::Motion, MOTION_SIDE, "motion")];
        for (supervision, side, name) in crops {
            if self.supervision == supervision && self.input != Size::square(side) {
                return refuse("input", format!("must be {side}×{side} px with supervision \"{name}\""));
            }
        }
        if self.supervision == Supervision::Mixed && self.labelled_fraction == 0.0 {
            return refuse("labelled_fraction", "must be above 0 with supervision \"mixed\"".into());
        }
        self.check_future()
    }

    fn check_future(&self) -> Result<()> {
        let FutureConfig { ahead, weight, robust_px, around, learn, velocity, sequence, .. } = &self.future;
        let refuse = |field: &str, reason: String| Err(Error::value("run configuration", field, reason));
        if ahead.is_empty() || ahead.iter().any(|&frames| frames < 2) {
            return refuse("future.ahead", "needs frames ahead, each at least 2 (the window holds 1)".into());
        }
        if !learn.is_empty() && !self.supervision.is_future() {
            return refuse("future.learn", "needs a supervision that learns through forecasts (future-2d-…)".into());
        }
        if self.supervision == Supervision::Future3dGt && *velocity != Velocity::Pictures {
            return refuse("future.velocity", "must be \"pictures\" with supervision \"future-3d-gt\"".into());
        }
        if let Some(frames) = *sequence {
            let shortest = STARTS - 1 + ahead.iter().min().unwrap_or(&0);
            if frames < shortest || self.phases.iter().any(|phase| frames > phase.batch) {
                let reason = format!("must be from {shortest} to the batch size, not {frames}");
                return refuse("future.sequence", reason);
            }
        }
        if !(2..=1000).contains(around) {
            return refuse("future.around", format!("must be from 2 to 1000 frames, not {around}"));
        }
        if !(weight.is_finite() && *weight > 0.0) {
            return refuse("future.weight", format!("must be positive, not {weight}"));
        }
        match *robust_px > 0.0 {
            true => Ok(()),
            false => refuse("future.robust_px", format!("must be positive (inf: plain L1), not {robust_px}")),
        }
    }
}
