//! Devices: what they are called, what they can do, and the clock.

use gravisight::Device;
use serde::{Deserialize, Serialize};
use tsify::Tsify;
use wasm_bindgen::prelude::{JsCast, JsValue, wasm_bindgen};
use web_sys::Window;

use gravisight_geometry::error::{Error, Result};
use gravisight_kernels::threads;

/// A WebGPU adapter, as far as the browser tells: some keep its names to themselves.
#[derive(Debug, Clone, Default, Serialize, Deserialize, Tsify)]
#[serde(rename_all = "camelCase", default)]
pub struct AdapterInfo {
    /// Such as `nvidia`.
    pub vendor: String,
    /// Its family, such as `ampere`.
    pub architecture: String,
    /// The vendor's number of the device.
    pub device: String,
    /// For people.
    pub description: String,
    /// Its limits.
    pub limits: AdapterLimits,
}

/// What a WebGPU adapter allows at most.
#[derive(Debug, Clone, Default, Serialize, Deserialize, Tsify)]
#[serde(rename_all = "camelCase", default)]
pub struct AdapterLimits {
    /// Bytes of a buffer.
    pub max_buffer_size: f64,
    /// Bytes of a buffer that a kernel sees.
    pub max_storage_buffer_binding_size: f64,
    /// Bytes that the threads of a workgroup share.
    pub max_compute_workgroup_storage_size: f64,
    /// Threads of a workgroup.
    pub max_compute_invocations_per_workgroup: f64,
}

impl AdapterInfo {
    /// For people; empty where the browser keeps the names to itself.
    fn name(&self) -> String {
        let parts = [&self.vendor, &self.architecture, &self.description];
        parts.into_iter().filter(|part| !part.is_empty()).cloned().collect::<Vec<_>>().join(" ")
    }
}

/// What web-sys has only among its unstable parts, which every user of the crate would have to turn on.
#[wasm_bindgen]
extern "C" {
    type GpuNavigator;
    #[wasm_bindgen(method, getter)]
    fn gpu(this: &GpuNavigator) -> Option<Gpu>;

    type Gpu;
    #[wasm_bindgen(method, catch, js_name = requestAdapter)]
    async fn request_adapter(this: &Gpu, options: &JsValue) -> std::result::Result<JsValue, JsValue>;

    type GpuAdapter;
    #[wasm_bindgen(method, getter)]
    fn info(this: &GpuAdapter) -> JsValue;
    #[wasm_bindgen(method, getter)]
    fn limits(this: &GpuAdapter) -> JsValue;
}

/// This thread's global scope. A Worker's and Node.js's have under the same names what is used of it.
pub(super) fn scope() -> Window {
    js_sys::global().unchecked_into()
}

/// This thread's clock, ms.
pub(super) fn now() -> f64 {
    scope().performance().map_or(0.0, |clock| clock.now())
}

/// The WebGPU adapter that a model runs on in this browser; none where there is none.
async fn adapter() -> Option<AdapterInfo> {
    let navigator: JsValue = js_sys::Reflect::get(&scope(), &"navigator".into()).ok()?;
    let navigator = navigator.is_object().then(|| navigator.unchecked_into::<GpuNavigator>())?;
    // As Burn asks for it.
    let options = js_sys::Object::new();
    js_sys::Reflect::set(&options, &"powerPreference".into(), &"high-performance".into()).ok()?;
    let found = navigator.gpu()?.request_adapter(&options).await.ok()?;
    let found = found.is_object().then(|| found.unchecked_into::<GpuAdapter>())?;
    let limits = serde_wasm_bindgen::from_value(found.limits()).unwrap_or_default();
    // Older browsers have no `info`.
    Some(AdapterInfo { limits, ..serde_wasm_bindgen::from_value(found.info()).unwrap_or_default() })
}

/// A device, with its name and its adapter.
#[derive(Clone)]
pub(super) struct Named {
    pub device: Device,
    /// In words.
    pub name: String,
    /// Of WebGPU.
    pub adapter: Option<AdapterInfo>,
}

/// The device of a name.
pub(super) async fn device_of(name: &str) -> Result<Named> {
    match name {
        "cpu" => {
            let vectors = if cfg!(feature = "relaxed-simd") { "relaxed SIMD" } else { "SIMD128" };
            let threads = match threads() {
                1 => "one thread".to_owned(),
                many => format!("{many} threads"),
            };
            Ok(Named { device: Device::flex(), name: format!("CPU ({vectors}, {threads})"), adapter: None })
        }
        "webgpu" => {
            let device = webgpu::device().await?;
            let adapter = adapter().await;
            let words = adapter.as_ref().map(AdapterInfo::name).filter(|name| !name.is_empty());
            let name = words.map_or_else(|| "WebGPU".into(), |name| format!("WebGPU ({name})"));
            Ok(Named { device, name, adapter })
        }
        other => Err(Error::Device { device: other.into(), reason: "must be \"cpu\" or \"webgpu\"".into() }),
    }
}

#[cfg(feature = "wgpu")]
mod webgpu {
    use std::cell::RefCell;

    use gravisight::Device;

    use gravisight_geometry::error::{Error, Result};

    /// Commands that are gathered before they are submitted.
    const TASKS_MAX: usize = 32;

    thread_local! {
        /// The page's one WebGPU device: a second initialisation is an error.
        static DEVICE: RefCell<Option<Device>> = const { RefCell::new(None) };
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
    use gravisight::Device;

    use gravisight_geometry::error::{Error, Result};

    pub(super) async fn device() -> Result<Device> {
        Err(Error::Device { device: "webgpu".into(), reason: "this is the CPU build of the package".into() })
    }
}
