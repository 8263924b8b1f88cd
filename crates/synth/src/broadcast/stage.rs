//! What is seen besides the ball: ground, lines, net, people, a crowd.

use nalgebra::{Point2, Point3};
use rand::RngExt;

use super::super::random::canvas::{Canvas, Ellipse, PaintColour, PaintedLine, Polygon, mix};
use super::super::random::noise::smooth;
use super::Kind;
use gravisight_geometry::camera::{Camera, Court};
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;
use gravisight_physics::Scene;

/// Half a line's least width, px.
const LEAST_HALF: f64 = 0.4;
/// Opacity of a net.
const NET: f32 = 0.35;
/// Least distance of a ground's colour from the ball's.
const UNLIKE: f32 = 0.4;
/// A person's height, m.
const TALL: f64 = 1.8;

/// A person who walks about.
pub(super) struct Person {
    /// Where they are in the middle of their way, m.
    home: [f64; 2],
    /// How far they go, m, how often a second, and from where on.
    reach: [f64; 2],
    rate: f64,
    phase: f64,
    /// Shirt, trousers, skin.
    colours: [PaintColour; 3],
}

fn colour(random: &mut Random) -> PaintColour {
    std::array::from_fn(|_| random.random_range(0.08..0.9))
}

/// One before which a ball of the colour `paint` is seen.
fn unlike(paint: PaintColour, random: &mut Random) -> PaintColour {
    loop {
        let found = colour(random);
        if (0..3).map(|channel| (found[channel] - paint[channel]).powi(2)).sum::<f32>() > UNLIKE * UNLIKE {
            return found;
        }
    }
}

impl Person {
    pub fn draw(home: [f64; 2], random: &mut Random) -> Self {
        Self {
            home,
            reach: [random.random_range(0.2..1.6), random.random_range(0.1..0.8)],
            rate: random.random_range(0.15..0.5),
            phase: random.random_range(0.0..std::f64::consts::TAU),
            colours: [
                colour(random),
                colour(random),
                mix([0.85, 0.65, 0.5], [0.35, 0.22, 0.15], random.random_range(0.0..1.0)),
            ],
        }
    }

    /// Where the feet are, m, at a time, s.
    pub fn feet(&self, time: f64) -> Point3<f64> {
        let turn = self.phase + std::f64::consts::TAU * self.rate * time;
        Point3::new(self.home[0] + self.reach[0] * turn.sin(), self.home[1] + self.reach[1] * (0.7 * turn).cos(), 0.0)
    }

    /// Lays them over a picture; the place and radius of the parts that can hide a ball, px.
    pub fn paint(&self, canvas: &mut Canvas, camera: &Camera, time: f64) -> Vec<[f32; 3]> {
        let feet = self.feet(time);
        let at = |height: f64, aside: f64| -> Option<[f32; 2]> {
            let point = camera.camera_from_world(&Point3::new(feet.x + aside, feet.y, height));
            if point.z < 0.5 {
                return None;
            }
            camera.image_from_camera(&point).ok().map(|at| [at.x as f32, at.y as f32])
        };
        let stride = 0.3 * (8.0 * self.rate * time * std::f64::consts::TAU + self.phase).sin();
        let arm = 0.45 * (5.0 * self.rate * time * std::f64::consts::TAU).cos();
        let parts = [
            (at(0.9, 0.0), at(0.05, stride), 0.075, 1),
            (at(0.9, 0.0), at(0.05, -stride), 0.075, 1),
            (at(0.95, 0.0), at(1.45, 0.0), 0.19, 0),
            (at(1.4, 0.0), at(1.05, arm), 0.055, 2),
            (at(1.4, 0.0), at(1.1, -0.3), 0.055, 2),
            (at(TALL - 0.2, 0.0), at(TALL - 0.1, 0.0), 0.1, 2),
        ];
        let depth = camera.camera_from_world(&feet).z;
        let focal = camera.intrinsic()[(0, 0)];
        let mut hides = Vec::new();
        for (from, to, half, of) in parts {
            let (Some(from), Some(to)) = (from, to) else { continue };
            let half = (half * focal / depth) as f32;
            canvas.fill(&PaintedLine { from, to, half }, 1.5, 1.0, |_, _| self.colours[of]);
            hides.extend([
                [from[0], from[1], half],
                [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0, half],
                [to[0], to[1], half],
            ]);
        }
        hides
    }
}

/// The picture without anything that moves.
pub(super) fn empty(kind: Kind, camera: &Camera, scene: &Scene, paint: PaintColour, random: &mut Random) -> Canvas {
    let size = camera.size();
    let mut canvas = Canvas::new(size, [0.5; 3]);
    let [inner, outer, far] = std::array::from_fn(|_| unlike(paint, random));
    let texture = smooth(&canvas, 40.0, 5, 0.7, random);
    let crowd = smooth(&canvas, 9.0, 2, 0.9, random);
    let [half_width, half_length] = kind.court();
    let back = kind.wall();
    let width = size.width as usize;
    for row in 0..size.height as usize {
        for column in 0..width {
            let index = row * width + column;
            let ground = on_plane(camera, column, row, 0.0).filter(|point| point.y < back);
            let shade = 0.85 + 0.3 * texture[index];
            let of = match ground {
                Some(point) if point.x.abs() < half_width && point.y.abs() < half_length => inner,
                Some(_) => outer,
                None => mix(far, [0.05, 0.05, 0.06], 0.6 * crowd[index]),
            };
            (0..3).for_each(|channel| canvas.planes[channel][index] = (of[channel] * shade).clamp(0.0, 1.0));
        }
    }
    tops(&mut canvas, camera, scene, inner);
    lines(&mut canvas, camera, kind);
    net(&mut canvas, camera, scene, kind);
    canvas
}

/// The tops of the scene's boxes: tables.
pub(crate) fn tops(canvas: &mut Canvas, camera: &Camera, scene: &Scene, inner: PaintColour) {
    for cuboid in &scene.boxes {
        let [x, y, z] = cuboid.half_size;
        let top = cuboid.position[2] + z;
        let corners = [[-x, -y], [x, -y], [x, y], [-x, y]].map(|[dx, dy]| {
            camera.image_from_world(&Point3::new(cuboid.position[0] + dx, cuboid.position[1] + dy, top)).ok()
        });
        let corners: Vec<[f32; 2]> = corners.into_iter().flatten().map(|at| [at.x as f32, at.y as f32]).collect();
        if corners.len() == 4 {
            let surface = mix(inner, [0.1, 0.2, 0.4], 0.7);
            canvas.fill(&Polygon::new(&corners), 1.5, 1.0, |_, _| surface);
        }
    }
}

/// Where a point is seen, px, and how far before the camera, m; none where it is not before it.
fn seen(camera: &Camera, point: [f64; 3]) -> Option<(Point2<f64>, f64)> {
    let seen = camera.camera_from_world(&point.into());
    (seen.z > 0.3).then(|| camera.image_from_camera(&seen).ok().map(|at| (at, seen.z))).flatten()
}

/// The court's lines.
pub(crate) fn lines(canvas: &mut Canvas, camera: &Camera, kind: Kind) {
    let image = |point| seen(camera, point);
    for line in Court::named(kind.name()).map_or(&[][..], |court| &court.lines) {
        // In short pieces: a line's width is another at either end, and its end may be behind the camera.
        for part in 0..20 {
            let edges = [part, part + 1].map(|number| {
                let edges = line.edges(f64::from(number) / 20.0)?;
                Some([image(edges[0].into())?.0, image(edges[1].into())?.0])
            });
            let [Some([a, b]), Some([c, d])] = edges else { continue };
            let [from, to] = [nalgebra::center(&a, &b), nalgebra::center(&c, &d)];
            let half = (0.5 * (to - from).normalize().perp(&(b - a)).abs()).max(LEAST_HALF) as f32;
            let line = PaintedLine { from: [from.x as f32, from.y as f32], to: [to.x as f32, to.y as f32], half };
            canvas.fill(&line, 1.2, 0.9, |_, _| [0.93, 0.93, 0.9]);
        }
    }
}

/// The net.
pub(crate) fn net(canvas: &mut Canvas, camera: &Camera, scene: &Scene, kind: Kind) {
    let image = |point| seen(camera, point);
    let surface = scene.boxes.iter().map(|cuboid| cuboid.position[2] + cuboid.half_size[2]).fold(0.0, f64::max);
    let surface = if kind == Kind::TableTennis { surface } else { 0.0 };
    for pair in scene.net.windows(2) {
        let foot = |top: [f64; 3]| [top[0], top[1], if kind == Kind::Volleyball { top[2] - 1.0 } else { surface }];
        let corners = [pair[0], pair[1], foot(pair[1]), foot(pair[0])].map(image);
        let corners: Vec<[f32; 2]> = corners.into_iter().flatten().map(|(at, _)| [at.x as f32, at.y as f32]).collect();
        if corners.len() == 4 {
            canvas.fill(&Polygon::new(&corners), 1.5, NET, |_, _| [0.1; 3]);
            canvas.fill(&PaintedLine { from: corners[0], to: corners[1], half: 1.2 }, 1.5, 0.9, |_, _| [0.95; 3]);
        }
    }
}

/// The point of the level at `height` that a pixel shows, m.
fn on_plane(camera: &Camera, column: usize, row: usize, height: f64) -> Option<Point3<f64>> {
    let near = camera.world_from_image(&Point2::new(column as f64, row as f64), 1.0).ok()?;
    let eye = camera.world_from_camera(&Point3::origin());
    let way = near - eye;
    let fraction = (height - eye.z) / way.z;
    (fraction > 0.0 && fraction < 1e4).then(|| eye + way * fraction)
}

/// The picture of a ball of a radius, m, at a place: an ellipse, longer away from the camera's axis (the cameras have no lens).
pub(crate) fn outline(camera: &Camera, radius: f64, at: &Point3<f64>) -> Ellipse {
    let centre = camera.camera_from_world(at);
    let intrinsic = camera.intrinsic();
    let beyond = centre.z.powi(2) - radius.powi(2);
    let across = intrinsic[(0, 0)] * radius / beyond.sqrt();
    let along = across * ((centre.coords.norm_squared() - radius.powi(2)) / beyond).sqrt();
    let middle =
        [0, 1].map(|axis| (intrinsic[(axis, axis)] * centre[axis] * centre.z / beyond + intrinsic[(axis, 2)]) as f32);
    let out = centre.y.atan2(centre.x);
    Ellipse {
        centre: middle,
        semi: [along, across].map(|semi| semi as f32),
        axis: [out.cos() as f32, out.sin() as f32],
    }
}

/// Lays the ball over a picture as the shutter saw it: its outlines while that was open.
pub(crate) fn ball(canvas: &mut Canvas, outlines: &[Ellipse], paint: PaintColour, light: [f32; 2]) {
    let fraction = 1.0 / outlines.len() as f32;
    let size = Size::new(canvas.width as u32, canvas.height as u32);
    let mut covered: std::collections::BTreeMap<usize, (f32, PaintColour)> = std::collections::BTreeMap::new();
    for disc in outlines {
        let ([x, y], radius, [cos, sin]) = (disc.centre, disc.semi[0], disc.axis);
        let light = [cos * light[0] + sin * light[1], cos * light[1] - sin * light[0]];
        let within = |at: f32, side: u32| at.clamp(0.0, side as f32) as usize;
        for row in within(y - radius - 1.0, size.height)..within(y + radius + 2.0, size.height) {
            for column in within(x - radius - 1.0, size.width)..within(x + radius + 2.0, size.width) {
                let cover = fraction * disc.coverage(column as f32, row as f32);
                if cover > 0.0 {
                    let [u, v] = disc.local(column as f32, row as f32);
                    let lit = 0.72 + 0.28 * (u * light[0] + v * light[1]).clamp(-1.0, 1.0);
                    let (sum, colour) = covered.entry(row * canvas.width + column).or_default();
                    *sum += cover;
                    (0..3).for_each(|channel| colour[channel] += cover * paint[channel] * lit);
                }
            }
        }
    }
    for (index, (cover, colour)) in covered {
        canvas.blend(index, colour.map(|value| value / cover), cover.min(1.0));
    }
}
