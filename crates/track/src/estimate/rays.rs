//! What rays alone tell, for the search to start from: ballistic flights through them, contacts on them, and the labels in a plane.

use nalgebra::{Cholesky, Point2, RowVector3, SMatrix, SVector, Vector3};

use super::model::Model;
use super::observation::{Ray, RayObservation};
use gravisight_physics::{FORCES, column};

/// Nearest and farthest that a ball is looked for, m.
const NEAREST: f64 = 0.1;
const FARTHEST: f64 = 500.0;
/// Fastest ball, m/s.
const FASTEST: f64 = 120.0;
/// Rounds of either kind; residual from which on a label counts less, in standard deviations; a decrease of the cost that ends them; parts
/// of a step that are tried; fewest labels, a known place counting for two.
const LINEAR: usize = 2;
const ROUNDS: usize = 3;
const LOOSE: f64 = 8.0;
const LITTLE: f64 = 0.5;
const FRACTIONS: [f64; 3] = [1.0, 0.3, 0.1];
const FEWEST: usize = 3;
/// Fraction of its acceleration that a flight may change by on its way.
const CHANGING: f64 = 0.2;
/// Cosine of the largest angle from the middle of the rays at which they still meet the plane before it.
const STEEPEST: f64 = 0.1;

/// A plane before the camera in which the rays' directions are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    axis: Vector3<f64>,
    across: [Vector3<f64>; 2],
    /// Pixels to a unit.
    scale: f64,
}

impl Plane {
    /// About the middle of the rays; none where there are none.
    pub fn of(observations: &[RayObservation]) -> Option<Self> {
        let rays = || observations.iter().filter_map(|seen| seen.ray.as_ref());
        let axis = rays().map(|ray| ray.direction).sum::<Vector3<f64>>().try_normalize(1e-3)?;
        let first = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
        let scale = rays().map(|ray| ray.px_per_radian()).sum::<f64>() / rays().count() as f64;
        Some(Self { axis, across: [first, axis.cross(&first)], scale })
    }

    /// The direction that it is perpendicular to.
    pub fn axis(&self) -> Vector3<f64> {
        self.axis
    }

    /// Where a direction meets it, px.
    pub fn point(&self, direction: &Vector3<f64>) -> Option<Point2<f64>> {
        let along = self.axis.dot(direction);
        let [x, y] = [0, 1].map(|index| self.scale * self.across[index].dot(direction) / along);
        (along > STEEPEST).then(|| Point2::new(x, y))
    }

    /// The labels in it, px, with their frames.
    pub fn labels(&self, observations: &[RayObservation]) -> Vec<(usize, Point2<f64>)> {
        let of = |(frame, seen): (usize, &RayObservation)| Some((frame, self.point(&seen.ray.as_ref()?.direction)?));
        observations.iter().enumerate().filter_map(of).collect()
    }

    /// The unit direction to a point of it.
    pub fn direction(&self, point: &Point2<f64>) -> Vector3<f64> {
        (self.axis + (self.across[0] * point.x + self.across[1] * point.y) / self.scale).normalize()
    }
}

/// A flight that is looked for, beside by its labels.
pub struct BallisticQuery<'a> {
    pub frames: std::ops::RangeInclusive<usize>,
    /// The time of its position and velocity, s.
    pub time: f64,
    /// Where it is known to be: s, m, and that one's standard deviation, m.
    pub places: &'a [(f64, Vector3<f64>, f64)],
    /// What its velocity is where nothing else is known, m/s.
    pub velocity: Vector3<f64>,
}

/// A flight of constant acceleration.
#[derive(Debug, Clone, Copy)]
pub struct BallisticFlight {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    /// Sum of squares, in standard deviations.
    pub cost: f64,
}

impl Model<'_> {
    /// The most probable flight of constant acceleration through rays of frames taken at `times` with `noise` px: what accelerates it is
    /// gravity, the air's drag, and what a spin can add. First of the acceleration that the forces have without spin, which is linear;
    /// then by Gauss and Newton's steps.
    pub fn ballistic(&self, times: &[f64], sought: &BallisticQuery, noise: f64) -> Option<BallisticFlight> {
        let frames = sought.frames.clone();
        let seen: Vec<(f64, &Ray)> = frames
            .filter_map(|frame| Some((times[frame] - sought.time, self.observations[frame].ray.as_ref()?)))
            .collect();
        let (_, ray) = seen.first()?;
        if seen.len() + 2 * sought.places.len() < FEWEST {
            return None;
        }
        let sought = BallisticProblem { sought, seen: &seen, noise, place: self.place, speed: self.config.speed };
        let middle = sought.sought.places.first().map_or(self.place.0, |known| known.1);
        let mut flight = BallisticFlight {
            position: middle,
            velocity: sought.sought.velocity,
            acceleration: self.gravity(),
            cost: 0.0,
        };
        let mut free = 0.0;
        for _ in 0..LINEAR {
            flight = sought.linear(&flight)?;
            let still = column(flight.position, flight.velocity, self.spin.0);
            let forced = self.forecaster.flight(&still, &[0.0; FORCES], false);
            flight.acceleration = forced.slope().1;
            free = forced.by_spin() * self.spin.1 + CHANGING * flight.acceleration.norm();
        }
        let mean = flight.acceleration;
        flight.cost = sought.cost(&flight, (&mean, free))?;
        for _ in 0..ROUNDS {
            let Some(next) = sought.stepped(&flight, (&mean, free)) else { break };
            let decrease = flight.cost - next.cost;
            flight = next;
            if decrease < LITTLE {
                break;
            }
        }
        let depth = ray.direction.dot(&(flight.position - ray.origin));
        ((NEAREST..FARTHEST).contains(&depth) && flight.velocity.norm() < FASTEST).then_some(flight)
    }
}

/// A flight that is looked for, with what is known of it.
struct BallisticProblem<'a> {
    sought: &'a BallisticQuery<'a>,
    /// Rays, and when they were seen, s from [`BallisticQuery::time`].
    seen: &'a [(f64, &'a Ray)],
    /// px.
    noise: f64,
    /// Where it is, m, and how fast, m/s: means and standard deviations.
    place: (Vector3<f64>, Vector3<f64>),
    speed: f64,
}

impl BallisticProblem<'_> {
    /// The flight with this one's acceleration; its labels as many pixels off as they would be at this one's distances.
    fn linear(&self, flight: &BallisticFlight) -> Option<BallisticFlight> {
        let mut sums = NormalEquations::<6>::default();
        for (t, ray) in self.seen {
            let at = flight.at(*t);
            let far = ray.direction.dot(&(at - ray.origin)).max(NEAREST);
            let off = ray.residual(&at).map_or(f64::INFINITY, |(off, _)| off.norm() / self.noise);
            // Labels far off count less; the first time nothing is known of that.
            let robust = if flight.cost > 0.0 { 1.0 / (1.0 + (off / LOOSE).powi(2)) } else { 1.0 };
            for (row, offset) in ray.equations() {
                let right = offset - (row * flight.acceleration)[0] * t * t / 2.0;
                sums.add(&row, *t, right, (far * self.noise).powi(-2) * robust);
            }
        }
        for (time, place, sigma) in self.sought.places {
            let t = time - self.sought.time;
            let right = place - flight.acceleration * (t * t / 2.0);
            (0..3).for_each(|axis| sums.add(&Vector3::ith(axis, 1.0).transpose(), t, right[axis], sigma.powi(-2)));
        }
        for axis in 0..3 {
            sums.known(axis, self.place.0[axis], self.place.1[axis]);
            sums.known(3 + axis, self.sought.velocity[axis], self.speed);
        }
        let solution = sums.solved()?;
        let [position, velocity] = [0, 3].map(|at| solution.fixed_rows::<3>(at).into_owned());
        Some(BallisticFlight { position, velocity, cost: 1.0, ..*flight })
    }

    /// The flight after a step downhill, its acceleration within `free` (m/s²) of a mean; none where there is none.
    fn stepped(&self, flight: &BallisticFlight, (mean, free): (&Vector3<f64>, f64)) -> Option<BallisticFlight> {
        let mut sums = NormalEquations::<9>::default();
        for (t, ray) in self.seen {
            let (off, jacobian) = ray.residual(&flight.at(*t))?;
            let robust = 1.0 / (1.0 + off.norm_squared() / (self.noise * LOOSE).powi(2));
            for row in 0..2 {
                sums.add(&jacobian.row(row).into_owned(), *t, -off[row], robust * self.noise.powi(-2));
            }
        }
        for (time, place, sigma) in self.sought.places {
            let t = time - self.sought.time;
            let off = place - flight.at(t);
            (0..3).for_each(|axis| sums.add(&Vector3::ith(axis, 1.0).transpose(), t, off[axis], sigma.powi(-2)));
        }
        for axis in 0..3 {
            sums.known(axis, self.place.0[axis] - flight.position[axis], self.place.1[axis]);
            sums.known(3 + axis, self.sought.velocity[axis] - flight.velocity[axis], self.speed);
            sums.known(6 + axis, mean[axis] - flight.acceleration[axis], free);
        }
        let step = sums.solved()?;
        let by = |fraction: f64| {
            let [position, velocity, acceleration] = [0, 3, 6].map(|at| step.fixed_rows::<3>(at) * fraction);
            let mut next = BallisticFlight {
                position: flight.position + position,
                velocity: flight.velocity + velocity,
                acceleration: flight.acceleration + acceleration,
                cost: 0.0,
            };
            next.cost = self.cost(&next, (mean, free))?;
            (next.cost < flight.cost).then_some(next)
        };
        FRACTIONS.into_iter().find_map(by)
    }

    /// Sum of squares, in standard deviations; none of a flight behind the camera.
    fn cost(&self, flight: &BallisticFlight, (mean, free): (&Vector3<f64>, f64)) -> Option<f64> {
        let mut cost = ((flight.acceleration - mean) / free).norm_squared();
        cost += (flight.position - self.place.0).component_div(&self.place.1).norm_squared();
        cost += ((flight.velocity - self.sought.velocity) / self.speed).norm_squared();
        for (t, ray) in self.seen {
            let off = ray.residual(&flight.at(*t))?.0.norm_squared() / (self.noise * self.noise);
            cost += LOOSE * LOOSE * (off / (LOOSE * LOOSE)).ln_1p();
        }
        let places = self.sought.places.iter();
        let known = |(time, place, sigma): &(f64, Vector3<f64>, f64)| {
            ((flight.at(time - self.sought.time) - place) / *sigma).norm_squared()
        };
        Some(cost + places.map(known).sum::<f64>())
    }
}

/// Of position, velocity and, of nine numbers, acceleration.
struct NormalEquations<const N: usize> {
    normal: SMatrix<f64, N, N>,
    right: SVector<f64, N>,
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        Self { normal: SMatrix::zeros(), right: SVector::zeros() }
    }
}

impl<const N: usize> NormalEquations<N> {
    /// Adds that `row` times the position at `t` is `value`.
    fn add(&mut self, row: &RowVector3<f64>, t: f64, value: f64, weight: f64) {
        let powers = [1.0, t, t * t / 2.0];
        let a = SVector::<f64, N>::from_fn(|index, _| row[index % 3] * powers[index / 3]);
        self.normal += a * (a.transpose() * weight);
        self.right += a * (value * weight);
    }

    /// Adds what one of the numbers is, and its standard deviation.
    fn known(&mut self, index: usize, value: f64, sigma: f64) {
        self.normal[(index, index)] += sigma.powi(-2);
        self.right[index] += value * sigma.powi(-2);
    }

    fn solved(self) -> Option<SVector<f64, N>> {
        Some(Cholesky::new(self.normal)?.solve(&self.right))
    }
}

impl BallisticFlight {
    /// Where it is at a time from [`BallisticQuery::time`], m.
    pub fn at(&self, t: f64) -> Vector3<f64> {
        self.position + self.velocity * t + self.acceleration * (t * t / 2.0)
    }
}
