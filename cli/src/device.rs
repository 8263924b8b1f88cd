//! `--device`.

use clap::ValueEnum;
#[cfg(feature = "wgpu")]
use gravisight::Gpu;
use gravisight::{Device, Error};

/// Where the network runs.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceChoice {
    /// wgpu if this build supports it and this machine has a GPU, otherwise cpu.
    Auto,
    /// All cores.
    Cpu,
    /// Vulkan, Metal or DX12 (build with `--features wgpu`).
    #[value(aliases = ["gpu", "vulkan", "metal", "dx12"])]
    Wgpu,
    #[value(hide = true)]
    Cuda,
}

impl DeviceChoice {
    /// The device.
    pub fn open(self) -> Result<Device, Error> {
        match self {
            Self::Auto => Ok(wgpu(Software::Refused).unwrap_or_else(|_| Device::flex())),
            Self::Cpu => Ok(Device::flex()),
            Self::Wgpu => wgpu(Software::Taken),
            Self::Cuda => {
                let reason = "is not supported; an NVIDIA card is used through Vulkan: --device wgpu";
                Err(Error::Device { device: "cuda".into(), reason: reason.into() })
            }
        }
    }
}

/// Whether an adapter that computes on the CPU will do.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Software {
    Taken,
    Refused,
}

/// The GPU; its name goes to standard error.
#[cfg(feature = "wgpu")]
fn wgpu(software: Software) -> Result<Device, Error> {
    let Gpu { device, name, is_software } = Gpu::open()?;
    match (is_software, software) {
        (true, Software::Refused) => {
            return Err(Error::Device { device: name, reason: "computes on the CPU".into() });
        }
        (true, Software::Taken) => {
            eprintln!("warning: {name} is a driver that computes on the CPU; --device cpu is faster");
        }
        (false, _) => eprintln!("GPU: {name}"),
    }
    Ok(device)
}

#[cfg(not(feature = "wgpu"))]
fn wgpu(_: Software) -> Result<Device, Error> {
    let reason = "this build has no support for it; build with `cargo install --path cli --features wgpu`";
    Err(Error::Device { device: "wgpu".into(), reason: reason.into() })
}
