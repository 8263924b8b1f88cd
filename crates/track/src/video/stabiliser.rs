//! Frames as a camera that stands still would show them.

use std::sync::Arc;

use nalgebra::Matrix3;

use super::config::RegistrationConfig;
use super::court::CourtViews;
use super::planes::{Planes, Spare};
use super::registration::Registration;
use super::state::State;
use super::view::{CameraMotion, View, displacement, is_still, scale};

/// A frame in the canvas's pixels.
#[derive(Clone)]
pub(super) struct Stabilised {
    pub planes: Arc<Planes>,
    /// Whether it is the frame as it was taken.
    pub as_taken: bool,
}

/// Finds the views of frames, and shows them as the canvas's view would.
pub(super) struct Stabiliser {
    config: RegistrationConfig,
    /// First frames of which one is the first view: the first with something that can be found again.
    first_frames: usize,
    /// Of the frames to the first view, if that can be found again; and to the first after a cut, while that view is shown.
    registration: Option<Registration>,
    other: Option<Registration>,
    /// The court that is seen, if the camera is known.
    court: Option<CourtViews>,
    /// Whether another view than the registered one is shown, since a cut.
    is_cut: bool,
    /// In whose pixels frames are stabilised: those of the first view, until the camera has moved far.
    canvas: View,
    /// The last stabilised frame.
    last: Option<Stabilised>,
}

impl Stabiliser {
    /// Without any frame yet.
    pub fn new(config: RegistrationConfig, first_frames: usize) -> Self {
        Self {
            config,
            first_frames,
            registration: None,
            other: None,
            court: None,
            is_cut: false,
            canvas: View::FIRST,
            last: None,
        }
    }

    /// Finds the views of frames by this court, too.
    pub fn see_court(&mut self, court: CourtViews) {
        self.court = Some(court);
    }

    /// The view of the canvas.
    pub fn canvas(&self) -> &View {
        &self.canvas
    }

    /// The view of the next frame, by what stands still in it, and where its camera looks, if not where it did at first.
    pub fn view(&mut self, planes: &Planes, state: &State) -> (View, Option<CameraMotion>) {
        let frames = state.frames();
        if self.registration.is_none() && frames.len() < self.first_frames {
            self.registration = Registration::of(planes, self.config);
            if self.registration.is_some()
                && let Some(court) = &mut self.court
            {
                court.begin(planes, &self.config);
            }
        }
        let due = !self.is_cut || frames.len().is_multiple_of(self.config.return_every);
        if let Some(view) = due.then(|| self.registered(planes)).flatten() {
            (self.is_cut, self.other) = (false, None);
            let moved = displacement(&view.frame_from_first, state.size);
            return (view, (moved > self.config.elsewhere_px).then_some(CameraMotion::Moved(moved)));
        }
        let last = frames.last().map_or(View::FIRST, |frame| frame.view);
        if self.is_cut {
            let view = self.other.as_mut().and_then(|other| {
                let view = other.view(planes)?;
                other.accept(planes, &view.frame_from_first, false);
                Some(view)
            });
            return (view.unwrap_or(last), Some(CameraMotion::Cut));
        }
        // Too little is found again: of a camera that stood still, because something is before it.
        let is_still = is_still(&last.frame_from_first, state.size, &self.config);
        (last, (!is_still).then_some(CameraMotion::Cut))
    }

    /// The view of a frame that shows the first one's surroundings: by what stands still, and where the camera moves, by the court's lines.
    fn registered(&mut self, planes: &Planes) -> Option<View> {
        let registration = self.registration.as_mut()?;
        let found = registration.view(planes);
        let size = [planes.width, planes.height];
        let moved = |view: &View| displacement(&view.frame_from_first, size) > self.config.elsewhere_px;
        let view = match (&mut self.court, &found) {
            (Some(court), found) if found.as_ref().is_none_or(moved) => {
                let seen = court.view(planes, found.as_ref(), &self.config);
                if let (None, Some(found)) = (&seen, found) {
                    court.accept(found);
                }
                seen.or(*found)?
            }
            (court, found) => {
                let view = (*found)?;
                court.iter_mut().for_each(|court| court.accept(&view));
                view
            }
        };
        registration.accept(planes, &view.frame_from_first, found.is_none());
        Some(view)
    }

    /// Stabilises about a frame of this view from now on, if it is far from the canvas's: returns the homography from its pixels to those of
    /// the old canvas.
    pub fn move_canvas(&mut self, view: &View, planes: &Planes, spare: &mut Spare) -> Option<Matrix3<f64>> {
        let size = [planes.width, planes.height];
        let away = view.frame_from_first * self.canvas.first_from_frame;
        let larger = scale(&away, size.map(|side| side as f64 / 2.0));
        let RegistrationConfig { canvas_moved, canvas_scaled, .. } = self.config;
        let is_far = displacement(&away, size) > canvas_moved * size[0] as f64
            || !(canvas_scaled.recip()..canvas_scaled).contains(&larger);
        if !is_far {
            return None;
        }
        let old_from_new = self.canvas.frame_from_first * view.first_from_frame;
        self.canvas = *view;
        if let Some(last) = &mut self.last {
            last.move_canvas(&old_from_new, planes, spare);
        }
        Some(old_from_new)
    }

    /// A frame of this view as the canvas shows it, and its differences from the frame before as that shows that; `since` are those of the
    /// frames as they were taken.
    pub fn stabilise(
        &mut self,
        view: &View,
        planes: Arc<Planes>,
        since: Option<Vec<u8>>,
        spare: &mut Spare,
    ) -> (Stabilised, Option<Vec<u8>>) {
        let frame_from_canvas = view.frame_from_first * self.canvas.first_from_frame;
        let as_taken = is_still(&frame_from_canvas, [planes.width, planes.height], &self.config);
        let before = self.last.take();
        let planes = match as_taken {
            true => planes,
            false => {
                let beyond = before.as_ref().map(|before| &*before.planes);
                Arc::new(planes.warped(&frame_from_canvas, beyond, spare))
            }
        };
        let since = match &before {
            Some(before) if !(as_taken && before.as_taken) => {
                since.into_iter().for_each(|bytes| spare.give(bytes));
                Some(before.planes.difference(&planes, spare))
            }
            _ => since,
        };
        let stabilised = Stabilised { planes, as_taken };
        self.last = Some(stabilised.clone());
        (stabilised, since)
    }

    /// Another picture is shown. Returns whether frames are no longer related to the first view.
    pub fn cut(&mut self) -> bool {
        self.canvas = View::FIRST;
        let Some(registration) = &mut self.registration else { return false };
        registration.start_again();
        self.is_cut = true;
        self.other = self.last.as_ref().and_then(|last| Registration::of(&last.planes, self.config));
        true
    }
}

impl Stabilised {
    /// The same in the pixels of another canvas; what it does not show is as in `planes`.
    pub fn move_canvas(&mut self, old_from_new: &Matrix3<f64>, planes: &Planes, spare: &mut Spare) {
        let moved = self.planes.warped(old_from_new, Some(planes), spare);
        *self = Self { planes: Arc::new(moved), as_taken: false };
    }
}
