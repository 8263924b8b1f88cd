//! Where cameras stand: broadcasters' high up, people's at the edge of the ground.

use nalgebra::Vector3;
use rand::RngExt;

use super::super::broadcast::Kind;
use super::motion::Stand;
use crate::random::Random;
use crate::size::Size;

/// Sizes of pictures, px: broadcasts', phones' that lie and that stand.
const BROADCAST: [[u32; 2]; 3] = [[1920, 1080], [1920, 1080], [1280, 720]];
const PHONE: [[u32; 2]; 3] = [[1920, 1080], [1280, 720], [1280, 720]];
const UPRIGHT: [u32; 2] = [720, 1280];
/// How often a phone stands: of what is wide it seldom does.
const STANDS: f64 = 0.4;
/// Roll of a phone on a tripod, radians.
const ROLL: f64 = 0.02;

/// How often a kind is filmed by a broadcaster.
pub(super) fn official(kind: Kind, random: &mut Random) -> bool {
    random.random_bool(match kind {
        Kind::Tennis => 0.7,
        Kind::TableTennis | Kind::Volleyball => 0.5,
        Kind::Toss => 0.0,
    })
}

/// A camera for a kind of play.
pub(super) fn stand(kind: Kind, official: bool, random: &mut Random) -> Stand {
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
            let (turn, far): (f64, f64) = (between(-0.25..0.25), between(7.0..10.0));
            ([far * turn.sin(), -far * turn.cos(), between(2.5..4.5)], [0.0, 0.2, 0.8], between(1.5..2.0))
        }
        (Kind::TableTennis, false) => {
            let (turn, far): (f64, f64) = (between(-1.2..1.2), between(3.8..5.5));
            ([far * turn.cos(), far * turn.sin(), between(1.2..1.9)], [0.0, 0.0, 0.9], between(0.75..0.95))
        }
        (Kind::Volleyball, true) => (
            [between(15.0..21.0), between(-3.0..3.0), between(5.0..9.0)],
            [0.0, between(-1.0..1.0), 1.3],
            between(0.8..1.1),
        ),
        (Kind::Volleyball, false) => (
            [between(-3.0..3.0), -between(11.0..15.0), between(1.6..4.0)],
            [0.0, 0.0, 1.6],
            between(0.7..0.9),
        ),
        (Kind::Toss, _) => (
            [between(-0.7..0.7), -between(3.5..6.5), between(0.9..1.7)],
            [0.0, 0.0, between(0.9..1.3)],
            between(0.75..1.1),
        ),
    };
    (eye.into(), target.into(), focal)
}
