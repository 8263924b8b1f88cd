//! The browser's boundary: an opaque handle, plain objects in and out, no arithmetic.

use std::cell::RefCell;

use js_sys::{Float32Array, Object, Reflect};
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::{JsCast as _, JsValue, wasm_bindgen};

use burn::tensor::Device;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::evaluate::distance_to_ground_truth;
use crate::image::Picture;
use crate::localise::{Localiser, Maps};
use crate::model::Card;

/// Name of the JavaScript errors.
const ERROR_NAME: &str = "GravisightError";

thread_local! {
    /// The last panic's message: a trap itself carries none.
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| LAST_PANIC.with(|last| *last.borrow_mut() = info.to_string())));
}

/// What the code said when it trapped; empty if it did not.
#[wasm_bindgen(js_name = lastPanic)]
pub fn last_panic() -> String {
    LAST_PANIC.with(|last| last.borrow().clone())
}

/// A model on a device, warmed up.
#[wasm_bindgen(js_name = Localiser)]
pub struct JsLocaliser {
    localiser: Localiser,
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
        let create = match device.as_str() {
            "cpu" => cpu(card, weights).await,
            "webgpu" => webgpu::create(card, weights).await,
            other => Err(Error::Device { device: other.into(), reason: "must be \"cpu\" or \"webgpu\"".into() }),
        };
        create.map_err(js_error)
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
        let picture = Picture::from_rgba(&rgba, [width, height]).map_err(js_error)?;
        self.run(&picture, &camera, options).await.map_err(js_error)
    }

    /// The device, in words.
    #[wasm_bindgen(getter, js_name = deviceName)]
    pub fn device_name(&self) -> String {
        self.device_name.clone()
    }
}

impl JsLocaliser {
    async fn run(&self, picture: &Picture, camera: &str, options: JsValue) -> Result<JsValue> {
        let options: RawOptions = serde_wasm_bindgen::from_value(options).map_err(Error::format("options"))?;
        let camera = Camera::from_json(camera, "camera")?;
        let found = self.localiser.localise(picture, &camera, options.maps).await?;
        // Plain objects, not `Map`s.
        let serialiser = serde_wasm_bindgen::Serializer::json_compatible();
        let object = found.serialize(&serialiser).map_err(Error::format("result"))?;
        set(&object, "notes", &found.notes.serialize(&serialiser).map_err(Error::format("result"))?);
        if let Some(truth) = options.truth {
            set(&object, "dtg", &JsValue::from_f64(distance_to_ground_truth(found.world, truth)));
        }
        if let Some(maps) = &found.maps {
            set(&object, "maps", &js_maps(maps));
        }
        Ok(object)
    }
}

/// A warmed-up localiser on the CPU.
async fn cpu(card: Card, weights: Vec<u8>) -> Result<JsLocaliser> {
    let localiser = Localiser::new(card, weights, &Device::flex())?;
    localiser.warm_up().await?;
    let vectors = if cfg!(feature = "relaxed-simd") { "relaxed SIMD" } else { "SIMD128" };
    Ok(JsLocaliser { localiser, device_name: format!("CPU ({vectors}, one thread)") })
}

#[cfg(feature = "wgpu")]
mod webgpu {
    use std::cell::RefCell;

    use burn::tensor::Device;

    use super::JsLocaliser;
    use crate::error::{Error, Result};
    use crate::localise::Localiser;
    use crate::model::Card;

    /// Commands that are gathered before they are submitted.
    const TASKS_MAX: usize = 32;

    thread_local! {
        /// The page's one WebGPU device: a second initialisation is an error.
        static DEVICE: RefCell<Option<Device>> = const { RefCell::new(None) };
    }

    /// A warmed-up localiser on WebGPU whose output was compared with the CPU's: a pipeline that
    /// the browser refuses is not reported as an error but computes garbage.
    pub(super) async fn create(card: Card, weights: Vec<u8>) -> Result<JsLocaliser> {
        let device = device().await?;
        let on_cpu = Localiser::new(card.clone(), weights.clone(), &Device::flex())?;
        let localiser = Localiser::new(card, weights, &device)?;
        localiser.check_against(&on_cpu).await?;
        // Browsers keep the adapter's name to themselves, as a rule.
        let adapter = device.identity().map(|identity| identity.name.to_string()).filter(|name| !name.is_empty());
        let device_name = adapter.map_or_else(|| "WebGPU".into(), |name| format!("WebGPU ({name})"));
        Ok(JsLocaliser { localiser, device_name })
    }

    async fn device() -> Result<Device> {
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
    use super::JsLocaliser;
    use crate::error::{Error, Result};
    use crate::model::Card;

    pub(super) async fn create(_card: Card, _weights: Vec<u8>) -> Result<JsLocaliser> {
        Err(Error::Device { device: "webgpu".into(), reason: "this is the CPU build of the package".into() })
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

/// A JavaScript `Error` with the text and [`Error::code`].
fn js_error(error: Error) -> JsValue {
    let object = js_sys::Error::new(&error.to_string());
    object.set_name(ERROR_NAME);
    set(&object, "code", &JsValue::from_str(error.code()));
    object.into()
}

/// Sets a property of a fresh, extensible object, which cannot fail.
fn set(object: &JsValue, key: &str, value: &JsValue) {
    Reflect::set(object.unchecked_ref::<Object>(), &JsValue::from_str(key), value).ok();
}
