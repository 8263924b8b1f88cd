//! Whether a path through the picture bends downwards as a ball's does, where neither the camera nor the ball is known.
//!
//! The picture of gravity, in apparent radii a second squared, is the same wherever a ball is: g / R, for an upright camera. It is unknown within
//! the sizes of balls (and of slow motion), but one number for all paths of a video's ball: paths that are surely the ball's tell it for the others.
//! What rolls, drives or glides bends less, a limb anyhow.

use nalgebra::Vector2;

use super::config::{FallConfig, GravityConfig};
use super::gravity::{Acceleration, ImagePoint, parts, student};
use gravisight_geometry::statistics::median;

/// How a path bends.
#[derive(Debug, Clone)]
pub(super) struct Fall {
    /// Log-likelihood ratio of a ball under each of [`gravities`] over another thing.
    log_ratios: Vec<f64>,
}

impl Fall {
    /// Of a path before an upright camera; `focal` is about its focal length, px. None for a path that is too short to tell.
    pub fn of(path: &[ImagePoint], focal: f64, config: &FallConfig, gravity_config: &GravityConfig) -> Option<Self> {
        let radius = median(path.iter().map(|point| point.radius)).filter(|radius| *radius > 0.0)?;
        let parts = parts(path, config.part).filter(|part| part.len() >= gravity_config.fewest);
        // A path towards the camera also bends by perspective: by twice the image's speed times the relative change of depth, which is about half
        // the speed over the focal length.
        let bend = |Acceleration { speed, along_axes, sigma }| {
            (along_axes / radius, sigma / radius, speed * speed / (focal * radius))
        };
        let bends: Vec<(Vector2<f64>, f64, f64)> = parts.filter_map(Acceleration::of).map(bend).collect();
        if bends.is_empty() {
            return None;
        }
        let student = |value: f64, spread: f64| student(value, spread, gravity_config.freedom);
        let ball = |gravity: f64| {
            let part = |(bend, sigma, perspective): &(Vector2<f64>, f64, f64)| {
                let off = bend.y - config.along * gravity;
                let sigma = sigma.hypot(*perspective);
                let spread = gravity * config.spread[usize::from(off > 0.0)];
                let across = gravity * config.spread_across;
                student(off, spread.hypot(sigma)) + student(bend.x, across.hypot(sigma))
            };
            bends.iter().map(part).sum::<f64>()
        };
        let other = |scale: f64| {
            let part = |(bend, sigma, _): &(Vector2<f64>, f64, f64)| {
                student(bend.y, scale.hypot(*sigma)) + student(bend.x, scale.hypot(*sigma))
            };
            bends.iter().map(part).sum::<f64>()
        };
        let others = even(config.others, config.steps).map(|scale| other(scale) - (config.steps as f64).ln());
        let other = log_sum(&others.collect::<Vec<_>>());
        Some(Self { log_ratios: gravities(config).map(|(gravity, _)| ball(gravity) - other).collect() })
    }

    /// Log-likelihood ratio where gravity has these log-probabilities.
    fn log_ratio(&self, log_probabilities: &[f64]) -> f64 {
        let both: Vec<f64> = self.log_ratios.iter().zip(log_probabilities).map(|(ratio, log)| ratio + log).collect();
        log_sum(&both)
    }
}

/// Log-odds that each path bends as the ball's does, from how all of them bend and the log-odds of each that it is the ball's before that: a path
/// either has the gravity of the others that are balls', or one of its own, or how it falls tells nothing.
pub(super) fn log_odds(falls: &[(Fall, f64)], config: &FallConfig) -> Vec<f64> {
    let prior: Vec<f64> = gravities(config).map(|(_, probability)| probability.ln()).collect();
    // Of each path under each gravity: what it says about gravity, be it the ball's or not.
    let says = |(fall, log_odds): &(Fall, f64)| -> Vec<f64> {
        let ball = 1.0 / (1.0 + (-log_odds).exp());
        let [ball, other] = [ball * (1.0 - config.own_gravity), 1.0 - ball * (1.0 - config.own_gravity)].map(f64::ln);
        fall.log_ratios.iter().map(|ratio| log_sum(&[other, ball + ratio])).collect()
    };
    let said: Vec<Vec<f64>> = falls.iter().map(says).collect();
    let total = |gravity: usize| prior[gravity] + said.iter().map(|said| said[gravity]).sum::<f64>();
    let total: Vec<f64> = (0..prior.len()).map(total).collect();
    let of_path = |((fall, _), said): (&(Fall, f64), &Vec<f64>)| {
        let by_others: Vec<f64> = total.iter().zip(said).map(|(total, own)| total - own).collect();
        let sum = log_sum(&by_others);
        let by_others: Vec<f64> = by_others.iter().map(|log| log - sum).collect();
        let common = (1.0 - config.own_gravity).ln() + fall.log_ratio(&by_others);
        let own = config.own_gravity.ln() + fall.log_ratio(&prior);
        let upright = log_sum(&[common, own]) + (1.0 - config.untold).ln();
        log_sum(&[upright, config.untold.ln()]).min(config.most)
    };
    falls.iter().zip(&said).map(of_path).collect()
}

/// Values of gravity, radii/s², and their probabilities before anything is seen.
fn gravities(config: &FallConfig) -> impl Iterator<Item = (f64, f64)> {
    let (slowed, steps) = (config.slowed_fraction, config.steps);
    let of =
        move |range: [f64; 2], fraction: f64| even(range, steps).map(move |value| (value, fraction / steps as f64));
    of(config.slowed, slowed).chain(of(config.gravities, 1.0 - slowed))
}

/// So many values in a range that are even in the logarithm.
fn even([least, most]: [f64; 2], steps: usize) -> impl Iterator<Item = f64> {
    (0..steps).map(move |step| (least.ln() + (most / least).ln() * (step as f64 + 0.5) / steps as f64).exp())
}

/// Logarithm of the sum of values of which the logarithms are given.
fn log_sum(logarithms: &[f64]) -> f64 {
    let largest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    largest + logarithms.iter().map(|value| (value - largest).exp()).sum::<f64>().ln()
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

    fn fall(path: &[ImagePoint]) -> Option<Fall> {
        Fall::of(path, 1280.0, &FallConfig::default(), &GravityConfig::default())
    }

    /// Of a path alone.
    fn of(path: &[ImagePoint]) -> f64 {
        log_odds(&[(fall(path).unwrap(), 0.0)], &FallConfig::default())[0]
    }

    #[test]
    fn what_falls_is_a_ball_and_what_glides_rises_or_jerks_is_none() {
        // A tennis ball: 9.81 m/s² over 0.0335 m.
        let falls = of(&path(25, [0.0, 5.0 * 293.0]));
        let others = [[0.0, 0.0], [0.0, -5.0 * 293.0], [5.0 * 293.0, 0.0]].map(|other| of(&path(25, other)));
        assert!(falls > 3.0 && others[0] < -1.0 && others.iter().all(|other| *other < 0.5), "{falls} {others:?}");
        // In five frames of a small ball nothing can be told.
        let short: Vec<ImagePoint> =
            path(5, [0.0; 2]).into_iter().map(|point| ImagePoint { radius: 0.5, ..point }).collect();
        assert!(of(&short).abs() < 1.0, "{}", of(&short));
        assert!(fall(&[]).is_none());
    }

    #[test]
    fn a_path_that_is_surely_the_balls_tells_gravity_for_the_others() {
        let [tennis, football] = [293.0, 89.0].map(|gravity| fall(&path(25, [0.0, 5.0 * gravity])).unwrap());
        // Of the last of these paths, beside two that are surely the ball's.
        let beside = |sure: &Fall, last: &Fall| {
            let paths = [(sure.clone(), 8.0), (sure.clone(), 8.0), (last.clone(), 0.0)];
            log_odds(&paths, &FallConfig::default())[2]
        };
        for (one, other) in [(&tennis, &football), (&football, &tennis)] {
            let (same, different) = (beside(one, one), beside(other, one));
            assert!(same > different + 0.4, "{same} {different}");
        }
    }
}
