//! What a step is given: pictures, their labels, and windows of them where forecasts teach.

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};

use gravisight_geometry::camera::Camera;
use gravisight_physics::Forecaster;

/// Pictures with their labels.
#[derive(Debug, Clone)]
pub struct Batch {
    /// Normalised pictures, `[batch, height, width, channels]`, row-major.
    pub pictures: Vec<f32>,
    /// Height and width of the pictures, px.
    pub size: [usize; 2],
    /// Their channels: 3; 6 for the verifier, whose input is a crop and its surroundings.
    pub channels: usize,
    /// Their labels.
    pub labels: Labels,
    /// Windows among them, where forecasts teach.
    pub windows: Vec<Window>,
}

impl Batch {
    /// Pictures.
    pub fn count(&self) -> usize {
        self.pictures.len() / (self.channels * self.size[0] * self.size[1])
    }
}

/// Labels of a batch: one of each ball, and of each picture without one.
#[derive(Debug, Clone, Default)]
pub struct Labels {
    /// Index of the picture in the batch, rising.
    pub picture: Vec<usize>,
    /// 2D positions, px of the network's input; none for a picture without the ball.
    pub image: Vec<Option<[f64; 2]>>,
    /// Depths (camera z), m.
    pub depth: Vec<f64>,
    /// How much each depth counts, 0 (not at all: forecasts teach, or there is no ball) to 1.
    pub depth_weight: Vec<f64>,
}

/// The affine map from a drawn picture to the clip's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureTransform {
    /// From an offset in the drawn picture to an offset in the clip's, px.
    pub linear: Matrix2<f64>,
    /// Where the drawn picture's first pixel lies in the clip's, px.
    pub origin: Vector2<f64>,
    /// The clip's depths over the drawn picture's: it was magnified by as much, and looks nearer.
    pub zoom: f64,
}

impl PictureTransform {
    /// Where a point of the clip's picture is in the drawn one, px.
    pub fn picture_from_clip(&self, point: [f64; 2]) -> [f64; 2] {
        let inverse = self.linear.try_inverse().unwrap_or_else(Matrix2::identity); // a rotation times a number is never singular
        (inverse * (Vector2::from(point) - self.origin)).into()
    }

    /// Px of the clip's picture to one of the drawn one, in the mean over directions.
    pub fn scale(&self) -> f64 {
        self.linear.determinant().abs().sqrt()
    }

    /// Where a point of the drawn picture is in the clip's, px.
    pub fn clip_from_picture(&self, point: [f64; 2]) -> [f64; 2] {
        (self.linear * Vector2::from(point) + self.origin).into()
    }
}

/// What a forecast must meet, or what tells where the ball flies: a 2D position; or where the ball is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// A 2D label, px of the clip's picture.
    Label([f64; 2]),
    /// The network's own 2D position in this picture of the batch, detached.
    Predicted {
        /// Index in the batch.
        picture: usize,
        /// Its transform.
        transform: PictureTransform,
    },
    /// The network's own 2D position in this frame when it last saw it.
    Remembered(FrameId),
    /// No forecast: what the network finds in this picture of the batch must be the true position, camera coordinates, m.
    True {
        /// Index in the batch.
        picture: usize,
        /// Its transform.
        transform: PictureTransform,
        /// Where the ball is.
        position: [f64; 3],
    },
}

/// A frame of a run's clips: numbers of the clip and of the frame in it.
pub type FrameId = [usize; 2];

/// What a forecast starts from: position and velocity.
#[derive(Debug, Clone)]
pub enum Start {
    /// Three neighbouring pictures of the batch, from `Window::first` on; the middle one's time is 0.
    Pictures {
        /// Their transforms.
        transforms: [PictureTransform; 3],
        /// Their times, s.
        times: [f64; 3],
    },
    /// One picture of the batch, at time 0, and the 2D positions around it.
    Track {
        /// Its transform.
        transform: PictureTransform,
        /// Which frame it is.
        frame: FrameId,
        /// Times, s, and 2D positions of the frames around and of itself, by time.
        around: Vec<(f64, Target)>,
        /// The clip's physics with nothing to touch.
        free: Arc<Forecaster>,
    },
}

/// What a forecast starts from, and what it must meet.
#[derive(Debug, Clone)]
pub struct Window {
    /// Index in the batch of the first of its pictures; the others follow.
    pub first: usize,
    /// Position and velocity at time 0.
    pub start: Start,
    /// Radius of the ball, m, where the network reads its apparent radius, px, instead of its depth; else none.
    pub ball_radius: Option<f64>,
    /// From the clip's first frame to time 0, s.
    pub since_start: f64,
    /// The camera of the clip's pictures.
    pub camera: Camera,
    /// The clip's physics.
    pub forecaster: Arc<Forecaster>,
    /// Times, s, and targets.
    pub ahead: Vec<(f64, Target)>,
}

impl Window {
    /// Times of what the forecast must meet, s.
    pub fn times(&self) -> Vec<f64> {
        self.ahead.iter().map(|(time, _)| *time).collect()
    }
}
