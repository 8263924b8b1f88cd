//! `Localiser`.

use burn::tensor::Device;
use js_sys::{Float32Array, Object};
use serde::Deserialize;
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::{js_error, object_of, set};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::evaluate::distance_to_ground_truth;
use crate::image::Picture;
use crate::localise::{LocaliseOptions, Localiser, Maps};
use crate::model::Card;
use crate::size::Size;

/// A model on a device, warmed up.
#[wasm_bindgen(js_name = Localiser)]
pub struct JsLocaliser {
    pub(super) localiser: Localiser,
    device_name: String,
}

/// What JavaScript asks for besides the position.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawOptions {
    #[serde(default)]
    maps: bool,
    #[serde(default)]
    truth: Option<[f64; 3]>,
}

#[wasm_bindgen(js_class = Localiser)]
impl JsLocaliser {
    /// Checks and loads `weights` for the model of `card` on `device` ("cpu" or "webgpu") and runs
    /// it once, so that the first picture pays nothing.
    pub async fn create(card: String, weights: Vec<u8>, device: String) -> std::result::Result<Self, JsValue> {
        let card = Card::from_json(&card, "model card").map_err(js_error)?;
        create(card, weights, &device).await.map_err(js_error)
    }

    /// The position of the ball in a PNG, JPEG or WebP file.
    pub async fn localise(
        &self,
        picture: Vec<u8>,
        camera: String,
        options: JsValue,
    ) -> std::result::Result<JsValue, JsValue> {
        let picture = Picture::decode(&picture).map_err(js_error)?;
        self.run(&picture, &camera, options).await.map_err(js_error)
    }

    /// The position of the ball in RGBA pixels.
    #[wasm_bindgen(js_name = localiseRgba)]
    pub async fn localise_rgba(
        &self,
        rgba: Vec<u8>,
        width: u32,
        height: u32,
        camera: String,
        options: JsValue,
    ) -> std::result::Result<JsValue, JsValue> {
        let picture = Picture::from_rgba(&rgba, Size { width, height }).map_err(js_error)?;
        self.run(&picture, &camera, options).await.map_err(js_error)
    }

    /// The device, in words.
    #[wasm_bindgen(getter, js_name = deviceName)]
    pub fn device_name(&self) -> String {
        self.device_name.clone()
    }
}

/// What only the build with the training knows.
#[wasm_bindgen(js_class = Localiser)]
impl JsLocaliser {
    /// How the depth found in a PNG, JPEG or WebP file depends on each pixel.
    pub fn saliency(&self, picture: Vec<u8>) -> std::result::Result<JsValue, JsValue> {
        self.saliency_of(&Picture::decode(&picture).map_err(js_error)?).map_err(js_error)
    }

    /// The same for RGBA pixels.
    #[wasm_bindgen(js_name = saliencyRgba)]
    pub fn saliency_rgba(&self, rgba: Vec<u8>, width: u32, height: u32) -> std::result::Result<JsValue, JsValue> {
        self.saliency_of(&Picture::from_rgba(&rgba, Size { width, height }).map_err(js_error)?).map_err(js_error)
    }
}

impl JsLocaliser {
    fn saliency_of(&self, picture: &Picture) -> Result<JsValue> {
        let found = self.localiser.saliency(picture)?;
        let object = Object::new();
        set(&object, "width", &JsValue::from_f64(found.width as f64));
        set(&object, "height", &JsValue::from_f64(found.height as f64));
        set(&object, "values", &Float32Array::from(found.values.as_slice()));
        set(&object, "depth", &JsValue::from_f64(found.depth));
        Ok(object.into())
    }
}

impl JsLocaliser {
    /// `localiser`, with the device's name in words.
    pub(super) fn named(localiser: Localiser, device_name: String) -> Self {
        Self { localiser, device_name }
    }

    async fn run(&self, picture: &Picture, camera: &str, options: JsValue) -> Result<JsValue> {
        let options: RawOptions = serde_wasm_bindgen::from_value(options).map_err(Error::format("options"))?;
        let camera = Camera::from_json(camera, "camera")?;
        let found = self.localiser.localise(picture, &camera, LocaliseOptions { maps: options.maps }).await?;
        let object = object_of(&found)?;
        set(&object, "notes", &object_of(&found.notes)?);
        if let Some(truth) = options.truth {
            set(&object, "dtg", &JsValue::from_f64(distance_to_ground_truth(found.world, truth)));
        }
        if let Some(maps) = &found.maps {
            set(&object, "maps", &js_maps(maps));
        }
        Ok(object)
    }
}

/// The CPU, in words.
pub(super) fn cpu_name() -> String {
    let vectors = if cfg!(feature = "relaxed-simd") { "relaxed SIMD" } else { "SIMD128" };
    format!("CPU ({vectors}, one thread)")
}

/// A warmed-up localiser. On WebGPU its output was compared with the CPU's: a pipeline that the browser refuses is not
/// reported as an error but computes garbage.
async fn create(card: Card, weights: Vec<u8>, device: &str) -> Result<JsLocaliser> {
    let (device, name) = device_of(device).await?;
    let is_cpu = device == Device::flex();
    let on_cpu = (!is_cpu).then(|| Localiser::new(card.clone(), weights.clone(), &Device::flex())).transpose()?;
    let localiser = Localiser::new(card, weights, &device)?;
    match &on_cpu {
        Some(on_cpu) => localiser.check_against(on_cpu).await?,
        None => localiser.warm_up().await?,
    }
    Ok(JsLocaliser::named(localiser, name))
}

#[cfg(feature = "wgpu")]
mod webgpu {
    use std::cell::RefCell;

    use burn::tensor::Device;

    use crate::error::{Error, Result};

    /// Commands that are gathered before they are submitted.
    const TASKS_MAX: usize = 32;

    thread_local! {
        /// The page's one WebGPU device: a second initialisation is an error.
        static DEVICE: RefCell<Option<Device>> = const { RefCell::new(None) };
    }

    /// The device, in words. Browsers keep the adapter's name to themselves, as a rule.
    pub(super) fn name(device: &Device) -> String {
        let adapter = device.identity().map(|identity| identity.name.to_string()).filter(|name| !name.is_empty());
        adapter.map_or_else(|| "WebGPU".into(), |name| format!("WebGPU ({name})"))
    }

    pub(super) async fn device() -> Result<Device> {
        if let Some(device) = DEVICE.with(|device| device.borrow().clone()) {
            return Ok(device);
        }
        let initialised = Device::wgpu_options().tasks_max(TASKS_MAX).init_async().await;
        let device =
            initialised.map_err(|error| Error::Device { device: "webgpu".into(), reason: error.to_string() })?;
        DEVICE.with(|slot| *slot.borrow_mut() = Some(device.clone()));
        Ok(device)
    }
}

#[cfg(not(feature = "wgpu"))]
mod webgpu {
    use burn::tensor::Device;

    use crate::error::{Error, Result};

    pub(super) fn name(_device: &Device) -> String {
        String::new()
    }

    pub(super) async fn device() -> Result<Device> {
        Err(Error::Device { device: "webgpu".into(), reason: "this is the CPU build of the package".into() })
    }
}

/// The device of a name, and what to call it.
pub(super) async fn device_of(name: &str) -> Result<(Device, String)> {
    match name {
        "cpu" => Ok((Device::flex(), cpu_name())),
        "webgpu" => webgpu::device().await.map(|device| {
            let words = webgpu::name(&device);
            (device, words)
        }),
        other => Err(Error::Device { device: other.into(), reason: "must be \"cpu\" or \"webgpu\"".into() }),
    }
}

fn js_maps(maps: &Maps) -> JsValue {
    let object = Object::new();
    set(&object, "width", &JsValue::from_f64(maps.width as f64));
    set(&object, "height", &JsValue::from_f64(maps.height as f64));
    set(&object, "heatmap", &Float32Array::from(maps.heatmap.as_slice()));
    set(&object, "depth", &Float32Array::from(maps.depth.as_slice()));
    object.into()
}
