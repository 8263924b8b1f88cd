//! `--device`.

use clap::ValueEnum;
use gravisight::{Device, Error};

/// Where the network runs.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceChoice {
    /// wgpu if this build and this machine support it, otherwise cpu.
    Auto,
    /// All cores.
    Cpu,
    /// Vulkan, Metal or DX12 (build with `--features wgpu`).
    Wgpu,
}

impl DeviceChoice {
    /// The device.
    pub fn open(self) -> Result<Device, Error> {
        match self {
            Self::Auto => Ok(wgpu().unwrap_or_else(|_| Device::flex())),
            Self::Cpu => Ok(Device::flex()),
            Self::Wgpu => wgpu(),
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
    let reason = "this build has no support for it; build with `cargo install --path cli --features wgpu`";
    Err(Error::Device { device: "wgpu".into(), reason: reason.into() })
}
