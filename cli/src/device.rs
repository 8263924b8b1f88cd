//! `--device`.

use clap::ValueEnum;
use gravisight::{Device, Error};

/// Where the network runs.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceChoice {
    /// wgpu where this build has it and the machine an adapter, else cpu.
    Auto,
    /// All cores.
    Cpu,
    /// Vulkan, Metal or DX12 (build with `--features wgpu`).
    Wgpu,
    /// NVIDIA (build with `--features cuda`).
    Cuda,
}

impl DeviceChoice {
    /// The device.
    pub fn open(self) -> Result<Device, Error> {
        match self {
            Self::Auto => Ok(wgpu().unwrap_or_else(|_| Device::flex())),
            Self::Cpu => Ok(Device::flex()),
            Self::Wgpu => wgpu(),
            Self::Cuda => cuda(),
        }
    }
}

#[cfg(feature = "wgpu")]
fn wgpu() -> Result<Device, Error> {
    let failed = |error: String| Error::Device { device: "wgpu".into(), reason: error };
    Device::wgpu_options().init().map_err(|error| failed(error.to_string()))
}

#[cfg(not(feature = "wgpu"))]
fn wgpu() -> Result<Device, Error> {
    Err(absent("wgpu"))
}

#[cfg(feature = "cuda")]
fn cuda() -> Result<Device, Error> {
    Ok(Device::cuda(0))
}

#[cfg(not(feature = "cuda"))]
fn cuda() -> Result<Device, Error> {
    Err(absent("cuda"))
}

#[cfg(not(all(feature = "wgpu", feature = "cuda")))]
fn absent(device: &str) -> Error {
    let reason = format!("this build has no support for it; build with `cargo build --release --features {device}`");
    Error::Device { device: device.into(), reason }
}
