//! Whether a path through the picture bends downwards as a ball's does, where neither the camera nor the ball is known.
//!
//! The picture of gravity, in apparent radii a second squared, is the same wherever a ball is: g / R, for an upright camera. It is unknown within
//! the sizes of balls (and of slow motion), but one number for the whole path. What rolls, drives or glides bends less, a limb anyhow.

use nalgebra::Vector2;

use super::config::{FallConfig, GravityConfig};
use super::gravity::{Acceleration, ImagePoint, parts, student};
use gravisight_geometry::statistics::median;

/// Log-odds that a path (of an upright camera) bends as a ball's does; `focal` is about the camera's focal length, px.
pub(super) fn log_odds(path: &[ImagePoint], focal: f64, config: &FallConfig, gravity_config: &GravityConfig) -> f64 {
    let Some(radius) = median(path.iter().map(|point| point.radius)).filter(|radius| *radius > 0.0) else { return 0.0 };
    let parts = parts(path, gravity_config.part).filter(|part| part.len() >= gravity_config.fewest);
    // A path towards the camera also bends by perspective: by twice the image's speed times the relative change of depth, which is about half the
    // speed over the focal length.
    let bend = |Acceleration { speed, along_axes, sigma }| {
        (along_axes / radius, sigma / radius, speed * speed / (focal * radius))
    };
    let bends: Vec<(Vector2<f64>, f64, f64)> = parts.filter_map(Acceleration::of).map(bend).collect();
    if bends.is_empty() {
        return 0.0;
    }
    let student = |value: f64, spread: f64| student(value, spread, gravity_config.freedom);
    let ball = |gravity: f64| {
        let part = |(bend, sigma, perspective): &(Vector2<f64>, f64, f64)| {
            let off = bend.y - config.along * gravity;
            let sigma = sigma.hypot(*perspective);
            let spread = gravity * config.spread[usize::from(off > 0.0)];
            student(off, spread.hypot(sigma)) + student(bend.x, (gravity * config.spread_across).hypot(sigma))
        };
        bends.iter().map(part).sum::<f64>()
    };
    let other = |scale: f64| {
        let part = |(bend, sigma, _): &(Vector2<f64>, f64, f64)| {
            student(bend.y, scale.hypot(*sigma)) + student(bend.x, scale.hypot(*sigma))
        };
        bends.iter().map(part).sum::<f64>()
    };
    let [ball, other] = [marginal(config.gravities, config.steps, ball), marginal(config.others, config.steps, other)];
    (ball - other).clamp(-config.most, config.most)
}

/// Logarithm of the mean of a likelihood over a range that is even in the logarithm, by so many values.
fn marginal([least, most]: [f64; 2], steps: usize, log_likelihood: impl Fn(f64) -> f64) -> f64 {
    let at = |step: usize| (least.ln() + (most / least).ln() * (step as f64 + 0.5) / steps as f64).exp();
    let values: Vec<f64> = (0..steps).map(|step| log_likelihood(at(step))).collect();
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + (values.iter().map(|value| (value - largest).exp()).sum::<f64>() / steps as f64).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path of 30 frames a second with this acceleration, px/s², of something with a radius of 5 px.
    fn path(frames: i32, acceleration: [f64; 2]) -> Vec<ImagePoint> {
        let point = |frame: i32| {
            let time = f64::from(frame) / 30.0;
            let at = [0, 1].map(|axis| [200.0, -150.0][axis] * time + acceleration[axis] * time * time / 2.0);
            ImagePoint { time, at: at.into(), radius: 5.0, sigma: 0.7 }
        };
        (0..frames).map(point).collect()
    }

    fn of(path: &[ImagePoint]) -> f64 {
        log_odds(path, 1280.0, &FallConfig::default(), &GravityConfig::default())
    }

    #[test]
    fn what_falls_is_a_ball_and_what_glides_rises_or_jerks_is_none() {
        // A tennis ball: 9.81 m/s² over 0.0335 m.
        let falls = of(&path(25, [0.0, 5.0 * 293.0]));
        let others = [[0.0, 0.0], [0.0, -5.0 * 293.0], [5.0 * 293.0, 0.0]].map(|other| of(&path(25, other)));
        assert!(falls > 3.0 && others[0] < -1.0 && others.iter().all(|other| *other < 0.0), "{falls} {others:?}");
        // In five frames of a small ball nothing can be told.
        let short: Vec<ImagePoint> =
            path(5, [0.0; 2]).into_iter().map(|point| ImagePoint { radius: 0.5, ..point }).collect();
        assert!(of(&short).abs() < 1.0, "{}", of(&short));
        assert_eq!(of(&[]), 0.0);
    }
}
