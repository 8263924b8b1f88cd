//! From a point before a camera to its image: what every camera does, wherever it stands.

use nalgebra::{Matrix2x3, Matrix3, Point2, Point3, Vector2};

use super::Distortion;
use super::fold::Range;
use crate::error::{Error, Result};

/// Depth at or below which a point has no image, m.
const MIN_DEPTH: f64 = 1e-9;

/// A point's image.
pub(super) struct Projected {
    /// px.
    pub image: Point2<f64>,
    /// d(image)/d(camera), px/m.
    pub jacobian: Matrix2x3<f64>,
    /// The image at focal length 1, before the lens distorts it.
    pub ideal: Vector2<f64>,
}

/// Image of a camera point: paper eq. (1). `range` is the distortion's.
///
/// # Errors
/// [`Error::BehindCamera`] for a depth that is not positive, [`Error::OutsideLens`] for a point beyond the radius at which the lens
/// model folds over.
pub(super) fn projected(
    intrinsic: &Matrix3<f64>,
    distortion: &Distortion,
    range: &Range,
    in_camera: &Point3<f64>,
) -> Result<Projected> {
    let z = in_camera.z;
    if z.is_nan() || z <= MIN_DEPTH {
        return Err(Error::BehindCamera { depth: z });
    }
    let ideal = Vector2::new(in_camera.x / z, in_camera.y / z);
    if !range.holds(&ideal) {
        return Err(Error::OutsideLens { x: ideal.x, y: ideal.y });
    }
    let d_ideal = Matrix2x3::new(1.0 / z, 0.0, -ideal.x / z, 0.0, 1.0 / z, -ideal.y / z);
    let (distorted, d_distorted) = distortion.distort(ideal);
    let focal = intrinsic.fixed_view::<2, 2>(0, 0).into_owned();
    let image = Point2::from(focal * distorted + intrinsic.fixed_view::<2, 1>(0, 2));
    Ok(Projected { image, jacobian: focal * d_distorted * d_ideal, ideal })
}
