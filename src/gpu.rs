//! A GPU by its name.

use burn::tensor::Device;
use burn::tensor::wgpu::wgpu::DeviceType;

use gravisight_geometry::error::{Error, Result};

/// A device that Vulkan, Metal or DX12 offers.
///
/// ```no_run
/// let gpu = gravisight::Gpu::open()?;
/// println!("{}", gpu.name);
/// # Ok::<(), gravisight::Error>(())
/// ```
pub struct Gpu {
    /// To run networks on.
    pub device: Device,
    /// As its driver names it, with the driver's interface.
    pub name: String,
    /// Whether it is a driver that computes on the CPU, which [`Device::flex`] does faster.
    pub is_software: bool,
}

impl Gpu {
    /// The fastest adapter. It can be opened only once in a process; clone its device.
    ///
    /// # Errors
    /// [`Error::Device`] where there is none, or it was opened before.
    pub fn open() -> Result<Self> {
        let failed = |reason: String| Error::Device { device: "wgpu".into(), reason };
        let opened = Device::wgpu_options().init_with_setup();
        let (device, setup) = opened.map_err(|error| failed(error.to_string()))?;
        let adapter = setup.adapter.get_info();
        let name = format!("{} ({})", adapter.name, adapter.backend);
        Ok(Self { device, name, is_software: adapter.device_type == DeviceType::Cpu })
    }
}
