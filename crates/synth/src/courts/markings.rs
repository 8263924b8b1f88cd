//! What is painted on the ground: a court's lines, its variants, and what the rules add to the straight lines.

use nalgebra::{Point3, Vector3};

use super::piece::{Outline, Piece};
use gravisight_geometry::camera::{Court, CourtLine};
use gravisight_geometry::error::Result;

/// Half the width of a tennis court for singles, m (ITF rules).
const SINGLES: f64 = 4.115;
/// Tolerance of coordinates that are the same, m.
const SAME: f64 = 1e-6;
/// The centre mark of a tennis court: length and width, m (ITF rules), and where the base lines are.
const MARK: [f64; 2] = [0.1, 0.05];
const BASE_LINE: f64 = 11.885;
/// Width of the lines of a basketball court, m; radius of its circles; where its end lines, free throw lines and rings are (FIBA rules).
const BASKETBALL_LINE: f64 = 0.05;
const CIRCLE: f64 = 1.8;
const END_LINE: f64 = 14.0;
const FREE_THROW: f64 = 8.2;
const RING: f64 = 12.425;
/// The three-point line: radius about the ring, distance of its straight parts from the middle, m (FIBA rules).
const THREE_POINTS: [f64; 2] = [6.75, 6.6];
/// Half the width of a basketball key, m (FIBA rules).
const KEY: f64 = 2.45;
/// Distance of the attack line of volleyball and of the non-volley line of pickleball from the net, m (FIVB and USA Pickleball rules).
const ATTACK: f64 = 3.0;
const NON_VOLLEY: f64 = 2.1336;

/// The courts whose lines are known.
pub fn courts() -> Vec<&'static str> {
    Court::names().into_iter().filter(|name| Court::named(name).is_ok_and(|court| !court.lines.is_empty())).collect()
}

/// Half the width and length of a court between the outermost ends of its lines, m, and its height.
///
/// # Errors
/// As [`Court::named`].
pub fn extent(court: &str) -> Result<([f64; 2], f64)> {
    let lines = &Court::named(court)?.lines;
    let half = [0, 1]
        .map(|axis| lines.iter().flat_map(|line| [line.from, line.to]).map(|end| end[axis].abs()).fold(0.0, f64::max));
    Ok((half, lines.first().map_or(0.0, |line| line.from[2])))
}

/// A court's straight lines; of a tennis court for singles only those that it has.
///
/// # Errors
/// As [`Court::named`].
pub fn lines(court: &str, singles: bool) -> Result<Vec<CourtLine>> {
    let lines = &Court::named(court)?.lines;
    if !singles {
        return Ok(lines.clone());
    }
    let is_inside = |line: &&CourtLine| line.from[0].abs().min(line.to[0].abs()) < SINGLES + SAME || !is_along(line);
    let shorter = |[x, y, z]: [f64; 3]| [x.clamp(-SINGLES, SINGLES), y, z];
    let left = lines.iter().filter(is_inside);
    Ok(left.map(|line| CourtLine { from: shorter(line.from), to: shorter(line.to), ..line.clone() }).collect())
}

fn is_along(line: &CourtLine) -> bool {
    (line.from[0] - line.to[0]).abs() < SAME
}

/// A line as a flat piece; [`None`] of a line that is none.
pub fn piece(line: &CourtLine) -> Option<Piece> {
    let [[a, b], [c, _]] = [line.edges(0.0)?, line.edges(1.0)?];
    Some(Piece::rectangle(a, [c - a, b - a]))
}

/// What else is painted on a court: marks and curves.
pub fn curves(court: &str) -> Vec<Piece> {
    match court {
        "tennis" => [1.0, -1.0]
            .map(|end| {
                let origin = Point3::new(-MARK[1] / 2.0, end * BASE_LINE, 0.0);
                Piece::rectangle(origin, [Vector3::x() * MARK[1], Vector3::y() * (-end * MARK[0])])
            })
            .to_vec(),
        "basketball-fiba" => basketball(),
        _ => vec![],
    }
}

fn basketball() -> Vec<Piece> {
    let ring = |y: f64, towards: f64, radius: f64, from: f64| Piece {
        origin: Point3::new(0.0, y, 0.0),
        axes: [Vector3::x(), Vector3::y() * towards],
        outline: Outline::Ring { radius, width: BASKETBALL_LINE, from },
    };
    let [radius, aside] = THREE_POINTS;
    let bends = (radius.powi(2) - aside.powi(2)).sqrt();
    let mut all = vec![ring(0.0, 1.0, CIRCLE, -2.0 * CIRCLE)];
    for end in [1.0, -1.0] {
        all.push(ring(end * FREE_THROW, -end, CIRCLE, 0.0));
        all.push(ring(end * RING, -end, radius, bends));
        for side in [1.0, -1.0] {
            let origin = Point3::new(side * aside, end * END_LINE, 0.0);
            let inwards = Vector3::y() * (-end * (END_LINE - RING + bends));
            all.push(Piece::rectangle(origin, [Vector3::x() * (-side * BASKETBALL_LINE), inwards]));
        }
    }
    all
}

/// Parts of a court that often have a colour of their own.
pub fn areas(court: &str) -> Vec<Piece> {
    let rectangle = |[x, y]: [f64; 2], [wide, long]: [f64; 2]| {
        Piece::rectangle(Point3::new(x, y, 0.0), [Vector3::x() * wide, Vector3::y() * long])
    };
    match court {
        "basketball-fiba" => {
            [-END_LINE, FREE_THROW].map(|y| rectangle([-KEY, y], [2.0 * KEY, END_LINE - FREE_THROW])).to_vec()
        }
        "volleyball" => vec![rectangle([-4.5, -ATTACK], [9.0, 2.0 * ATTACK])],
        "pickleball" => vec![rectangle([-3.048, -NON_VOLLEY], [6.096, 2.0 * NON_VOLLEY])],
        _ => vec![],
    }
}
