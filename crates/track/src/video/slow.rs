//! A ball that hardly moves: it is part of its own background, so no difference between frames shows it.

use nalgebra::Vector2;

use super::BallTracker;
use super::state::FrameId;
use super::view::{CameraMotion, FirstView, Place};
use gravisight_geometry::camera::{Detection, Outline};

impl BallTracker {
    /// Where to look for balls that hardly moved between two frames in which the detector found them: in each frame from the `earlier` to
    /// the `later` one, the outline in that frame's pixels. Motion is what is left in the
    /// first view, so a camera that pans moves nothing; none where a cut is between the two.
    #[doc(hidden)]
    pub fn slow_balls(
        &self,
        (earlier, before): (FrameId, &[Detection]),
        (later, balls): (FrameId, &[Detection]),
    ) -> Vec<(FrameId, Outline)> {
        let config = &self.config.slow;
        if later.since(earlier) > config.most_frames || !self.are_comparable(earlier, later) {
            return vec![];
        }
        let view = |frame: FrameId| &self.state.frame(frame).view;
        let first = |frame: FrameId, found: &Detection| -> (Place<FirstView>, f64) {
            let at = Place::new(found.outline.centre.coords.into());
            (view(frame).first(&at), found.outline.radius * view(frame).scale(&at))
        };
        let unsure = view(earlier).sigma.hypot(view(later).sigma);
        let least = config.least_displacement_px.max(self.config.tracklets.gate * unsure);
        let before: Vec<(Place<FirstView>, f64)> = before.iter().map(|found| first(earlier, found)).collect();
        let mut places = vec![];
        for (at, radius) in balls.iter().map(|found| first(later, found)) {
            let slow = |(other, other_radius): &&(Place<FirstView>, f64)| {
                let is_alike = (config.alike.recip()..config.alike).contains(&(radius / other_radius));
                is_alike && (least..config.most_displacement * radius).contains(&Vector2::from(at.minus(other)).norm())
            };
            let Some((other, _)) = before.iter().find(slow) else { continue };
            let displacement = Vector2::from(at.minus(other));
            for frame in (earlier.0..=later.0).map(FrameId) {
                let fraction = frame.since(earlier) as f64 / later.since(earlier).max(1) as f64;
                let between = Vector2::from(other.xy) + fraction * displacement;
                let centre = view(frame).frame(&Place::new(between.into()));
                places.push((frame, Outline { centre: centre.xy.into(), radius: radius / view(frame).scale(&centre) }));
            }
        }
        places
    }

    /// Whether no cut is between two frames.
    fn are_comparable(&self, earlier: FrameId, later: FrameId) -> bool {
        let is_cut = |frame: FrameId| matches!(self.state.frame(frame).elsewhere, Some(CameraMotion::Cut));
        let is_between = |&cut: &FrameId| earlier < cut && cut <= later;
        is_cut(earlier) == is_cut(later) && !self.state.cuts().iter().any(is_between)
    }
}
