//! Where is played: the ground and what is around it, as a picture without anything that moves.

use nalgebra::Point3;
use rand::RngExt;

use super::super::broadcast::Kind;
use super::super::random::canvas::{Canvas, PaintColour, mix};
use super::super::random::noise::smooth;
use super::boards::Board;
use super::easel::Rays;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::random::Random;

/// Colours of courts and what is around them: hard courts, clay, grass, halls.
const GROUNDS: [[PaintColour; 2]; 8] = [
    [[0.33, 0.31, 0.52], [0.5, 0.64, 0.42]],
    [[0.28, 0.45, 0.42], [0.36, 0.36, 0.38]],
    [[0.16, 0.36, 0.6], [0.3, 0.5, 0.36]],
    [[0.2, 0.4, 0.65], [0.2, 0.28, 0.5]],
    [[0.7, 0.42, 0.28], [0.68, 0.4, 0.27]],
    [[0.62, 0.28, 0.22], [0.22, 0.42, 0.24]],
    [[0.36, 0.5, 0.25], [0.33, 0.47, 0.23]],
    [[0.76, 0.6, 0.42], [0.55, 0.3, 0.24]],
];
/// How often a ground has a colour of its own.
const OWN_COLOUR: f64 = 0.3;
/// Least distance of a ground's colour from the ball's.
const UNLIKE: f32 = 0.35;
/// Height and depth of a row of seats, m.
pub(super) const ROW: [f64; 2] = [0.4, 0.8];
/// How often the edge of a shadow lies on an outdoor ground, and what is left of the light in it.
const SHADOW: f64 = 0.4;
const SHADED: f32 = 0.55;
/// Height of trees, m.
const TREES: f64 = 7.0;

/// What is around the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Style {
    /// Boards and stands full of people.
    Stadium,
    /// Walls and a ceiling.
    Hall,
    /// A fence, trees, the sky.
    Park,
}

/// A ground with its surroundings.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub kind: Kind,
    /// Half the width and length of what has the inner colour, m.
    pub court: [f64; 2],
    pub style: Style,
    /// Half its width and length, m.
    pub room: [f64; 2],
    /// Height of the wall or fence around it, m.
    pub fence: f64,
    /// Rise of the stands a metre, and how deep they are, m.
    pub rise: f64,
    pub depth: f64,
    pub inner: PaintColour,
    pub outer: PaintColour,
    wall: PaintColour,
    sky: [PaintColour; 2],
    /// Brightness of the stands.
    pub dim: f32,
    /// Strength of the ground's texture, and size of its grain, px.
    grain: [f32; 2],
    /// Where `a·x + b·y > c` the ground lies in the shade.
    pub shade: Option<[f64; 3]>,
    pub boards: Vec<Board>,
    /// Where the umpire's chair stands, m.
    pub chair: [f64; 2],
}

/// What a ray meets.
enum Met {
    Ground(f64, f64),
    /// Way along the wall, height over the ground, m.
    Fence(f64, f64),
    /// How far up the stand, m.
    Seats(f64),
    Beyond(f64),
}

impl Place {
    pub fn draw(kind: Kind, official: bool, paint: PaintColour, random: &mut Random) -> Self {
        let style = match (official, kind) {
            (true, _) => Style::Stadium,
            (false, Kind::TableTennis | Kind::Volleyball) => Style::Hall,
            (false, _) if random.random_bool(0.75) => Style::Park,
            _ => Style::Hall,
        };
        let court = if kind == Kind::Toss { [0.0; 2] } else { kind.court() };
        let room = room(kind, random);
        Self::around(court, kind, style, room, paint, random)
    }

    /// A place of a style around a court, inside walls; half their widths and lengths, m. `paint` is seen before its ground.
    pub fn around(
        court: [f64; 2],
        kind: Kind,
        style: Style,
        room: [f64; 2],
        paint: PaintColour,
        random: &mut Random,
    ) -> Self {
        let (inner, outer) = grounds(paint, random);
        let fence = match style {
            Style::Stadium => random.random_range(0.8..1.4),
            Style::Hall => random.random_range(1.0..3.0),
            Style::Park => random.random_range(1.2..4.0),
        };
        let mut place = Self {
            kind,
            court,
            style,
            room,
            fence,
            rise: random.random_range(0.4..0.7),
            depth: random.random_range(6.0..16.0),
            inner,
            outer,
            wall: tint(random),
            sky: [tint(random), [random.random_range(0.55..0.95); 3]],
            dim: if random.random_bool(0.5) { random.random_range(0.2..0.5) } else { random.random_range(0.5..0.95) },
            grain: [random.random_range(0.03..0.22), random.random_range(2.0..9.0)],
            shade: None,
            boards: vec![],
            chair: chair(kind, court, room, random),
        };
        if style != Style::Hall && random.random_bool(SHADOW) {
            let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
            place.shade = Some([cos, sin, random.random_range(-0.6..0.6) * room[1]]);
        }
        if style != Style::Park || random.random_bool(0.3) {
            place.put_up_boards(random);
        }
        place
    }

    /// Boards along the far wall and the sides, some of them screens.
    fn put_up_boards(&mut self, random: &mut Random) {
        let [wide, long] = self.room;
        let screens = self.style == Style::Stadium && random.random_bool(0.7);
        let walls = [
            ([-wide, long], [wide, long]),
            ([wide, long], [wide, -long]),
            ([-wide, -long], [-wide, long]),
            ([wide, -long], [-wide, -long]),
        ];
        for (from, to) in walls {
            let pieces = random.random_range(1..=4_u32);
            for piece in 0..pieces {
                if self.style != Style::Stadium && random.random_bool(0.6) {
                    continue;
                }
                let at = |part: u32| {
                    let fraction = f64::from(part) / f64::from(pieces);
                    [0, 1].map(|axis| from[axis] + fraction * (to[axis] - from[axis]))
                };
                let high = self.fence.min(random.random_range(0.8..1.3));
                let screen = screens && random.random_bool(0.6);
                self.boards.push(Board::draw(at(piece), at(piece + 1), [0.05, high], screen, random));
            }
        }
    }

    /// Whether somebody at `eye` sees the inner side of a wall there; m.
    pub fn faces(&self, eye: &Point3<f64>, board: &Board) -> bool {
        let middle = board.middle();
        let [wide, long] = self.room;
        let across = (middle.x.abs() - wide).abs() < 1e-6;
        match across {
            true => (eye.x * middle.x.signum()) < wide,
            false => (eye.y * middle.y.signum()) < long,
        }
    }

    fn met(&self, eye: [f64; 3], ray: [f64; 3]) -> Met {
        let out = |axis: usize| (self.room[axis].copysign(ray[axis]) - eye[axis]) / ray[axis];
        let [across, along] = [out(0), out(1)];
        let exit = across.min(along);
        if ray[2] < 0.0 {
            let down = -eye[2] / ray[2];
            if down < exit {
                return Met::Ground(eye[0] + down * ray[0], eye[1] + down * ray[1]);
            }
        }
        let axis = usize::from(along < across);
        let height = eye[2] + exit * ray[2];
        if height < self.fence {
            return Met::Fence(eye[1 - axis] + exit * ray[1 - axis], height);
        }
        if self.style == Style::Stadium {
            // The stand is a slope behind the wall's upper edge.
            let sign = ray[axis].signum();
            let drop = ray[2] - self.rise * sign * ray[axis];
            let place = (self.fence - self.rise * (self.room[axis] - sign * eye[axis]) - eye[2]) / drop;
            let back = sign * (eye[axis] + place * ray[axis]) - self.room[axis];
            if place > 0.0 && (0.0..self.depth).contains(&back) {
                return Met::Seats(back);
            }
        }
        Met::Beyond(height)
    }

    /// The picture that a camera has of it.
    pub fn picture(&self, camera: &Camera, random: &mut Random) -> Canvas {
        let mut canvas = Canvas::new(camera.size(), [0.5; 3]);
        let texture = smooth(&canvas, 60.0, 5, 0.7, random);
        let grain = smooth(&canvas, self.grain[1], 2, 0.8, random);
        let leaves = smooth(&canvas, 22.0, 4, 0.85, random);
        let rays = Rays::of(camera);
        for row in 0..canvas.height {
            for column in 0..canvas.width {
                let index = row * canvas.width + column;
                let met = self.met(rays.eye, rays.at(column as f64, row as f64));
                let found = self.colour(&met, [texture[index], grain[index], leaves[index]]);
                (0..3).for_each(|channel| canvas.planes[channel][index] = found[channel].clamp(0.0, 1.0));
            }
        }
        canvas
    }

    fn colour(&self, met: &Met, [texture, grain, leaves]: [f32; 3]) -> PaintColour {
        let [strength, _] = self.grain;
        let worn = 0.92 + 0.16 * texture + strength * (grain - 0.5);
        match *met {
            Met::Ground(x, y) => {
                let [half_width, half_length] = self.court;
                let inside = x.abs() < half_width && y.abs() < half_length;
                let shaded = self.shade.is_some_and(|[a, b, c]| a * x + b * y > c);
                let of = if inside { self.inner } else { self.outer };
                of.map(|value| value * worn * if shaded { SHADED } else { 1.0 })
            }
            Met::Fence(along, height) => {
                let panel = (along / 2.0).rem_euclid(1.0);
                let post = if panel < 0.04 { 0.7 } else { 1.0 };
                let top = if self.fence - height < 0.06 { 1.3 } else { 1.0 };
                self.wall.map(|value| value * post * top * (0.95 + 0.1 * texture))
            }
            Met::Seats(back) => {
                let step = (back / ROW[1]).rem_euclid(1.0);
                let edge = if step < 0.3 { 0.5 } else { 1.0 };
                mix(self.wall, [0.25, 0.25, 0.27], 0.6).map(|value| value * self.dim * edge)
            }
            Met::Beyond(height) => self.beyond(height, texture, leaves),
        }
    }

    fn beyond(&self, height: f64, texture: f32, leaves: f32) -> PaintColour {
        match self.style {
            Style::Stadium => [0.07, 0.075, 0.09].map(|value| value * (0.6 + self.dim + 0.4 * texture)),
            Style::Hall if height < 9.0 => {
                let panel = if (height / 1.4).rem_euclid(1.0) < 0.03 { 0.8 } else { 1.0 };
                self.sky[0].map(|value| (0.25 + 0.6 * value) * panel * (0.9 + 0.2 * texture))
            }
            Style::Hall => [0.3; 3].map(|value| value * (0.8 + 0.4 * leaves)),
            Style::Park => {
                let top = TREES * (0.4 + f64::from(texture)) + 1.5 * f64::from(leaves);
                if height < top {
                    let light = (2.2 * (leaves - 0.35)).clamp(0.0, 1.0);
                    mix([0.05, 0.08, 0.05], [0.3, 0.38, 0.2], light)
                } else {
                    mix(self.sky[1], [0.6, 0.72, 0.88], 0.4)
                }
            }
        }
    }
}

/// Half a ground's width and length, m.
fn room(kind: Kind, random: &mut Random) -> [f64; 2] {
    let [wide, long] = match kind {
        Kind::Tennis => [8.5..11.5, 16.5..20.0],
        Kind::TableTennis => [3.2..5.0, 5.5..7.5],
        Kind::Volleyball => [7.5..10.0, 12.5..16.0],
        Kind::Toss => [3.0..9.0, 3.0..12.0],
    };
    [random.random_range(wide), random.random_range(long)]
}

/// Beside the net, inside the boards, m.
fn chair(kind: Kind, court: [f64; 2], [wide, _]: [f64; 2], random: &mut Random) -> [f64; 2] {
    let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
    let beside = if kind == Kind::TableTennis { 2.5 } else { court[0] + 2.0 };
    [side * beside.min(wide - 0.8), 0.05]
}

fn tint(random: &mut Random) -> PaintColour {
    let grey = random.random_range(0.08..0.4_f32);
    std::array::from_fn(|_| (grey + random.random_range(-0.1..0.15_f32)).max(0.02))
}

/// Colours of a court and of what is around it, before which a ball is seen.
fn grounds(paint: PaintColour, random: &mut Random) -> (PaintColour, PaintColour) {
    let unlike =
        |of: &PaintColour| (0..3).map(|channel| (of[channel] - paint[channel]).powi(2)).sum::<f32>() > UNLIKE * UNLIKE;
    loop {
        let [inner, outer] = match random.random_bool(OWN_COLOUR) {
            true => [(); 2].map(|()| std::array::from_fn(|_| random.random_range(0.08..0.8))),
            false => {
                let light = random.random_range(0.75..1.15_f32);
                GROUNDS[random.random_range(0..GROUNDS.len())].map(|of| of.map(|value| value * light))
            }
        };
        if unlike(&inner) && unlike(&outer) {
            return (inner, outer);
        }
    }
}
