//! Whether a ball came down within a court's lines.

use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::scene::Scene;

/// Distance within which a point lies on a line, and a line on the ground that is touched, m.
const ON: f64 = 0.02;

impl Scene {
    /// The probability that a ball whose centre is at `at` (m, with its covariance, m²) when it touches the ground comes down within
    /// the outermost of the scene's `lines` there. None where those do not go round a convex place, as a tennis court's do
    /// (the doubles court's).
    pub fn within_lines(&self, at: &Point3<f64>, covariance: &Matrix3<f64>) -> Option<f64> {
        let height = at.z - self.ball.radius;
        // What is touched is known to a ball's radius or so.
        let level = |line: &&[[f64; 3]; 2]| line.iter().all(|end| (end[2] - height).abs() < ON + self.ball.radius);
        let lines: Vec<[Point2<f64>; 2]> =
            self.lines.iter().filter(level).map(|line| line.map(|[x, y, _]| Point2::new(x, y))).collect();
        let outline = hull(lines.iter().flatten().copied().collect());
        if outline.len() < 3 {
            return None;
        }
        let mut within = 1.0;
        for (index, from) in outline.iter().enumerate() {
            let to = &outline[(index + 1) % outline.len()];
            if !lines.iter().any(|line| distance(from, line) < ON && distance(to, line) < ON) {
                return None;
            }
            let along = (to - from).normalize();
            let inward = Vector3::new(-along.y, along.x, 0.0);
            let off = inward.xy().dot(&(at.xy() - from));
            let sigma = inward.dot(&(covariance * inward)).max(0.0).sqrt().max(f64::MIN_POSITIVE);
            within *= 0.5 * libm::erfc(-off / (sigma * std::f64::consts::SQRT_2));
        }
        Some(within)
    }
}

fn distance(point: &Point2<f64>, [from, to]: &[Point2<f64>; 2]) -> f64 {
    let way = to - from;
    let share = ((point - from).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    (point - (from + share * way)).norm()
}

/// The corners of the convex hull, counterclockwise (Andrew's monotone chain).
fn hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let half = |points: &mut dyn Iterator<Item = &Point2<f64>>| {
        let mut side: Vec<Point2<f64>> = Vec::new();
        for &point in points {
            while let [.., before, last] = side[..] {
                if (last - before).perp(&(point - last)) > 1e-9 {
                    break;
                }
                side.pop();
            }
            side.push(point);
        }
        side.pop();
        side
    };
    let mut corners = half(&mut points.iter());
    corners.extend(half(&mut points.iter().rev()));
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(name: &str) -> Scene {
        Scene::named(name).unwrap()
    }

    fn within(scene: &Scene, [x, y]: [f64; 2], sigma: f64, height: f64) -> Option<f64> {
        let at = Point3::new(x, y, height + scene.ball.radius);
        scene.within_lines(&at, &(Matrix3::identity() * sigma * sigma))
    }

    #[test]
    fn a_ball_is_in_out_or_perhaps() {
        let tennis = scene("tennis");
        let at = |place: [f64; 2]| within(&tennis, place, 0.05, 0.0).unwrap();
        assert!(at([0.0, 0.0]) > 0.999 && at([5.0, -11.0]) > 0.999);
        assert!(at([6.0, 0.0]) < 0.001 && at([0.0, 12.3]) < 0.001);
        assert!((at([5.485, 3.0]) - 0.5).abs() < 1e-9);
        // a standard deviation inside a line, and inside two at a corner
        assert!((at([5.435, 3.0]) - 0.841_345).abs() < 1e-5);
        assert!((at([5.435, 11.835]) - 0.841_345_f64.powi(2)).abs() < 1e-5);
        // a table's edges are lines on it, not on the floor
        let table = scene("table-tennis");
        assert!(within(&table, [0.0, 0.0], 0.01, 0.76).is_some_and(|within| within > 0.999));
        assert_eq!(within(&table, [0.0, 0.0], 0.01, 0.0), None);
    }

    #[test]
    fn without_lines_round_a_place_nothing_is_said() {
        for name in ["floor", "free"] {
            assert_eq!(within(&scene(name), [0.0, 0.0], 0.1, 0.0), None, "{name}");
        }
    }
}
