//! The camera of the search: square pixels, the principal point in the picture's middle, no lens.

use nalgebra::{Matrix3, Point2, Point3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// Points nearer to the camera than this, m, have no image.
pub(super) const NEAR: f64 = 0.05;
/// Unknowns of a view: logarithm of the focal length, rotation (3), translation (3).
pub(super) const UNKNOWNS: usize = 7;

/// Focal length and pose of a camera whose other numbers are known.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Focal length, px.
    pub focal: f64,
    /// Principal point, px.
    pub centre: Vector2<f64>,
    /// `camera = rotation · world + translation`.
    pub rotation: Matrix3<f64>,
    /// m.
    pub translation: Vector3<f64>,
}

impl View {
    /// The camera point of a world point, m.
    pub(super) fn camera_from_world(&self, world: &Point3<f64>) -> Vector3<f64> {
        self.rotation * world.coords + self.translation
    }

    /// The image of a camera point, px; meaningless behind the camera.
    pub(super) fn image_from_camera(&self, camera: &Vector3<f64>) -> Point2<f64> {
        Point2::from(self.centre + camera.xy() * (self.focal / camera.z))
    }

    /// The image of a world point, px; [`None`] where it is not in front of the camera.
    pub(super) fn image(&self, world: &Point3<f64>) -> Option<Point2<f64>> {
        let camera = self.camera_from_world(world);
        (camera.z > NEAR).then(|| self.image_from_camera(&camera))
    }

    /// [`Self::image`] and its derivative by the unknowns, px.
    pub(super) fn image_with_jacobian(&self, world: &Point3<f64>) -> Option<(Point2<f64>, SMatrix<f64, 2, UNKNOWNS>)> {
        let turned = self.rotation * world.coords;
        let camera = turned + self.translation;
        if camera.z <= NEAR {
            return None;
        }
        let scale = self.focal / camera.z;
        let off = camera.xy() * scale;
        let by_camera = SMatrix::<f64, 2, 3>::new(scale, 0.0, -off.x / camera.z, 0.0, scale, -off.y / camera.z);
        let mut jacobian = SMatrix::<f64, 2, UNKNOWNS>::zeros();
        jacobian.set_column(0, &off);
        // A small rotation w moves the camera point by w × turned = −[turned]× · w.
        jacobian.fixed_view_mut::<2, 3>(0, 1).copy_from(&(-by_camera * turned.cross_matrix()));
        jacobian.fixed_view_mut::<2, 3>(0, 4).copy_from(&by_camera);
        Some((Point2::from(self.centre + off), jacobian))
    }

    /// Moved by a step of the unknowns.
    pub(super) fn moved(&self, by: &SVector<f64, UNKNOWNS>) -> Self {
        let turn = Rotation3::new(Vector3::new(by[1], by[2], by[3]));
        Self {
            focal: self.focal * by[0].exp(),
            centre: self.centre,
            rotation: turn * self.rotation,
            translation: self.translation + Vector3::new(by[4], by[5], by[6]),
        }
    }

    /// Where the camera stands, m.
    pub(super) fn place(&self) -> Vector3<f64> {
        -self.rotation.transpose() * self.translation
    }

    /// The view that a half-turn of the court makes of this one: courts look the same from both ends.
    pub(super) fn turned(&self) -> Self {
        Self { rotation: self.rotation * Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0)), ..*self }
    }

    /// The one of the two half-turns that has the camera at the near end, y < 0.
    pub(super) fn at_near_end(&self) -> Self {
        if self.place().y < 0.0 { *self } else { self.turned() }
    }

    /// Whether all of its numbers are finite.
    pub(super) fn is_finite(&self) -> bool {
        let numbers = self.rotation.iter().chain(self.translation.iter()).chain([&self.focal]);
        numbers.into_iter().all(|number| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_images_derivative_equals_central_differences() {
        let view = View {
            focal: 900.0,
            centre: Vector2::new(320.0, 180.0),
            rotation: *Rotation3::from_euler_angles(1.9, 0.1, 0.3).matrix(),
            translation: Vector3::new(0.5, -0.3, 14.0),
        };
        let world = Point3::new(2.0, -5.0, 0.9);
        let (image, jacobian) = view.image_with_jacobian(&world).unwrap();
        assert_eq!(image, view.image(&world).unwrap());
        for unknown in 0..UNKNOWNS {
            let step = SVector::ith(unknown, 1e-5);
            let [up, down] = [step, -step].map(|step| view.moved(&step).image(&world).unwrap());
            let difference = (up - down) / 2e-5 - jacobian.column(unknown);
            assert!(difference.norm() < 1e-5 * jacobian.column(unknown).norm().max(1.0), "{unknown}: {difference}");
        }
    }
}
