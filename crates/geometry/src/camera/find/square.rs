//! Views of a quadrilateral whose sides are four known lines of a court, in closed form.

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use super::polish::{Corners, polished};
use super::view::View;

/// Corners farther from the picture's middle than this, in units, are too unsure.
const FARTHEST: f64 = 4.0;
/// Least area of a quadrilateral, units².
const LEAST_AREA: f64 = 1e-4;
/// Least and greatest focal length, in units.
pub(super) const FOCAL: [f64; 2] = [0.3, 12.0];
/// Focal lengths that are tried where the quadrilateral's own are unlikely, in units: with little perspective noise makes f² negative.
const FOCALS: [f64; 6] = [0.7, 1.2, 2.0, 3.5, 6.0, 10.0];
/// Error below which the quadrilateral's own focal lengths are likely.
const LIKELY: f64 = 0.02;

/// How well a quadrilateral has to fit. Measured on 41 scenes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Most error of the closed form: squared cosine between the sides plus squared logarithm of their ratio.
    error: f64,
    /// Whether the closed form is polished to the corners.
    is_polished: bool,
    /// Most distance of a corner, in units, and as a fraction of the quadrilateral's side.
    off: f64,
    off_by_side: f64,
}

impl Fit {
    /// Of corners that are seen.
    pub(super) const CORNERS: Self = Self { error: 0.6, is_polished: true, off: 0.006, off_by_side: 0.03 };
    /// Of lines that meet out of view.
    pub(super) const LINES: Self = Self { error: 0.15, is_polished: false, off: 0.008, off_by_side: 0.03 };
}

/// A convex quadrilateral, and the homography that maps the unit square to it: columns `x`, `y` and the first corner.
pub(super) struct Square {
    corners: [Point2<f64>; 4],
    x: Vector3<f64>,
    y: Vector3<f64>,
    /// Root of its area, in units.
    side: f64,
}

impl Square {
    /// Between two lines of one family and two of another, as equations in units; [`None`] if it is not convex or too small.
    pub(super) fn between([left, right]: [&Vector3<f64>; 2], [near, far]: [&Vector3<f64>; 2]) -> Option<Self> {
        let meet = |a: &Vector3<f64>, b: &Vector3<f64>| Point2::from_homogeneous(a.cross(b));
        let corners = [meet(left, near)?, meet(right, near)?, meet(right, far)?, meet(left, far)?];
        if !corners.iter().all(|corner| corner.coords.amax() <= FARTHEST) {
            return None;
        }
        let side = |index: usize| corners[(index + 1) % 4] - corners[index % 4];
        let turn = |index: usize| side(index).perp(&side(index + 1)) > 0.0;
        let area = (0..4).map(|index| corners[index].coords.perp(&corners[(index + 1) % 4].coords)).sum::<f64>() / 2.0;
        if (1..4).any(|index| turn(index) != turn(0)) || area.abs() < LEAST_AREA {
            return None;
        }
        // Heckbert, "Fundamentals of texture mapping and image warping", 1989, section 2.2.3.
        let [p0, p1, p2, p3] = corners.map(|corner| corner.coords);
        let (d1, d2, d3) = (p1 - p2, p3 - p2, p0 - p1 + p2 - p3);
        let determinant = d1.perp(&d2);
        let (g, h) = (d3.perp(&d2) / determinant, d1.perp(&d3) / determinant);
        let column = |to: Vector2<f64>, last: f64| (to - p0 + to * last).push(last);
        (g.is_finite() && h.is_finite()).then(|| Self {
            corners,
            x: column(p1, g),
            y: column(p3, h),
            side: area.abs().sqrt(),
        })
    }

    /// The focal length, in units, with which the square is most nearly a rectangle of this ratio of width to length; [`None`] if its
    /// error is above `most`. Zhang's two equations for f² (2000): the sides are at right angles, and their lengths have that ratio.
    fn focal(&self, ratio: f64, most: f64) -> Option<f64> {
        let (flat, deep) = (self.x.xy().dot(&self.y.xy()), self.x.z * self.y.z);
        let [x_flat, y_flat] = [&self.x, &self.y].map(|side| side.xy().norm_squared());
        let [x_deep, y_deep] = [&self.x, &self.y].map(|side| side.z * side.z);
        let error = |focal: f64| {
            let square = focal * focal;
            let (x, y) = (x_flat / square + x_deep, y_flat / square + y_deep);
            let cosine = (flat / square + deep) / (x * y).sqrt();
            let aspect = 0.5 * (x / (y * ratio * ratio)).ln();
            (focal, cosine * cosine + aspect * aspect)
        };
        let least = |best: Option<(f64, f64)>, next: (f64, f64)| match best {
            Some(best) if best.1 <= next.1 => Some(best),
            _ => Some(next),
        };
        let by_angle = -flat / deep;
        let by_ratio = (x_flat - ratio * ratio * y_flat) / (ratio * ratio * y_deep - x_deep);
        let is_known = |square: &f64| *square > 0.0 && square.is_finite();
        let both = is_known(&by_angle) && is_known(&by_ratio);
        let mean = if both { (by_angle * by_ratio).sqrt() } else { 0.0 };
        let own = [by_angle, by_ratio, mean].into_iter().filter(is_known);
        let mut best = own.map(|square| error(square.sqrt().clamp(FOCAL[0], FOCAL[1]))).fold(None, least);
        if !both || best.is_none_or(|(_, error)| error >= LIKELY) {
            best = FOCALS.into_iter().map(error).fold(best, least);
        }
        best.filter(|(_, error)| *error < most).map(|(focal, _)| focal)
    }

    /// The views from above that show the rectangle between `x` and between `y`, m, at a height, m, as this square; in units, with the
    /// principal point at 0. Its sides may run along the court's x axis or against it. [`None`] if no camera is likely.
    pub(super) fn views(&self, x: [f64; 2], y: [f64; 2], height: f64, fit: Fit) -> Option<impl Iterator<Item = View>> {
        let focal = self.focal((x[1] - x[0]) / (y[1] - y[0]), fit.error)?;
        let ways = [x, [x[1], x[0]]];
        Some(ways.into_iter().filter_map(move |x| self.view(focal, x, y, height, fit)))
    }

    fn view(&self, focal: f64, x: [f64; 2], y: [f64; 2], height: f64, fit: Fit) -> Option<View> {
        let (width, length) = (x[1] - x[0], y[1] - y[0]);
        let ray = |column: &Vector3<f64>| Vector3::new(column.x / focal, column.y / focal, column.z);
        let (first, second) = (ray(&self.x) / width, ray(&self.y) / length);
        let scale = 2.0 / (first.norm() + second.norm());
        let (first, second) = (first.try_normalize(0.0)?, second.try_normalize(0.0)?);
        // The two nearest directions at right angles.
        let sum = (first + second).try_normalize(0.0)? / std::f64::consts::SQRT_2;
        let difference = (first - second).try_normalize(0.0)? / std::f64::consts::SQRT_2;
        let (first, second) = (sum + difference, sum - difference);
        let rotation = Matrix3::from_columns(&[first, second, first.cross(&second)]);
        let translation = ray(&self.corners[0].coords.push(1.0)) * scale;
        let view = View { focal, centre: Vector2::zeros(), rotation, translation };
        // From below the court is mirrored.
        if view.place().z <= 0.0 {
            return None;
        }
        // The origin is at the first corner while the corners are compared.
        let corner = |across: f64, away: f64| Point3::new(across, away, 0.0);
        let world = [corner(0.0, 0.0), corner(width, 0.0), corner(width, length), corner(0.0, length)];
        let corners = Corners { world: &world, image: &self.corners, focal: FOCAL };
        let (view, off) = if fit.is_polished { polished(corners, view)? } else { (view, corners.worst(&view)?) };
        let origin = Vector3::new(x[0], y[0], height);
        let translation = view.translation - view.rotation * origin;
        (off <= fit.off + fit.off_by_side * self.side).then_some(View { translation, ..view })
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::camera::find::testing::{WIDTH, random_view};
    use crate::random::Stream;

    /// The square that a view shows of the rectangle of a tennis court, with its lines moved by `noise` px at their ends.
    fn seen(view: &View, noise: f64, random: &mut crate::random::Random) -> Option<Square> {
        let corners = [(-4.09, -11.835), (4.09, -11.835), (4.09, 11.835), (-4.09, 11.835)];
        let images = corners.map(|(x, y)| view.image(&Point3::new(x, y, 0.0)));
        let [p0, p1, p2, p3] = [images[0]?, images[1]?, images[2]?, images[3]?];
        let mut line = |a: Point2<f64>, b: Point2<f64>| {
            let mut moved = |at: Point2<f64>| {
                let by = Vector2::new(random.random_range(-1.0..1.0), random.random_range(-1.0..1.0));
                ((at.coords + noise * by - view.centre) / WIDTH).push(1.0)
            };
            let line = moved(a).cross(&moved(b));
            line / line.xy().norm()
        };
        let (left, right, near, far) = (line(p0, p3), line(p1, p2), line(p0, p1), line(p3, p2));
        Square::between([&left, &right], [&near, &far])
    }

    /// Most distance between where two views put the court's corners, px.
    fn off(found: &View, truth: &View) -> f64 {
        let found = View { focal: found.focal * WIDTH, centre: truth.centre, ..*found };
        let corner = |x: f64, y: f64| {
            let at = Point3::new(x, y, 0.0);
            (found.image(&at).unwrap() - truth.image(&at).unwrap()).norm()
        };
        [(-5.485, -11.885), (5.485, -11.885), (5.485, 11.885), (-5.485, 11.885)]
            .into_iter()
            .map(|(x, y)| corner(x, y))
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_view_comes_back_from_exact_lines_and_nearly_from_inexact_ones() {
        let mut random = Stream::Scene.of(11);
        let (mut exact, mut inexact, mut count) = (vec![], vec![], 0);
        while count < 300 {
            let truth = random_view(&mut random);
            let Some(square) = seen(&truth, 0.0, &mut random) else { continue };
            count += 1;
            let best = |square: &Square| {
                let views = square.views([-4.09, 4.09], [-11.835, 11.835], 0.0, Fit::CORNERS);
                views.into_iter().flatten().map(|view| off(&view, &truth)).fold(f64::INFINITY, f64::min)
            };
            exact.push(best(&square));
            inexact.push(seen(&truth, 0.5, &mut random).map_or(f64::INFINITY, |square| best(&square)));
        }
        exact.sort_by(f64::total_cmp);
        inexact.sort_by(f64::total_cmp);
        assert!(exact[count - 1] < 1e-3, "{:?}", &exact[count - 10..]);
        assert!(inexact[count * 9 / 10] < 2.0, "{:?}", &inexact[count * 9 / 10..]);
    }
}
