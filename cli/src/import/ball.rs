//! A ball by what somebody drew around it: its centre and its radius.

use nalgebra::Point2;

/// From the picture's corner, where drawing tools count from, to the middle of its first pixel, px.
const HALF_PIXEL: f64 = 0.5;
/// Where tools put a ball that is not visible, px: (0, 0) and (−1, −1), counted from the first pixel's middle or from the corner.
const NOWHERE: [[f64; 2]; 4] = [[0.0, 0.0], [-1.0, -1.0], [-HALF_PIXEL; 2], [-1.0 - HALF_PIXEL; 2]];

/// Standard deviation of a radius by hand, px: each edge is placed to about 1 px, and a radius is half the distance of two.
const BY_HAND: f64 = 0.7;
/// The same as a fraction of the radius: where people see a blurred edge, which zooming in does not change.
const BLURRED: f64 = 0.05;
/// What a box's sides say of a streak: one that a ball draws at the median angle (22.5° to the longer side) makes the shorter side
/// longer, too, and half of it is then this fraction of the sides' difference more than the ball's radius.
const STREAK: f64 = 0.35;

/// The ball by a shape that is drawn around it, px.
#[derive(Debug, Clone)]
pub(super) struct Ball {
    /// Its centre; the first pixel's middle is (0, 0).
    pub centre: Point2<f64>,
    /// Its radius and the standard deviation of that; a point has none.
    pub radius: Option<[f64; 2]>,
}

impl Ball {
    /// At a point, counted from the picture's corner, px.
    pub fn at([x, y]: [f64; 2]) -> Self {
        Self { centre: Point2::new(x - HALF_PIXEL, y - HALF_PIXEL), radius: None }
    }

    /// In a box: its centre, counted from the picture's corner, and its sides, px.
    pub fn in_box(centre: [f64; 2], sides: [f64; 2]) -> Self {
        Self { radius: of_box(sides.map(f64::abs)), ..Self::at(centre) }
    }

    /// In an ellipse: its centre, counted from the picture's corner, and its semi-axes, px.
    pub fn in_ellipse(centre: [f64; 2], semi_axes: [f64; 2]) -> Self {
        Self { radius: of_ellipse(semi_axes), ..Self::at(centre) }
    }
}

/// Whether a ball is said to be where tools put one that is not visible.
pub(super) fn is_nowhere(place: &Point2<f64>) -> bool {
    NOWHERE.contains(&[place.x, place.y])
}

/// Semi-minor axis of an ellipse of these semi-axes, px, and its standard deviation: what a streak does not lengthen.
fn of_ellipse([a, b]: [f64; 2]) -> Option<[f64; 2]> {
    known(a.min(b), 0.0)
}

/// Half of the smaller side of a box of these sides, px, and its standard deviation. A box does not say how a streak lies in it.
fn of_box([width, height]: [f64; 2]) -> Option<[f64; 2]> {
    known(width.min(height) / 2.0, STREAK * (width - height).abs())
}

fn known(radius: f64, streak: f64) -> Option<[f64; 2]> {
    (radius > 0.0).then(|| [radius, BY_HAND.hypot(BLURRED * radius).hypot(streak)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_streak_lengthens_the_shorter_side_by_its_constant() {
        let (sin, cos) = 22.5_f64.to_radians().sin_cos();
        let (ball, streak) = (3.0, 20.0);
        let sides = [2.0 * ball + streak * cos, 2.0 * ball + streak * sin];
        let excess = sides[1] / 2.0 - ball;
        assert!((excess / (sides[0] - sides[1]) - STREAK).abs() < 0.01);
        let [radius, sigma] = of_box(sides).unwrap();
        assert!(radius - ball < sigma && sigma < 2.0 * (radius - ball));
    }
}
