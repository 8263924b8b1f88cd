//! What a ball can touch: exact distances to planes and boxes, with their derivatives.

use nalgebra::{Matrix3, Vector3};
use serde::{Serialize, Serializer};

use super::scene::Scene;

/// Names an obstacle of a scene; serialises as its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// The floor.
    Floor,
    /// `walls[index]`.
    Wall(usize),
    /// `boxes[index]`.
    Box(usize),
}

impl std::fmt::Display for Surface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Floor => write!(f, "floor"),
            Self::Wall(index) => write!(f, "walls[{index}]"),
            Self::Box(index) => write!(f, "boxes[{index}]"),
        }
    }
}

impl Serialize for Surface {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A convex obstacle. Signed distances are negative inside.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct Obstacle {
    pub surface: Surface,
    pub shape: Shape,
}

#[derive(Debug, Clone)]
#[doc(hidden)]
pub enum Shape {
    /// The half-space below `normal · r = offset`.
    Plane { normal: Vector3<f64>, offset: f64 },
    /// A box; `turn` is world_from_box.
    Cuboid { centre: Vector3<f64>, half: Vector3<f64>, turn: Matrix3<f64> },
}

/// The nearest point of an obstacle, seen from a point r.
#[derive(Debug, Clone, Copy)]
#[doc(hidden)]
pub struct Nearest {
    /// Signed distance d(r), m.
    pub distance: f64,
    /// ∇d: from the obstacle to r, unit length.
    pub normal: Vector3<f64>,
    /// ∂normal/∂r, the Hessian of d, 1/m: zero at a face, 1/d across an edge, and at a corner.
    pub curvature: Matrix3<f64>,
}

impl Obstacle {
    /// The obstacles of a scene: floor, walls, boxes.
    pub fn of(scene: &Scene) -> Vec<Self> {
        let floor = scene.floor.iter().map(|floor| Self {
            surface: Surface::Floor,
            shape: Shape::Plane { normal: Vector3::z(), offset: floor.height },
        });
        let walls = scene.walls.iter().enumerate().map(|(index, wall)| {
            let normal = Vector3::from(wall.normal).normalize();
            let offset = normal.dot(&Vector3::from(wall.point));
            Self { surface: Surface::Wall(index), shape: Shape::Plane { normal, offset } }
        });
        let boxes = scene.boxes.iter().enumerate().map(|(index, cuboid)| {
            let (centre, half, turn) = (cuboid.position.into(), cuboid.half_size.into(), cuboid.world_from_box());
            Self { surface: Surface::Box(index), shape: Shape::Cuboid { centre, half, turn } }
        });
        floor.chain(walls).chain(boxes).collect()
    }

    /// Signed distance of `r`, m.
    #[inline]
    pub fn distance(&self, r: &Vector3<f64>) -> f64 {
        match &self.shape {
            Shape::Plane { normal, offset } => normal.dot(r) - offset,
            Shape::Cuboid { centre, half, turn } => {
                let beyond = into_box(r - centre, turn).abs() - half;
                let outside = beyond.map(|d| d.max(0.0)).norm();
                if outside > 0.0 { outside } else { beyond.max() }
            }
        }
    }

    /// How much of the way from `eye` to `r` lies inside, m.
    pub fn between(&self, eye: &Vector3<f64>, r: &Vector3<f64>) -> f64 {
        let way = r - eye;
        // Where the way passes each slab, as shares of it.
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        let mut clip = |at: f64, by: f64, low: f64, high: f64| {
            let (a, b) = ((low - at) / by, (high - at) / by);
            if by == 0.0 {
                if at < low || at > high {
                    to = -1.0;
                }
            } else {
                from = from.max(a.min(b));
                to = to.min(a.max(b));
            }
        };
        match &self.shape {
            Shape::Plane { normal, offset } => clip(normal.dot(eye), normal.dot(&way), f64::NEG_INFINITY, *offset),
            Shape::Cuboid { centre, half, turn } => {
                let (at, by) = (into_box(eye - centre, turn), into_box(way, turn));
                (0..3).for_each(|axis| clip(at[axis], by[axis], -half[axis], half[axis]));
            }
        }
        (to - from).max(0.0) * way.norm()
    }

    /// Centres of a ball of this `radius` on a ray from `eye` that touches a face which it comes towards; one that passes a face by no
    /// more than `margin` touches its rim.
    pub fn touching(
        &self,
        eye: &Vector3<f64>,
        direction: &Vector3<f64>,
        radius: f64,
        margin: f64,
    ) -> Vec<Vector3<f64>> {
        match &self.shape {
            Shape::Plane { normal, offset } => {
                let along = (offset + radius - normal.dot(eye)) / normal.dot(direction);
                if along > 0.0 && along.is_finite() && normal.dot(direction) < 0.0 {
                    vec![eye + direction * along]
                } else {
                    vec![]
                }
            }
            Shape::Cuboid { centre, half, turn } => {
                let (at, by) = (into_box(eye - centre, turn), into_box(*direction, turn));
                let face = |axis: usize| {
                    let side = -by[axis].signum();
                    let along = (side * (half[axis] + radius) - at[axis]) / by[axis];
                    let mut point = at + by * along;
                    let beside = |other: usize| other == axis || point[other].abs() <= half[other] + margin;
                    if !along.is_finite() || along <= 0.0 || !(0..3).all(beside) {
                        return None;
                    }
                    for other in (0..3).filter(|&other| other != axis) {
                        point[other] = point[other].clamp(-half[other], half[other]);
                    }
                    Some(centre + out_of_box(point, turn))
                };
                (0..3).filter_map(face).collect()
            }
        }
    }

    /// Distance, normal and curvature at `r`.
    #[inline]
    pub fn nearest(&self, r: &Vector3<f64>) -> Nearest {
        match &self.shape {
            Shape::Plane { normal, offset } => {
                Nearest { distance: normal.dot(r) - offset, normal: *normal, curvature: Matrix3::zeros() }
            }
            Shape::Cuboid { centre, half, turn } => {
                let local = into_box(r - centre, turn);
                let beyond = local.abs() - half;
                let outside = beyond.map(|d| d.max(0.0));
                let distance = outside.norm();
                let sign = |axis: usize| if local[axis] < 0.0 { -1.0 } else { 1.0 };
                if distance <= 0.0 {
                    let axis = beyond.imax();
                    let mut normal = Vector3::zeros();
                    normal[axis] = sign(axis);
                    let normal = out_of_box(normal, turn);
                    return Nearest { distance: beyond[axis], normal, curvature: Matrix3::zeros() };
                }
                let n = Vector3::from_fn(|axis, _| sign(axis) * outside[axis] / distance);
                let normal = out_of_box(n, turn);
                let crossed = outside.iter().filter(|&&d| d > 0.0).count();
                let curvature = match crossed {
                    1 => Matrix3::zeros(),
                    _ => {
                        let across = Matrix3::from_diagonal(&outside.map(|d| f64::from(u8::from(d > 0.0))));
                        turn * ((across - n * n.transpose()) / distance) * turn.transpose()
                    }
                };
                Nearest { distance, normal, curvature }
            }
        }
    }
}

/// Box axes from world axes, by world_from_box.
#[inline]
pub(crate) fn into_box(v: Vector3<f64>, turn: &Matrix3<f64>) -> Vector3<f64> {
    turn.tr_mul(&v)
}

/// World axes from box axes, by world_from_box.
#[inline]
pub(crate) fn out_of_box(v: Vector3<f64>, turn: &Matrix3<f64>) -> Vector3<f64> {
    turn * v
}
