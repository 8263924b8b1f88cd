//! What stands on a court: its net and posts, its table, its boards, its glass, and people.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::footage::easel::Easel;
use super::super::footage::person::{Body, Held, Look};
use super::super::random::canvas::PaintColour;
use super::piece::Piece;
use gravisight_geometry::error::Result;
use gravisight_geometry::random::Random;
use gravisight_physics::Scene;

/// White of a net's tape, black of its cord, colours as fractions of full scale.
const TAPE: PaintColour = [0.93, 0.93, 0.91];
const CORD: PaintColour = [0.08, 0.08, 0.09];
/// Opacity of a net: a fine one far away to a thick one.
const NET_OPACITY: [f32; 2] = [0.12, 0.45];
/// Radius of posts, m: of a net, a board's mast and a frame of glass walls.
const POST: f64 = 0.045;
const MAST: f64 = 0.1;
const FRAME: f64 = 0.03;
/// A table's edge and legs, m: height of its sides (ITTF: playing surface at 0.76 m), places of the legs as fractions of its half sizes.
const TABLE_SIDE: f64 = 0.035;
const LEGS: [f64; 2] = [0.75, 0.8];
const LEG_RADIUS: f64 = 0.03;
/// Opacity of a basketball board, from glass to wood.
const BOARD_OPACITY: [f32; 2] = [0.35, 1.0];
/// A basketball ring: radius and thickness, m; height; where its centre, the board and the mast are (FIBA rules).
const RING_RADIUS: f64 = 0.225;
const RING_HALF: f64 = 0.009;
const RING_HEIGHT: f64 = 3.05;
const RING_AT: f64 = 12.425;
const BOARD_AT: f64 = 12.8;
const MAST_AT: f64 = 15.4;
const RING_PARTS: u32 = 16;
/// The glass walls of padel: height, distance of the posts, m (FIP rules).
const GLASS: f64 = 3.0;
const GLASS_POSTS: f64 = 2.0;
/// Least distance of people from the camera, m: nearer ones hide everything.
const NEAREST: f64 = 2.5;
/// 1-σ of where people stand, as a fraction of half the court's size.
const SPREAD: f64 = 0.75;
/// Radius of the shadow that somebody casts, m, and its opacity.
const SHADOW_REACH: f64 = 0.45;
const SHADOW_OPACITY: [f32; 2] = [0.0, 0.4];

/// A net's measures, m: how high the mesh is, how wide the tape at its top.
struct NetSize {
    mesh: f64,
    tape: f64,
}

/// What stands on a court.
#[derive(Debug, Clone)]
pub struct Furniture {
    court: &'static str,
    /// The upper edge of its net, m; empty without one.
    net: Vec<[f64; 3]>,
    net_opacity: f32,
    board_opacity: f32,
    /// Colour of posts and of a table.
    metal: PaintColour,
    table: PaintColour,
}

/// Somebody on or beside a court.
#[derive(Debug, Clone)]
pub struct Someone {
    body: Body,
    look: Look,
    shadow: f32,
}

/// By the sports' rules: ITF, ITTF, FIVB, BWF, USA Pickleball, FIP.
fn net_size(court: &str) -> NetSize {
    match court {
        "table-tennis" => NetSize { mesh: 0.1525, tape: 0.012 },
        "volleyball" => NetSize { mesh: 1.0, tape: 0.07 },
        "badminton" => NetSize { mesh: 0.76, tape: 0.0375 },
        _ => NetSize { mesh: 1.1, tape: 0.05 },
    }
}

impl Furniture {
    /// Of a court; its net is away now and then.
    ///
    /// # Errors
    /// As [`Scene::named`].
    pub fn draw(court: &'static str, table: PaintColour, random: &mut Random) -> Result<Self> {
        let scene = if court == "basketball-fiba" { "basketball" } else { court };
        // Volleyball and badminton nets are taken down after play; a court is also played on without one.
        let is_away = matches!(court, "volleyball" | "badminton") && random.random_bool(0.2);
        let net = if is_away { vec![] } else { Scene::named(scene)?.net };
        Ok(Self {
            court,
            net,
            net_opacity: random.random_range(NET_OPACITY[0]..NET_OPACITY[1]),
            board_opacity: random.random_range(BOARD_OPACITY[0]..BOARD_OPACITY[1]),
            metal: [random.random_range(0.05..0.8); 3],
            table,
        })
    }

    /// Whether it is a table, which hides who is behind it.
    pub fn is_table(&self) -> bool {
        self.court == "table-tennis"
    }

    /// What is painted before all people.
    ///
    /// # Errors
    /// As [`Piece::paint`].
    pub fn paint_behind(&self, easel: &mut Easel) -> Result<()> {
        match self.court {
            "basketball-fiba" => [1.0, -1.0].into_iter().try_for_each(|end| self.board(easel, end)),
            "padel" => {
                self.glass(easel);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// A table with the lines `painted` by the caller between its top and its net; else only the net.
    ///
    /// # Errors
    /// As [`Piece::paint`].
    pub fn paint_middle(&self, easel: &mut Easel, paint_lines: impl FnOnce(&mut Easel) -> Result<()>) -> Result<()> {
        if self.is_table() {
            self.paint_table(easel)?;
            paint_lines(easel)?;
        }
        self.paint_net(easel)
    }

    fn paint_table(&self, easel: &mut Easel) -> Result<()> {
        let ([wide, long], height) = super::markings::extent(self.court)?;
        let [across, along] = LEGS;
        for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
            let foot = Point3::new(x * across * wide, y * along * long, 0.0);
            easel.limb(&foot, &(foot + Vector3::z() * (height - TABLE_SIDE)), LEG_RADIUS, CORD);
        }
        let camera = easel.camera;
        let corners = [[-wide, -long], [wide, -long], [wide, long], [-wide, long]];
        let corners = corners.map(|[x, y]| Point3::new(x, y, height));
        let dark = self.table.map(|value| 0.5 * value);
        for (index, corner) in corners.iter().enumerate() {
            let side = corners[(index + 1) % corners.len()] - corner;
            let face = Piece::rectangle(*corner, [side, Vector3::z() * -TABLE_SIDE]);
            face.paint(&mut easel.canvas, camera, |_| (dark, 1.0))?;
        }
        let top = Piece::rectangle(corners[0], [corners[1] - corners[0], corners[3] - corners[0]]);
        top.paint(&mut easel.canvas, camera, |_| (self.table, 1.0))
    }

    fn paint_net(&self, easel: &mut Easel) -> Result<()> {
        let size = net_size(self.court);
        let camera = easel.camera;
        for pair in self.net.windows(2) {
            let [from, to] = [pair[0], pair[1]].map(Point3::from);
            let down = size.mesh.min(from.z.min(to.z));
            let mesh = Piece::rectangle(from, [to - from, Vector3::z() * -down]);
            mesh.paint(&mut easel.canvas, camera, |_| (CORD, self.net_opacity))?;
            let tape = Piece::rectangle(from, [to - from, Vector3::z() * -size.tape]);
            tape.paint(&mut easel.canvas, camera, |_| (TAPE, 1.0))?;
            // Folded over a cord, it is seen from above, too.
            let folded =
                Piece::rectangle(from - Vector3::y() * (size.tape / 2.0), [to - from, Vector3::y() * size.tape]);
            folded.paint(&mut easel.canvas, camera, |_| (TAPE, 1.0))?;
        }
        if let [first, .., last] = self.net[..] {
            for [x, y, z] in [first, last] {
                let foot = if self.is_table() { z - size.mesh } else { 0.0 };
                let half = if self.is_table() { POST / 4.0 } else { POST };
                easel.limb(&Point3::new(x, y, foot), &Point3::new(x, y, z), half, self.metal);
            }
        }
        Ok(())
    }

    /// A basketball board with its mast and ring, at an end.
    fn board(&self, easel: &mut Easel, end: f64) -> Result<()> {
        let at = |y: f64, z: f64| Point3::new(0.0, end * y, z);
        easel.limb(&at(MAST_AT, 0.0), &at(MAST_AT, 2.6), MAST, self.metal);
        easel.limb(&at(MAST_AT, 2.6), &at(BOARD_AT, 3.2), MAST, self.metal);
        let corner = Point3::new(-0.9, end * BOARD_AT, 2.9);
        let board = Piece::rectangle(corner, [Vector3::x() * 1.8, Vector3::z() * 1.05]);
        let camera = easel.camera;
        board.paint(&mut easel.canvas, camera, |_| (TAPE, self.board_opacity))?;
        let rim = |part: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(part) / f64::from(RING_PARTS)).sin_cos();
            Point3::new(RING_RADIUS * cos, end * RING_AT + RING_RADIUS * sin, RING_HEIGHT)
        };
        (0..RING_PARTS).for_each(|part| easel.limb(&rim(part), &rim(part + 1), RING_HALF, [0.85, 0.3, 0.1]));
        Ok(())
    }

    /// The frames of the glass walls.
    fn glass(&self, easel: &mut Easel) {
        let [wide, long] = [5.0, 10.0];
        let post = |x: f64, y: f64| [Point3::new(x, y, 0.0), Point3::new(x, y, GLASS)];
        let mut posts = Vec::new();
        for side in [1.0, -1.0] {
            let along = (0..=10).map(|number| post(side * wide, f64::from(number) * GLASS_POSTS - long));
            let across = (1..5).map(|number| post(f64::from(number) * GLASS_POSTS - wide, side * long));
            posts.extend(along.chain(across));
        }
        posts.iter().for_each(|[foot, top]| easel.limb(foot, top, FRAME, self.metal));
        // The upper rails, from post to post.
        let rails = posts.iter().flat_map(|[_, top]| posts.iter().map(move |[_, next]| (top, next)));
        let is_rail = |(top, next): &(&Point3<f64>, &Point3<f64>)| {
            let way: Vector3<f64> = *next - *top;
            way.x + way.y > 0.0 && (way.norm() - GLASS_POSTS).abs() < POST
        };
        rails.filter(is_rail).for_each(|(top, next)| easel.limb(top, next, FRAME, self.metal));
    }
}

impl Someone {
    /// Somebody who plays, waits or walks by on a court of half the size `half`, m.
    pub fn draw(half: [f64; 2], held: Held, random: &mut Random) -> Self {
        let [x, y] =
            gravisight_geometry::random::normal_pair::<f64>(random).map(|normal| SPREAD * normal.clamp(-2.0, 2.0));
        let feet = Point3::new(x * half[0], y * half[1], 0.0);
        let facing = random.random_range(0.0..std::f64::consts::TAU);
        let mut body = Body::standing(feet, facing);
        body.step = random.random_range(0.0..std::f64::consts::TAU);
        body.stride = random.random_range(0.0..0.42);
        body.astride = random.random_range(0.1..0.3);
        body.crouch = random.random_range(0.0..0.6_f64).powi(2);
        body.lean = random.random_range(-0.05..0.5);
        for (hand, side) in body.hands.iter_mut().zip([-1.0, 1.0]) {
            *hand =
                [side * random.random_range(0.0..0.4), random.random_range(0.0..0.5), random.random_range(-0.5..0.5)];
        }
        body.held = held;
        Self { body, look: Look::draw(random), shadow: random.random_range(SHADOW_OPACITY[0]..SHADOW_OPACITY[1]) }
    }

    /// Where their feet are, m.
    pub fn feet(&self) -> Point3<f64> {
        self.body.feet
    }

    /// Whether they are so far before the camera that they do not hide everything.
    pub fn is_visible(&self, easel: &Easel) -> bool {
        easel.camera.camera_from_world(&self.body.feet).z > NEAREST
    }

    /// Draws them.
    pub fn paint(&self, easel: &mut Easel) {
        easel.shadow(&self.body.feet, SHADOW_REACH, self.shadow);
        self.body.paint(easel, &self.look);
    }
}
