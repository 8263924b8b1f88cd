//! `Localiser`.

use std::sync::Arc;

use gravisight::Device;
use js_sys::Float32Array;
use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::device::{AdapterInfo, Named, device_of, now};
use super::picture::{self, AnyPicture};
use super::tracker::JsVideoTracker;
use super::{js_error, object_of};
use gravisight::localise::{Localisation, LocaliseOptions, Localiser, Maps, Region, Saliency};
use gravisight::model::Card;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::Scene;
use gravisight_track::TrackerConfig;

/// A model on a device, warmed up.
#[wasm_bindgen(js_name = Localiser)]
pub struct JsLocaliser {
    localiser: Arc<Localiser>,
    device: Named,
}

/// What is asked for besides the position.
#[derive(Default, Deserialize, Tsify)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Wanted {
    /// Also return the heatmap.
    #[serde(default)]
    heatmap: bool,
    /// Also return the depth map.
    #[serde(default)]
    depth_map: bool,
    /// The ball's radius, in metres: a model that reads sizes needs it.
    #[serde(default)]
    ball_radius: Option<f64>,
    /// Search this part of the picture alone.
    #[serde(default)]
    region: Option<Region>,
    /// What the camera looks at: where it says that the ball cannot be, none is taken for it.
    #[serde(default)]
    scene: Option<Scene>,
    /// Also return so many likely places.
    #[serde(default)]
    candidates: usize,
    /// `oneSigma` of the calibration that made the camera: its uncertainty enters σ. Of a model that reads sizes.
    #[serde(default)]
    camera_sigma: Vec<Camera>,
    /// The true position in the world, in metres: the result then carries `dtg`, the distance to it.
    #[serde(default)]
    truth: Option<[f64; 3]>,
}

/// Where the ball is in a picture, and what else was asked for.
#[derive(Serialize, Tsify)]
#[tsify(missing_as_null, hashmap_as_object)]
#[serde(rename_all = "camelCase")]
pub struct Position {
    /// Where the ball is.
    #[serde(flatten)]
    pub found: Localisation,
    /// Time that it took, the picture's reading included.
    pub milliseconds: f64,
    /// Distance to `truth` in metres, where it was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[tsify(optional)]
    pub dtg: Option<f64>,
    /// Probability that the ball is in the cell; sums to 1. Where asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[tsify(optional)]
    pub heatmap: Option<FloatMap>,
    /// Distance along the camera's axis, in metres. Where asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[tsify(optional)]
    pub depth_map: Option<FloatMap>,
}

/// A map over the whole picture, row-major.
#[derive(Serialize, Tsify)]
pub struct FloatMap {
    /// Cells in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One a cell.
    #[serde(with = "serde_wasm_bindgen::preserve")]
    #[tsify(type = "Float32Array")]
    pub values: Float32Array,
}

#[wasm_bindgen(js_class = Localiser)]
impl JsLocaliser {
    /// Checks and loads `weights` for the model of `card` on `device` ("cpu" or "webgpu") and runs
    /// it once, so that the first picture pays nothing.
    pub async fn create(card: String, weights: Vec<u8>, device: String) -> std::result::Result<Self, JsValue> {
        let card = Card::from_json(&card, "model card").map_err(js_error)?;
        create(card, weights, &device).await.map_err(js_error)
    }

    /// The position of the ball in a picture that `camera` (JSON) took.
    pub async fn localise(
        &self,
        picture: AnyPicture,
        camera: String,
        options: Option<Ts<Wanted>>,
    ) -> std::result::Result<Ts<Position>, JsValue> {
        self.run(&picture, &camera, options).await.map_err(js_error)
    }

    /// How the depth found in a picture depends on each pixel, in metres by full brightness; of a model that reads sizes as a share of
    /// the depth. On the CPU.
    pub async fn saliency(&self, picture: AnyPicture) -> std::result::Result<Ts<FloatMap>, JsValue> {
        let saliency = async || {
            let Saliency { width, height, values, .. } =
                self.localiser.saliency(&picture::read(&picture).await?).await?;
            object_of(&FloatMap { width, height, values: values.as_slice().into() })
        };
        saliency().await.map_err(js_error)
    }

    /// Runs the network on a test picture of the size that its card names: the time that this takes, ms.
    pub async fn measure(&self) -> std::result::Result<f64, JsValue> {
        let start = now();
        self.localiser.warm_up().await.map_err(js_error)?;
        Ok(now() - start)
    }

    /// Follows the ball through a video with this model, which lives as long as the tracker does; `camera` (JSON) films it, if
    /// that is known. `config` (JSON) holds the tracker's numbers that are not the usual ones. The lines of a `court` tell how the camera turns and
    /// zooms.
    pub fn tracker(
        &self,
        camera: Option<String>,
        config: Option<String>,
        court: Option<String>,
    ) -> std::result::Result<JsVideoTracker, JsValue> {
        let camera = camera.map(|camera| Camera::from_json(&camera, "camera")).transpose().map_err(js_error)?;
        let config = config.map(|config| TrackerConfig::from_json(&config)).transpose().map_err(js_error)?;
        JsVideoTracker::new(Arc::clone(&self.localiser), camera, config.unwrap_or_default(), court.as_deref())
            .map_err(js_error)
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

impl JsLocaliser {
    pub(super) fn new(localiser: Localiser, device: Named) -> Self {
        Self { localiser: Arc::new(localiser), device }
    }

    async fn run(&self, picture: &AnyPicture, camera: &str, wanted: Option<Ts<Wanted>>) -> Result<Ts<Position>> {
        let start = now();
        let wanted = wanted.map(|wanted| wanted.to_rust()).transpose().map_err(Error::format("options"))?;
        let wanted = wanted.unwrap_or_default();
        let picture = picture::read(picture).await?;
        let camera = Camera::from_json(camera, "camera")?;
        // A model of one scene knows itself where its ball can be.
        let volume = wanted.scene.as_ref().and_then(Scene::volume).filter(|_| self.localiser.reads_size());
        let mut found = self
            .localiser
            .localise(
                &picture,
                &camera,
                LocaliseOptions {
                    maps: wanted.heatmap || wanted.depth_map,
                    ball_radius: wanted.ball_radius,
                    region: wanted.region,
                    candidates: wanted.candidates,
                    volume,
                },
            )
            .await?;
        if let Some(radius) = wanted.ball_radius.filter(|_| !wanted.camera_sigma.is_empty()) {
            found.add_camera_sigma(&camera.for_picture(picture.size())?, radius, &wanted.camera_sigma)?;
        }
        found.doubt(&camera, &wanted.scene.map_or(vec![], |scene| scene.landmarks()));
        let map = |wanted: bool, values: fn(&Maps) -> &[f32]| {
            let maps = found.maps.as_ref().filter(|_| wanted);
            maps.map(|maps| FloatMap { width: maps.width, height: maps.height, values: values(maps).into() })
        };
        let dtg = wanted.truth.map(|truth| found.dtg(truth));
        object_of(&Position {
            dtg,
            heatmap: map(wanted.heatmap, |maps| &maps.heatmap),
            depth_map: map(wanted.depth_map, |maps| &maps.depth),
            milliseconds: now() - start,
            found,
        })
    }
}

/// A warmed-up localiser. On WebGPU its output was compared with the CPU's: a pipeline that the browser refuses is not
/// reported as an error but computes garbage.
async fn create(card: Card, weights: Vec<u8>, device: &str) -> Result<JsLocaliser> {
    let named = device_of(device).await?;
    let is_cpu = named.device == Device::flex();
    let on_cpu = (!is_cpu).then(|| Localiser::new(card.clone(), weights.clone(), &Device::flex())).transpose()?;
    let localiser = Localiser::new(card, weights, &named.device)?;
    match &on_cpu {
        Some(on_cpu) => localiser.check_against(on_cpu).await?,
        None => localiser.warm_up().await?,
    }
    Ok(JsLocaliser::new(localiser, named))
}
