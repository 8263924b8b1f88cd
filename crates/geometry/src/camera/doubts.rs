//! What about a camera cannot be, or hardly, whoever made it: words for whoever uses it.

use nalgebra::{Point2, Point3, Vector3};

use super::Camera;

/// Below the ground by more than this, m.
const BELOW: f64 = 0.1;
/// Radius of the largest ball of the sports, a basketball's, m: where it is less than a pixel no ball can be seen.
pub(super) const LARGEST_BALL: f64 = 0.12;
/// How many times as large one focal length may be as the other: anamorphic video has 1.46.
const STRETCHED: f64 = 1.5;
/// Widest picture that a lens without distortion takes, degrees: lenses that keep lines straight end there.
const STRAIGHT: f64 = 100.0;
/// Cosine of the angle from straight up from which on the picture's lower edge points upwards.
const UPWARDS: f64 = 0.5;

impl Camera {
    /// Where it stands in the world, m.
    pub(crate) fn centre(&self) -> Point3<f64> {
        self.world_from_camera(&Point3::origin())
    }

    /// How wide the picture is without its lens's distortion, degrees.
    pub(super) fn field_of_view(&self) -> f64 {
        (2.0 * (self.size().xy()[0] / 2.0 / self.intrinsic()[(0, 0)]).atan()).to_degrees()
    }

    /// What is doubtful about this camera, in words; empty where nothing is. `ground` is the height of the ground, m, if that is known
    /// (else z = 0 is taken for it); `around` are points of the scene that stand where it should look, if any are known, m.
    ///
    /// A world whose z points up, in metres, is assumed, as everywhere.
    pub fn doubts(&self, ground: Option<f64>, around: &[Point3<f64>]) -> Vec<String> {
        let parts = [
            self.below_ground(ground),
            self.far_away(around),
            self.off_centre(),
            self.stretched(),
            self.wide(),
            self.looking_away(around),
        ];
        let found: Vec<String> = parts.into_iter().flatten().collect();
        // A camera that looks away is turned; that it is upside down besides says nothing new.
        let turned = if self.looking_away(around).is_some() { None } else { self.upside_down() };
        found.into_iter().chain(turned).collect()
    }

    fn below_ground(&self, ground: Option<f64>) -> Option<String> {
        let height = ground.unwrap_or(0.0);
        let below = height - self.centre().z;
        let known = if ground.is_some() { "the scene's ground" } else { "if that is the ground" };
        (below > BELOW).then(|| match ground {
            Some(_) => format!(
                "the camera is {below:.1} m below z = {height} m, {known}: are near and far, or left and right, swapped?"
            ),
            None => format!(
                "the camera is {below:.1} m below z = 0 m: {known}, are near and far, or left and right, swapped?"
            ),
        })
    }

    fn far_away(&self, around: &[Point3<f64>]) -> Option<String> {
        let origin = [Point3::origin()];
        let (points, of) = if around.is_empty() { (&origin[..], "the world's origin") } else { (around, "the scene") };
        let distance = points.iter().map(|point| (point - self.centre()).norm()).fold(f64::INFINITY, f64::min);
        let pixel = distance / self.intrinsic()[(0, 0)];
        (pixel > LARGEST_BALL).then(|| {
            format!(
                "the camera is {distance:.0} m from {of}, where a pixel covers {pixel:.2} m, too coarse to show a ball: is camera.json in \
                 centimetres or millimetres instead of metres? If so, divide the last column of `camera_from_world` by 100 or 1000"
            )
        })
    }

    fn off_centre(&self) -> Option<String> {
        let [width, height] = self.size().xy();
        let [x, y] = [self.intrinsic()[(0, 2)], self.intrinsic()[(1, 2)]];
        let inside = (0.0..width).contains(&x) && (0.0..height).contains(&y);
        (!inside).then(|| {
            format!(
                "the principal point ({x:.0}, {y:.0}) lies outside the {} picture: the intrinsic matrix is for another picture size, or \
                 transposed",
                self.size()
            )
        })
    }

    fn stretched(&self) -> Option<String> {
        let [fx, fy] = [self.intrinsic()[(0, 0)], self.intrinsic()[(1, 1)]];
        let ratio = (fx / fy).max(fy / fx);
        (ratio > STRETCHED).then(|| {
            format!(
                "the focal lengths {fx:.0} and {fy:.0} px differ by a factor of {ratio:.1}: pixels are nearly square, so one of them is \
                 wrong, or for another picture size"
            )
        })
    }

    fn wide(&self) -> Option<String> {
        let degrees = self.field_of_view();
        (degrees > STRAIGHT && self.distortion().is_none()).then(|| {
            format!(
                "the picture is {degrees:.0}° wide, but camera.json has no lens distortion: no lens that wide keeps lines straight; \
                 calibrate with --estimate distortion, or correct the focal length"
            )
        })
    }

    fn upside_down(&self) -> Option<String> {
        let down = self.rotation().transpose() * Vector3::y();
        (down.z > UPWARDS).then(|| {
            "the camera is upside down (its picture's lower edge points up): does y in the picture count from the \
             bottom, or z in the world point down?"
                .into()
        })
    }

    fn looking_away(&self, around: &[Point3<f64>]) -> Option<String> {
        let seen = |camera: &Self| around.iter().any(|point| camera.sees(point));
        if around.is_empty() || seen(self) {
            return None;
        }
        // Of the whole matrix, or of its rotation alone.
        let rotation = self.rotation.transpose();
        let translations = [-(rotation * self.translation), self.translation];
        let inverse = translations.map(|translation| Self {
            rotation,
            rotation_inverse: self.rotation,
            translation,
            ..self.clone()
        });
        let advice = if inverse.iter().any(seen) {
            "; it would be if `camera_from_world` in camera.json were inverted"
        } else {
            ": is it the camera of this scene, and is `camera_from_world` not inverted?"
        };
        Some(format!("no part of the scene is in the camera's picture{advice}"))
    }

    /// Whether the picture shows this point of the world, if nothing is before it.
    fn sees(&self, point: &Point3<f64>) -> bool {
        let [width, height] = self.size().xy();
        let inside = |image: Point2<f64>| (0.0..width).contains(&image.x) && (0.0..height).contains(&image.y);
        self.image_from_world(point).is_ok_and(inside)
    }
}
