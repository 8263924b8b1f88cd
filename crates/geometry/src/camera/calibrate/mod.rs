//! A camera from labelled points: where clicks on known points say it stands, and how sure that is.
//!
//! A start in closed form (direct linear transform, or the homography of a plane), then the least-squares optimum of
//! the reprojection errors. The paper refines by BFGS; Levenberg–Marquardt finds the same optimum in a tenth of the
//! steps and gives the covariance.

mod doubts;
mod follow;
mod lens;
mod lines;
mod noise;
mod outcome;
mod paint;
mod points;
mod refine;
mod start;

use nalgebra::{Matrix3, Matrix3x4, Point2, Point3, Vector2, Vector3};

use self::doubts::on_a_line;
pub use self::follow::{CourtFollower, FollowedCamera, camera_by_homography, homography_between};
pub use self::lines::{LineSeen, calibrate_by_lines};
use self::noise::{ClickNoise, f_tail};
pub use self::outcome::{Calibration, CalibrationMethod, CameraSigma, PointSigma, WrongClick};
pub use self::points::Points;
pub use self::refine::Unknowns;
use self::refine::{Guess, Refined, Seen, refine};
use self::start::{Plane, Pose};
use super::Camera;
use crate::error::{Error, Result};

/// Width over length below which points count as one line.
const LINE: f64 = 1e-3;
/// Height over length below which six points are too flat for the direct linear transform, and above which a plane's
/// homography is no start.
const FLAT: f64 = 1e-4;
const SOLID: f64 = 0.5;
/// The same up to which four points are enough.
const NEARLY_FLAT: f64 = 0.1;
/// Chance of calling a good click wrong, in one calibration.
const FALSE_ALARM: f64 = 1e-3;
/// Clicks are not taken to be better than this, px, when one is called wrong.
const BEST_CLICK: f64 = 0.3;
/// One click in so many may be wrong (and one more, if two are mixed up).
const PER_OUTLIER: usize = 5;
/// Difference of two costs (px², and as a share) that rounding explains.
const SAME_COST: f64 = 1e-6;
/// Focal length that is tried first where none is known and the points do not say, as a share of the picture's width.
const USUAL_FOCAL: f64 = 1.2;

/// A camera from labelled points: at least six, or four in one plane.
///
/// Without [`Points::intrinsic`] the focal length is estimated, with the principal point in the picture's middle. Without a lens given or
/// asked for, one coefficient of it is estimated where that pays (an F test), before any click is called wrong.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*}; }
/// use gravisight::{Points, Unknowns, calibrate};
///
/// let points = r#"{"width": 1920, "height": 1080, "court": "tennis",
///     "names": ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"],
///     "image": [[312.5, 905.0], [1630.0, 897.5], [601.0, 322.0], [1297.0, 319.5]]}"#;
/// let found = calibrate(&Points::from_json(points, "points.json")?, &Unknowns::default())?;
/// println!("{} ± {} px", found.camera.intrinsic(), found.rms_px);
/// # Ok::<(), gravisight::Error>(())
/// ```
///
/// # Errors
/// [`Error::Calibration`] with what to add, where the points do not fix a camera; clicks that the given lens cannot have
/// seen are among [`Calibration::outliers`], or named there.
pub fn calibrate(points: &Points, unknowns: &Unknowns) -> Result<Calibration> {
    calibrated(points, unknowns)?.concluded(points)
}

/// The same without what follows from it.
fn calibrated(points: &Points, unknowns: &Unknowns) -> Result<Calibration> {
    let unknowns = &with_found_lens(points, unknowns);
    check_lens(points, unknowns)?;
    let (problem, (solution, outliers)) = Problem::new(points, unknowns).by_clicks_and_lens()?;
    let noise = problem.noise(&solution.0, &outliers);
    problem.result(solution, outliers, noise, noise.variance())
}

/// A refined camera and how its start was found.
type Solution = (Refined, CalibrationMethod);

struct Problem<'a> {
    points: &'a Points,
    unknowns: Unknowns,
}

fn refuse(reason: impl Into<String>) -> Error {
    Error::Calibration { reason: reason.into() }
}

/// The lens of a camera that has placed points is a rough one: it is estimated as well.
fn with_found_lens(points: &Points, unknowns: &Unknowns) -> Unknowns {
    let is_rough = points.sigma.is_some() && !points.distortion.is_none() && !points.distortion.is_fisheye();
    Unknowns { distortion: unknowns.distortion.max(usize::from(is_rough)), ..*unknowns }
}

/// Refuses to estimate a fisheye, whose coefficients are others.
fn check_lens(points: &Points, unknowns: &Unknowns) -> Result<()> {
    match points.distortion.is_fisheye() && unknowns.distortion > 0 {
        true => Err(refuse(
            "the coefficients of a fisheye cannot be estimated: remove `distortion` from what is to be estimated",
        )),
        false => Ok(()),
    }
}

impl<'a> Problem<'a> {
    fn new(points: &'a Points, unknowns: &Unknowns) -> Self {
        let mut unknowns = *unknowns;
        unknowns.focal |= points.intrinsic.is_none();
        Self { points, unknowns }
    }

    /// The camera by the clicks, and those that had no part in it.
    fn by_clicks(&self) -> Result<(Solution, Vec<usize>)> {
        let outside = self.outside_the_lens();
        let all: Vec<usize> = (0..self.points.image.len()).filter(|index| !outside.contains(index)).collect();
        self.check(&all).map_err(|error| self.without(&outside, error))?;
        let mut outliers = Vec::new();
        let mut found = self.solve(&all);
        while outliers.len() < all.len().div_ceil(PER_OUTLIER) {
            let wrong = |count| self.wrong_clicks(&all, &outliers, count, found.as_ref().ok());
            let Some((wrong, better)) = wrong(1).or_else(|| wrong(2)) else { break };
            outliers.extend(wrong);
            found = Ok(better);
        }
        outliers.extend(&outside);
        outliers.sort_unstable();
        Ok((found.map_err(|error| self.without(&outside, error))?, outliers))
    }

    /// How far the clicks are off, by what the best camera by them leaves; of points that were placed, by what is known of them.
    fn noise(&self, by_clicks: &Refined, outliers: &[usize]) -> ClickNoise {
        if let Some(sigma) = self.points.sigma {
            return ClickNoise::placed(sigma, self.points.image.len());
        }
        let freedom = (2 * (self.points.image.len() - outliers.len())).saturating_sub(self.unknowns.count());
        ClickNoise::by(by_clicks.cost, freedom)
    }

    /// Clicks that a lens which is known cannot have seen, by index.
    fn outside_the_lens(&self) -> Vec<usize> {
        let is_known = self.unknowns == Unknowns::default();
        let Some(inverse) = self.points.intrinsic.filter(|_| is_known).and_then(|known| known.try_inverse()) else {
            return Vec::new();
        };
        let seen = |click: &Point2<f64>| self.points.distortion.undistort((inverse * click.coords.push(1.0)).xy());
        let clicks = self.points.image.iter().enumerate();
        clicks.filter(|(_, click)| seen(click).is_err()).map(|(index, _)| index).collect()
    }

    /// An error about the other points that names those left out.
    fn without(&self, outside: &[usize], error: Error) -> Error {
        let Error::Calibration { reason } = &error else { return error };
        if outside.is_empty() {
            return error;
        }
        let name = |index: &usize| match self.points.names.get(*index) {
            Some(name) => format!("`{name}`"),
            None => format!("point {index}"),
        };
        let names = outside.iter().map(name).collect::<Vec<_>>().join(", ");
        refuse(format!("{reason} (left out because the given lens projects no point there: {names})"))
    }

    fn check(&self, of: &[usize]) -> Result<()> {
        let count = of.len();
        let parameters = self.unknowns.count();
        if count < 4 || 2 * count < parameters {
            let least = parameters.div_ceil(2).max(4);
            return Err(refuse(format!(
                "too few points ({count}) for {parameters} unknowns; label at least {least} in one plane, or 6 in space"
            )));
        }
        let world: Vec<Point3<f64>> = of.iter().map(|&index| self.points.world[index]).collect();
        let plane =
            Plane::through(&world).ok_or_else(|| refuse("the world points are too far apart to compute with"))?;
        let [length, width, height] = plane.extents;
        if width <= LINE * length {
            return Err(refuse(
                "the world points lie on one line, which leaves the camera free to turn about it; add points off this line",
            ));
        }
        if height > NEARLY_FLAT * length && count < 6 {
            return Err(refuse(format!("too few points in space ({count}); label at least 6, or 4 in one plane")));
        }
        Ok(())
    }

    /// The intrinsics to start from; without given ones, with a focal length.
    fn intrinsic(&self, focal: Option<f64>) -> Matrix3<f64> {
        let [width, height] = self.points.size.xy();
        self.points.intrinsic.unwrap_or_else(|| {
            let focal = focal.unwrap_or(USUAL_FOCAL * width);
            Matrix3::new(focal, 0.0, (width - 1.0) / 2.0, 0.0, focal, (height - 1.0) / 2.0, 0.0, 0.0, 1.0)
        })
    }

    /// Clicks without the intrinsics.
    fn ideal(&self, intrinsic: &Matrix3<f64>, image: &[Point2<f64>]) -> Vec<Point2<f64>> {
        let inverse = intrinsic.try_inverse().unwrap_or_else(Matrix3::identity);
        let ideal = |point: &Point2<f64>| (inverse * point.coords.push(1.0)).xy();
        let undistorted = |point| self.points.distortion.undistort(point).unwrap_or(point);
        image.iter().map(|point| Point2::from(undistorted(ideal(point)))).collect()
    }

    /// Starts in closed form, before it is known whether the points are in front of the camera.
    fn starts(&self, world: &[Point3<f64>], image: &[Point2<f64>]) -> Vec<(Guess, CalibrationMethod)> {
        let Some(plane) = Plane::through(world) else { return Vec::new() };
        let [length, _, height] = plane.extents;
        let mut starts = Vec::new();
        let mut add = |poses: Option<&[Pose]>, intrinsic: Matrix3<f64>, method: CalibrationMethod| {
            let guess = |pose: &Pose| Guess { pose: *pose, intrinsic, distortion: self.points.distortion };
            starts.extend(poses.unwrap_or_default().iter().map(|pose| (guess(pose), method)));
        };
        let middle = self.intrinsic(None).fixed_view::<2, 1>(0, 2).into_owned();
        if world.len() >= 6 && height > FLAT * length {
            let focal = start::projection(world, image).as_ref().and_then(start::focal_of_projection);
            let intrinsic = self.intrinsic(focal);
            let projection: Option<Matrix3x4<f64>> = start::projection(world, &self.ideal(&intrinsic, image));
            let pose = projection.and_then(|projection| start::pose_of_projection(&projection, &plane.centre));
            add(
                pose.map(|pose| [pose]).as_ref().map(|pose| &pose[..]),
                intrinsic,
                CalibrationMethod::DirectLinearTransform,
            );
        }
        if height <= SOLID * length {
            let centred: Vec<Point2<f64>> = image.iter().map(|point| point - middle).collect();
            let focal = start::homography(&plane, world, &centred).as_ref().and_then(start::focal_of_homography);
            // What a plane that nearly faces the camera says may be far off.
            for focal in [None, focal] {
                let intrinsic = self.intrinsic(focal);
                let homography = start::homography(&plane, world, &self.ideal(&intrinsic, image));
                let poses = homography.and_then(|homography| start::poses_of_homography(&homography, &plane));
                add(poses.as_ref().map(|poses| &poses[..]), intrinsic, CalibrationMethod::Homography);
            }
        }
        starts
    }

    /// The best camera for some of the points.
    fn solve(&self, of: &[usize]) -> Result<Solution> {
        let world: Vec<Point3<f64>> = of.iter().map(|&index| self.points.world[index]).collect();
        let image: Vec<Point2<f64>> = of.iter().map(|&index| self.points.image[index]).collect();
        let clicks: Vec<Seen> = world.iter().zip(&image).map(|(&world, &image)| Seen::click(world, image)).collect();
        let refined = self.starts(&world, &image).into_iter().filter_map(|(start, method)| {
            // The pose first: a focal length must not make up for a start that is far off.
            let pose = refine(start, &Unknowns::default(), &clicks)?;
            Some((refine(pose.guess, &self.unknowns, &clicks)?, method))
        });
        // Of two that meet in one minimum, the first.
        let better = |a: Solution, b: Solution| if b.0.cost < a.0.cost * (1.0 - SAME_COST) - SAME_COST { b } else { a };
        refined.reduce(better).ok_or_else(|| match on_a_line(&world) {
            on if world.len() < on + 2 => refuse(format!(
                "{on} of these {} points lie on one line, which does not determine a camera; click more points, at \
                 least two of them off that line",
                world.len()
            )),
            _ => refuse(
                "no camera has all these points in front of it; check that each click belongs to its point, that the \
                 world is right-handed in metres, and that y counts downwards in the picture",
            ),
        })
    }

    /// The `count` (1, or 2 that may have been mixed up) clicks that belong least to the others, and the camera without
    /// them; [`None`] if they belong: F test of the two errors that each click adds, with Bonferroni's correction for
    /// looking at every choice.
    fn wrong_clicks(
        &self,
        all: &[usize],
        outliers: &[usize],
        count: usize,
        found: Option<&Solution>,
    ) -> Option<(Vec<usize>, Solution)> {
        let left: Vec<usize> = all.iter().copied().filter(|index| !outliers.contains(index)).collect();
        let freedom =
            (2 * left.len()).checked_sub(self.unknowns.count() + 2 * count).filter(|&freedom| freedom >= 2)?;
        if left.len() < 5 + count {
            return None;
        }
        let scatter = found.map_or(f64::INFINITY, |(found, _)| found.cost) / freedom as f64;
        // Two at once are looked for only where something is wrong: there are many pairs.
        if count > 1 && scatter < (3.0 * BEST_CLICK).powi(2) {
            return None;
        }
        let choices: Vec<Vec<usize>> = match count {
            1 => left.iter().map(|&index| vec![index]).collect(),
            _ => left.iter().flat_map(|&a| left.iter().filter(move |&&b| b > a).map(move |&b| vec![a, b])).collect(),
        };
        let without = |wrong: &Vec<usize>| {
            let rest: Vec<usize> = left.iter().copied().filter(|index| !wrong.contains(index)).collect();
            self.solve(&rest).ok().map(|solution| (wrong.clone(), solution))
        };
        let (wrong, better) =
            choices.iter().filter_map(without).min_by(|(_, (a, _)), (_, (b, _))| a.cost.total_cmp(&b.cost))?;
        let freedom = freedom as f64;
        // Points that a camera has placed fit each other, however far off they are.
        let best = self.points.sigma.unwrap_or(0.0).max(BEST_CLICK);
        let variance = (better.0.cost / freedom).max(best * best);
        let added = found.map_or(f64::INFINITY, |(found, _)| found.cost) - better.0.cost;
        let chance = f_tail(count, freedom, added / (2 * count) as f64 / variance);
        (chance * (choices.len() as f64) < FALSE_ALARM).then_some((wrong, better))
    }

    /// A solution, with the clicks' noise and the variance that its errors have in the unit of its weights.
    fn result(
        &self,
        (refined, method): Solution,
        outliers: Vec<usize>,
        noise: ClickNoise,
        variance: f64,
    ) -> Result<Calibration> {
        let vague = || {
            refuse(if self.unknowns.count() > 6 {
                "the points do not separate the camera's distance, focal length and lens; add points at other depths \
                 (off the plane, nearer and farther), or give `intrinsic`"
            } else {
                "the points do not determine the camera; add points farther apart, off their line or plane"
            })
        };
        let used = self.points.image.len() - outliers.len();
        let unit = refined.covariance.clone().ok_or_else(vague)?;
        // Small enough for a derivative: a millionth of what clicks of 1 px would leave open.
        let steps: Vec<f64> = unit.diagonal().iter().map(|variance| (1e-6 * variance.sqrt()).max(1e-12)).collect();
        let size = self.points.size;
        // Wrong clicks have the best camera infinitely far away, or with an infinite focal length.
        let camera_of = |guess: &Guess| {
            let reason = "the clicks do not determine a camera: check that each click is on its point and that both lists \
                          have the same order, or give `intrinsic`";
            guess.camera(size).map_err(|_| refuse(reason))
        };
        let camera = camera_of(&refined.guess)?;
        let neighbours = (refined.guess.neighbours(&self.unknowns, &steps).iter())
            .map(|[up, down]| Ok([camera_of(up)?, camera_of(down)?]))
            .collect::<Result<Vec<_>>>()?;
        let residual = |(world, image): (&Point3<f64>, &Point2<f64>)| {
            camera.image_from_world(world).map_or(Vector2::repeat(f64::INFINITY), |found| found - image)
        };
        let residuals_px: Vec<Vector2<f64>> = self.points.world.iter().zip(&self.points.image).map(residual).collect();
        let of_used = residuals_px.iter().enumerate().filter(|(index, _)| !outliers.contains(index));
        let square = of_used.map(|(_, residual)| residual.norm_squared()).sum::<f64>();
        let wrong = |&index: &usize| WrongClick {
            index,
            name: self.points.names.get(index).cloned(),
            residual_px: residuals_px[index],
        };
        let focal_px =
            if self.unknowns.focal { (unit[(6, 6)] * variance).sqrt() * camera.intrinsic()[(0, 0)] } else { 0.0 };
        let rotation = Vector3::from_fn(|axis, _| (unit[(axis, axis)] * variance).sqrt());
        let mut calibration = Calibration {
            rms_px: (square / used as f64).sqrt(),
            noise_px: noise.variance().sqrt(),
            method,
            outliers: outliers.iter().map(wrong).collect(),
            residuals_px,
            lines: Vec::new(),
            centre: camera.centre(),
            doubts: Vec::new(),
            sigma: CameraSigma { rotation, focal_px, ..CameraSigma::default() },
            point_sigma: PointSigma::default(),
            one_sigma: (refined.guess.one_sigma(&self.unknowns, &(&unit * variance)).iter())
                .map(&camera_of)
                .collect::<Result<_>>()?,
            noise,
            covariance: unit.clone(),
            steps,
            neighbours,
            camera,
        };
        let centre = |camera: &Camera| Ok(camera.world_from_camera(&Point3::origin()).coords);
        let distance = calibration.camera.camera_from_world(&Point3::from(self.centre())).coords.norm();
        let vagueness = calibration.sigma_of(centre)?.norm();
        // What overflows (points a thousand kilometres apart) is no camera either.
        if vagueness > distance || !vagueness.is_finite() || !calibration.rms_px.is_finite() {
            return Err(vague());
        }
        calibration.covariance = unit * variance;
        calibration.sigma.centre = calibration.sigma_of(centre)?;
        Ok(calibration)
    }

    /// The middle of the world points.
    fn centre(&self) -> Vector3<f64> {
        self.points.world.iter().map(|point| point.coords).sum::<Vector3<f64>>() / self.points.world.len() as f64
    }
}
