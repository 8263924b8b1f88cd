//! A court as the search knows it: the middles of its painted lines.

use nalgebra::{Point3, Vector3};

use crate::camera::court::{Court, CourtLine};
use crate::error::{Error, Result};

/// Two coordinates closer than this, m, are the same.
const SAME: f64 = 1e-6;
/// The white tape at the top of a table's net (ITTF rules 2.02: the net's top is 15.25 cm above the table and reaches 15.25 cm beyond
/// it): height of its upper edge, half its length and its width, m. Without it the table's short side is found as the long one, seen from
/// far away.
const TAPE_TOP: f64 = 0.9125;
const TAPE_REACH: f64 = 0.915;
const TAPE_WIDTH: f64 = 0.012;
/// Half the width of a tennis court for doubles and for singles, m (ITF rules).
const DOUBLES: f64 = 5.485;
const SINGLES_HALF: f64 = 4.115;
/// What the name of a court ends with that has lines for singles only.
pub(super) const SINGLES: &str = "-singles";

/// A line of the model.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModelLine {
    /// The ends of the paint's middle, m.
    pub ends: [Point3<f64>; 2],
    /// From the middle of the paint to its edge, m.
    pub half_width: Vector3<f64>,
    /// Whether it runs along y, the court's length.
    pub is_along: bool,
}

/// What is painted on one court.
#[derive(Debug, Clone)]
pub(super) struct CourtModel {
    /// The name, with that of the variant.
    pub name: String,
    /// Its lines by their edges, in the order of the court's; the tape of a table's net follows.
    pub painted: Vec<CourtLine>,
    /// The same lines by their middles.
    pub lines: Vec<ModelLine>,
    /// Where its lines along y cross the x axis, and its lines along x the y axis, m, ascending.
    pub crossings: [Vec<f64>; 2],
    /// Height of its plane, m.
    pub height: f64,
    /// Its larger extent, m.
    pub size: f64,
}

impl ModelLine {
    /// A point of the line; `fraction` is 0 at one end and 1 at the other, and may lie outside.
    pub(super) fn at(&self, fraction: f64) -> Point3<f64> {
        self.ends[0] + (self.ends[1] - self.ends[0]) * fraction
    }

    /// Unit vector from one end to the other.
    pub(super) fn direction(&self) -> Vector3<f64> {
        (self.ends[1] - self.ends[0]).normalize()
    }
}

impl CourtModel {
    /// The models of a court: itself, and the variants that are painted instead.
    ///
    /// # Errors
    /// As [`Court::named`]; [`Error::Calibration`] for a court whose lines are not known.
    pub(super) fn of(court: &str) -> Result<Vec<Self>> {
        let lines = &Court::named(court)?.lines;
        if lines.is_empty() {
            let reason = format!("the painted lines of `{court}` are not known, so they cannot be found in a picture");
            return Err(Error::Calibration { reason });
        }
        Ok(match court {
            "tennis" => {
                vec![Self::with(court, lines.clone()), Self::with(&format!("{court}{SINGLES}"), singles(lines))]
            }
            "table-tennis" => {
                let with_tape = lines.iter().cloned().chain([tape()]).collect();
                vec![Self::with(court, with_tape)]
            }
            _ => vec![Self::with(court, lines.clone())],
        })
    }

    /// The models of every court whose lines are known.
    pub(super) fn all() -> Vec<Vec<Self>> {
        Court::names().into_iter().filter_map(|court| Self::of(court).ok()).collect()
    }

    fn with(name: &str, painted: Vec<CourtLine>) -> Self {
        let height = painted.first().map_or(0.0, |line| line.from[2]);
        let lines: Vec<ModelLine> = painted.iter().map(model_line).collect();
        let crossings = [0, 1].map(|axis: usize| {
            let is_flat = |line: &&ModelLine| line.ends.iter().all(|end| (end.z - height).abs() < SAME);
            let across = lines.iter().filter(is_flat).map(|line| line.ends.map(|end| end[axis]));
            let mut all: Vec<f64> = across.filter(|[a, b]| (a - b).abs() < SAME).map(|[at, _]| at).collect();
            all.sort_by(f64::total_cmp);
            all.dedup_by(|a, b| (*a - *b).abs() < SAME);
            all
        });
        let extent = |axis: usize| crossings[axis].last().unwrap_or(&0.0) - crossings[axis].first().unwrap_or(&0.0);
        let size = extent(0).max(extent(1));
        Self { name: name.into(), painted, lines, crossings, height, size }
    }

    /// The points of a 3×3 grid over the court, by which two cameras are compared.
    pub(super) fn grid(&self) -> Vec<Point3<f64>> {
        let ends = |axis: usize| match (self.crossings[axis].first(), self.crossings[axis].last()) {
            (Some(&first), Some(&last)) => [first, 0.0, last],
            _ => [0.0; 3],
        };
        ends(0).iter().flat_map(|&x| ends(1).map(|y| Point3::new(x, y, self.height))).collect()
    }
}

/// The middle of a line's paint.
fn model_line(line: &CourtLine) -> ModelLine {
    let half = line.width / 2.0;
    let [from, to] = [line.from, line.to].map(Point3::from);
    let aside = line.paint.map_or_else(Vector3::zeros, |paint| Vector3::from(paint) * half);
    // Flat on the ground; the tape is folded over a cord, so that it is seen from everywhere.
    let half_width = Vector3::z().cross(&(to - from)).normalize() * half;
    ModelLine { ends: [from + aside, to + aside], half_width, is_along: (from.x - to.x).abs() < SAME }
}

fn tape() -> CourtLine {
    let end = |x: f64| [x, 0.0, TAPE_TOP];
    CourtLine { from: end(-TAPE_REACH), to: end(TAPE_REACH), width: TAPE_WIDTH, paint: Some([0.0, 0.0, -1.0]) }
}

/// A tennis court without the side lines for doubles; its base lines end at those for singles.
fn singles(lines: &[CourtLine]) -> Vec<CourtLine> {
    let is_doubles = |x: f64| (x.abs() - DOUBLES).abs() < SAME;
    let is_side_line = |line: &&CourtLine| is_doubles(line.from[0]) && (line.from[0] - line.to[0]).abs() < SAME;
    let shorter =
        |end: [f64; 3]| if is_doubles(end[0]) { [SINGLES_HALF.copysign(end[0]), end[1], end[2]] } else { end };
    let left = lines.iter().filter(|line| !is_side_line(line));
    left.map(|line| CourtLine { from: shorter(line.from), to: shorter(line.to), ..line.clone() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tennis_court_for_singles_has_seven_lines_within_the_singles_side_lines() {
        let [doubles, singles] = <[CourtModel; 2]>::try_from(CourtModel::of("tennis").unwrap()).unwrap();
        assert_eq!([doubles.lines.len(), singles.lines.len()], [9, 7]);
        assert_eq!([doubles.crossings[0].len(), singles.crossings[0].len(), singles.crossings[1].len()], [5, 3, 4]);
        assert!(singles.lines.iter().all(|line| line.ends.iter().all(|end| end.x.abs() <= SINGLES_HALF)));
    }

    #[test]
    fn a_table_has_the_tape_of_its_net_which_is_not_in_its_plane() {
        let table = &CourtModel::of("table-tennis").unwrap()[0];
        let tape = &table.lines[5];
        assert!(table.lines.len() == 6 && (tape.ends[0].z - 0.9065).abs() < 1e-9 && !tape.is_along);
        assert_eq!([table.crossings[0].len(), table.crossings[1].len()], [3, 2]);
    }

    #[test]
    fn a_court_without_known_lines_is_refused() {
        assert!(CourtModel::of("football").unwrap_err().to_string().contains("not known"));
        assert!(CourtModel::of("no court").is_err());
    }
}
