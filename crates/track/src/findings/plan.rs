//! A place from above, and where the ball bounced in it.

use nalgebra::{Matrix2, Point3, SymmetricEigen, Vector3};
use serde::Serialize;

use super::covariance_at;
use crate::Fit;
use gravisight_physics::{Cuboid, Scene};

/// Room around what is drawn, as a fraction of its longer side, and at least, m.
const MARGIN: f64 = 0.05;
const LEAST_MARGIN: f64 = 0.5;
/// A bounce that is known worse than this is not drawn, m: its ellipse would be the whole picture.
const LEAST_KNOWN: f64 = 5.0;

/// A place seen from above (x to the right, y up), m.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Plan {
    /// Painted lines, the net, outlines of boxes: each from point to point.
    pub lines: Vec<Vec<[f64; 2]>>,
    /// Bounces that are explained.
    pub bounces: Vec<Spot>,
    /// The corner with the least x and y, and the one with the most, of all that is there with some room.
    pub low: [f64; 2],
    /// See `low`.
    pub high: [f64; 2],
}

/// A bounce seen from above.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Spot {
    /// The bounce's number, from 1.
    pub bounce: usize,
    /// Its middle, m.
    pub at: [f64; 2],
    /// Semi-axes of its 1-σ ellipse, m, the longer first.
    pub sigma: [f64; 2],
    /// Angle of the longer one from x towards y, rad.
    pub angle: f64,
}

impl Plan {
    /// Of what the scene holds and the fits' explained bounces.
    pub(super) fn new<'a>(scene: &Scene, fits: impl Iterator<Item = &'a Fit>) -> Self {
        let mut lines: Vec<Vec<[f64; 2]>> =
            scene.lines.iter().map(|line| line.map(|[x, y, _]| [x, y]).to_vec()).collect();
        lines.push(scene.net.iter().map(|[x, y, _]| [*x, *y]).collect());
        lines.extend(scene.boxes.iter().map(outline));
        lines.retain(|line| line.len() > 1);
        let mut bounces = Vec::new();
        let mut number = 0;
        for fit in fits {
            for impact in &fit.impacts {
                number += 1;
                let Some(covariance) = covariance_at(fit, impact.time).filter(|_| impact.explained) else { continue };
                let spot = Spot::new(number, &impact.world, covariance.fixed_view::<2, 2>(0, 0).into_owned());
                if spot.sigma[0] < LEAST_KNOWN {
                    bounces.push(spot);
                }
            }
        }
        let mut plan = Self { lines, bounces, ..Self::default() };
        plan.frame();
        plan
    }

    /// Finds the corners.
    fn frame(&mut self) {
        let spots = self.bounces.iter().flat_map(|spot| {
            let [x, y] = spot.at;
            let reach = 2.0 * spot.sigma[0];
            [[x - reach, y - reach], [x + reach, y + reach]]
        });
        let points: Vec<[f64; 2]> = self.lines.iter().flatten().copied().chain(spots).collect();
        if points.is_empty() {
            return;
        }
        let least = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
        let most = |axis: usize| points.iter().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
        let longer = (most(0) - least(0)).max(most(1) - least(1));
        let margin = (MARGIN * longer).max(LEAST_MARGIN);
        self.low = [0, 1].map(|axis| least(axis) - margin);
        self.high = [0, 1].map(|axis| most(axis) + margin);
    }
}

impl Spot {
    fn new(bounce: usize, world: &Point3<f64>, covariance: Matrix2<f64>) -> Self {
        let SymmetricEigen { eigenvalues, eigenvectors } = covariance.symmetric_eigen();
        let [longer, shorter] = if eigenvalues[0] >= eigenvalues[1] { [0, 1] } else { [1, 0] };
        let axis = eigenvectors.column(longer);
        Self {
            bounce,
            at: [world.x, world.y],
            sigma: [longer, shorter].map(|index| eigenvalues[index].max(0.0).sqrt()),
            angle: axis.y.atan2(axis.x),
        }
    }
}

/// The upper side of a box from above, closed.
fn outline(cuboid: &Cuboid) -> Vec<[f64; 2]> {
    let world_from_box = cuboid.world_from_box();
    let corner = |[x, y]: [f64; 2]| {
        let [half_x, half_y, half_z] = cuboid.half_size;
        let at = Point3::from(cuboid.position) + world_from_box * Vector3::new(x * half_x, y * half_y, half_z);
        [at.x, at.y]
    };
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]].map(corner).to_vec()
}
