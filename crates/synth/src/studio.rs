//! Faces and lights: what a ray meets, and OpenGL's lighting of it.

use nalgebra::{Point3, Rotation3, Vector3};

use super::scenes::{BallLook, Light, Paper, RoomWall, SceneBlock};

/// The floor's half side, and a wall's, m.
pub(super) const FLOOR: f64 = 800.0;
/// Distance between the floor's lighting corners, m: MuJoCo's.
pub(super) const FLOOR_GRID: f64 = 2.0 * FLOOR / 198.0;
/// Cells of a box face's lighting grid in each direction: MuJoCo's.
const FACE_GRID: usize = 4;
/// How far from a surface rays start, m.
pub(super) const CLEAR: f64 = 1e-4;

pub(super) type Colour = Vector3<f64>;

/// Light that leaves a surface towards the eye: what its colour tints, and what shines white.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shine {
    pub(super) diffuse: f64,
    pub(super) specular: f64,
}

/// The same from the headlight and from the spot light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit {
    pub(super) head: Shine,
    pub(super) spot: Shine,
}

impl Lit {
    /// Weighted sum.
    pub(super) fn mix(parts: [(f64, Self); 3]) -> Self {
        let sum = |of: fn(&Self) -> f64| parts.iter().map(|(weight, lit)| weight * of(lit)).sum();
        Self {
            head: Shine { diffuse: sum(|lit| lit.head.diffuse), specular: sum(|lit| lit.head.specular) },
            spot: Shine { diffuse: sum(|lit| lit.spot.diffuse), specular: sum(|lit| lit.spot.specular) },
        }
    }
}

impl Shine {
    pub(super) fn of(&self, colour: &Colour) -> Colour {
        colour * self.diffuse + Colour::repeat(self.specular)
    }
}

/// A face of a box, or the floor.
pub(super) struct Face {
    pub(super) centre: Point3<f64>,
    /// Two directions in the face and its normal.
    pub(super) axes: [Vector3<f64>; 3],
    /// Half its sides; the floor's are infinite.
    pub(super) half: [f64; 2],
    /// Sides of a lighting cell.
    pub(super) cell: [f64; 2],
    pub(super) colour: Colour,
    pub(super) alpha: f64,
}

/// A ray's meeting with a face.
#[derive(Clone, Copy)]
pub(super) struct RayHit {
    pub(super) distance: f64,
    pub(super) face: usize,
    pub(super) point: Point3<f64>,
}

impl Face {
    /// Lighting at a point, interpolated between a cell's corners as two triangles do it.
    pub(super) fn lit(&self, studio: &RayCaster<'_>, point: &Point3<f64>, eye: &Point3<f64>) -> Lit {
        let offset = point - self.centre;
        let at = [0, 1].map(|axis| {
            let corner = if self.half[axis].is_finite() { self.half[axis] } else { 0.0 };
            (offset.dot(&self.axes[axis]) + corner) / self.cell[axis]
        });
        let cell = at.map(f64::floor);
        let [x, y] = [at[0] - cell[0], at[1] - cell[1]];
        let corner = |right: f64, up: f64| {
            let place = [0, 1].map(|axis| {
                let corner = if self.half[axis].is_finite() { self.half[axis] } else { 0.0 };
                (cell[axis] + [right, up][axis]) * self.cell[axis] - corner
            });
            studio.light(&(self.centre + self.axes[0] * place[0] + self.axes[1] * place[1]), &self.axes[2], eye)
        };
        if x + y < 1.0 {
            Lit::mix([(1.0 - x - y, corner(0.0, 0.0)), (x, corner(1.0, 0.0)), (y, corner(0.0, 1.0))])
        } else {
            Lit::mix([(x + y - 1.0, corner(1.0, 1.0)), (1.0 - x, corner(0.0, 1.0)), (1.0 - y, corner(1.0, 0.0))])
        }
    }
}

/// The lights and everything that does not move.
pub(super) struct RayCaster<'a> {
    pub(super) paper: &'a Paper,
    pub(super) lamp: &'a Light,
    pub(super) faces: Vec<Face>,
    /// A ball that does not move.
    pub(super) anchor: Option<&'a BallLook>,
    /// Whether the first face is a floor.
    pub(super) floor: bool,
    /// Direction that the camera looks in.
    pub(super) forward: Vector3<f64>,
    pub(super) light: Point3<f64>,
    pub(super) axis: Vector3<f64>,
}

impl RayCaster<'_> {
    /// OpenGL's fixed lighting of a point, without shadows.
    pub(super) fn light(&self, point: &Point3<f64>, normal: &Vector3<f64>, eye: &Point3<f64>) -> Lit {
        let (light, Paper { headlight, material, .. }) = (self.lamp, self.paper);
        let view = (eye - point).normalize();
        let shine = |towards: &Vector3<f64>, diffuse: f64, specular: f64| {
            let facing = normal.dot(towards);
            if facing <= 0.0 {
                return Shine { diffuse: 0.0, specular: 0.0 };
            }
            let half = (towards + view).try_normalize(1e-12).unwrap_or(*normal);
            let gloss = normal.dot(&half).max(0.0).powf(material.shininess);
            Shine { diffuse: diffuse * facing, specular: specular * material.specular * gloss }
        };
        let mut head = shine(&-self.forward, headlight.diffuse, headlight.specular);
        head.diffuse += headlight.ambient;
        let towards = (self.light - point).normalize();
        let cosine = -towards.dot(&self.axis);
        let cone = if cosine > light.cutoff.to_radians().cos() { cosine.powf(light.exponent) } else { 0.0 };
        Lit { head, spot: shine(&towards, light.diffuse * cone, light.specular * cone) }
    }

    /// The nearest face that a ray meets from the front, of those that `wanted` names.
    pub(super) fn cast(
        &self,
        from: &Point3<f64>,
        along: &Vector3<f64>,
        wanted: impl Fn(&Face) -> bool,
    ) -> Option<RayHit> {
        let mut nearest: Option<RayHit> = None;
        for (index, face) in self.faces.iter().enumerate().filter(|(_, face)| wanted(face)) {
            let slope = along.dot(&face.axes[2]);
            if slope >= -1e-12 {
                continue;
            }
            let distance = (face.centre - from).dot(&face.axes[2]) / slope;
            if distance <= CLEAR || nearest.is_some_and(|hit| hit.distance <= distance) {
                continue;
            }
            let point = from + along * distance;
            let offset = point - face.centre;
            if (0..2).all(|axis| offset.dot(&face.axes[axis]).abs() <= face.half[axis]) {
                nearest = Some(RayHit { distance, face: index, point });
            }
        }
        nearest
    }

    /// Whether a box or the ball in the centre (not the one that moves) is between a point and the light.
    pub(super) fn shadowed(&self, point: &Point3<f64>) -> bool {
        let way = self.light - point;
        let distance = way.norm();
        let boxes = |face: &Face| face.half[0].is_finite();
        let behind_anchor = self.anchor.is_some_and(|anchor| {
            let met = sphere(point, &(way / distance), &Point3::origin(), anchor.radius);
            met.is_some_and(|met| met > CLEAR && met < distance)
        });
        // From the light, so that faces are met from the front.
        let hit = self.cast(&self.light, &(-way / distance), boxes);
        behind_anchor || hit.is_some_and(|hit| hit.distance < distance - 10.0 * CLEAR)
    }
}

/// Distance along a ray to a sphere.
pub(super) fn sphere(from: &Point3<f64>, along: &Vector3<f64>, centre: &Point3<f64>, radius: f64) -> Option<f64> {
    let way = centre - from;
    let middle = way.dot(along);
    let square = radius * radius - (way.norm_squared() - middle * middle);
    (square > 0.0 && middle > square.sqrt()).then(|| middle - square.sqrt())
}

/// The faces of a box that can be seen: its sides and its top.
pub(super) fn faces(block: &SceneBlock) -> Vec<Face> {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), block.yaw.to_radians());
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| turn * axis);
    let face = |normal: usize, sign: f64| {
        let (u, v) = ((normal + 1) % 3, (normal + 2) % 3);
        let half = [block.half_size[u], block.half_size[v]];
        Face {
            centre: Point3::from(block.position) + axes[normal] * sign * block.half_size[normal],
            axes: [axes[u], axes[v] * sign, axes[normal] * sign],
            half,
            cell: half.map(|half| 2.0 * half / FACE_GRID as f64),
            colour: Vector3::from(block.colour).cast(),
            alpha: block.alpha,
        }
    };
    vec![face(0, 1.0), face(0, -1.0), face(1, 1.0), face(1, -1.0), face(2, 1.0)]
}

/// A wall, as far as the floor's grid of lighting goes.
pub(super) fn wall(wall: &RoomWall) -> Face {
    let normal = Vector3::from(wall.normal).normalize();
    let across = normal.cross(&Vector3::z()).normalize();
    Face {
        centre: Point3::from(wall.point),
        axes: [across, normal.cross(&across), normal],
        half: [FLOOR; 2],
        cell: [FLOOR_GRID; 2],
        colour: Vector3::from(wall.colour).cast(),
        alpha: 1.0,
    }
}
