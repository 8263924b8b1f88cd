//! The views of a camera that turns and zooms, by a court's painted lines: what registration alone loses, or lets drift, they hold.

use super::config::RegistrationConfig;
use super::planes::Planes;
use super::view::View;
use gravisight_geometry::camera::{Camera, CourtFollower, FollowedCamera, camera_by_homography, homography_between};

/// Follows the camera of a video by the court that it shows.
pub(super) struct CourtViews {
    follower: CourtFollower,
    given: Camera,
    /// The camera of the first view, as the lines show it there, and how far off that is (1-σ), px: what a camera that was given and the lines
    /// disagree about is the same in all frames.
    first: Option<(Camera, f64)>,
    /// That of the last frame, and the one before.
    last: [Option<Camera>; 2],
}

impl CourtViews {
    pub fn new(follower: CourtFollower, camera: Camera) -> Self {
        Self { follower, given: camera, first: None, last: [None, None] }
    }

    /// Takes the first view.
    pub fn begin(&mut self, planes: &Planes, config: &RegistrationConfig) {
        let seen = self.follower.follow(&planes.levels[0], &self.given, config.court_first_sigma);
        self.first = seen.map(|seen| (seen.camera, seen.sigma_px));
        self.last = [self.first.as_ref().map(|first| first.0.clone()), None];
    }

    /// The view of a frame, which registration says is `registered`, if it does; none where the court is not seen.
    pub fn view(&mut self, planes: &Planes, registered: Option<&View>, config: &RegistrationConfig) -> Option<View> {
        let (first, first_sigma) = self.first.as_ref()?;
        let follow = |camera: &Camera, sigma: f64| self.follower.follow(&planes.levels[0], camera, sigma);
        let by_registration = registered.and_then(|view| camera_by_homography(first, &view.frame_from_first));
        let by_registration = by_registration.and_then(|camera| follow(&camera, config.court_registered_sigma));
        let FollowedCamera { camera, sigma_px, .. } = by_registration.or_else(|| {
            let predicted = [self.extrapolated(), self.last[0].clone()].into_iter().flatten();
            predicted.into_iter().find_map(|camera| follow(&camera, config.court_lost_sigma))
        })?;
        let view = View::new(homography_between(first, &camera)?, sigma_px.hypot(*first_sigma))?;
        self.last = [Some(camera), self.last[0].take()];
        Some(view)
    }

    /// Takes the view of a frame that was found otherwise.
    pub fn accept(&mut self, view: &View) {
        let camera = self.first.as_ref().and_then(|(first, _)| camera_by_homography(first, &view.frame_from_first));
        self.last = [camera, self.last[0].take()];
    }

    /// The camera of the next frame, if it goes on as from the frame before to the last.
    fn extrapolated(&self) -> Option<Camera> {
        let [Some(last), Some(before)] = &self.last else { return None };
        camera_by_homography(last, &homography_between(before, last)?)
    }
}
