//! Several pictures at once, of models that give depth: what validation asks for.

use nalgebra::{Point2, Point3};

use super::Localiser;
use super::network::Seen;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::Result;
use gravisight_geometry::image::{NetworkInput, Picture};
use gravisight_geometry::size::Size;

/// A picture as a network takes it.
pub(crate) struct Taken {
    pub(super) values: Vec<f32>,
    pub(super) view: View,
}

/// What leads from the network's input back to the picture and to metres.
pub(super) struct View {
    /// Of the picture.
    size: Size,
    /// The part of the input that shows it.
    pub(super) content: Size,
    /// Scaled to the picture.
    pub(super) camera: Camera,
}

impl View {
    /// What lies at `at` in the input, px, at `depth`, m: in the picture, px, and in the camera's frame.
    pub(super) fn position(&self, at: [f64; 2], depth: f64) -> Result<([f64; 2], Point3<f64>)> {
        let (given, content) = (self.size.xy(), self.content.xy());
        let image = std::array::from_fn(|axis| (at[axis] + 0.5) * given[axis] / content[axis] - 0.5);
        Ok((image, self.camera.camera_from_image(&Point2::from(image), depth)?))
    }
}

/// Where the ball is in one of several pictures.
pub(crate) struct Position {
    /// In the picture, px.
    pub(crate) image: Point2<f64>,
    /// In the world, m.
    pub(crate) world: Point3<f64>,
    pub(crate) confidence: f64,
}

impl Localiser {
    /// `picture`, taken by `camera`, as the network takes it.
    ///
    /// # Errors
    /// [`Error::CameraMismatch`].
    pub(crate) fn take(&self, picture: &Picture, camera: &Camera) -> Result<Taken> {
        let size = picture.size();
        let camera = camera.for_picture(size)?;
        let NetworkInput { values, content, .. } = picture.network_input(self.card.input, &self.card.normalisation);
        Ok(Taken { values, view: View { size, content, camera } })
    }

    /// Where the network sees the ball in each of several pictures: with a model that gives depth.
    ///
    /// # Errors
    /// [`Error::OutputNotFinite`], [`Error::Device`], [`Error::Distortion`].
    pub(crate) async fn positions(&self, pictures: Vec<Taken>) -> Result<Vec<Result<Position>>> {
        let (mut values, mut views) = (Vec::new(), Vec::new());
        for taken in pictures {
            values.extend(taken.values);
            views.push(taken.view);
        }
        let seen = self.run_all(values).await?;
        let position = |(seen, view): (Seen, View)| {
            let (image, in_camera) = view.position(seen.image, seen.depth)?;
            let world = view.camera.world_from_camera(&in_camera);
            Ok(Position { image: image.into(), world, confidence: seen.confidence })
        };
        Ok(seen.into_iter().zip(views).map(position).collect())
    }
}
