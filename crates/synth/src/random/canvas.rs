//! A picture in the making, and shapes drawn on it with the fraction of each pixel that they cover.

use rand::RngExt;

use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// Semi-axis from which on an outline is as good as straight within a pixel, px.
const STRAIGHT: f32 = 6.0;
/// Parts that a pixel's side is cut into at most.
const MOST_PARTS: f32 = 4.0;

/// Red, green, blue as fractions of full scale.
pub type PaintColour = [f32; 3];

/// Weighted mean of two colours: `a` at 0, `b` at 1.
pub fn mix(a: PaintColour, b: PaintColour, fraction: f32) -> PaintColour {
    std::array::from_fn(|channel| a[channel] + fraction * (b[channel] - a[channel]))
}

/// A picture, one plane a channel, rows from the top.
#[derive(Debug, Clone)]
pub struct Canvas {
    pub width: usize,
    pub height: usize,
    pub planes: [Vec<f32>; 3],
}

/// What lies where in a shape's own frame.
pub trait PaintedShape {
    /// Left, top, right and bottom of all that it covers, px.
    fn bounds(&self) -> [f32; 4];
    /// How far inside its outline a point lies, px; negative outside.
    fn inside(&self, x: f32, y: f32) -> f32;
}

impl Canvas {
    pub fn new(size: Size, colour: PaintColour) -> Self {
        let (width, height) = (size.width as usize, size.height as usize);
        Self { width, height, planes: colour.map(|value| vec![value; width * height]) }
    }

    /// Lays a colour over a pixel.
    pub fn blend(&mut self, index: usize, colour: PaintColour, fraction: f32) {
        for (plane, value) in self.planes.iter_mut().zip(colour) {
            plane[index] += fraction * (value - plane[index]);
        }
    }

    /// Visits the pixels that `shape` covers, with the fraction covered: `softness` px wide edges, 1 for a sharp one.
    pub fn cover(&self, shape: &impl PaintedShape, softness: f32, mut visit: impl FnMut(usize, f32, f32, f32)) {
        let [left, top, right, bottom] = shape.bounds();
        let within = |at: f32, count: usize| at.clamp(0.0, count as f32) as usize;
        let columns = within(left - softness, self.width)..within(right + softness + 2.0, self.width);
        for row in within(top - softness, self.height)..within(bottom + softness + 2.0, self.height) {
            for column in columns.clone() {
                let (x, y) = (column as f32, row as f32);
                let fraction = (0.5 + shape.inside(x, y) / softness).clamp(0.0, 1.0);
                if fraction > 0.0 {
                    visit(row * self.width + column, x, y, fraction);
                }
            }
        }
    }

    /// Draws a shape, its colour by place.
    pub fn fill(
        &mut self,
        shape: &impl PaintedShape,
        softness: f32,
        opacity: f32,
        colour: impl Fn(f32, f32) -> PaintColour,
    ) {
        let mut covered = Vec::new();
        self.cover(shape, softness, |index, x, y, fraction| covered.push((index, x, y, fraction)));
        for (index, x, y, fraction) in covered {
            self.blend(index, colour(x, y), fraction * opacity);
        }
    }
}

/// A convex polygon: its corners and, of each edge, the inward normal and its offset.
#[derive(Debug, Clone)]
pub struct Polygon {
    edges: Vec<[f32; 3]>,
    bounds: [f32; 4],
}

impl Polygon {
    /// Of corners in order, either way round.
    pub fn new(corners: &[[f32; 2]]) -> Self {
        let count = corners.len();
        let middle = [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f32>() / count as f32);
        let edge = |index: usize| {
            let ([ax, ay], [bx, by]) = (corners[index], corners[(index + 1) % count]);
            let length = (bx - ax).hypot(by - ay).max(1e-6);
            let normal = [(ay - by) / length, (bx - ax) / length];
            let at = |[x, y]: [f32; 2]| normal[0] * (x - ax) + normal[1] * (y - ay);
            let sign = if at(middle) < 0.0 { -1.0 } else { 1.0 };
            [sign * normal[0], sign * normal[1], sign * (-normal[0] * ax - normal[1] * ay)]
        };
        let least = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f32::INFINITY, f32::min);
        let most = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f32::NEG_INFINITY, f32::max);
        Self { edges: (0..count).map(edge).collect(), bounds: [least(0), least(1), most(0), most(1)] }
    }

    /// A rectangle about a point.
    pub fn rectangle([x, y]: [f32; 2], [half_width, half_height]: [f32; 2], turn: f32) -> Self {
        let (sin, cos) = turn.sin_cos();
        let corner = |[u, v]: [f32; 2]| {
            let [u, v] = [u * half_width, v * half_height];
            [x + cos * u - sin * v, y + sin * u + cos * v]
        };
        Self::new(&[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner))
    }

    /// Three to seven corners on an ellipse about a point, at most `widest` as wide as long.
    pub fn random(centre: [f32; 2], reach: f32, widest: f32, random: &mut Random) -> Self {
        let count = random.random_range(3..=7_usize);
        let (narrow, turn) = (random.random_range(0.25..widest), random.random_range(0.0..std::f32::consts::TAU));
        let (sin, cos) = turn.sin_cos();
        let mut angles: Vec<f32> = (0..count).map(|_| random.random_range(0.0..std::f32::consts::TAU)).collect();
        angles.sort_by(f32::total_cmp);
        let corner = |angle: &f32| {
            let [u, v] = [reach * angle.cos(), narrow * reach * angle.sin()];
            [centre[0] + cos * u - sin * v, centre[1] + sin * u + cos * v]
        };
        Self::new(&angles.iter().map(corner).collect::<Vec<_>>())
    }
}

impl PaintedShape for Polygon {
    fn bounds(&self) -> [f32; 4] {
        self.bounds
    }

    fn inside(&self, x: f32, y: f32) -> f32 {
        self.edges.iter().map(|[a, b, c]| a * x + b * y + c).fold(f32::INFINITY, f32::min)
    }
}

/// An ellipse: what a sphere looks like, and much that is none.
#[derive(Debug, Clone, Copy)]
pub struct Ellipse {
    pub centre: [f32; 2],
    /// Semi-axes, px: the one along `axis`, the other.
    pub semi: [f32; 2],
    /// Unit vector.
    pub axis: [f32; 2],
}

impl Ellipse {
    /// A point in the ellipse's frame: fractions of the semi-axes.
    pub fn local(&self, x: f32, y: f32) -> [f32; 2] {
        let [dx, dy] = [x - self.centre[0], y - self.centre[1]];
        let [along, across] = self.semi;
        let [cos, sin] = self.axis;
        [(cos * dx + sin * dy) / along, (cos * dy - sin * dx) / across]
    }

    /// The fraction of a pixel that it covers. Of a small ellipse, whose outline bends within a pixel, by parts of the pixel.
    pub fn coverage(&self, x: f32, y: f32) -> f32 {
        let parts = (STRAIGHT / self.semi[0].min(self.semi[1])).ceil().clamp(1.0, MOST_PARTS) as usize;
        if parts == 1 {
            return self.coverage_of(x, y, 1.0);
        }
        let side = 1.0 / parts as f32;
        let part = |index: usize| {
            let offset = |at: usize| (at as f32 + 0.5) * side - 0.5;
            self.coverage_of(x + offset(index % parts), y + offset(index / parts), side)
        };
        (0..parts * parts).map(part).sum::<f32>() * side * side
    }

    /// The fraction of a square of `side` px that the half plane covers which touches the outline next to it, less what that
    /// has more.
    fn coverage_of(&self, x: f32, y: f32, side: f32) -> f32 {
        let [u, v] = self.local(x, y);
        let [along, across] = self.semi;
        let level = u.hypot(v);
        if level < 1e-6 {
            return 1.0;
        }
        let [cos, sin] = self.axis;
        let (du, dv) = (u / along, v / across);
        let slope = du.hypot(dv);
        let normal = [(cos * du - sin * dv) / slope, (sin * du + cos * dv) / slope].map(f32::abs);
        let distance = (1.0 - level) * level / slope / side - side / (24.0 * across.min(along));
        half_plane(distance, normal[0].max(normal[1]), normal[0].min(normal[1]))
    }
}

/// The fraction of a square that a half plane covers whose edge is `distance` of its sides from its middle; the parts of the edge's normal,
/// the larger first.
fn half_plane(distance: f32, large: f32, small: f32) -> f32 {
    let corner = 0.5 * (large + small) - distance.abs();
    let outside = if corner <= 0.0 {
        0.0
    } else if corner >= small {
        // The edge crosses opposite sides.
        0.5 - distance.abs() / large
    } else {
        0.5 * corner * corner / (large * small)
    };
    if distance < 0.0 { outside } else { 1.0 - outside }
}

impl PaintedShape for Ellipse {
    fn bounds(&self) -> [f32; 4] {
        let [along, across] = self.semi;
        let half = [0, 1].map(|axis| (along * self.axis[axis]).hypot(across * self.axis[1 - axis]));
        let [x, y] = self.centre;
        [x - half[0], y - half[1], x + half[0], y + half[1]]
    }

    /// To first order in the distance from the outline.
    fn inside(&self, x: f32, y: f32) -> f32 {
        let [u, v] = self.local(x, y);
        let [along, across] = self.semi;
        let level = u.hypot(v);
        if level < 1e-6 {
            return along.min(across);
        }
        let slope = (u / along).hypot(v / across) / level;
        (1.0 - level) / slope
    }
}

/// A line with round ends.
#[derive(Debug, Clone, Copy)]
pub struct PaintedLine {
    pub from: [f32; 2],
    pub to: [f32; 2],
    /// Half its width, px.
    pub half: f32,
}

impl PaintedShape for PaintedLine {
    fn bounds(&self) -> [f32; 4] {
        let ([ax, ay], [bx, by], half) = (self.from, self.to, self.half);
        [ax.min(bx) - half, ay.min(by) - half, ax.max(bx) + half, ay.max(by) + half]
    }

    fn inside(&self, x: f32, y: f32) -> f32 {
        let ([ax, ay], [bx, by]) = (self.from, self.to);
        let [dx, dy] = [bx - ax, by - ay];
        let fraction = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy).max(1e-6)).clamp(0.0, 1.0);
        self.half - (x - ax - fraction * dx).hypot(y - ay - fraction * dy)
    }
}
