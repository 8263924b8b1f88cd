//! A forecast's start from the network's positions, with its derivatives.

use nalgebra::{Matrix2x6, Matrix3, Matrix6, Point2, Point3, Vector3, Vector6};

use super::super::examples::{PictureTransform, Start, Target, Window};
use super::knowledge::OwnTrack;
use gravisight_geometry::camera::Outline;
use gravisight_geometry::error::Result;
use gravisight_physics::{Forecaster, State};

/// Residual at which a free flight through the positions around counts half, px: they are labels, or as good as them, and
/// a contact among them shows.
const HALF_WEIGHT_PX: f64 = 0.3;
/// Fewest positions that tell a velocity: with two the residual says nothing.
const FEWEST: usize = 4;
/// Gauss-Newton steps for a free flight: one is exact where the forces are linear in position and velocity.
const STEPS: usize = 3;

/// Depth error of a network that still learns, m: a position that moves by many px with that says little.
const DEPTH_ERROR: f64 = 0.3;

/// A forecast's start.
pub struct Launch {
    /// Position, m.
    pub position: Point3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
    /// How much it counts, 0 to 1.
    pub weight: f64,
    /// How much the network's third number of the picture changes with a metre of depth: 1, or of an apparent radius px.
    by_metre: f64,
    /// Pictures of the batch, and the derivatives of position and velocity by what was found in them (x and y in px of
    /// the drawn picture, depth in m).
    pub slopes: Vec<(usize, Matrix3<f64>, Matrix3<f64>)>,
}

impl Launch {
    /// The state at time 0.
    pub fn state(&self, window: &Window) -> State {
        window.forecaster.scene().in_flight(self.position, self.velocity, window.since_start)
    }

    /// How much a position ahead counts whose derivative by the start's position and velocity is `by_start` (px a m, px a
    /// m/s). Beyond contacts, beside edges above all, a small error of depth is one of many px, whose sign says nothing.
    /// The paper's windows count alike.
    pub fn trust(&self, by_start: &Matrix2x6<f64>) -> f64 {
        let [(_, position, velocity)] = &self.slopes[..] else { return 1.0 };
        let (of_position, of_velocity) = (by_start.fixed_view::<2, 3>(0, 0), by_start.fixed_view::<2, 3>(0, 3));
        let by_depth = of_position * position.column(2) + of_velocity * velocity.column(2);
        (1.0 + (by_depth * self.by_metre * DEPTH_ERROR).norm_squared()).sqrt().recip()
    }

    /// The start of `window` by `positions`, one a picture of the batch, and `own`. None where it has none: too few
    /// positions, or a free flight cannot be found.
    ///
    /// # Errors
    /// As [`Camera::world_from_image_with_jacobian`](gravisight_geometry::camera::Camera::world_from_image_with_jacobian).
    pub fn of(window: &Window, positions: &[[f64; 3]], own: &OwnTrack) -> Result<Option<Self>> {
        match &window.start {
            Start::Pictures { transforms, times } => Self::of_pictures(window, transforms, *times, positions).map(Some),
            Start::Track { transform, around, free, .. } => {
                let (position, slope) = point(window, transform, positions[window.first])?;
                let seen = |(time, target): &(f64, Target)| Some((*time, seen(window, *target, positions, own)?));
                let around: Vec<(f64, Point2<f64>)> = around.iter().filter_map(seen).collect();
                let Some((flight, residual)) = freest(window, free, &around, position)? else { return Ok(None) };
                let Some((velocity, by_position)) = flight.velocity(position) else { return Ok(None) };
                Ok(Some(Self {
                    position,
                    velocity,
                    weight: (1.0 + (residual / HALF_WEIGHT_PX).powi(2)).powi(-2),
                    by_metre: by_metre(window, positions[window.first], &position),
                    slopes: vec![(window.first, slope, by_position * slope)],
                }))
            }
        }
    }

    /// The slope at the middle of the parabola through three points: exact in free flight. Paper eq. (3).
    fn of_pictures(
        window: &Window,
        transforms: &[PictureTransform; 3],
        times: [f64; 3],
        positions: &[[f64; 3]],
    ) -> Result<Self> {
        let (before, after) = (times[1] - times[0], times[2] - times[1]);
        let fractions = [
            -after / (before * (before + after)),
            (after - before) / (before * after),
            before / (after * (before + after)),
        ];
        let mut launch = Self {
            position: Point3::origin(),
            velocity: Vector3::zeros(),
            weight: 1.0,
            by_metre: 1.0,
            slopes: Vec::new(),
        };
        for (index, (transform, fraction)) in transforms.iter().zip(fractions).enumerate() {
            let picture = window.first + index;
            let (point, slope) = point(window, transform, positions[picture])?;
            launch.velocity += point.coords * fraction;
            let middle = f64::from(u8::from(index == 1));
            launch.position += point.coords * middle;
            launch.slopes.push((picture, slope * middle, slope * fraction));
        }
        Ok(launch)
    }
}

/// Where the ball is in the world by what was found in a drawn picture (its position there, and its depth or apparent radius), and its
/// derivative.
pub fn point(
    window: &Window,
    transform: &PictureTransform,
    [x, y, third]: [f64; 3],
) -> Result<(Point3<f64>, Matrix3<f64>)> {
    let image = Point2::from(transform.clip_from_picture([x, y]));
    let scale = if window.ball_radius.is_some() { transform.scale() } else { transform.zoom };
    let (point, by_clip) = match window.ball_radius {
        Some(radius) => {
            let outline = Outline { centre: image, radius: third * scale };
            window.camera.world_from_outline_with_jacobian(&outline, radius)?
        }
        None => window.camera.world_from_image_with_jacobian(&image, third * scale)?,
    };
    let mut by_drawn = Matrix3::from_diagonal_element(scale);
    by_drawn.fixed_view_mut::<2, 2>(0, 0).copy_from(&transform.linear);
    Ok((point, by_clip * by_drawn))
}

/// How much the third number changes with a metre of depth, of a ball at `position`.
fn by_metre(window: &Window, [_, _, third]: [f64; 3], position: &Point3<f64>) -> f64 {
    match window.ball_radius {
        Some(_) => third / window.camera.camera_from_world(position).z.abs().max(f64::MIN_POSITIVE),
        None => 1.0,
    }
}

/// Where the image of the ball's centre is by what was found in a drawn picture, px of the clip's; none where there is no ball
/// of such an outline.
pub fn image_of(window: &Window, transform: &PictureTransform, found: [f64; 3]) -> Option<Point2<f64>> {
    match window.ball_radius {
        // An outline's centre is a little further out.
        Some(_) => window.camera.image_from_world(&point(window, transform, found).ok()?.0).ok(),
        None => Some(transform.clip_from_picture([found[0], found[1]]).into()),
    }
}

/// The 2D position of `target`, px of the clip's picture; none where the network has not seen the frame yet.
pub fn seen(window: &Window, target: Target, positions: &[[f64; 3]], own: &OwnTrack) -> Option<Point2<f64>> {
    match target {
        Target::Label(label) => Some(label.into()),
        Target::Predicted { picture, transform } => image_of(window, &transform, positions[picture]),
        Target::Remembered(frame) => own.get(&frame).map(|&image| image.into()),
        Target::True { .. } => None,
    }
}

/// Rays that a ball in free flight passes, as linear equations `a·δ = right` of the change of its state at time 0.
struct FreeFlight {
    /// One row a ray and direction across it.
    rows: Vec<Vector6<f64>>,
    right: Vec<f64>,
    /// The state that they are linear about.
    position: Point3<f64>,
    velocity: Vector3<f64>,
}

impl FreeFlight {
    /// About `position` and `velocity` at time 0; none where they cannot be forecast.
    fn about(
        window: &Window,
        free: &Forecaster,
        around: &[(f64, Point2<f64>)],
        position: Point3<f64>,
        velocity: Vector3<f64>,
    ) -> Result<Option<Self>> {
        let centre = window.camera.world_from_camera(&Point3::origin());
        let start = free.scene().in_flight(position, velocity, window.since_start);
        let times: Vec<f64> = around.iter().map(|(time, _)| *time).collect();
        let forecast = free.forecast_with_jacobians(&start, &times);
        if !forecast.status.is_exact() || forecast.states.len() != times.len() {
            return Ok(None);
        }
        let (mut rows, mut right) = (Vec::new(), Vec::new());
        for ((state, jacobian), (_, image)) in forecast.states.iter().zip(&forecast.jacobians).zip(around) {
            let ray = window.camera.world_from_image(image, 1.0)? - centre;
            let across = ray.cross(&Vector3::ith(ray.iamin(), 1.0)).normalize();
            for normal in [across, ray.cross(&across).normalize()] {
                rows.push(jacobian.fixed_view::<3, 6>(0, 0).transpose() * normal);
                right.push(-normal.dot(&(state.position - centre)));
            }
        }
        Ok(Some(Self { rows, right, position, velocity }))
    }

    /// The state that passes nearest to the rays: position and velocity.
    fn solve(&self) -> Option<(Point3<f64>, Vector3<f64>)> {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for (row, value) in self.rows.iter().zip(&self.right) {
            normal += row * row.transpose();
            right += row * *value;
        }
        let change: Vector6<f64> = normal.cholesky()?.solve(&right);
        let [position, velocity] = [0, 3].map(|first| change.fixed_rows::<3>(first).into_owned());
        Some((self.position + position, self.velocity + velocity))
    }

    /// The velocity with which it passes nearest to the rays from `position`, and its derivative by that.
    fn velocity(&self, position: Point3<f64>) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let moved = position - self.position;
        let (mut normal, mut mixed, mut right) = (Matrix3::zeros(), Matrix3::zeros(), Vector3::zeros());
        for (row, value) in self.rows.iter().zip(&self.right) {
            let (by_position, by_velocity) = (row.fixed_rows::<3>(0), row.fixed_rows::<3>(3));
            normal += by_velocity * by_velocity.transpose();
            mixed += by_velocity * by_position.transpose();
            right += by_velocity * (value - by_position.dot(&moved));
        }
        let normal = normal.cholesky()?;
        Some((self.velocity + normal.solve(&right), -normal.solve(&mixed)))
    }
}

/// Of the positions around, those before and those after: the ones that a free flight explains best, linear about the ball
/// at `position`, and how well, px rms. A contact splits what is around.
fn freest(
    window: &Window,
    free: &Forecaster,
    around: &[(f64, Point2<f64>)],
    position: Point3<f64>,
) -> Result<Option<(FreeFlight, f64)>> {
    let before = around.partition_point(|(time, _)| *time <= 0.0);
    let after = around.partition_point(|(time, _)| *time < 0.0);
    let mut best: Option<(FreeFlight, f64)> = None;
    for part in [around, &around[..before], &around[after..]] {
        if part.len() < FEWEST {
            continue;
        }
        let Some((velocity, residual)) = free_flight(window, free, part, position)? else { continue };
        if best.as_ref().is_none_or(|(_, least)| residual < *least)
            && let Some(flight) = FreeFlight::about(window, free, part, position, velocity)?
        {
            best = Some((flight, residual));
        }
        if residual <= HALF_WEIGHT_PX {
            break;
        }
    }
    Ok(best)
}

/// The free flight through `around` that fits best, wherever it is: the velocity that belongs to `position`, and the
/// residual, px rms.
fn free_flight(
    window: &Window,
    free: &Forecaster,
    around: &[(f64, Point2<f64>)],
    position: Point3<f64>,
) -> Result<Option<(Vector3<f64>, f64)>> {
    let (mut at, mut velocity, mut here) = (position, Vector3::zeros(), Vector3::zeros());
    for _ in 0..STEPS {
        let Some(flight) = FreeFlight::about(window, free, around, at, velocity)? else { return Ok(None) };
        let Some(solved) = flight.solve() else { return Ok(None) };
        (at, velocity) = solved;
        let Some(flight) = FreeFlight::about(window, free, around, position, here)? else { return Ok(None) };
        let Some((next, _)) = flight.velocity(position) else { return Ok(None) };
        here = next;
    }
    let start = free.scene().in_flight(at, velocity, window.since_start);
    let times: Vec<f64> = around.iter().map(|(time, _)| *time).collect();
    let forecast = free.forecast(&start, &times);
    if forecast.states.len() != times.len() {
        return Ok(None);
    }
    let mut squares = 0.0;
    for (state, (_, image)) in forecast.states.iter().zip(around) {
        // A flight behind the camera is none.
        let Ok(projected) = window.camera.image_from_world(&state.position) else { return Ok(None) };
        squares += (projected - image).norm_squared();
    }
    let residual = (squares / around.len() as f64).sqrt();
    Ok(residual.is_finite().then_some((here, residual)))
}
