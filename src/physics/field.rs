//! Forces per unit mass, and how they change with the state.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::columns::{Columns, column, part};
use super::obstacle::{Obstacle, Shape, Surface, into_box, out_of_box, rotation};
use super::scene::{Contact, Scene};

/// Where a sigmoid's tail is below the rounding of the accelerations (e⁻⁴⁰).
const SIGMOID_TAIL: f64 = 40.0;
/// Step of the default Hessian's central differences, m.
const HESSIAN_STEP: f64 = 1e-5;

/// A potential of the user's own: the paper's "arbitrary physics".
///
/// Everything is per unit of the ball's mass, in the world frame.
pub trait Potential: Send + Sync + std::fmt::Debug {
    /// V(r), J/kg.
    fn value(&self, position: &Vector3<f64>) -> f64;

    /// ∇V(r), m/s²: the ball is accelerated against it.
    fn gradient(&self, position: &Vector3<f64>) -> Vector3<f64>;

    /// ∇∇V(r), 1/s². Without it the gradient's central differences (10 µm apart) are used.
    fn hessian(&self, position: &Vector3<f64>) -> Matrix3<f64> {
        let column = |axis: usize| {
            let step = Vector3::ith(axis, HESSIAN_STEP);
            (self.gradient(&(position + step)) - self.gradient(&(position - step))) / (2.0 * HESSIAN_STEP)
        };
        Matrix3::from_columns(&[column(0), column(1), column(2)])
    }
}

/// Something that says how a state moves on.
pub(crate) trait Flow {
    /// Time derivative of the state and of its sensitivities (the variational equations).
    fn derivative<const M: usize>(&self, y: &Columns<M>) -> Columns<M>;
    /// Whether the spin changes, or acts.
    fn spins(&self) -> bool;
}

/// ∂(acceleration)/∂(position, velocity, spin).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Partials {
    pub position: Matrix3<f64>,
    pub velocity: Matrix3<f64>,
    pub spin: Matrix3<f64>,
}

impl Partials {
    pub fn zero() -> Self {
        Self { position: Matrix3::zeros(), velocity: Matrix3::zeros(), spin: Matrix3::zeros() }
    }
}

/// A scene's smooth forces.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub gravity: Vector3<f64>,
    /// ½ρAC_d/m, 1/m; negative when time runs backwards.
    drag: f64,
    /// ½ρARC_l/m.
    lift: f64,
    /// k/m and the anchor.
    pub spring: Option<(f64, Vector3<f64>)>,
    /// 1/s; negative when time runs backwards.
    spin_decay: f64,
    potential: Option<Arc<dyn Potential>>,
    radius: f64,
    contact: Contact,
    obstacles: Vec<Obstacle>,
}

/// A force field whose motion has a closed form: `a = pull − stiffness·r`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear {
    pub pull: Vector3<f64>,
    pub stiffness: f64,
}

impl Field {
    pub fn new(scene: &Scene, obstacles: &[Obstacle], potential: Option<Arc<dyn Potential>>) -> Self {
        let ball = &scene.ball;
        let pressure = 0.5 * ball.air_density * std::f64::consts::PI * ball.radius.powi(2) / ball.mass;
        Self {
            gravity: scene.gravity.into(),
            drag: pressure * ball.drag_coefficient,
            lift: pressure * ball.radius * ball.lift_coefficient,
            spring: scene.spring.as_ref().map(|spring| (spring.stiffness / ball.mass, spring.anchor.into())),
            spin_decay: ball.spin_decay,
            potential,
            radius: ball.radius,
            contact: scene.contact.clone(),
            obstacles: obstacles.to_vec(),
        }
    }

    /// The user's own potential.
    pub fn potential(&self) -> Option<&Arc<dyn Potential>> {
        self.potential.as_ref()
    }

    /// 1/s.
    pub fn spin_decay(&self) -> f64 {
        self.spin_decay
    }

    /// The same forces for (r, −v, −ω) as time runs backwards.
    pub fn reversed(&self) -> Self {
        Self { drag: -self.drag, spin_decay: -self.spin_decay, ..self.clone() }
    }

    /// The motion away from obstacles (and out of reach of soft ones), where it has a closed form for a ball of
    /// this spin.
    pub fn linear(&self, spin: &Vector3<f64>) -> Option<Linear> {
        let magnus = self.lift != 0.0 && *spin != Vector3::zeros();
        if self.drag != 0.0 || magnus || self.potential.is_some() {
            return None;
        }
        Some(self.linear_part())
    }

    /// The forces that have a closed form.
    pub fn linear_part(&self) -> Linear {
        let (stiffness, anchor) = self.spring.unwrap_or((0.0, Vector3::zeros()));
        Linear { pull: self.gravity + stiffness * anchor, stiffness }
    }

    /// The forces that have none, soft walls left out, m/s².
    pub fn nonlinear_acceleration(&self, r: &Vector3<f64>, v: &Vector3<f64>, w: &Vector3<f64>) -> Vector3<f64> {
        let potential = self.potential.as_ref().map_or(Vector3::zeros(), |potential| potential.gradient(r));
        self.lift * w.cross(v) - self.drag * v.norm() * v - potential
    }

    /// Acceleration, m/s²; its partials are added to `partials`.
    #[inline]
    pub fn acceleration<const PARTIALS: bool>(
        &self,
        r: &Vector3<f64>,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
        partials: &mut Partials,
    ) -> Vector3<f64> {
        let mut a = self.contacts::<PARTIALS>(r, partials);
        if self.drag != 0.0 {
            let speed = v.norm();
            a -= self.drag * speed * v;
            if PARTIALS && speed > 0.0 {
                partials.velocity -= self.drag * (Matrix3::identity() * speed + v * v.transpose() / speed);
            }
        }
        if self.lift != 0.0 {
            a += self.lift * w.cross(v);
            if PARTIALS {
                partials.velocity += self.lift * w.cross_matrix();
                partials.spin -= self.lift * v.cross_matrix();
            }
        }
        if let Some((stiffness, anchor)) = &self.spring {
            a -= *stiffness * (r - anchor);
            if PARTIALS {
                partials.position -= Matrix3::identity() * *stiffness;
            }
        }
        if let Some(potential) = &self.potential {
            a -= potential.gradient(r);
            if PARTIALS {
                partials.position -= potential.hessian(r);
            }
        }
        a
    }

    /// Gravity and the paper's soft potentials.
    #[inline]
    fn contacts<const PARTIALS: bool>(&self, r: &Vector3<f64>, partials: &mut Partials) -> Vector3<f64> {
        match self.contact {
            // impacts, and soft contacts while they last (`Pressing`), are not forces of the field
            Contact::Bounce { .. } | Contact::Spring { .. } => self.gravity,
            Contact::Penalty { c, beta, beta_box } => {
                let mut a = self.gravity;
                for obstacle in &self.obstacles {
                    match &obstacle.shape {
                        Shape::Plane { normal, offset } => {
                            let x = beta * (normal.dot(r) - offset);
                            if x > SIGMOID_TAIL {
                                continue;
                            }
                            let (above, below) = sigmoids(x);
                            a += c * below * normal;
                            let mut slope = -c * normal;
                            if obstacle.surface == Surface::Floor {
                                // gravity under a ReLU, whose derivative is the sigmoid
                                a -= self.gravity * below;
                                slope += self.gravity;
                            }
                            if PARTIALS {
                                partials.position += slope * normal.transpose() * (beta * above * below);
                            }
                        }
                        Shape::Cuboid { centre, half, cos, sin } => {
                            let local = into_box(r - centre, *cos, *sin);
                            if (local.abs() - half).max() * beta_box > SIGMOID_TAIL {
                                continue;
                            }
                            let pulses = [0, 1, 2].map(|axis| pulse(local[axis], half[axis], beta_box));
                            let [x, y, z] = pulses.map(|[value, _, _]| value);
                            let [dx, dy, dz] = pulses.map(|[_, slope, _]| slope);
                            let scale = c / beta_box;
                            let gradient = scale * Vector3::new(dx * y * z, x * dy * z, x * y * dz);
                            a -= out_of_box(gradient, *cos, *sin);
                            if PARTIALS {
                                let [ddx, ddy, ddz] = pulses.map(|[_, _, bend]| bend);
                                let (xy, xz, yz) = (dx * dy * z, dx * y * dz, x * dy * dz);
                                let hessian =
                                    Matrix3::new(ddx * y * z, xy, xz, xy, x * ddy * z, yz, xz, yz, x * y * ddz);
                                let turn = rotation(*cos, *sin);
                                partials.position -= scale * (turn * hessian * turn.transpose());
                            }
                        }
                    }
                }
                a
            }
        }
    }

    /// Potential energy, J/kg; what drag and friction take is not in it.
    pub fn potential_energy(&self, r: &Vector3<f64>) -> f64 {
        let spring = self.spring.map_or(0.0, |(stiffness, anchor)| 0.5 * stiffness * (r - anchor).norm_squared());
        let own = self.potential.as_ref().map_or(0.0, |potential| potential.value(r));
        let mut sum = spring + own;
        let mut gravity = -self.gravity.dot(r);
        for obstacle in &self.obstacles {
            match (&self.contact, &obstacle.shape) {
                (Contact::Bounce { .. }, _) => {}
                (Contact::Spring { stiffness }, _) => {
                    sum += 0.5 * stiffness * (self.radius - obstacle.distance(r)).max(0.0).powi(2);
                }
                (Contact::Penalty { c, beta, .. }, Shape::Plane { normal, offset }) => {
                    let height = normal.dot(r) - offset;
                    sum += c * softplus(-beta * height) / beta;
                    if obstacle.surface == Surface::Floor {
                        // only the part along the normal is under the ReLU's potential
                        let down = -self.gravity.dot(normal);
                        gravity += down * (softplus(beta * height) / beta - normal.dot(r));
                    }
                }
                (Contact::Penalty { c, beta_box, .. }, Shape::Cuboid { centre, half, cos, sin }) => {
                    let local = into_box(r - centre, *cos, *sin);
                    let pulses = [0, 1, 2].map(|axis| pulse(local[axis], half[axis], *beta_box)[0]);
                    sum += c / beta_box * pulses.iter().product::<f64>();
                }
            }
        }
        sum + gravity
    }
}

/// A field with the obstacles that a soft sphere presses on.
///
/// Which ones is fixed for the length of a contact, so that forces are smooth within it.
pub(crate) struct Pressing<'a> {
    pub field: &'a Field,
    /// One flag an obstacle.
    pub active: &'a [bool],
    /// Per unit mass, 1/s².
    pub stiffness: f64,
}

impl Flow for Field {
    #[inline]
    fn derivative<const M: usize>(&self, y: &Columns<M>) -> Columns<M> {
        let mut partials = Partials::zero();
        let (r, v, w) = (y.position(), y.velocity(), y.spin());
        let a = match M {
            1 => self.acceleration::<false>(&r, &v, &w, &mut partials),
            _ => self.acceleration::<true>(&r, &v, &w, &mut partials),
        };
        self.slope(y, a, &partials)
    }

    fn spins(&self) -> bool {
        self.spin_decay != 0.0 || self.lift != 0.0
    }
}

impl Flow for Pressing<'_> {
    fn spins(&self) -> bool {
        self.field.spins()
    }

    #[inline]
    fn derivative<const M: usize>(&self, y: &Columns<M>) -> Columns<M> {
        let mut partials = Partials::zero();
        let (r, v, w) = (y.position(), y.velocity(), y.spin());
        let mut a = self.field.acceleration::<true>(&r, &v, &w, &mut partials);
        let pressed = self.field.obstacles.iter().zip(self.active).filter(|(_, active)| **active);
        for (obstacle, _) in pressed {
            let near = obstacle.nearest(&r);
            let depth = self.field.radius - near.distance;
            a += self.stiffness * depth * near.normal;
            partials.position += self.stiffness * (near.curvature * depth - near.normal * near.normal.transpose());
        }
        self.field.slope(y, a, &partials)
    }
}

impl Field {
    /// The slope of state and sensitivities under an acceleration and its partials.
    #[inline]
    pub fn slope<const M: usize>(&self, y: &Columns<M>, a: Vector3<f64>, partials: &Partials) -> Columns<M> {
        let mut slope = Columns([[0.0; 9]; M]);
        slope.0[0] = column(y.velocity(), a, -self.spin_decay * y.spin());
        let by_position_only = self.drag == 0.0 && self.lift == 0.0;
        for (out, sensitivity) in slope.0.iter_mut().zip(&y.0).skip(1) {
            let (dr, dv, dw) = (part(sensitivity, 0), part(sensitivity, 1), part(sensitivity, 2));
            let mut da = partials.position * dr;
            if !by_position_only {
                da += partials.velocity * dv + partials.spin * dw;
            }
            *out = column(dv, da, -self.spin_decay * dw);
        }
        slope
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
