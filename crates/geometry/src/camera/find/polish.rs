//! The best view of four corners.

use std::convert::Infallible;

use nalgebra::{Point2, Point3, SMatrix, SVector};

use super::view::{UNKNOWNS, View};
use crate::least_squares::{Damping, LeastSquares, minimised};

/// Eight steps, damped little. The closed form's view is near, except where there is hardly any perspective; without these steps
/// telephoto views (f above three widths) are lost. Measured on 41 scenes.
const DAMPING: Damping =
    Damping { first: 1e-4, relax: 1.0, least: 1e-4, stiffen: 20.0, most: 10.0, steps: 8, converged: 1e-4 };
/// Weight of a prior on the logarithm of the focal length, widths²: where there is no perspective, nothing else is known of it.
const PRIOR: f64 = 1e-6;
/// Longest step of the logarithm of the focal length.
const LONGEST: f64 = 0.5;

/// Four points of a plane and their images in a view's units.
#[derive(Clone, Copy)]
pub(super) struct Corners<'a> {
    pub world: &'a [Point3<f64>; 4],
    pub image: &'a [Point2<f64>; 4],
    /// Least and greatest focal length.
    pub focal: [f64; 2],
}

struct Polished<'a> {
    corners: Corners<'a>,
    view: View,
    cost: f64,
    normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    gradient: SVector<f64, UNKNOWNS>,
}

impl<'a> Polished<'a> {
    /// [`None`] where a corner is not in front of the camera.
    fn at(corners: Corners<'a>, view: View) -> Option<Self> {
        let mut at = Self { corners, view, cost: 0.0, normal: SMatrix::zeros(), gradient: SVector::zeros() };
        for (world, image) in corners.world.iter().zip(corners.image) {
            let (seen, jacobian) = view.image_with_jacobian(world)?;
            let error = seen - image;
            at.cost += error.norm_squared();
            at.normal += jacobian.transpose() * jacobian;
            at.gradient += jacobian.transpose() * error;
        }
        at.normal[(0, 0)] += PRIOR;
        Some(at)
    }
}

impl LeastSquares for Polished<'_> {
    type Normal = ();
    type Step = SVector<f64, UNKNOWNS>;
    type Error = Infallible;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn linearised(&mut self) -> Result<Option<()>, Infallible> {
        Ok(Some(()))
    }

    fn step(&self, (): &(), damping: f64) -> Option<Self::Step> {
        let mut damped = self.normal;
        for index in 0..UNKNOWNS {
            damped[(index, index)] = damped[(index, index)] * (1.0 + damping) + 1e-12;
        }
        let step = damped.cholesky()?.solve(&-self.gradient);
        Some(if step[0].abs() > LONGEST { step * (LONGEST / step[0].abs()) } else { step })
    }

    fn moved(&self, (): &(), step: &Self::Step) -> Result<Option<Self>, Infallible> {
        let mut view = self.view.moved(step);
        view.focal = view.focal.clamp(self.corners.focal[0], self.corners.focal[1]);
        Ok(Self::at(self.corners, view))
    }
}

impl Corners<'_> {
    /// The greatest distance of a corner from where a view puts it; [`None`] where one is not in front of the camera.
    pub(super) fn worst(&self, view: &View) -> Option<f64> {
        let distance = |(world, image): (&Point3<f64>, &Point2<f64>)| Some((view.image(world)? - image).norm());
        self.world.iter().zip(self.image).map(distance).try_fold(0.0_f64, |worst, off| Some(worst.max(off?)))
    }
}

/// The view nearest to `view` with the least distances of the four corners, and the greatest of these; [`None`] behind the camera.
pub(super) fn polished(corners: Corners, view: View) -> Option<(View, f64)> {
    let Ok(found) = minimised(Polished::at(corners, view)?, &DAMPING);
    Some((found.view, corners.worst(&found.view)?))
}
