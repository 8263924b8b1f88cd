//! Weights in safetensors files, under PyTorch's tensor names.

use burn::store::{
    BurnToPyTorchAdapter, KeyRemapper, ModuleStore, PyTorchToBurnAdapter, SafetensorsStore, SafetensorsStoreError,
    bridge,
};
use burn::tensor::{DType, Device};

use super::config::{BackboneConfig, PenConfig};
use super::pen::Pen;
use crate::error::{Error, Result};

/// A network of architecture `config` with the weights in `bytes`.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole safetensors file,
/// [`Error::WeightsArchitecture`] for a missing, surplus or misshapen tensor,
/// [`Error::WeightsNotFinite`] for NaN or infinity.
pub fn load(config: &PenConfig, bytes: Vec<u8>, device: &Device) -> Result<Pen> {
    let mut pen = Pen::new(config, device)?;
    let mut store = checked_store(bytes)?;
    let result = store.apply_to(&mut pen).map_err(architecture)?;
    if let Some((name, _)) = result.missing.first() {
        let reason = format!("tensor `{name}` is missing ({} in all)", result.missing.len());
        return Err(Error::WeightsArchitecture { reason });
    }
    if let Some(name) = result.unused.first() {
        let reason = format!("tensor `{name}` has no place in it ({} in all)", result.unused.len());
        return Err(Error::WeightsArchitecture { reason });
    }
    Ok(pen)
}

/// `pen` with its ResNet34 backbone's weights taken from a file with timm's `resnet34` names
/// (`conv1.weight`, `layer1.0.bn2.running_var`, …). layer4, `fc` and batch counters are ignored.
///
/// # Errors
/// As [`load`]; [`Error::WeightsArchitecture`] also where `pen` has another backbone.
pub fn load_backbone_timm(mut pen: Pen, bytes: Vec<u8>) -> Result<Pen> {
    let BackboneConfig::ResNet34 { .. } = pen.config().backbone else {
        let reason = "timm's resnet34 weights fit the `resnet34` backbone only".into();
        return Err(Error::WeightsArchitecture { reason });
    };
    let remapper = KeyRemapper::new()
        .add_pattern("^", "backbone.")
        .map_err(|error| Error::WeightsArchitecture { reason: error.to_string() })?;
    let mut store = checked_store(bytes)?.remap(remapper).with_regex(r"^backbone\.");
    let result = store.apply_to(&mut pen).map_err(architecture)?;
    let missing = result.missing.iter().find(|(name, _)| name.starts_with("backbone."));
    if let Some((name, _)) = missing {
        let name = name.trim_start_matches("backbone.");
        return Err(Error::WeightsArchitecture { reason: format!("tensor `{name}` is missing") });
    }
    Ok(pen)
}

/// The weights of `pen` as a safetensors file. Reads the device synchronously: not in a browser
/// with WebGPU.
///
/// # Errors
/// [`Error::WeightsFile`] where the device cannot be read.
pub fn save(pen: &Pen) -> Result<Vec<u8>> {
    let refuse = |error: SafetensorsStoreError| Error::WeightsFile { reason: error.to_string() };
    // One entry of metadata: several are written in an order that changes from call to call.
    let mut store = SafetensorsStore::from_bytes(None)
        .with_to_adapter(BurnToPyTorchAdapter)
        .skip_enum_variants(true)
        .clear_metadata()
        .metadata("format", "pt");
    store.collect_from(pen).map_err(refuse)?;
    store.get_bytes().map_err(refuse)
}

/// A store over `bytes` that speaks PyTorch's names, its tensors checked to be whole and finite.
fn checked_store(bytes: Vec<u8>) -> Result<SafetensorsStore> {
    let mut store = SafetensorsStore::from_bytes(Some(bytes))
        .with_from_adapter(PyTorchToBurnAdapter)
        .skip_enum_variants(true)
        .validate(true)
        .allow_partial(true);
    let file = |reason: String| Error::WeightsFile { reason };
    for (name, tensor) in store.get_all_tensors().map_err(|error| file(error.to_string()))? {
        if tensor.dtype.is_float() && tensor.dtype != DType::F32 {
            let reason = format!("tensor `{name}` is {:?}; convert the file to F32", tensor.dtype);
            return Err(Error::WeightsArchitecture { reason });
        }
        let data = bridge::to_data(tensor).map_err(|error| file(error.to_string()))?;
        if data.iter::<f32>().any(|value| !value.is_finite()) {
            return Err(Error::WeightsNotFinite { tensor: name.clone() });
        }
    }
    Ok(store)
}

fn architecture(error: SafetensorsStoreError) -> Error {
    Error::WeightsArchitecture { reason: error.to_string() }
}
