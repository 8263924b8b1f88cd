//! A ball's radius by what somebody drew around it.

/// Standard deviation of a radius by hand, px: each edge is placed to about 1 px, and a radius is half the distance of two.
const BY_HAND: f64 = 0.7;
/// The same as a fraction of the radius: where people see a blurred edge, which zooming in does not change.
const BLURRED: f64 = 0.05;
/// What a box's sides say of a streak: one that a ball draws at the median angle (22.5° to the longer side) makes the shorter side
/// longer, too, and half of it is then this fraction of the sides' difference more than the ball's radius.
const STREAK: f64 = 0.35;

/// Semi-minor axis of an ellipse of these semi-axes, px, and its standard deviation: what a streak does not lengthen.
pub(super) fn of_ellipse([a, b]: [f64; 2]) -> Option<[f64; 2]> {
    known(a.min(b), 0.0)
}

/// Half of the smaller side of a box of these sides, px, and its standard deviation. A box does not say how a streak lies in it.
pub(super) fn of_box([width, height]: [f64; 2]) -> Option<[f64; 2]> {
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
