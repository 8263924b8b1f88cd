//! A ball that hardly moves: it is part of its own background, so no difference between frames shows it.

use nalgebra::Point2;

use super::{BallTracker, CameraMotion};
use gravisight_geometry::camera::{Detection, Outline};

/// A ball that moved less than so many radii since, and more than so many px, hardly moves.
const SLOW: f64 = 4.0;
const LEAST_DISPLACEMENT_PX: f64 = 1.0;
/// Largest ratio of the radii of one ball in two such frames.
const ALIKE: f64 = 1.3;

impl BallTracker {
    /// Where to look for balls that hardly moved between two frames in which the detector found them: in each frame from the `earlier` to
    /// the `later` one (numbers among those that are not repeated), the outline in that frame's pixels. Motion is what is left in the
    /// first view, so a camera that pans moves nothing; none where a cut is between the two.
    #[doc(hidden)]
    pub fn slow_balls(
        &self,
        (earlier, before): (usize, &[Detection]),
        (later, balls): (usize, &[Detection]),
    ) -> Vec<(usize, Outline)> {
        if !self.are_comparable(earlier, later) {
            return vec![];
        }
        let first = |place: usize, found: &Detection| {
            let Outline { centre, radius } = found.outline;
            let view = &self.views[place];
            let at = Point2::from(view.first(centre.coords.into()));
            Outline { centre: at, radius: radius * view.scale(centre.coords.into()) }
        };
        let unsure = self.views[earlier].sigma.hypot(self.views[later].sigma);
        let least = LEAST_DISPLACEMENT_PX.max(self.config.gate * unsure);
        let before: Vec<Outline> = before.iter().map(|found| first(earlier, found)).collect();
        let mut places = vec![];
        for ball in balls.iter().map(|found| first(later, found)) {
            let slow = |other: &&Outline| {
                let is_alike = (ALIKE.recip()..ALIKE).contains(&(ball.radius / other.radius));
                is_alike && (least..SLOW * ball.radius).contains(&(ball.centre - other.centre).norm())
            };
            let Some(other) = before.iter().find(slow) else { continue };
            let displacement = ball.centre - other.centre;
            for place in earlier..=later {
                let fraction = (place - earlier) as f64 / (later - earlier).max(1) as f64;
                let view = &self.views[place];
                let centre = view.frame((other.centre + fraction * displacement).coords.into());
                places.push((place, Outline { centre: centre.into(), radius: ball.radius / view.scale(centre) }));
            }
        }
        places
    }

    /// Whether no cut is between two frames, by their numbers among those that are not repeated.
    fn are_comparable(&self, earlier: usize, later: usize) -> bool {
        let is_cut = |place: usize| matches!(self.elsewhere[place], Some(CameraMotion::Cut));
        let is_between = |cut: &usize| (earlier + 1..=later).contains(cut);
        is_cut(earlier) == is_cut(later) && !self.cuts.iter().any(is_between)
    }
}
