//! The camera of a later frame: it stands where it stood, turned and zoomed, and a court's painted lines tell how.

use nalgebra::{Matrix3, Matrix4, Point2, Point3, Rotation3, Vector2, Vector3, Vector4};

use super::lines::{Line, LineSample, Spacing, found};
use super::paint::Grey;
use crate::camera::court::CourtLine;
use crate::camera::{Camera, Court};
use crate::error::{Error, Result};

/// How often lines are searched and the camera turned.
const ROUNDS: usize = 3;
/// Gauss–Newton steps with the same places of the lines.
const STEPS: usize = 3;
/// Samples of a line: enough for two numbers.
const SPACING: Spacing = Spacing { every: 4.0, most: 60 };
/// Least fraction of the lines in view that is found. Below it, something else is shown.
const LEAST_FOUND: f64 = 0.5;
/// Lines that are needed: two that are not parallel fix the four unknowns, and a third has to agree.
const FEWEST_LINES: usize = 3;
/// Huber's limit, σ.
const HUBER: f64 = 2.0;
/// Points along each side of the picture at which the camera's uncertainty is taken.
const GRID: usize = 3;

/// The unknowns: a rotation about the camera's axes (3, rad) and the logarithm of the focal length.
type Unknowns = Vector4<f64>;

/// Follows a camera that turns and zooms about its centre, by the painted lines of a court.
#[derive(Debug, Clone)]
pub struct CourtFollower {
    lines: Vec<CourtLine>,
}

/// A camera that was followed.
#[derive(Debug, Clone)]
pub struct FollowedCamera {
    /// The camera of that frame.
    pub camera: Camera,
    /// 1-σ of where it puts a point, px, along each axis: root mean square over the picture.
    pub sigma_px: f64,
    /// Fraction of the lines in view that were found.
    pub found: f64,
}

impl CourtFollower {
    /// By the lines of a court ([`Court::names`]).
    ///
    /// # Errors
    /// [`Error::Calibration`] for an unknown court, or one whose lines are not known.
    pub fn new(court: &str) -> Result<Self> {
        let lines = Court::named(court)?.lines.clone();
        if lines.is_empty() {
            let reason =
                format!("the painted lines of `{court}` are not known, so a camera cannot be followed by them");
            return Err(Error::Calibration { reason });
        }
        Ok(Self { lines })
    }

    /// The camera of a frame near a `predicted` one that is `sigma` px off (1-σ); `levels` are the frame's brightness, rows from the top.
    /// [`None`] where the frame shows too little of the court.
    pub fn follow(&self, levels: &[u8], predicted: &Camera, sigma: f64) -> Option<FollowedCamera> {
        let [width, height] = predicted.size().xy();
        if levels.len() != (width * height) as usize {
            return None;
        }
        let grey = Grey::of_levels(levels, width as usize, height as usize);
        let prior = prior(predicted, sigma);
        let (mut moved, mut information) = (Unknowns::zeros(), prior);
        let mut fraction = 0.0;
        for _ in 0..ROUNDS {
            let camera = turned(predicted, &moved)?;
            let covariance = information.try_inverse()?;
            let lines = self.expected(&camera, &covariance);
            let found = found(&lines, &grey, 1.0);
            fraction = found.len() as f64 / lines.len().max(1) as f64;
            if found.len() < FEWEST_LINES {
                return None;
            }
            let seen: Vec<_> = found.iter().flat_map(|line| line.seen.iter()).collect();
            for _ in 0..STEPS {
                let camera = turned(predicted, &moved)?;
                let (mut normal, mut gradient) = (prior, prior * moved);
                for place in &seen {
                    let across = place.across?;
                    let (image, derivatives) = with_derivatives(&camera, &place.world)?;
                    let row = Unknowns::from(derivatives.map(|by| place.weight * across.dot(&by)));
                    let error = place.weight * across.dot(&(image - place.image));
                    let robust = (HUBER / error.abs()).min(1.0);
                    normal += robust * row * row.transpose();
                    gradient += robust * error * row;
                }
                moved -= normal.cholesky()?.solve(&gradient);
                information = normal;
            }
        }
        if fraction < LEAST_FOUND {
            return None;
        }
        let camera = turned(predicted, &moved)?;
        let sigma_px = spread(&camera, &information.try_inverse()?)?;
        Some(FollowedCamera { camera, sigma_px, found: fraction })
    }

    /// The lines that a camera expects in the picture; `covariance` is that of the unknowns.
    fn expected(&self, camera: &Camera, covariance: &Matrix4<f64>) -> Vec<Line> {
        let look = |world: &Point3<f64>| with_derivatives(camera, world);
        let unsure = |across: &Vector2<f64>, derivatives: &[Vector2<f64>; 4]| {
            let row = Unknowns::from(derivatives.map(|by| across.dot(&by)));
            row.dot(&(covariance * row)).max(0.0).sqrt()
        };
        let sample = |line: &CourtLine| LineSample::of(line, camera.size(), SPACING, &look, &unsure);
        let lines = self.lines.iter().enumerate();
        lines.filter_map(|(index, line)| Some(Line { index, width: line.width, samples: sample(line)? })).collect()
    }
}

/// Information of a camera that is `sigma` px off in the picture's middle, and as much at its sides.
fn prior(camera: &Camera, sigma: f64) -> Matrix4<f64> {
    let focal = camera.intrinsic()[(0, 0)];
    let half = camera.size().xy()[0] / 2.0;
    let by = |radians: f64| radians.powi(-2);
    Matrix4::from_diagonal(&Vector4::new(by(sigma / focal), by(sigma / focal), by(sigma / half), by(sigma / half)))
}

/// The camera turned about its centre and zoomed.
fn turned(camera: &Camera, by: &Unknowns) -> Option<Camera> {
    let turn = Rotation3::new(by.xyz());
    let mut intrinsic = *camera.intrinsic();
    let zoom = by.w.exp();
    [(0, 0), (0, 1), (1, 1)].into_iter().for_each(|at| intrinsic[at] *= zoom);
    camera.turned(&turn).with_intrinsic(intrinsic).ok()
}

/// A point's image, px, and its derivatives by the unknowns.
fn with_derivatives(camera: &Camera, world: &Point3<f64>) -> Option<(Point2<f64>, [Vector2<f64>; 4])> {
    let at = camera.camera_from_world(world);
    let (image, jacobian) = camera.image_from_camera_with_jacobian(&at).ok()?;
    let by_turn = |axis: usize| jacobian * Vector3::ith(axis, 1.0).cross(&at.coords);
    let by_zoom = image.coords - camera.intrinsic().fixed_view::<2, 1>(0, 2);
    Some((image, [by_turn(0), by_turn(1), by_turn(2), by_zoom]))
}

/// 1-σ of where the camera puts far points, px, along each axis: root mean square over the picture.
fn spread(camera: &Camera, covariance: &Matrix4<f64>) -> Option<f64> {
    let [width, height] = camera.size().xy();
    let place = |index: usize, side: f64| side * (index as f64 + 0.5) / GRID as f64;
    let mut sum = 0.0;
    for index in 0..GRID * GRID {
        let image = Point2::new(place(index % GRID, width), place(index / GRID, height));
        let world = camera.world_from_image(&image, 1.0).ok()?;
        let (_, derivatives) = with_derivatives(camera, &world)?;
        for axis in 0..2 {
            let row = Unknowns::from(derivatives.map(|by| by[axis]));
            sum += row.dot(&(covariance * row));
        }
    }
    Some((sum / (2 * GRID * GRID) as f64).sqrt())
}

/// The homography from one camera's picture to another's that stands in the same place, without their lenses.
pub fn homography_between(from: &Camera, to: &Camera) -> Option<Matrix3<f64>> {
    Some(to.intrinsic() * to.rotation() * from.rotation().transpose() * from.intrinsic().try_inverse()?)
}

/// The camera whose picture a homography makes of that of `camera`: turned and zoomed about its centre.
pub fn camera_by_homography(camera: &Camera, homography: &Matrix3<f64>) -> Option<Camera> {
    let intrinsic = camera.intrinsic();
    let mut to_middle = Matrix3::identity();
    to_middle.fixed_view_mut::<2, 1>(0, 2).copy_from(&-intrinsic.fixed_view::<2, 1>(0, 2));
    let product = to_middle * homography * intrinsic;
    let product = product * product.determinant().signum();
    let [x, y, z] = [0, 1, 2].map(|row| product.row(row).norm());
    // Rows are the rotation's, times the two focal lengths and 1.
    let zoom = (x * y).sqrt() / z / (intrinsic[(0, 0)] * intrinsic[(1, 1)]).sqrt();
    let mut zoomed = *intrinsic;
    [(0, 0), (0, 1), (1, 1)].into_iter().for_each(|at| zoomed[at] *= zoom);
    let turn = zoomed.try_inverse()? * homography * intrinsic;
    let turn = turn / turn.determinant().cbrt();
    let turn = Rotation3::from_matrix(&turn);
    camera.turned(&turn).with_intrinsic(zoomed).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;
    use crate::size::Size;

    /// A camera behind a tennis court's near end.
    fn camera() -> Camera {
        let intrinsic = Matrix3::new(1500.0, 0.0, 639.5, 0.0, 1500.0, 359.5, 0.0, 0.0, 1.0);
        let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.28).into_inner() * level;
        let place = Vector3::new(0.5, -27.0, 9.0);
        Camera::new(Size::new(1280, 720), intrinsic, Distortion::default(), rotation, -rotation * place).unwrap()
    }

    /// What a camera sees of a tennis court: paint of 200 levels on ground of 90, and somebody before it.
    fn seen(camera: &Camera) -> Vec<u8> {
        let [width, height] = [1280, 720];
        let mut levels = vec![90; width * height];
        for line in &Court::named("tennis").unwrap().lines {
            let corner = |share: f64, edge: usize| camera.image_from_world(&line.edges(share).unwrap()[edge]).unwrap();
            let corners = [corner(0.0, 0), corner(0.0, 1), corner(1.0, 1), corner(1.0, 0)];
            let side = |at: &Point2<f64>, index: usize| {
                let (from, to) = (corners[index], corners[(index + 1) % 4]);
                (to - from).perp(&(at - from)) / (to - from).norm()
            };
            let turn = side(&corners[2], 0).signum();
            for (index, level) in levels.iter_mut().enumerate() {
                let at = Point2::new((index % width) as f64, (index / width) as f64);
                let inside = (0..4).map(|edge| (turn * side(&at, edge) + 0.5).clamp(0.0, 1.0)).product::<f64>();
                *level = (*level).max((90.0 + 110.0 * inside) as u8);
            }
        }
        for row in 380..600 {
            levels[row * width + 600..row * width + 660].fill(40);
        }
        levels
    }

    #[test]
    fn a_camera_that_turns_and_zooms_is_followed() {
        let first = camera();
        let follower = CourtFollower::new("tennis").unwrap();
        for step in 0..4 {
            let by = f64::from(step) * Unknowns::new(0.002, -0.004, 0.001, 0.006);
            let truth = turned(&first, &by).unwrap();
            let found = follower.follow(&seen(&truth), &first, 9.0).unwrap();
            let homography = homography_between(&truth, &found.camera).unwrap();
            let off = [[100.0, 100.0], [1180.0, 100.0], [640.0, 360.0], [1180.0, 620.0]]
                .map(|[x, y]| (homography.transform_point(&Point2::new(x, y)) - Point2::new(x, y)).norm());
            assert!(off.iter().all(|off| *off < 0.3), "step {step}: {off:?} px");
            assert!(found.sigma_px > 0.02 && found.sigma_px < 0.3 && found.found > 0.8, "{found:?}");
        }
    }

    #[test]
    fn another_picture_is_not_followed() {
        let follower = CourtFollower::new("tennis").unwrap();
        assert!(follower.follow(&vec![90; 1280 * 720], &camera(), 9.0).is_none());
        assert!(follower.follow(&[0; 3], &camera(), 9.0).is_none());
        let by = Unknowns::new(0.0, 0.1, 0.0, 0.0);
        let elsewhere = seen(&turned(&camera(), &by).unwrap());
        assert!(follower.follow(&elsewhere, &camera(), 9.0).is_none());
        assert!(CourtFollower::new("squash").unwrap_err().to_string().contains("not known"));
    }

    #[test]
    fn a_homography_and_the_camera_that_it_turns_are_the_same() {
        let first = camera();
        let by = Unknowns::new(0.02, -0.05, 0.01, 0.2);
        let second = turned(&first, &by).unwrap();
        let homography = homography_between(&first, &second).unwrap();
        for scale in [1.0, -3.0] {
            let found = camera_by_homography(&first, &(homography * scale)).unwrap();
            assert!((found.rotation() - second.rotation()).norm() < 1e-9);
            assert!((found.intrinsic() - second.intrinsic()).norm() < 1e-6);
        }
    }
}
