//! How the sphere of an outline moves with it.

use nalgebra::{Matrix3, Point3, Vector3};

use super::{Camera, Outline};
use crate::error::Result;

/// Step of the central differences of an outline, as a share of the ball's distance: their error is its square.
const STEP: f64 = 1e-5;

impl Camera {
    /// The centre (world frame, m) of the ball of `radius` (m) that has this outline, and its 3×3 Jacobian d(world)/d(centre's
    /// u, v, outline's radius), m/px. By the inverse of the outline's derivatives, which are central differences.
    ///
    /// # Errors
    /// As [`Self::ball_from_outline`].
    #[doc(hidden)]
    pub fn world_from_outline_with_jacobian(
        &self,
        outline: &Outline,
        radius: f64,
    ) -> Result<(Point3<f64>, Matrix3<f64>)> {
        let centre = self.ball_from_outline(outline, radius)?;
        let step = STEP * centre.coords.norm();
        let mut by_centre = Matrix3::zeros();
        for axis in 0..3 {
            let at = |by: f64| self.outline(&(centre + Vector3::ith(axis, by)), radius);
            let (less, more) = (at(-step)?, at(step)?);
            let moved = (more.centre - less.centre) / (2.0 * step);
            by_centre.set_column(axis, &Vector3::new(moved.x, moved.y, (more.radius - less.radius) / (2.0 * step)));
        }
        // A sphere's outline always tells where it is.
        let by_outline = by_centre.try_inverse().unwrap_or_else(Matrix3::zeros);
        Ok((self.world_from_camera(&centre), self.rotation_inverse * by_outline))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::super::Distortion;
    use super::*;
    use crate::size::Size;

    #[test]
    fn the_slope_of_a_spheres_place_equals_central_differences() {
        let intrinsic = Matrix3::new(500.0, 0.0, 499.5, 0.0, 480.0, 399.5, 0.0, 0.0, 1.0);
        let bent = Distortion { k1: -0.1, p1: 0.002, ..Distortion::default() };
        let rotation = Rotation3::from_euler_angles(0.3, -0.8, 1.9).into_inner();
        let camera = Camera::new(Size::new(1000, 800), intrinsic, bent, rotation, Vector3::new(0.4, 1.0, 2.0)).unwrap();
        let radius = 0.2;
        for centre in [Point3::new(0.1, 0.2, 3.0), Point3::new(1.9, -1.2, 2.6)] {
            let outline = camera.outline(&centre, radius).unwrap();
            let (place, slope) = camera.world_from_outline_with_jacobian(&outline, radius).unwrap();
            assert!((place - camera.world_from_camera(&centre)).norm() < 1e-7);
            for axis in 0..3 {
                let at = |by: f64| {
                    let mut moved = outline;
                    match axis {
                        2 => moved.radius += by,
                        _ => moved.centre[axis] += by,
                    }
                    camera.world_from_camera(&camera.ball_from_outline(&moved, radius).unwrap())
                };
                let expected = (at(1e-4) - at(-1e-4)) / 2e-4;
                let found = slope.column(axis);
                assert!((found - expected).norm() < 1e-4 * expected.norm(), "{axis}: {found} {expected}");
            }
        }
    }
}
