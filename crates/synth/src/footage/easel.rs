//! Draws what stands in the world as a camera sees it, from far to near.

use nalgebra::{Point3, Vector3};

use super::super::random::canvas::{Canvas, Ellipse, PaintColour, PaintedLine, PaintedShape, Polygon};
use gravisight_geometry::camera::Camera;

/// Least distance before the camera of what is drawn, m.
const NEAREST: f64 = 0.3;
/// Width of a sharp edge in broadcasts, px: they are soft.
const EDGE: f32 = 1.5;
/// Opacity from which on a shape hides a ball.
const HIDES: f32 = 0.5;
/// How much darker the side away from the light is, and how much lighter the other.
const SHADE: f32 = 0.22;
/// How much lighter and darker folds are.
const FOLDS: f32 = 0.07;

/// The rays of a camera's pixels.
#[derive(Debug, Clone)]
pub(crate) struct Rays {
    /// The camera's centre, m.
    pub eye: [f64; 3],
    columns: [Vector3<f64>; 3],
}

impl Rays {
    pub fn of(camera: &Camera) -> Self {
        let intrinsic = camera.intrinsic();
        let world = camera.rotation().transpose();
        let [x, y, z] = [0, 1, 2].map(|axis| world.column(axis).into_owned());
        let (right, down) = (x / intrinsic[(0, 0)], y / intrinsic[(1, 1)]);
        let forward = z - right * intrinsic[(0, 2)] - down * intrinsic[(1, 2)];
        Self { eye: camera.world_from_camera(&Point3::origin()).coords.into(), columns: [right, down, forward] }
    }

    /// Direction of the ray of a place in the picture, px; its part along the camera's axis is 1.
    pub fn at(&self, column: f64, row: f64) -> [f64; 3] {
        (self.columns[0] * column + self.columns[1] * row + self.columns[2]).into()
    }
}

/// A canvas before a camera. It notes whether a ball that was drawn is hidden by what is drawn after it.
pub(crate) struct Easel<'a> {
    pub canvas: Canvas,
    pub camera: &'a Camera,
    /// Width of edges, px.
    pub softness: f32,
    /// Brightness of what is drawn.
    pub light: f32,
    /// Where a ball's centre was drawn, px, and how far inside a shape it is hidden.
    watched: Option<([f32; 2], f32)>,
    pub hidden: bool,
}

impl<'a> Easel<'a> {
    pub fn new(canvas: Canvas, camera: &'a Camera) -> Self {
        Self { canvas, camera, softness: EDGE, light: 1.0, watched: None, hidden: false }
    }

    /// From now on whether a ball at a place, of a radius, px, is hidden is noted.
    pub fn watch(&mut self, at: [f32; 2], radius: f32) {
        self.watched = Some((at, -0.3 * radius));
    }

    /// Edges as sharp as can be, or blurred by so many px.
    pub fn blurred(&mut self, px: f32) {
        self.softness = EDGE.max(px);
    }

    /// Where a point is seen, px, and the scale there, px/m; none of one that is not before the camera.
    pub fn seen(&self, at: &Point3<f64>) -> Option<([f32; 2], f64)> {
        let point = self.camera.camera_from_world(at);
        if point.z < NEAREST {
            return None;
        }
        let found = self.camera.image_from_camera(&point).ok()?;
        Some(([found.x as f32, found.y as f32], self.camera.intrinsic()[(0, 0)] / point.z))
    }

    /// Whether a place is in the picture or near it, px.
    fn near(&self, [x, y]: [f32; 2], reach: f32) -> bool {
        x > -reach && y > -reach && x < self.canvas.width as f32 + reach && y < self.canvas.height as f32 + reach
    }

    pub fn fill(&mut self, shape: &impl PaintedShape, opacity: f32, colour: impl Fn(f32, f32) -> PaintColour) {
        let light = self.light;
        if let Some((at, reach)) = self.watched {
            self.hidden |= opacity > HIDES && shape.inside(at[0], at[1]) > reach;
        }
        self.canvas.fill(shape, self.softness, opacity, |x, y| colour(x, y).map(|value| value * light));
    }

    /// A limb with round ends, half as thick, m, lit from a side.
    pub fn limb(&mut self, from: &Point3<f64>, to: &Point3<f64>, half: f64, colour: PaintColour) {
        let (Some((a, scale)), Some((b, _))) = (self.seen(from), self.seen(to)) else { return };
        let half = ((half * scale) as f32).max(0.35);
        if !self.near(a, 60.0 + half) && !self.near(b, 60.0 + half) {
            return;
        }
        let line = PaintedLine { from: a, to: b, half };
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let length = dx.hypot(dy).max(1e-3);
        // Lit from the left and above.
        let [nx, ny] = [dy / length, -dx / length];
        let sign = if nx > 0.3 || (nx > -0.3 && ny > 0.0) { -1.0 } else { 1.0 };
        // Cloth has folds, and no two limbs the same.
        let turn = 40.0 * colour[0] + 90.0 * colour[1] + 7.0 * half;
        self.fill(&line, 1.0, |x, y| {
            let aside = sign * ((x - a[0]) * nx + (y - a[1]) * ny) / half;
            let along = ((x - a[0]) * dx + (y - a[1]) * dy) / (length * half);
            let folds = (2.3 * along + 1.7 * aside + turn).sin() * (1.1 * along - 2.9 * aside - turn).sin();
            let shade = 1.0 - 0.5 * SHADE + SHADE * aside.clamp(-1.0, 1.0) + FOLDS * folds;
            colour.map(|value| (value * shade).min(1.0))
        });
    }

    /// A sphere, lit from above.
    pub fn sphere(&mut self, at: &Point3<f64>, radius: f64, colour: PaintColour) {
        let Some((centre, scale)) = self.seen(at) else { return };
        let radius = (radius * scale) as f32;
        if !self.near(centre, radius) || radius < 0.05 {
            return;
        }
        let disc = Ellipse { centre, semi: [radius; 2], axis: [1.0, 0.0] };
        self.fill(&disc, 1.0, |_, y| {
            let shade = 1.0 - SHADE * ((y - centre[1]) / radius).clamp(-1.0, 1.0);
            colour.map(|value| (value * shade).min(1.0))
        });
    }

    /// A flat piece with straight edges; nothing where a corner is behind the camera.
    pub fn piece(&mut self, corners: &[Point3<f64>], opacity: f32, colour: PaintColour) {
        let seen: Vec<[f32; 2]> = corners.iter().filter_map(|corner| Some(self.seen(corner)?.0)).collect();
        if seen.len() == corners.len() {
            self.fill(&Polygon::new(&seen), opacity, |_, _| colour);
        }
    }

    /// A shadow on the ground, m.
    pub fn shadow(&mut self, at: &Point3<f64>, reach: f64, opacity: f32) {
        let (Some((centre, _)), Some((side, _)), Some((away, _))) =
            (self.seen(at), self.seen(&(at + Vector3::x() * reach)), self.seen(&(at + Vector3::y() * reach)))
        else {
            return;
        };
        let wide = (side[0] - centre[0]).abs().max((away[0] - centre[0]).abs()).max(0.5);
        let high = (side[1] - centre[1]).abs().max((away[1] - centre[1]).abs()).max(0.5);
        let disc = Ellipse { centre, semi: [wide, high], axis: [1.0, 0.0] };
        let softness = self.softness + 0.7 * high;
        self.canvas.fill(&disc, softness, opacity, |_, _| [0.02; 3]);
    }
}
