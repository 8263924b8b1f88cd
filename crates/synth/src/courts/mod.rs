//! Pictures of courts by random cameras, as people film them; of each the exact camera. Some pictures show no court.
//!
//! For measuring and fitting what finds a court's camera by its lines. A picture is drawn from (seed, split, court, number) alone.

mod furniture;
mod ground;
mod lens;
mod markings;
mod piece;
mod scene;
#[cfg(test)]
mod tests;
mod viewpoint;

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

pub use self::markings::courts;
use self::scene::Scenery;
use super::sets::Split;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::random::Stream;

/// What names of pictures without a court begin with.
const EMPTY: &str = "empty";

/// A picture in the making.
pub struct CourtPicture {
    name: String,
    scenery: Scenery,
    seed: u64,
    /// What the seed's numbers are drawn for: the split and the name.
    stream: String,
}

impl CourtPicture {
    /// The picture `number` of a court, one of [`courts`]; without one, a picture that shows none.
    ///
    /// # Errors
    /// [`Error::Data`] where no camera is found that sees the court; as
    /// [`Court::named`](gravisight_geometry::camera::Court::named).
    pub fn draw(court: Option<&'static str>, split: Split, number: usize, seed: u64) -> Result<Self> {
        let name = format!("{}-{number:03}", court.unwrap_or(EMPTY));
        let stream = format!("courts/{}/{name}", split.name());
        let scenery = Scenery::draw(court, &mut Stream::Scene.of_named(seed, &stream))?;
        Ok(Self { name, scenery, seed, stream })
    }

    /// As in file names.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What takes the picture.
    pub fn camera(&self) -> &Camera {
        &self.scenery.camera
    }

    /// The picture before it is compressed.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn picture(&self) -> Result<RgbImage> {
        self.scenery.picture(&mut Stream::FrameNoise.of_named(self.seed, &self.stream))
    }

    /// The picture as a JPEG file.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn jpeg(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, self.scenery.quality);
        self.picture()?
            .write_with_encoder(encoder)
            .map_err(|error| Error::Data { what: self.name.clone(), reason: error.to_string() })?;
        Ok(bytes)
    }
}
