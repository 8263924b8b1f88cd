//! Flat pieces of the world, such as painted lines, drawn with the exact fraction of each pixel that they cover.

use nalgebra::{Matrix3, Point3, Vector3};

use super::super::random::canvas::{Canvas, PaintColour};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};

/// Least depth of what is drawn, m; nearer parts are cut off.
const NEAREST: f64 = 0.05;
/// How far outside its outline a piece still covers part of a pixel, px.
const REACH: f64 = 1.0;

/// The outline of a piece in its own coordinates, m.
#[derive(Debug, Clone, Copy)]
pub enum Outline {
    /// From the origin to these lengths.
    Rectangle([f64; 2]),
    /// The part of a ring about the origin whose second coordinate is at least `from`.
    Ring { radius: f64, width: f64, from: f64 },
}

/// A flat piece: its origin, the directions of its two coordinates, its outline.
#[derive(Debug, Clone)]
pub struct Piece {
    pub origin: Point3<f64>,
    /// Unit vectors, which need not be at right angles.
    pub axes: [Vector3<f64>; 2],
    pub outline: Outline,
}

/// A place in a piece.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// In the piece's coordinates, m.
    pub at: [f64; 2],
    /// How much of each coordinate a pixel covers, m.
    pub pixel: [f64; 2],
    /// Where it is in the canvas.
    pub index: usize,
}

/// The fraction of a pixel within two parallel edges; distances inside them, px.
fn between(first: f64, second: f64) -> f64 {
    let side = |distance: f64| (0.5 + distance).clamp(0.0, 1.0);
    (side(first) + side(second) - 1.0).max(0.0)
}

impl Piece {
    /// The rectangle with two sides from a corner, m.
    pub fn rectangle(origin: Point3<f64>, sides: [Vector3<f64>; 2]) -> Self {
        let lengths = sides.map(|side| side.norm());
        Self { origin, axes: sides.map(|side| side.normalize()), outline: Outline::Rectangle(lengths) }
    }

    /// A room's floor, by half its width and length, m.
    pub fn floor([wide, long]: [f64; 2]) -> Self {
        let sides = [Vector3::x() * (2.0 * wide), Vector3::y() * (2.0 * long)];
        Self::rectangle(Point3::new(-wide, -long, 0.0), sides)
    }

    /// Turned about the world's vertical axis and moved along its ground, m.
    #[must_use]
    pub fn moved(&self, turn: f64, by: [f64; 2]) -> Self {
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
        let origin = turn * self.origin + Vector3::new(by[0], by[1], 0.0);
        Self { origin, axes: self.axes.map(|axis| turn * axis), outline: self.outline }
    }

    /// A corner's or any place's position, m.
    fn point(&self, [u, v]: [f64; 2]) -> Point3<f64> {
        self.origin + self.axes[0] * u + self.axes[1] * v
    }

    /// Corners of a rectangle that contains the outline, m.
    pub fn corners(&self) -> [Point3<f64>; 4] {
        let [low, high] = match self.outline {
            Outline::Rectangle(lengths) => [[0.0; 2], lengths],
            Outline::Ring { radius, width, from } => {
                let reach = radius + width;
                [[-reach, from.max(-reach)], [reach; 2]]
            }
        };
        [low, [high[0], low[1]], high, [low[0], high[1]]].map(|at| self.point(at))
    }

    /// The corners of the part before a camera without a lens, px.
    fn seen(&self, camera: &Camera) -> Vec<[f64; 2]> {
        let corners = self.corners().map(|corner| camera.camera_from_world(&corner));
        let mut before = Vec::new();
        for (index, here) in corners.iter().enumerate() {
            let next = &corners[(index + 1) % corners.len()];
            if here.z >= NEAREST {
                before.push(*here);
            }
            if (here.z < NEAREST) != (next.z < NEAREST) {
                before.push(here + (next - here) * ((NEAREST - here.z) / (next.z - here.z)));
            }
        }
        let image = |at: Point3<f64>| camera.intrinsic() * at.coords / at.z;
        before.into_iter().map(image).map(|at| [at.x, at.y]).collect()
    }

    /// The fraction of a pixel that is inside, at a place with its gradients, m and m/px.
    fn coverage(&self, at: [f64; 2], gradients: [[f64; 2]; 2]) -> f64 {
        let slope = |[x, y]: [f64; 2]| x.hypot(y).max(f64::MIN_POSITIVE);
        match self.outline {
            Outline::Rectangle(lengths) => {
                let side =
                    |axis: usize| [at[axis], lengths[axis] - at[axis]].map(|inside| inside / slope(gradients[axis]));
                let [[left, right], [low, high]] = [side(0), side(1)];
                between(left, right) * between(low, high)
            }
            Outline::Ring { radius, width, from } => {
                let out = at[0].hypot(at[1]).max(f64::MIN_POSITIVE);
                let gradient = [0, 1].map(|axis| (at[0] * gradients[0][axis] + at[1] * gradients[1][axis]) / out);
                let inside = [out - radius + width / 2.0, radius + width / 2.0 - out].map(|it| it / slope(gradient));
                between(inside[0], inside[1]) * between((at[1] - from) / slope(gradients[1]), 1.0)
            }
        }
    }

    /// Lays the piece over a picture of a camera without a lens. `colour` gives its colour and opacity at each place.
    ///
    /// # Errors
    /// [`Error::Data`] for a piece that is seen exactly from its edge.
    pub fn paint(
        &self,
        canvas: &mut Canvas,
        camera: &Camera,
        colour: impl Fn(&Spot) -> (PaintColour, f32),
    ) -> Result<()> {
        let [first, second] = self.axes.map(|axis| camera.rotation() * axis);
        let origin = camera.camera_from_world(&self.origin).coords;
        let image_from_piece = camera.intrinsic() * Matrix3::from_columns(&[first, second, origin]);
        let piece_from_image = image_from_piece.try_inverse().ok_or_else(|| Error::Data {
            what: "court".into(),
            reason: "a flat piece is seen exactly from its edge; choose another seed".into(),
        })?;
        let [u, v, w] = [0, 1, 2].map(|row| piece_from_image.row(row).transpose());
        let corners = self.seen(camera);
        for row in 0..canvas.height {
            let Some([left, right]) = span(&corners, row as f64) else { continue };
            let within = |at: f64| at.clamp(0.0, canvas.width as f64) as usize;
            for column in within(left - REACH)..within(right + REACH + 1.0) {
                let pixel = Vector3::new(column as f64, row as f64, 1.0);
                let nearness = w.dot(&pixel);
                if nearness <= 0.0 {
                    continue;
                }
                let at = [u.dot(&pixel) / nearness, v.dot(&pixel) / nearness];
                let gradient = |of: &Vector3<f64>, at: f64| [0, 1].map(|axis| (of[axis] - at * w[axis]) / nearness);
                let gradients = [gradient(&u, at[0]), gradient(&v, at[1])];
                let cover = self.coverage(at, gradients);
                if cover > 0.0 {
                    let index = row * canvas.width + column;
                    let (colour, opacity) = colour(&Spot { at, pixel: gradients.map(|[x, y]| x.hypot(y)), index });
                    canvas.blend(index, colour, cover as f32 * opacity);
                }
            }
        }
        Ok(())
    }
}

/// From where to where a convex polygon reaches within [`REACH`] of a row, px.
fn span(corners: &[[f64; 2]], row: f64) -> Option<[f64; 2]> {
    let band = [row - REACH, row + REACH];
    let mut found: Option<[f64; 2]> = None;
    for (index, &[ax, ay]) in corners.iter().enumerate() {
        let [bx, by] = corners[(index + 1) % corners.len()];
        if ay.max(by) < band[0] || ay.min(by) > band[1] {
            continue;
        }
        let at = |y: f64| if ay == by { ax } else { ax + (bx - ax) * ((y - ay) / (by - ay)).clamp(0.0, 1.0) };
        let ends = if ay == by { [ax, bx] } else { band.map(at) };
        for x in ends {
            found = Some(found.map_or([x; 2], |[low, high]| [low.min(x), high.max(x)]));
        }
    }
    found
}
