//! Where a line of sight is in a part of the world.

use nalgebra::Point2;

use super::Camera;
use crate::volume::Volume;

impl Camera {
    /// The depths (camera z, m) at which what is seen at `image` (px) is inside `volume`, nearest and farthest; none where its line of
    /// sight does not pass the volume before the camera, or the lens has no such line.
    pub fn depths_within(&self, volume: &Volume, image: &Point2<f64>) -> Option<[f64; 2]> {
        let centre = self.centre();
        let along = self.world_from_image(image, 1.0).ok()? - centre;
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let [low, high] = [volume.low[axis], volume.high[axis]].map(|side| side - centre[axis]);
            if along[axis].abs() < f64::MIN_POSITIVE {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let [first, last] = [low / along[axis], high / along[axis]];
            near = near.max(first.min(last));
            far = far.min(first.max(last));
        }
        (near <= far && far > 0.0).then_some([near, far])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point2, Vector3};

    use super::*;
    use crate::camera::Distortion;
    use crate::size::Size;

    /// At (0, −4, 1), level, looking along y.
    fn camera() -> Camera {
        let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        let intrinsic = Matrix3::new(100.0, 0.0, 99.5, 0.0, 100.0, 99.5, 0.0, 0.0, 1.0);
        let translation = -(rotation * Vector3::new(0.0, -4.0, 1.0));
        Camera::new(Size::square(200), intrinsic, Distortion::default(), rotation, translation).unwrap()
    }

    #[test]
    fn a_line_of_sight_is_inside_between_the_sides_that_it_crosses() {
        let room = Volume { low: [-2.0, -3.0, 0.0], high: [2.0, 5.0, 3.0] };
        let depths = |x: f64, y: f64| camera().depths_within(&room, &Point2::new(x, y));
        // Straight ahead: from 1 to 9 m.
        let [near, far] = depths(99.5, 99.5).unwrap();
        assert!((near - 1.0).abs() < 1e-9 && (far - 9.0).abs() < 1e-9);
        // 45° down: the floor is met 1 m ahead, where the room begins; to the right the side wall is 2 m away.
        let [near, far] = depths(99.5, 199.5).unwrap();
        assert!((near - 1.0).abs() < 1e-9 && (far - 1.0).abs() < 1e-9);
        let [near, far] = depths(199.5, 99.5).unwrap();
        assert!((near - 1.0).abs() < 1e-9 && (far - 2.0).abs() < 1e-9);
        let below = Volume { high: [2.0, 5.0, -1.0], ..room };
        assert_eq!(
            camera().depths_within(&below, &Point2::new(99.5, 50.0)),
            None,
            "upwards there is nothing below the floor"
        );
        assert_eq!(camera().depths_within(&Volume::ALL, &Point2::new(99.5, 50.0)), Some([0.0, f64::INFINITY]));
    }
}
