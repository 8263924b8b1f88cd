//! First guesses of a pose from labelled points, in closed form.

use nalgebra::{DMatrix, Matrix3, Matrix3x4, Point2, Point3, Rotation3, Unit, Vector2, Vector3};

/// A pose: `camera = rotation · world + translation`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pose {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
}

/// The plane that points lie nearest to.
pub(super) struct Plane {
    pub centre: Point3<f64>,
    /// Two directions in the plane and its normal, right-handed.
    pub axes: Matrix3<f64>,
    /// Extents along the axes: root mean squares, m.
    pub extents: [f64; 3],
}

impl Plane {
    /// Of at least one point; [`None`] where numbers overflow.
    pub(super) fn through(points: &[Point3<f64>]) -> Option<Self> {
        let count = points.len() as f64;
        let centre = Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count);
        let scatter: Matrix3<f64> =
            points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum::<Matrix3<f64>>();
        let eigen = (scatter / count).try_symmetric_eigen(f64::EPSILON, 200)?;
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let column = |index: usize| eigen.eigenvectors.column(order[index]).into_owned();
        let (first, second) = (column(0), column(1));
        let extents = order.map(|index| eigen.eigenvalues[index].max(0.0).sqrt());
        Some(Self { centre, axes: Matrix3::from_columns(&[first, second, first.cross(&second)]), extents })
    }

    /// Coordinates in the plane, m.
    fn flat(&self, point: &Point3<f64>) -> Vector2<f64> {
        (self.axes.transpose() * (point - self.centre)).xy()
    }
}

/// Hartley's normalisation: centre and scale that bring points to the origin at a mean distance of √D.
fn normalisation<const D: usize>(points: &[nalgebra::SVector<f64, D>]) -> Option<(nalgebra::SVector<f64, D>, f64)> {
    let count = points.len() as f64;
    let centre = points.iter().sum::<nalgebra::SVector<f64, D>>() / count;
    let mean = points.iter().map(|point| (point - centre).norm()).sum::<f64>() / count;
    (mean > 0.0 && mean.is_finite()).then(|| (centre, (D as f64).sqrt() / mean))
}

/// The vector that `rows` map nearest to zero.
fn null_vector(rows: DMatrix<f64>) -> Option<Vec<f64>> {
    let columns = rows.ncols();
    // A square matrix: a thin decomposition of fewer rows than columns would leave the null space out.
    let svd = (rows.transpose() * &rows).try_symmetric_eigen(f64::EPSILON, 1000)?;
    let smallest = svd.eigenvalues.imin();
    let vector: Vec<f64> = svd.eigenvectors.column(smallest).iter().copied().collect();
    (vector.len() == columns && vector.iter().all(|value| value.is_finite())).then_some(vector)
}

/// The linear map `[3, D + 1]` between homogeneous points that brings `from` nearest to `to`: direct linear transform
/// (Hartley & Zisserman, 2004, algorithms 4.2 and 7.1, their linear part).
fn linear_map<const D: usize>(from: &[nalgebra::SVector<f64, D>], to: &[Vector2<f64>]) -> Option<DMatrix<f64>> {
    let ((from_centre, from_scale), (to_centre, to_scale)) = (normalisation(from)?, normalisation(to)?);
    let size = D + 1;
    let mut rows = DMatrix::zeros(2 * from.len(), 3 * size);
    for (index, (from, to)) in from.iter().zip(to).enumerate() {
        let point = (from - from_centre) * from_scale;
        let seen = (to - to_centre) * to_scale;
        for column in 0..size {
            let value = if column < D { point[column] } else { 1.0 };
            for axis in 0..2 {
                rows[(2 * index + axis, axis * size + column)] = value;
                rows[(2 * index + axis, 2 * size + column)] = -seen[axis] * value;
            }
        }
    }
    let scaled = DMatrix::from_row_slice(3, size, &null_vector(rows)?);
    let back = [1.0 / to_scale, 0.0, to_centre.x, 0.0, 1.0 / to_scale, to_centre.y, 0.0, 0.0, 1.0];
    let mut normalise = DMatrix::identity(size, size) * from_scale;
    normalise.view_mut((0, D), (D, 1)).copy_from(&(-from_centre * from_scale));
    normalise[(D, D)] = 1.0;
    Some(DMatrix::from_row_slice(3, 3, &back) * scaled * normalise)
}

/// The projection of at least six points that are not in one plane.
pub(super) fn projection(world: &[Point3<f64>], image: &[Point2<f64>]) -> Option<Matrix3x4<f64>> {
    let from: Vec<Vector3<f64>> = world.iter().map(|point| point.coords).collect();
    let to: Vec<Vector2<f64>> = image.iter().map(|point| point.coords).collect();
    Some(linear_map(&from, &to)?.fixed_view::<3, 4>(0, 0).into_owned())
}

/// The homography from `plane` to the image, of at least four points.
pub(super) fn homography(plane: &Plane, world: &[Point3<f64>], image: &[Point2<f64>]) -> Option<Matrix3<f64>> {
    let from: Vec<Vector2<f64>> = world.iter().map(|point| plane.flat(point)).collect();
    let to: Vec<Vector2<f64>> = image.iter().map(|point| point.coords).collect();
    Some(linear_map(&from, &to)?.fixed_view::<3, 3>(0, 0).into_owned())
}

/// The rotation nearest to `matrix`, and the scale between them.
pub(super) fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<(Matrix3<f64>, f64)> {
    let svd = matrix.try_svd(true, true, f64::EPSILON, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    Some((rotation, svd.singular_values.sum() / 3.0))
}

/// The pose of a projection of ideal image points (intrinsics taken away). `inside` is a point in front of the camera.
pub(super) fn pose_of_projection(projection: &Matrix3x4<f64>, inside: &Point3<f64>) -> Option<Pose> {
    let depth = (projection.row(2) * inside.to_homogeneous())[0];
    let projection = projection * depth.signum();
    let (rotation, scale) = nearest_rotation(&projection.fixed_view::<3, 3>(0, 0).into_owned())?;
    (scale > 0.0).then(|| Pose { rotation, translation: projection.column(3) / scale })
}

/// The poses of a plane's homography to ideal image points: the one it says, and the other one that a small plane
/// seen from afar cannot be told from (Schweighofer & Pinz, 2006): its tilt mirrored at the line of sight.
pub(super) fn poses_of_homography(homography: &Matrix3<f64>, plane: &Plane) -> Option<[Pose; 2]> {
    let homography = homography * homography[(2, 2)].signum();
    let scale = (homography.column(0).norm() * homography.column(1).norm()).sqrt();
    let columns = homography / scale;
    let (first, second): (Vector3<f64>, Vector3<f64>) = (columns.column(0).into(), columns.column(1).into());
    let (plane_rotation, _) = nearest_rotation(&Matrix3::from_columns(&[first, second, first.cross(&second)]))?;
    let centre: Vector3<f64> = columns.column(2).into();
    let pose = |plane_rotation: Matrix3<f64>| {
        let rotation = plane_rotation * plane.axes.transpose();
        Pose { rotation, translation: centre - rotation * plane.centre.coords }
    };
    let sight = centre.try_normalize(0.0)?;
    let normal: Vector3<f64> = plane_rotation.column(2).into();
    let normal = if normal.dot(&sight) > 0.0 { normal } else { -normal };
    let mirrored = match Unit::try_new(sight.cross(&normal), 1e-9) {
        Some(axis) => {
            let tilt = sight.dot(&normal).clamp(-1.0, 1.0).acos();
            Rotation3::from_axis_angle(&axis, -2.0 * tilt).into_inner() * plane_rotation
        }
        None => plane_rotation,
    };
    Some([pose(plane_rotation), pose(mirrored)])
}

/// The focal length, px, of a projection in pixels.
pub(super) fn focal_of_projection(projection: &Matrix3x4<f64>) -> Option<f64> {
    // K Kᵀ = M Mᵀ up to scale: with square pixels both diagonal entries give it, less the principal point's part.
    let product = projection.fixed_view::<3, 3>(0, 0) * projection.fixed_view::<3, 3>(0, 0).transpose();
    let product = product / product[(2, 2)];
    let squares = [0, 1].map(|axis| product[(axis, axis)] - product[(axis, 2)] * product[(axis, 2)]);
    let square = (squares[0] + squares[1]) / 2.0;
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}

/// The same from a plane's homography in pixels less the principal point (Zhang, 2000); [`None`] for a plane that
/// faces the camera.
pub(super) fn focal_of_homography(homography: &Matrix3<f64>) -> Option<f64> {
    let [a, b] = [0, 1].map(|column| homography.column(column).into_owned());
    // Two equations `p / f² + q = 0`: the plane's axes stay at right angles, and equally long.
    let equations =
        [(a.x * b.x + a.y * b.y, a.z * b.z), (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y, a.z * a.z - b.z * b.z)];
    let square = -equations.iter().map(|(p, _)| p * p).sum::<f64>() / equations.iter().map(|(p, q)| p * q).sum::<f64>();
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}
