//! Coordinates, and what a frame shows of the first view: the homography between them, as of a camera that turns and zooms about its centre.
//!
//! A place has the pixels that it counts in as its type, so that places of different frames can only be compared in the first view.

use std::marker::PhantomData;

use nalgebra::{Matrix3, Point2};

use super::config::RegistrationConfig;

/// Points along each side of the picture at which displacements are measured.
const GRID: usize = 5;

/// The pixels of the first view: those in which what different frames show is compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FirstView;

/// The pixels of a frame as it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FramePixels;

/// The pixels of the canvas, about which frames are stabilised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CanvasPixels;

/// A place, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place<Pixels> {
    pub xy: [f64; 2],
    pixels: PhantomData<Pixels>,
}

impl<Pixels> Place<Pixels> {
    pub const fn new(xy: [f64; 2]) -> Self {
        Self { xy, pixels: PhantomData }
    }

    /// The way from another place to this one, px.
    pub fn minus(&self, other: &Self) -> [f64; 2] {
        [self.xy[0] - other.xy[0], self.xy[1] - other.xy[1]]
    }

    /// px.
    pub fn distance(&self, other: &Self) -> f64 {
        let [x, y] = self.minus(other);
        x.hypot(y)
    }
}

/// Where a camera looks that no longer looks where it did at first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraMotion {
    /// It turned, moved or zoomed: what stands still is so far away in the picture, px, from where it was.
    Moved(f64),
    /// Most of the picture changed at once.
    Cut,
}

/// The view of a frame: from its pixels to those of the first view and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    pub first_from_frame: Matrix3<f64>,
    pub frame_from_first: Matrix3<f64>,
    /// Standard deviation of a point that it maps, along each axis, px of the first view.
    pub sigma: f64,
}

impl View {
    /// The first view.
    pub const FIRST: Self = Self {
        first_from_frame: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        frame_from_first: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        sigma: 0.0,
    };

    /// By its homography; none where that has no inverse.
    pub fn new(frame_from_first: Matrix3<f64>, sigma: f64) -> Option<Self> {
        let first_from_frame = frame_from_first.try_inverse()?;
        let is_finite = first_from_frame.iter().all(|value| value.is_finite());
        is_finite.then_some(Self { first_from_frame, frame_from_first, sigma })
    }

    /// Where a place of the frame is in the first view.
    pub fn first(&self, at: &Place<FramePixels>) -> Place<FirstView> {
        Place::new(mapped(&self.first_from_frame, at.xy))
    }

    /// Where a place of the first view is in the frame.
    pub fn frame(&self, at: &Place<FirstView>) -> Place<FramePixels> {
        Place::new(mapped(&self.frame_from_first, at.xy))
    }

    /// How much larger things are in the first view than in the frame, at a place of the frame.
    pub fn scale(&self, at: &Place<FramePixels>) -> f64 {
        scale(&self.first_from_frame, at.xy)
    }
}

/// Where a homography puts a point, px.
pub(super) fn mapped(homography: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let at = homography.transform_point(&Point2::new(x, y));
    [at.x, at.y]
}

/// Root of the factor by which a homography enlarges areas at a point.
pub(super) fn scale(homography: &Matrix3<f64>, [x, y]: [f64; 2]) -> f64 {
    let depth = homography[(2, 0)] * x + homography[(2, 1)] * y + homography[(2, 2)];
    (homography.determinant() / depth.powi(3)).abs().sqrt()
}

/// Mean distance by which a homography moves the points of a picture of `size`, px.
pub(super) fn displacement(homography: &Matrix3<f64>, size: [usize; 2]) -> f64 {
    let along = |index: usize, side: usize| index as f64 / (GRID - 1) as f64 * side as f64;
    let points = (0..GRID * GRID).map(|index| [along(index % GRID, size[0]), along(index / GRID, size[1])]);
    let moved = points.map(|at| {
        let to = mapped(homography, at);
        (to[0] - at[0]).hypot(to[1] - at[1])
    });
    moved.sum::<f64>() / (GRID * GRID) as f64
}

/// Whether a homography leaves a picture of `size` where it is.
pub(super) fn is_still(homography: &Matrix3<f64>, size: [usize; 2], config: &RegistrationConfig) -> bool {
    displacement(homography, size) < config.still_px
}
