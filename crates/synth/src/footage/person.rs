//! People of limbs: they step, swing, crouch and sit.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::random::canvas::{PaintColour, mix};
use super::easel::Easel;
use gravisight_geometry::random::Random;

/// A grown person's measures, m: height of hips and shoulders, half their widths, lengths of the leg's and the arm's halves.
const HIP: f64 = 0.9;
const SHOULDER: f64 = 1.42;
const HIPS: f64 = 0.1;
const SHOULDERS: f64 = 0.19;
const LEG: f64 = 0.47;
const ARM: f64 = 0.29;
/// Middle of the head, and its radius, m.
const HEAD: f64 = 1.63;
const HEAD_RADIUS: f64 = 0.105;
/// A racket: length from hand to the middle of its head, half the head's length and width, m.
const RACKET: [f64; 3] = [0.52, 0.17, 0.13];
/// Of table tennis.
const BAT: [f64; 3] = [0.13, 0.08, 0.08];
/// How often somebody wears a cap, and how often that is white.
const CAP: f64 = 0.4;
const WHITE: f64 = 0.6;

/// What somebody wears, and how tall they are.
#[derive(Debug, Clone)]
pub(crate) struct Look {
    shirt: PaintColour,
    trousers: PaintColour,
    skin: PaintColour,
    hair: PaintColour,
    cap: Option<PaintColour>,
    shoes: PaintColour,
    long_trousers: bool,
    long_sleeves: bool,
    /// As a fraction of a usual height.
    tall: f64,
}

/// What somebody holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Held {
    Nothing,
    Racket,
    Bat,
}

/// A body at a time.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    /// Between the feet, m.
    pub feet: Point3<f64>,
    /// Where it looks, radians in the ground's plane.
    pub facing: f64,
    /// Where in its step it is, radians, and how far it steps, m.
    pub step: f64,
    pub stride: f64,
    /// Half the way between the feet, m.
    pub astride: f64,
    /// 0 upright, 1 squatting.
    pub crouch: f64,
    /// How far it leans forward, radians.
    pub lean: f64,
    /// On a chair: its feet hang before it.
    pub seated: bool,
    /// Hands as seen from their shoulders: right, forward, up, m.
    pub hands: [[f64; 3]; 2],
    pub held: Held,
}

/// A colour that cloth has: seldom a pure one.
pub(super) fn dyed(random: &mut Random) -> PaintColour {
    let pure: PaintColour = std::array::from_fn(|_| random.random_range(0.05..0.85));
    let grey = pure.iter().sum::<f32>() / 3.0;
    mix(pure, [grey; 3], random.random_range(0.0..0.8))
}

impl Look {
    pub fn draw(random: &mut Random) -> Self {
        let dye = |random: &mut Random| -> PaintColour {
            match random.random_range(0..5) {
                0 => [random.random_range(0.8..0.95); 3],
                1 => [random.random_range(0.04..0.2); 3],
                _ => dyed(random),
            }
        };
        let hair = mix([0.06, 0.05, 0.04], [0.55, 0.4, 0.2], random.random_range(0.0..1.0_f32).powi(2));
        let bright = [random.random_range(0.82..0.97); 3];
        Self {
            shirt: dye(random),
            trousers: dye(random),
            skin: mix([0.82, 0.62, 0.48], [0.32, 0.2, 0.14], random.random_range(0.0..1.0)),
            hair,
            cap: random.random_bool(CAP).then(|| if random.random_bool(WHITE) { bright } else { dye(random) }),
            shoes: if random.random_bool(0.65) { bright } else { dye(random) },
            long_trousers: random.random_bool(0.3),
            long_sleeves: random.random_bool(0.25),
            tall: random.random_range(0.92..1.06),
        }
    }

    /// In another's shirt and trousers.
    pub fn dressed_as(self, other: &Self) -> Self {
        Self { shirt: other.shirt, trousers: other.trousers, long_trousers: other.long_trousers, ..self }
    }
}

/// The middle of a limb of two equal halves, bent towards a direction.
fn joint(from: &Point3<f64>, to: &Point3<f64>, half: f64, towards: &Vector3<f64>) -> Point3<f64> {
    let way = to - from;
    let out = half.powi(2) - (0.5 * way.norm()).powi(2);
    let across = towards - way * (towards.dot(&way) / way.norm_squared().max(1e-9));
    nalgebra::center(from, to) + across.try_normalize(1e-6).unwrap_or_default() * out.max(0.0).sqrt()
}

impl Body {
    /// Standing, arms down.
    pub fn standing(feet: Point3<f64>, facing: f64) -> Self {
        Self {
            feet,
            facing,
            step: 0.0,
            stride: 0.0,
            astride: HIPS,
            crouch: 0.0,
            lean: 0.0,
            seated: false,
            hands: [[-0.06, 0.05, -0.52], [0.06, 0.05, -0.52]],
            held: Held::Nothing,
        }
    }

    /// Forward and right, horizontal.
    fn axes(&self) -> [Vector3<f64>; 2] {
        let (sin, cos) = self.facing.sin_cos();
        [Vector3::new(cos, sin, 0.0), Vector3::new(sin, -cos, 0.0)]
    }

    /// Lays it over a picture: the far side first.
    pub fn paint(&self, easel: &mut Easel, look: &Look) {
        let [forward, right] = self.axes();
        let tall = look.tall;
        let hip = self.feet + Vector3::z() * (tall * HIP * (1.0 - 0.45 * self.crouch))
            - forward * (0.12 * self.crouch * tall);
        let (sin, cos) = self.lean.sin_cos();
        let up = Vector3::z() * cos + forward * sin;
        let shoulder = hip + up * (tall * (SHOULDER - HIP));
        let head = hip + up * (tall * (HEAD - HIP)) + forward * 0.03;
        let eye = easel.camera.world_from_camera(&Point3::origin());
        let right_is_near = right.dot(&(eye - self.feet)) > 0.0;
        let order = if right_is_near { [-1.0, 1.0] } else { [1.0, -1.0] };
        self.arm(easel, look, &shoulder, order[0]);
        for side in order {
            self.leg(easel, look, &hip, side);
        }
        self.torso(easel, look, &hip, &shoulder);
        easel.limb(&(shoulder + up * 0.03), &head, 0.055 * tall, look.skin);
        self.head(easel, look, &head, &up);
        self.arm(easel, look, &shoulder, order[1]);
    }

    fn head(&self, easel: &mut Easel, look: &Look, head: &Point3<f64>, up: &Vector3<f64>) {
        let [forward, _] = self.axes();
        easel.limb(&(head - up * 0.03), &(head + up * 0.02), HEAD_RADIUS, look.skin);
        let top = head + up * 0.04 - forward * 0.025;
        let cover = look.cap.unwrap_or(look.hair);
        easel.sphere(&top, HEAD_RADIUS * 1.02, cover);
        if look.cap.is_some() {
            let brim = head + up * 0.05;
            easel.limb(&brim, &(brim + forward * 0.16), 0.035, cover);
        }
    }

    fn torso(&self, easel: &mut Easel, look: &Look, hip: &Point3<f64>, shoulder: &Point3<f64>) {
        let [_, right] = self.axes();
        let down = shoulder - (shoulder - hip) * 0.08;
        for (top, bottom) in [(-0.75, -0.6), (0.75, 0.6), (0.0, 0.0)] {
            let from = down + right * (top * SHOULDERS);
            let to = hip + right * (bottom * HIPS) + (shoulder - hip) * 0.1;
            easel.limb(&from, &to, 0.105 * look.tall, look.shirt);
        }
    }

    fn leg(&self, easel: &mut Easel, look: &Look, hip: &Point3<f64>, side: f64) {
        let [forward, right] = self.axes();
        let tall = look.tall;
        let from = hip + right * (side * HIPS);
        let turn = self.step + if side > 0.0 { 0.0 } else { std::f64::consts::PI };
        let mut foot = self.feet + right * (side * self.astride) + forward * (self.stride * turn.sin());
        foot.z += 0.07 + (0.35 * self.stride * turn.cos()).max(0.0);
        if self.seated {
            foot = from + forward * (LEG * tall) - Vector3::z() * (LEG * tall);
        }
        let knee = match self.seated {
            true => from + forward * (LEG * tall),
            false => joint(&from, &foot, LEG * tall, &forward),
        };
        let shin = if look.long_trousers { look.trousers } else { look.skin };
        easel.limb(&knee, &foot, 0.052 * tall, shin);
        let thigh = if look.long_trousers { knee } else { from + (knee - from) * 0.75 };
        easel.limb(&from, &knee, 0.065 * tall, shin);
        easel.limb(&from, &thigh, 0.085 * tall, look.trousers);
        let heel = foot - Vector3::z() * 0.03 - forward * 0.05;
        easel.limb(&heel, &(heel + forward * 0.2), 0.045, look.shoes);
    }

    fn arm(&self, easel: &mut Easel, look: &Look, shoulder: &Point3<f64>, side: f64) {
        let [forward, right] = self.axes();
        let tall = look.tall;
        let from = shoulder + right * (side * SHOULDERS);
        let [aside, ahead, above] = self.hands[usize::from(side > 0.0)];
        let way = right * aside + forward * ahead + Vector3::z() * above;
        let hand = from + way * tall.min(1.98 * ARM / way.norm().max(1e-6));
        let elbow = joint(&from, &hand, ARM * tall, &(-forward - Vector3::z() * 0.5 + right * (0.5 * side)));
        let sleeve = if look.long_sleeves { elbow } else { from + (elbow - from) * 0.55 };
        easel.limb(&elbow, &hand, 0.04 * tall, if look.long_sleeves { look.shirt } else { look.skin });
        easel.limb(&from, &elbow, 0.048 * tall, look.skin);
        easel.limb(&from, &sleeve, 0.06 * tall, look.shirt);
        easel.sphere(&hand, 0.05 * tall, look.skin);
        if side > 0.0 && self.held != Held::Nothing {
            self.racket(easel, &hand, &(hand - elbow));
        }
    }

    fn racket(&self, easel: &mut Easel, hand: &Point3<f64>, forearm: &Vector3<f64>) {
        let [reach, along, across] = if self.held == Held::Bat { BAT } else { RACKET };
        let out = (forearm.normalize() + Vector3::z() * 0.25).normalize();
        let side = out.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or(Vector3::x());
        let middle = hand + out * reach;
        let corner = |part: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(part) / 12.0).sin_cos();
            middle + out * (along * cos) + side * (across * sin) + Vector3::z() * (0.3 * across * sin)
        };
        let rim: Vec<Point3<f64>> = (0..12).map(corner).collect();
        let bat = self.held == Held::Bat;
        let dark = [0.08, 0.08, 0.1];
        easel.piece(&rim, if bat { 1.0 } else { 0.3 }, if bat { [0.65, 0.08, 0.08] } else { [0.7; 3] });
        easel.limb(hand, &(middle - out * along), 0.014, dark);
        if !bat {
            (0..12).for_each(|part| easel.limb(&corner(part), &corner(part + 1), 0.011, dark));
        }
    }
}
