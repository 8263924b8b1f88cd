//! Where cameras stand: broadcasters' high up, people's at the edge of the ground.

use nalgebra::{Point3, Vector3};
use rand::RngExt;

use super::super::broadcast::Kind;
use super::motion::{Moves, Stand, Way};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// Sizes of pictures, px: broadcasts', phones' that lie and that stand.
const BROADCAST: [[u32; 2]; 3] = [[1920, 1080], [1920, 1080], [1280, 720]];
const PHONE: [[u32; 2]; 3] = [[1920, 1080], [1280, 720], [1280, 720]];
const UPRIGHT: [u32; 2] = [720, 1280];
/// How often a phone stands: of what is wide it seldom does.
const STANDS: f64 = 0.4;
/// Roll of a phone on a tripod, radians.
const ROLL: f64 = 0.02;
/// Fraction of the frames whose ball must be in the picture, and cameras that are tried for it.
const IN_PICTURE: f64 = 0.75;
const TRIES: usize = 40;
/// Least distance before the camera at which a ball is filmed, m.
const NEAREST: f64 = 0.5;
/// Times at which it is looked for.
const LOOKS: usize = 25;

/// How often a kind is filmed by a broadcaster.
pub(super) fn official(kind: Kind, random: &mut Random) -> bool {
    random.random_bool(match kind {
        Kind::Tennis => 0.7,
        Kind::TableTennis | Kind::Volleyball => 0.5,
        Kind::Toss => 0.0,
    })
}

/// A camera for a kind of play.
fn stand(kind: Kind, official: bool, random: &mut Random) -> Stand {
    let upright = !official && matches!(kind, Kind::Toss | Kind::TableTennis) && random.random_bool(STANDS);
    let sizes = if official { BROADCAST } else { PHONE };
    let [width, height] = if upright { UPRIGHT } else { sizes[random.random_range(0..sizes.len())] };
    let (eye, target, focal) = place(kind, official, random);
    let roll = if official { 0.0 } else { random.random_range(-ROLL..ROLL) };
    let size = Size::new(width, height);
    Stand { eye, target, focal: focal * f64::from(width.max(height)), size, roll }
}

/// Where it stands and looks, m, and its focal length as a fraction of the picture's longer side.
fn place(kind: Kind, official: bool, random: &mut Random) -> (Vector3<f64>, Vector3<f64>, f64) {
    let mut between = |range: std::ops::Range<f64>| random.random_range(range);
    let (eye, target, focal) = match (kind, official) {
        (Kind::Tennis, true) => (
            [between(-1.0..1.0), -between(24.0..32.0), between(7.0..11.0)],
            [0.0, between(-2.0..1.5), 0.0],
            between(1.3..1.7),
        ),
        (Kind::Tennis, false) => (
            [between(-5.0..5.0), -between(14.5..19.0), between(1.5..4.0)],
            [between(-0.5..0.5), 2.0, between(0.5..1.2)],
            between(0.75..1.0),
        ),
        (Kind::TableTennis, true) => {
            // High enough to look over the near player.
            let (turn, far): (f64, f64) = (between(-0.6..0.6), between(7.0..10.0));
            ([far * turn.sin(), -far * turn.cos(), between(4.0..6.5)], [0.0, 0.2, 0.8], between(1.4..1.9))
        }
        (Kind::TableTennis, false) => {
            let (turn, far): (f64, f64) = (between(-0.75..0.75), between(3.8..5.5));
            ([far * turn.cos(), far * turn.sin(), between(1.2..1.9)], [0.0, 0.0, 0.9], between(0.75..0.95))
        }
        (Kind::Volleyball, true) => (
            [between(15.0..21.0), between(-3.0..3.0), between(5.0..9.0)],
            [0.0, between(-1.0..1.0), 1.3],
            between(0.8..1.1),
        ),
        (Kind::Volleyball, false) => {
            ([between(-3.0..3.0), -between(11.0..15.0), between(1.6..4.0)], [0.0, 0.0, 1.6], between(0.7..0.9))
        }
        (Kind::Toss, _) => (
            [between(-0.7..0.7), -between(3.5..6.5), between(0.9..1.7)],
            [0.0, 0.0, between(0.9..1.3)],
            between(0.75..1.1),
        ),
    };
    (eye.into(), target.into(), focal)
}

/// A camera's way in which the ball is mostly in the picture.
pub(super) fn found_way(
    kind: Kind,
    official: bool,
    moves: Moves,
    lasts: f64,
    ball: impl Fn(f64) -> Point3<f64>,
    random: &mut Random,
) -> Result<Way> {
    let mut best = None;
    for _ in 0..TRIES {
        let way = Way::draw(stand(kind, official, random), moves, lasts, &ball, random);
        let fraction = in_picture(&way, lasts, &ball)?;
        if best.as_ref().is_none_or(|(most, _)| fraction > *most) {
            best = Some((fraction, way));
        }
        if fraction >= IN_PICTURE {
            break;
        }
    }
    best.map(|(_, way)| way).ok_or_else(|| Error::Data {
        what: kind.name().into(),
        reason: "no camera was found that sees the ball; choose another seed".into(),
    })
}

/// The fraction of the time in which the ball is in the picture.
fn in_picture(way: &Way, lasts: f64, ball: impl Fn(f64) -> Point3<f64>) -> Result<f64> {
    let mut seen = 0;
    for look in 0..LOOKS {
        let time = lasts * look as f64 / (LOOKS - 1) as f64;
        let camera = way.at(time)?;
        let [width, height] = camera.size().xy();
        let at = camera.camera_from_world(&ball(time));
        let inside = at.z > NEAREST
            && camera
                .image_from_camera(&at)
                .is_ok_and(|at| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y));
        seen += usize::from(inside);
    }
    Ok(seen as f64 / LOOKS as f64)
}
