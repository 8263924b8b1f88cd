//! The `penalty` contact model: the paper's soft potentials, forces without events; the ball is a point.

use nalgebra::{Matrix3, Vector3};

use crate::columns::Columns;
use crate::force::{Forces, Partials};
use crate::motion::closed_form::ClosedForm;
use crate::motion::integrate::{Flow, Integrator};
use crate::motion::run::{Depth, Model, Run};
use crate::obstacle::{Obstacle, Shape, Surface, into_box, out_of_box};
use crate::scene::Scene;

/// Where a sigmoid's tail is below the rounding of the accelerations (e⁻⁴⁰).
const SIGMOID_TAIL: f64 = 40.0;
/// Largest force (m/s²), and largest gradient of it (1/s²), of a soft wall that is not felt; and with fixed steps.
const SOFT_FORCE: f64 = 1e-6;
const SOFT_FORCE_OF_STEPS: f64 = 1e-12;
/// Widths (1/β) of a soft wall within which the ball is in contact with it; one step may cross as many unseen.
const SOFT_WALL_WIDTHS: f64 = 8.0;
/// Speed whose depth in a soft wall is still ordinary, m/s.
const ORDINARY_SPEED: f64 = 5.0;

#[derive(Debug, Clone)]
pub(crate) struct Penalty {
    /// m/s².
    c: f64,
    /// Sharpness of planes, 1/m.
    beta: f64,
    /// Sharpness of boxes, 1/m.
    beta_box: f64,
    gravity: Vector3<f64>,
}

/// The forces, soft walls included.
struct Soft<'a> {
    forces: &'a Forces,
    walls: &'a Penalty,
    obstacles: &'a [Obstacle],
}

impl Flow for Soft<'_> {
    fn spins(&self) -> bool {
        self.forces.spins()
    }

    #[inline]
    fn derivative_into<const M: usize>(&self, y: &Columns<M>, out: &mut Columns<M>) {
        self.forces.slope(y, |r, partials| self.walls.acceleration(self.obstacles, r, partials), out);
    }
}

impl Penalty {
    pub fn new(scene: &Scene, c: f64, beta: f64, beta_box: f64) -> Self {
        Self { c, beta, beta_box, gravity: scene.gravity.into() }
    }

    /// Distance from obstacles beyond which their forces are below the solver's tolerance, m.
    fn felt_within(&self, integrator: &Integrator) -> f64 {
        let tolerance = match integrator {
            Integrator::DormandPrince { atol, .. } => atol.min(SOFT_FORCE),
            _ => SOFT_FORCE_OF_STEPS,
        };
        let strongest = self.c.max(self.gravity.norm()).max(1.0);
        let reach = |beta: f64| (strongest * beta.max(1.0) / tolerance).ln().max(0.0) / beta;
        reach(self.beta).max(reach(self.beta_box))
    }

    /// A plane's push; the floor also takes gravity away, which stands under a ReLU whose derivative is the sigmoid.
    #[inline]
    fn plane(
        &self,
        surface: Surface,
        normal: &Vector3<f64>,
        height: f64,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        let x = self.beta * height;
        if x > SIGMOID_TAIL {
            return Vector3::zeros();
        }
        let (above, below) = sigmoids(x);
        let gravity = if surface == Surface::Floor { self.gravity } else { Vector3::zeros() };
        let push = self.c * normal - gravity;
        if let Some(partials) = partials {
            partials.position -= push * normal.transpose() * (self.beta * above * below);
        }
        below * push
    }

    #[inline]
    fn cuboid(
        &self,
        local: &Vector3<f64>,
        half: &Vector3<f64>,
        turn: &Matrix3<f64>,
        partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        if (local.abs() - half).max() * self.beta_box > SIGMOID_TAIL {
            return Vector3::zeros();
        }
        let pulses = [0, 1, 2].map(|axis| pulse(local[axis], half[axis], self.beta_box));
        let [x, y, z] = pulses.map(|[value, _, _]| value);
        let [dx, dy, dz] = pulses.map(|[_, slope, _]| slope);
        let scale = self.c / self.beta_box;
        if let Some(partials) = partials {
            let [ddx, ddy, ddz] = pulses.map(|[_, _, bend]| bend);
            let (xy, xz, yz) = (dx * dy * z, dx * y * dz, x * dy * dz);
            let hessian = Matrix3::new(ddx * y * z, xy, xz, xy, x * ddy * z, yz, xz, yz, x * y * ddz);
            partials.position -= scale * (turn * hessian * turn.transpose());
        }
        -out_of_box(scale * Vector3::new(dx * y * z, x * dy * z, x * y * dz), turn)
    }
}

impl Model for Penalty {
    type Phase = ();

    fn reversed(self) -> Self {
        self
    }

    /// Ordinary: as deep as a ball of 5 m/s gets. Deeper ones go to where wall and gravity balance.
    fn depth(&self, obstacle: &Obstacle) -> Depth {
        let sharpness = if matches!(obstacle.shape, Shape::Plane { .. }) { self.beta } else { self.beta_box };
        let ratio = (self.c / self.gravity.norm().max(self.c * 1e-3)).max(1.0);
        let lowest = -ORDINARY_SPEED * ORDINARY_SPEED / (2.0 * self.c.max(f64::MIN_POSITIVE));
        Depth { lowest, target: ratio.ln() / sharpness, touching: 0.0 }
    }

    fn reach(&self) -> f64 {
        SOFT_WALL_WIDTHS / self.beta.min(self.beta_box)
    }

    #[inline]
    fn acceleration(
        &self,
        obstacles: &[Obstacle],
        r: &Vector3<f64>,
        mut partials: Option<&mut Partials>,
    ) -> Vector3<f64> {
        let mut a = Vector3::zeros();
        for obstacle in obstacles {
            let partials = partials.as_deref_mut();
            a += match &obstacle.shape {
                Shape::Plane { normal, offset } => {
                    self.plane(obstacle.surface, normal, normal.dot(r) - offset, partials)
                }
                Shape::Cuboid { centre, half, turn } => self.cuboid(&into_box(r - centre, turn), half, turn, partials),
            };
        }
        a
    }

    fn potential_energy(&self, obstacles: &[Obstacle], r: &Vector3<f64>) -> f64 {
        let Self { c, beta, beta_box, gravity } = self;
        let energy = |obstacle: &Obstacle| match &obstacle.shape {
            Shape::Plane { normal, offset } => {
                let height = normal.dot(r) - offset;
                // only gravity's part along the normal is under the ReLU's potential
                let down = if obstacle.surface == Surface::Floor { -gravity.dot(normal) } else { 0.0 };
                c * softplus(-beta * height) / beta + down * (softplus(beta * height) / beta - normal.dot(r))
            }
            Shape::Cuboid { centre, half, turn } => {
                let local = into_box(r - centre, turn);
                let pulses = [0, 1, 2].map(|axis| pulse(local[axis], half[axis], *beta_box)[0]);
                c / beta_box * pulses.iter().product::<f64>()
            }
        };
        obstacles.iter().map(energy).sum()
    }

    fn first<const M: usize>(&self, _: &Run<M>) {}

    fn advance<const M: usize>(&self, run: &mut Run<M>, (): ()) {
        let clear = |run: &Run<M>| {
            let r = run.y.position();
            run.obstacles.iter().map(|obstacle| obstacle.distance(&r)).fold(f64::INFINITY, f64::min)
        };
        let felt = self.felt_within(&run.options.integrator);
        if clear(run) > felt
            && let Some(linear) = run.closed_form()
        {
            // where no soft wall is felt, an arc
            let arc = ClosedForm { linear, spin_decay: run.forces.spin_decay(), press: None };
            if run.follow(&arc, &[], felt, run.time_left()).obstacle.is_none() {
                return;
            }
        }
        // No step may jump over a wall: the ball must see it on the way.
        let longest = (clear(run).max(0.0) + self.reach()) / run.y.velocity().norm();
        let soft = Soft { forces: run.forces, walls: self, obstacles: run.obstacles };
        if let Some(step) = run.trial(&soft, longest) {
            run.commit(&step);
            run.slope = Some(step.last);
        }
    }
}

/// σ(x) and σ(−x), neither of them rounded to zero by the other.
#[inline]
fn sigmoids(x: f64) -> (f64, f64) {
    let e = (-x.abs()).exp();
    let (large, small) = (1.0 / (1.0 + e), e / (1.0 + e));
    if x >= 0.0 { (large, small) } else { (small, large) }
}

/// ln(1 + eˣ).
fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// σ(β(x + half)) − σ(β(x − half)), its first and second derivative.
#[inline]
fn pulse(x: f64, half: f64, beta: f64) -> [f64; 3] {
    let (rise, rise_rest) = sigmoids(beta * (x + half));
    let (fall, fall_rest) = sigmoids(beta * (x - half));
    let (up, down) = (rise * rise_rest, fall * fall_rest);
    // 1 − 2σ(x) = σ(−x) − σ(x)
    let bend = up * (rise_rest - rise) - down * (fall_rest - fall);
    [rise - fall, beta * (up - down), beta * beta * bend]
}
