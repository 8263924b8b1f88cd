//! The ball: a sphere in perspective, its pattern, its light, its motion while the shutter is open.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use rand::RngExt;

use super::background::colour;
use super::canvas::{Canvas, Ellipse, PaintColour, PaintedShape, mix};
use gravisight_geometry::random::Random;

/// Focal lengths of the cameras, px.
const FOCAL: [f64; 2] = [150.0, 2500.0];
/// Largest tangent of the angle between the ball's ray and the optical axis.
const OFF_AXIS: f64 = 0.6;
/// Longest way during the exposure, radii and px: a served tennis ball moves by 1 m in a fiftieth of a second, 30 radii; most by less
/// than three.
pub const STREAK: f32 = 12.0;
pub const STREAK_PX: f32 = 64.0;
/// Positions of a moving ball that are drawn at most.
const POSITIONS: f32 = 64.0;
/// What plain balls of common sports look like: tennis, orange, white, basketball, cricket, brown, teal, pink, blue.
const SPORTS: [PaintColour; 9] = [
    [0.80, 0.90, 0.25],
    [0.95, 0.55, 0.15],
    [0.95, 0.95, 0.93],
    [0.80, 0.42, 0.20],
    [0.60, 0.10, 0.12],
    [0.45, 0.28, 0.16],
    [0.10, 0.55, 0.55],
    [0.92, 0.45, 0.60],
    [0.15, 0.30, 0.75],
];

/// A ball as it lies in the picture.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// Its outline.
    pub outline: Ellipse,
    /// Way during the exposure, px.
    pub streak: [f32; 2],
    /// The camera's focal length, px.
    pub focal: f64,
    /// Its principal point, px.
    pub principal_point: [f64; 2],
}

/// A random ball of `radius` about `centre`, px: turned into an ellipse as a camera sees it off its axis, perhaps in motion.
pub fn place(centre: [f32; 2], radius: f32, random: &mut Random) -> Placed {
    let focal = random.random_range(FOCAL[0].ln()..FOCAL[1].ln()).exp();
    // Wide fields belong to short lenses: a picture is seldom larger than its focal length.
    let tangent = OFF_AXIS * random.random_range(0.0..1.0_f64).sqrt() * (700.0 / focal).min(1.0);
    let direction = random.random_range(0.0..TAU);
    // In units of the sphere's radius: b = f·R/√(z² − R²), a = f·R·√(|P|² − R²)/(z² − R²).
    let beyond = (focal / f64::from(radius)).powi(2);
    let longer = ((1.0 + beyond) * (1.0 + tangent * tangent) - 1.0) / beyond;
    let outline =
        Ellipse { centre, semi: [radius * longer.sqrt() as f32, radius], axis: [direction.cos(), direction.sin()] };
    let streak = if random.random_bool(0.4) {
        let length = (radius * STREAK * random.random_range(0.0..1.0_f32).powi(3)).min(STREAK_PX);
        let direction = random.random_range(0.0..TAU);
        [length * direction.cos(), length * direction.sin()]
    } else {
        [0.0; 2]
    };
    // The outline's centre is farther out than the centre's image.
    let out = focal * tangent * (1.0 + beyond.recip());
    let principal_point = [
        f64::from(centre[0]) - out * f64::from(direction.cos()),
        f64::from(centre[1]) - out * f64::from(direction.sin()),
    ];
    Placed { outline, streak, focal, principal_point }
}

/// How a ball's surface is coloured; points are on the unit sphere, in its own frame.
#[derive(Debug, Clone)]
enum Pattern {
    Plain,
    /// Two halves, or a cap.
    Cap {
        level: f32,
    },
    Stripes {
        count: f32,
    },
    Checkers {
        count: f32,
    },
    /// A seam as tennis balls, baseballs and basketballs have it.
    Seam {
        bend: f32,
        half: f32,
    },
    Spots {
        centres: Vec<[f32; 3]>,
        cosine: f32,
    },
    Wedges {
        count: f32,
    },
}

/// A ball's look.
#[derive(Debug, Clone)]
pub struct Look {
    colours: [PaintColour; 2],
    pattern: Pattern,
    /// Rows: the ball's own axes.
    axes: [[f32; 3]; 3],
    light: [f32; 3],
    ambient: f32,
    /// How much more of the surrounding light comes from above than from below.
    sky: f32,
    gain: f32,
    shine: f32,
    hardness: f32,
    /// Width of the pattern's edges on the unit sphere.
    edge: f32,
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A random direction.
fn direction(random: &mut Random) -> [f32; 3] {
    let z = random.random_range(-1.0..1.0_f32);
    let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
    let flat = (1.0 - z * z).sqrt();
    [flat * cos, flat * sin, z]
}

fn normalised(a: [f32; 3]) -> [f32; 3] {
    let length = dot(a, a).sqrt().max(1e-6);
    a.map(|value| value / length)
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Look {
    /// Of a ball of `radius` px.
    pub fn random(radius: f32, random: &mut Random) -> Self {
        let base = if random.random_bool(0.45) {
            let sport = SPORTS[random.random_range(0..SPORTS.len())];
            mix(sport, colour(random), random.random_range(0.0..0.25))
        } else {
            colour(random)
        };
        let other = match random.random_range(0..3) {
            0 => [random.random_range(0.0..0.15); 3],
            1 => [random.random_range(0.85..1.0); 3],
            _ => colour(random),
        };
        let pattern = match random.random_range(0..20) {
            0..=9 => Pattern::Plain,
            10 => Pattern::Cap { level: random.random_range(-0.7..0.7) },
            11 => Pattern::Stripes { count: random.random_range(2.0..6.0) },
            12 => Pattern::Checkers { count: random.random_range(2.0_f32..5.0).round() },
            13..=15 => Pattern::Seam { bend: random.random_range(0.3..0.9), half: random.random_range(0.03..0.12) },
            16 | 17 => {
                let count = random.random_range(3..14);
                let centres = (0..count).map(|_| direction(random)).collect();
                Pattern::Spots { centres, cosine: random.random_range(0.15_f32..0.5).cos() }
            }
            18 => Pattern::Wedges { count: random.random_range(2.0_f32..8.0).round() },
            _ => Pattern::Seam { bend: 0.0, half: random.random_range(0.05..0.3) },
        };
        let z = direction(random);
        let x = normalised(cross(z, direction(random)));
        // Mostly from above (up is −y in a picture), and seldom from behind.
        let mut light = direction(random);
        if random.random_bool(0.75) {
            light[1] = -light[1].abs() - 0.3;
        }
        if random.random_bool(0.7) {
            light[2] = light[2].abs();
        }
        Self {
            colours: [base, mix(base, other, random.random_range(0.3..1.0))],
            pattern,
            axes: [x, cross(z, x), z],
            light: normalised(light),
            ambient: random.random_range(0.04..0.8),
            sky: random.random_range(0.0..0.8),
            gain: random.random_range(0.7..1.3),
            shine: if random.random_bool(0.5) { random.random_range(0.0..0.7) } else { 0.0 },
            hardness: random.random_range(1.5..5.0_f32).exp(),
            edge: (1.0 / radius).min(1.0),
        }
    }

    /// The same in the dark, lit from near the camera.
    pub fn lit_from_camera(self, random: &mut Random) -> Self {
        let aside: [f32; 2] = std::array::from_fn(|_| random.random_range(-0.25..0.25));
        let light = normalised([aside[0], aside[1], 1.0]);
        Self { light, ambient: random.random_range(0.0..0.35), sky: 0.0, ..self }
    }

    /// The colour of the point whose outward normal is `normal` (camera's axes, z towards the camera).
    fn shade(&self, normal: [f32; 3]) -> PaintColour {
        let albedo = match &self.pattern {
            Pattern::Plain => self.colours[0],
            _ => mix(self.colours[0], self.colours[1], self.marked(self.axes.map(|axis| dot(axis, normal)))),
        };
        let surround = self.ambient * (1.0 - self.sky * (0.5 + 0.5 * normal[1]));
        let facing = dot(normal, self.light);
        let direct = (1.0 - self.ambient) * facing.max(0.0);
        let mut shine = 0.0;
        if self.shine > 0.0 {
            // Blinn's half vector between light and eye
            let half = normalised([self.light[0], self.light[1], self.light[2] + 1.0]);
            shine = self.shine * dot(normal, half).max(0.0).powf(self.hardness);
        }
        albedo.map(|value| self.gain * value * (surround + direct) + shine)
    }

    /// How much of the second colour a point of the ball has.
    fn marked(&self, [x, y, z]: [f32; 3]) -> f32 {
        let soft = |inside: f32| (0.5 + inside / self.edge).clamp(0.0, 1.0);
        match &self.pattern {
            Pattern::Plain => 0.0,
            Pattern::Cap { level } => soft(z - level),
            Pattern::Stripes { count } => soft((z * count * FRAC_PI_2).sin() / count),
            Pattern::Checkers { count } => {
                let around = (y.atan2(x) * count).sin() / count * (1.0 - z * z).sqrt();
                let along = (z.asin() * count).sin() / count;
                0.5 + 2.0 * (soft(around) - 0.5) * (soft(along) - 0.5)
            }
            Pattern::Seam { bend, half } => soft(half - (z - bend * (x * x - y * y)).abs()),
            Pattern::Spots { centres, cosine } => {
                let nearest = centres.iter().map(|&centre| dot(centre, [x, y, z])).fold(-1.0, f32::max);
                soft(nearest - cosine)
            }
            Pattern::Wedges { count } => {
                soft((y.atan2(x) * count / 2.0).sin() * (1.0 - z * z).sqrt() / count * PI / 2.0)
            }
        }
    }
}

/// A ball's fraction of each pixel of a part of a picture, and its colours times that.
pub struct Layer {
    pub left: i32,
    pub top: i32,
    pub width: usize,
    pub height: usize,
    /// Of each pixel: red, green, blue, fraction.
    pub values: Vec<[f32; 4]>,
}

impl Layer {
    /// The ball at rest.
    pub fn still(placed: &Placed, look: &Look) -> Self {
        let [cos, sin] = placed.outline.axis;
        Self::painted(&placed.outline, |[u, v]| {
            let square = (u * u + v * v).min(0.999);
            let shrink = (square / (u * u + v * v).max(1e-9)).sqrt().min(1.0);
            look.shade([shrink * (cos * u - sin * v), shrink * (sin * u + cos * v), (1.0 - square).sqrt()])
        })
    }

    /// An ellipse, the colour of each of its points by where it lies along its axes, in units of them.
    pub fn painted(outline: &Ellipse, colour: impl Fn([f32; 2]) -> PaintColour) -> Self {
        let [left, top, right, bottom] = outline.bounds();
        let (left, top) = ((left - 1.5).floor() as i32, (top - 1.5).floor() as i32);
        let (width, height) = ((right + 2.5).ceil() as i32 - left, (bottom + 2.5).ceil() as i32 - top);
        let (width, height) = (width as usize, height as usize);
        let mut values = vec![[0.0; 4]; width * height];
        for (index, value) in values.iter_mut().enumerate() {
            let (x, y) = ((left + (index % width) as i32) as f32, (top + (index / width) as i32) as f32);
            let fraction = outline.coverage(x, y);
            if fraction > 0.0 {
                let [r, g, b] = colour(outline.local(x, y));
                *value = [fraction * r, fraction * g, fraction * b, fraction];
            }
        }
        Self { left, top, width, height, values }
    }

    /// The same, moving evenly by `way` px about its place while the shutter is open.
    pub fn moved(self, way: [f32; 2]) -> Self {
        let length = way[0].hypot(way[1]);
        if length < 0.3 {
            return self;
        }
        let reach = [way[0].abs(), way[1].abs()].map(|side| (side / 2.0).ceil() as usize + 1);
        let (width, height) = (self.width + 2 * reach[0], self.height + 2 * reach[1]);
        let mut values = vec![[0.0_f32; 4]; width * height];
        let count = (1.5 * length).ceil().min(POSITIONS) as usize + 1;
        for position in 0..count {
            let fraction = (position as f32 + 0.5) / count as f32 - 0.5;
            let shift = [0, 1].map(|axis| fraction * way[axis] + reach[axis] as f32);
            let whole = shift.map(|shift| shift.floor() as usize);
            let [u, v] = [0, 1].map(|axis| shift[axis] - whole[axis] as f32);
            for (row, line) in self.values.chunks_exact(self.width).enumerate() {
                for (down, across_rows) in [(0, 1.0 - v), (1, v)] {
                    let start = (row + whole[1] + down) * width + whole[0];
                    let out = &mut values[start..start + self.width + 1];
                    let (near, far) = (across_rows * (1.0 - u) / count as f32, across_rows * u / count as f32);
                    for (column, value) in line.iter().enumerate() {
                        for channel in 0..4 {
                            out[column][channel] += near * value[channel];
                            out[column + 1][channel] += far * value[channel];
                        }
                    }
                }
            }
        }
        Self { left: self.left - reach[0] as i32, top: self.top - reach[1] as i32, width, height, values }
    }

    /// The same, each value with its neighbours, which weigh `weight` each along a row and then along a column.
    pub fn softened(mut self, weight: f32) -> Self {
        for along in [1, self.width] {
            let before = self.values.clone();
            for (index, value) in self.values.iter_mut().enumerate().skip(along) {
                let Some(after) = before.get(index + along) else { break };
                for ((value, own), sides) in
                    value.iter_mut().zip(before[index]).zip(before[index - along].iter().zip(after))
                {
                    *value = (1.0 - 2.0 * weight) * own + weight * (sides.0 + sides.1);
                }
            }
        }
        self
    }

    /// Visits the pixels of `canvas` that the ball has a fraction of.
    pub fn over(&self, canvas: &Canvas, mut visit: impl FnMut(usize, usize, usize, [f32; 4])) {
        for (index, &value) in self.values.iter().enumerate().filter(|(_, value)| value[3] > 0.0) {
            let (x, y) = (self.left + (index % self.width) as i32, self.top + (index / self.width) as i32);
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { continue };
            if x < canvas.width && y < canvas.height {
                visit(y * canvas.width + x, x, y, value);
            }
        }
    }

    /// Lays it over `canvas`.
    pub fn lay(&self, canvas: &mut Canvas) {
        let planes = &mut canvas.planes;
        let frame = Canvas { width: canvas.width, height: canvas.height, planes: [vec![], vec![], vec![]] };
        self.over(&frame, |index, _, _, value| {
            for (plane, colour) in planes.iter_mut().zip(value) {
                plane[index] = plane[index] * (1.0 - value[3]) + colour;
            }
        });
    }

    /// Its mean difference from `canvas` behind it, fractions of full scale.
    pub fn contrast(&self, canvas: &Canvas) -> f32 {
        let (mut sum, mut fractions) = (0.0, 0.0);
        self.over(canvas, |index, _, _, value| {
            fractions += 3.0 * value[3];
            sum += (0..3).map(|at| (value[at] - value[3] * canvas.planes[at][index]).abs()).sum::<f32>();
        });
        if fractions > 0.0 { sum / fractions } else { 0.0 }
    }

    /// Its fraction of all pixels, px².
    pub fn area(&self) -> f32 {
        self.values.iter().map(|value| value[3]).sum()
    }
}
