//! `Adapter`.

use js_sys::Uint8Array;
use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::device::{AdapterInfo, Named, device_of};
use super::fine_tuner::Model;
use super::held::MOST_BYTES;
use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use gravisight::model::Card;
use gravisight::train::{AdaptFlights, AdaptOptions, AdaptScore, AdaptStep, Adapted, Adapter};
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_track::{TrackedFrame, TrackedVideo};

/// What is read of a tracked video.
#[derive(Deserialize)]
struct TrackedFrames {
    explained: Option<bool>,
    frames: Vec<TrackedFrame>,
}

/// Where a run is.
#[derive(Serialize, Tsify)]
pub struct AdaptProgress {
    /// Steps done.
    pub step: usize,
    /// Steps in all.
    pub steps: usize,
}

/// The adapted model, and what it gained.
#[derive(Serialize, Tsify)]
pub struct AdaptedModel {
    /// A complete model: use it in place of the original.
    pub model: Model,
    /// What the model before found in the held-out flights.
    pub before: AdaptScore,
    /// What the adapted one finds there.
    pub after: AdaptScore,
}

/// A model that learns a ball from tracked videos.
#[wasm_bindgen(js_name = Adapter)]
pub struct JsAdapter {
    adapter: Adapter,
    device: Named,
}

#[wasm_bindgen(js_class = Adapter)]
impl JsAdapter {
    /// Starts from the model of `card` and `weights` on `device` ("cpu" or "webgpu"); `options` is JSON.
    pub async fn create(
        card: String,
        weights: Vec<u8>,
        options: String,
        device: String,
    ) -> std::result::Result<Self, JsValue> {
        let create = async || -> Result<Self> {
            let options: AdaptOptions = serde_json::from_str(&options).map_err(Error::format("options"))?;
            let device = device_of(&device).await?;
            let adapter = Adapter::new(Card::from_json(&card, "model card")?, weights, &options, &device.device)?;
            Ok(Self { adapter, device })
        };
        create().await.map_err(js_error)
    }

    /// Goes on from what [`Self::checkpoint`] gave, on `device`, once its videos are given again.
    pub async fn resume(checkpoint: Vec<u8>, device: String) -> std::result::Result<Self, JsValue> {
        let resume = async || -> Result<Self> {
            let device = device_of(&device).await?;
            let adapter = Adapter::resume(&checkpoint, &device.device)?;
            Ok(Self { adapter, device })
        };
        resume().await.map_err(js_error)
    }

    /// All that is needed to go on later but for the videos.
    pub async fn checkpoint(&self) -> std::result::Result<Uint8Array, JsValue> {
        self.adapter.checkpoint().await.map(|bytes| bytes.as_slice().into()).map_err(js_error)
    }

    /// Where the run is.
    pub fn progress(&self) -> std::result::Result<Ts<AdaptProgress>, JsValue> {
        let [step, steps] = self.adapter.progress();
        object_of(&AdaptProgress { step, steps }).map_err(js_error)
    }

    /// Begins with a tracked video (JSON), whose frames follow; `seeds` (JSON) are frames and pixels in which a person saw the ball. With the camera
    /// (JSON) and the ball's radius (m) the sizes are those at the distances that physics finds.
    pub fn begin(
        &mut self,
        tracked: &str,
        seeds: &str,
        camera: Option<String>,
        radius: Option<f64>,
    ) -> std::result::Result<Ts<AdaptFlights>, JsValue> {
        let begin = || {
            let TrackedFrames { explained, frames } =
                serde_json::from_str(tracked).map_err(Error::format("tracked video"))?;
            let seeds: Vec<(usize, [f64; 2])> = serde_json::from_str(seeds).map_err(Error::format("seeds"))?;
            let mut video = TrackedVideo::default();
            (video.explained, video.frames) = (explained, frames);
            let camera = camera.map(|camera| Camera::from_json(&camera, "camera")).transpose()?;
            if let Some(radius) = radius.filter(|radius| !(*radius > 0.0 && radius.is_finite())) {
                return Err(Error::value("ball", "radius", format!("must be a positive number, not {radius}")));
            }
            object_of(&self.adapter.begin(&video, &seeds, camera.as_ref().zip(radius))?)
        };
        begin().map_err(js_error)
    }

    /// The video's next frame, of `time` s.
    pub async fn add(&mut self, picture: AnyPicture, time: f64) -> std::result::Result<(), JsValue> {
        let mut add = async || -> Result<()> {
            self.adapter.add(picture::read(&picture).await?, time).await?;
            let bytes = self.adapter.picture_bytes();
            if bytes > MOST_BYTES {
                let reason = format!(
                    "the training images take {} MiB, but the limit is {} MiB; use fewer or smaller videos",
                    bytes >> 20,
                    MOST_BYTES >> 20
                );
                return Err(Error::Data { what: "videos".into(), reason });
            }
            Ok(())
        };
        add().await.map_err(js_error)
    }

    /// The video has no more frames.
    pub async fn end(&mut self) -> std::result::Result<(), JsValue> {
        self.adapter.end().await.map_err(js_error)
    }

    /// One step; undefined after the last.
    pub async fn step(&mut self) -> std::result::Result<Option<Ts<AdaptStep>>, JsValue> {
        let made = self.adapter.step().await.map_err(js_error)?;
        made.map(|step| object_of(&step)).transpose().map_err(js_error)
    }

    /// The adapted model, called `name`.
    pub async fn finish(&self, name: String) -> std::result::Result<Ts<AdaptedModel>, JsValue> {
        let finish = async || -> Result<Ts<AdaptedModel>> {
            let Adapted { card, weights, before, after } = self.adapter.finish(&name).await?;
            let model = Model { card: card.to_json()?, weights: weights.as_slice().into() };
            object_of(&AdaptedModel { model, before, after })
        };
        finish().await.map_err(js_error)
    }

    /// The device, in words.
    #[wasm_bindgen(getter, js_name = deviceName)]
    pub fn device_name(&self) -> String {
        self.device.name.clone()
    }

    /// The WebGPU adapter of the device; undefined on the CPU.
    #[wasm_bindgen(getter)]
    pub fn adapter(&self) -> std::result::Result<Option<Ts<AdapterInfo>>, JsValue> {
        self.device.adapter.as_ref().map(object_of).transpose().map_err(js_error)
    }
}
