//! One calibrated camera: intrinsics, lens distortion, pose.
//!
//! Frames: `world` is right-handed with z up; `camera` is OpenCV's (x right, y down, z forward);
//! `image` is in pixels with the first pixel's centre at (0, 0). Lengths are metres. All f64.

mod assumed;
mod calibrate;
mod circle;
mod court;
mod courts;
mod distortion;
mod doubts;
mod file;
mod find;
mod fold;
mod projection;
mod sphere;
mod sphere_slope;
mod volume;

use nalgebra::{Matrix2x3, Matrix3, Point2, Point3, Rotation3, Vector3};

pub use self::assumed::{AssumedCamera, Assumption, KnownOfCamera, assumed_camera};
pub use self::calibrate::{
    Calibration, CalibrationMethod, CameraSigma, CourtFollower, FollowedCamera, LineSeen, PointSigma, Points, Unknowns,
    WrongClick, calibrate, calibrate_by_lines, camera_by_homography, homography_between,
};
pub use self::circle::{BallAt, BallShift, Circle, DRAWN_SIGMA, symmetric};
pub use self::court::{Court, CourtLine};
pub use self::distortion::{Distortion, LensModel};
pub use self::find::{CourtVerdict, FoundCourt, FoundLine, OtherCourt, find_court};
#[doc(hidden)]
pub use self::find::{FEATURES as COURT_FEATURES, court_evidence};
use self::fold::Range;
use self::projection::projected;
pub use self::sphere::{Detection, Outline};
use crate::error::{Error, Result};
use crate::size::Size;

/// Smallest |determinant| of a matrix that is still inverted.
const MIN_DETERMINANT: f64 = 1e-9;
/// Relative difference of two aspect ratios that rounding to whole pixels explains.
const ASPECT_TOLERANCE: f64 = 0.01;

/// A pinhole camera with a lens ([`Distortion`]): paper eq. (1)–(2), M_int and M_ext.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// use gravisight::camera::Distortion;
/// use gravisight::{Camera, Size};
/// use nalgebra::{Matrix3, Point3, Vector3};
///
/// // 4 m before the world's origin and 1 m above it, level, looking along y.
/// let intrinsic = Matrix3::new(900.0, 0.0, 639.5, 0.0, 900.0, 359.5, 0.0, 0.0, 1.0);
/// let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
/// let translation = -rotation * Vector3::new(0.0, -4.0, 1.0);
/// let camera = Camera::new(Size::new(1280, 720), intrinsic, Distortion::default(), rotation, translation)?;
///
/// let image = camera.image_from_world(&Point3::new(0.5, 0.0, 1.2))?;
/// assert!((image.x - 752.0).abs() < 1e-9 && (image.y - 314.5).abs() < 1e-9);
/// let ball = camera.world_from_image(&image, 4.0)?;
/// assert!((ball - Point3::new(0.5, 0.0, 1.2)).norm() < 1e-9);
/// # Ok::<(), gravisight::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    size: Size,
    intrinsic: Matrix3<f64>,
    distortion: Distortion,
    /// From a picture's first row to its last, s.
    readout: f64,
    /// When its first row is read, after that of the whole picture of which it is a part, s.
    readout_start: f64,
    range: Range,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    intrinsic_inverse: Matrix3<f64>,
    rotation_inverse: Matrix3<f64>,
}

impl Camera {
    /// A camera for pictures of `size`.
    ///
    /// `intrinsic` is upper triangular with last row (0, 0, 1); `rotation` and `translation` map
    /// world to camera: `camera = rotation · world + translation`, metres.
    ///
    /// # Errors
    /// [`Error::CameraValue`] for NaN, a non-positive focal length, a matrix of another form or a
    /// `rotation` that is none; [`Error::CameraSingular`] for a matrix without inverse.
    pub fn new(
        size: Size,
        intrinsic: Matrix3<f64>,
        distortion: Distortion,
        rotation: Matrix3<f64>,
        translation: Vector3<f64>,
    ) -> Result<Self> {
        file::check(size, &intrinsic, &distortion, &rotation, &translation)?;
        let invert = |field, matrix: &Matrix3<f64>| match matrix.try_inverse() {
            Some(inverse) if matrix.determinant().abs() > MIN_DETERMINANT => Ok(inverse),
            _ => {
                let determinant = matrix.determinant();
                Err(Error::CameraSingular { what: "camera".into(), field, determinant })
            }
        };
        Ok(Self {
            size,
            intrinsic_inverse: invert("intrinsic", &intrinsic)?,
            rotation_inverse: invert("camera_from_world", &rotation)?,
            intrinsic,
            range: Range::of(&distortion),
            distortion,
            readout: 0.0,
            readout_start: 0.0,
            rotation,
            translation,
        })
    }

    /// The same with a rolling shutter that takes so long from a picture's first row to its last, s.
    ///
    /// # Errors
    /// [`Error::CameraValue`] for a time that is not from 0 to 1 s.
    pub fn with_readout(self, seconds: f64) -> Result<Self> {
        file::check_readout("readout_s", seconds, 0.0)?;
        Ok(Self { readout: seconds, ..self })
    }

    /// How long after the first row of a whole picture a row is read, s: of a rolling shutter, whose `readout_s` it goes by; 0
    /// for a global one. A cropped camera's rows are read when they were before.
    pub fn row_time(&self, row: f64) -> f64 {
        self.readout_start + self.readout * ((row + 0.5) / f64::from(self.size.height)).clamp(0.0, 1.0)
    }

    /// Size of the pictures this camera speaks of.
    pub fn size(&self) -> Size {
        self.size
    }

    /// M_int, px.
    pub fn intrinsic(&self) -> &Matrix3<f64> {
        &self.intrinsic
    }

    /// Lens distortion.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// This camera turned about its own centre: `by` maps old camera coordinates to new ones.
    #[must_use]
    pub fn turned(&self, by: &Rotation3<f64>) -> Self {
        let (rotation, translation) = (by * self.rotation, by * self.translation);
        let rotation_inverse = self.rotation_inverse * by.inverse();
        Self { rotation, translation, rotation_inverse, ..self.clone() }
    }

    /// This camera with another intrinsic matrix.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn with_intrinsic(self, intrinsic: Matrix3<f64>) -> Result<Self> {
        let camera = Self::new(self.size, intrinsic, self.distortion, self.rotation, self.translation)?;
        Ok(Self { readout: self.readout, readout_start: self.readout_start, ..camera })
    }

    /// Rotation of world into camera coordinates.
    pub fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// Camera coordinates of a world point, m.
    pub fn camera_from_world(&self, in_world: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * in_world.coords + self.translation)
    }

    /// World coordinates of a camera point, m.
    pub fn world_from_camera(&self, in_camera: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation_inverse * (in_camera.coords - self.translation))
    }

    /// Image of a camera point, px, with the lens distortion applied.
    ///
    /// # Errors
    /// [`Error::BehindCamera`] for a depth that is not positive, [`Error::OutsideLens`] for a point beyond the radius
    /// at which the lens model folds over.
    pub fn image_from_camera(&self, in_camera: &Point3<f64>) -> Result<Point2<f64>> {
        Ok(self.image_from_camera_with_jacobian(in_camera)?.0)
    }

    /// [`Self::image_from_camera`] and its 2×3 Jacobian d(image)/d(camera), px/m.
    ///
    /// # Errors
    /// As [`Self::image_from_camera`].
    pub fn image_from_camera_with_jacobian(&self, in_camera: &Point3<f64>) -> Result<(Point2<f64>, Matrix2x3<f64>)> {
        let projected = projected(&self.intrinsic, &self.distortion, &self.range, in_camera)?;
        Ok((projected.image, projected.jacobian))
    }

    /// Image of a world point, px.
    ///
    /// # Errors
    /// As [`Self::image_from_camera`].
    pub fn image_from_world(&self, in_world: &Point3<f64>) -> Result<Point2<f64>> {
        self.image_from_camera(&self.camera_from_world(in_world))
    }

    /// [`Self::image_from_world`] and its 2×3 Jacobian d(image)/d(world), px/m.
    ///
    /// # Errors
    /// As [`Self::image_from_camera`].
    pub fn image_from_world_with_jacobian(&self, in_world: &Point3<f64>) -> Result<(Point2<f64>, Matrix2x3<f64>)> {
        let (image, d_camera) = self.image_from_camera_with_jacobian(&self.camera_from_world(in_world))?;
        Ok((image, d_camera * self.rotation))
    }

    /// Camera point at pixel `image` and `depth` (camera z, m): paper eq. (2), first half.
    ///
    /// # Errors
    /// [`Error::BehindCamera`] for a depth that is not positive, [`Error::Distortion`] where the
    /// lens model has no inverse.
    pub fn camera_from_image(&self, image: &Point2<f64>, depth: f64) -> Result<Point3<f64>> {
        if depth.is_nan() || depth <= 0.0 {
            return Err(Error::BehindCamera { depth });
        }
        let distorted = self.intrinsic_inverse * image.coords.push(1.0);
        let ideal = self.distortion.undistort_within(&self.range, distorted.xy())?;
        Ok(Point3::from(ideal.push(1.0) * depth))
    }

    /// World point at pixel `image` and `depth` (camera z, m): paper eq. (2).
    ///
    /// # Errors
    /// As [`Self::camera_from_image`].
    pub fn world_from_image(&self, image: &Point2<f64>, depth: f64) -> Result<Point3<f64>> {
        Ok(self.world_from_camera(&self.camera_from_image(image, depth)?))
    }

    /// [`Self::world_from_image`] and its 3×3 Jacobian d(world)/d(u, v, depth), in m/px, m/px, m/m.
    ///
    /// # Errors
    /// As [`Self::camera_from_image`], and [`Error::Distortion`] where the lens model folds.
    pub fn world_from_image_with_jacobian(
        &self,
        image: &Point2<f64>,
        depth: f64,
    ) -> Result<(Point3<f64>, Matrix3<f64>)> {
        let in_camera = self.camera_from_image(image, depth)?;
        let ideal = in_camera.coords / depth;
        let (distorted, d_distorted) = self.distortion.distort(ideal.xy());
        let inverse_lens = d_distorted.try_inverse().ok_or(Error::Distortion {
            x: distorted.x,
            y: distorted.y,
            residual: f64::INFINITY,
            iterations: 0,
        })?;
        let d_ideal = inverse_lens * self.intrinsic_inverse.fixed_view::<2, 2>(0, 0) * depth;
        let mut d_camera = Matrix3::zeros();
        d_camera.fixed_view_mut::<2, 2>(0, 0).copy_from(&d_ideal);
        d_camera.set_column(2, &ideal);
        Ok((self.world_from_camera(&in_camera), self.rotation_inverse * d_camera))
    }

    /// The camera of the same picture resized to `size` (pixel-centre rule: `x' = (x + ½)·s − ½`).
    ///
    /// # Errors
    /// [`Error::CameraValue`] for a zero size.
    pub fn resized(&self, size: Size) -> Result<Self> {
        let sx = f64::from(size.width) / f64::from(self.size.width);
        let sy = f64::from(size.height) / f64::from(self.size.height);
        let resize = Matrix3::new(sx, 0.0, (sx - 1.0) / 2.0, 0.0, sy, (sy - 1.0) / 2.0, 0.0, 0.0, 1.0);
        let resized = Self::new(size, resize * self.intrinsic, self.distortion, self.rotation, self.translation)?;
        Ok(Self { readout: self.readout, readout_start: self.readout_start, ..resized })
    }

    /// The camera of the part of the picture of `size` whose first pixel is `(left, top)`.
    ///
    /// # Errors
    /// [`Error::CameraValue`] for a zero size.
    pub fn cropped(&self, [left, top]: [f64; 2], size: Size) -> Result<Self> {
        let shift = Matrix3::new(1.0, 0.0, -left, 0.0, 1.0, -top, 0.0, 0.0, 1.0);
        let cropped = Self::new(size, shift * self.intrinsic, self.distortion, self.rotation, self.translation)?;
        let a_row = self.readout / f64::from(self.size.height);
        let readout_start = self.readout_start + a_row * top;
        Ok(Self { readout: a_row * f64::from(size.height), readout_start, ..cropped })
    }

    /// The camera for a picture of size `picture`: itself, or itself scaled where the aspect
    /// ratio agrees to one percent or one pixel.
    ///
    /// # Errors
    /// [`Error::CameraMismatch`] where it does not.
    pub fn for_picture(&self, picture: Size) -> Result<Self> {
        if picture == self.size {
            return Ok(self.clone());
        }
        let scale = f64::from(picture.width) / f64::from(self.size.width);
        let expected_height = f64::from(self.size.height) * scale;
        let difference = (f64::from(picture.height) - expected_height).abs();
        if difference > (ASPECT_TOLERANCE * expected_height).max(1.0) {
            return Err(Error::CameraMismatch { camera: self.size, picture });
        }
        self.resized(picture)
    }
}
