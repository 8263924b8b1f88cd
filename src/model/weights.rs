//! Weights in safetensors files, under PyTorch's tensor names.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::store::{
    BurnToPyTorchAdapter, KeyRemapper, ModuleStore, PyTorchToBurnAdapter, SafetensorsStore, SafetensorsStoreError,
    bridge,
};
use burn::tensor::{DType, Device, Tensor, TensorData, Transaction, f16};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors};

use super::config::PenConfig;
use super::pen::Pen;
use gravisight_geometry::error::{Error, Result};

/// A network of architecture `config` with the weights in `bytes`.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole safetensors file,
/// [`Error::WeightsArchitecture`] for a missing, surplus or misshapen tensor,
/// [`Error::WeightsNotFinite`] for NaN or infinity.
pub fn load(config: &PenConfig, bytes: Vec<u8>, device: &Device) -> Result<Pen> {
    load_into(Pen::new(config, device)?, bytes)
}

/// `pen` with all its weights from `bytes`.
///
/// # Errors
/// As [`load`].
pub fn load_into(mut pen: Pen, bytes: Vec<u8>) -> Result<Pen> {
    let mut store = checked_store(bytes)?;
    let result = store.apply_to(&mut pen).map_err(architecture)?;
    if let Some((name, _)) = result.missing.first() {
        let reason = format!("tensor `{name}` is missing ({} missing in all)", result.missing.len());
        return Err(Error::WeightsArchitecture { reason });
    }
    if let Some(name) = result.unused.first() {
        let reason = format!("tensor `{name}` does not belong to it ({} such in all)", result.unused.len());
        return Err(Error::WeightsArchitecture { reason });
    }
    Ok(pen)
}

/// `pen` with its backbone's weights taken from a file as published: timm's `resnet34`, `convnext_nano` or
/// `convnextv2_nano` (`conv1.weight`, `layer1.0.bn2.running_var`, `stages.0.blocks.1.mlp.fc1.weight`, …). What PEN does not use
/// (`layer4`, `fc`, `head`, batch counters) is ignored.
///
/// # Errors
/// As [`load`]; [`Error::WeightsArchitecture`] also where nobody publishes weights for `pen`'s backbone.
pub fn load_backbone(mut pen: Pen, bytes: Vec<u8>) -> Result<Pen> {
    let Some(prefix) = pen.config().backbone.shape().published else {
        let reason = "no published weights fit this network's backbone (timm's fit only its own)".into();
        return Err(Error::WeightsArchitecture { reason });
    };
    let remapper = KeyRemapper::new()
        .add_pattern("^", prefix)
        .map_err(|error| Error::WeightsArchitecture { reason: error.to_string() })?;
    let mut store = checked_store(bytes)?.remap(remapper).with_regex(format!("^{}", prefix.replace('.', r"\.")));
    let result = store.apply_to(&mut pen).map_err(architecture)?;
    if let Some(name) = result.missing.iter().find_map(|(name, _)| name.strip_prefix(prefix)) {
        return Err(Error::WeightsArchitecture { reason: format!("tensor `{name}` is missing") });
    }
    Ok(pen)
}

/// A copy of `pen` on the CPU, without gradients, from a device that may be readable asynchronously only: a browser's GPU. `pen` stays
/// where it is, the statistics of its norms too (a clone of it would share them).
///
/// # Errors
/// [`Error::Device`] where the device cannot be read.
pub async fn on_cpu(pen: &Pen) -> Result<Pen> {
    let pen = pen.valid();
    let mut collected = TensorCollector { ids: vec![], values: Transaction::default() };
    pen.visit(&mut collected);
    let values = collected.values.execute_async().await;
    let values = values.map_err(|error| Error::Device { device: "GPU".into(), reason: error.to_string() })?;
    Ok(pen.map(&mut TensorReplacer { values: collected.ids.into_iter().zip(values).collect() }))
}

/// Gathers all float tensors.
struct TensorCollector {
    ids: Vec<ParamId>,
    values: Transaction,
}

impl ModuleVisitor for TensorCollector {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.ids.push(param.id);
        self.values = std::mem::take(&mut self.values).register(param.val());
    }
}

/// Puts them on the CPU.
struct TensorReplacer {
    values: HashMap<ParamId, TensorData>,
}

impl ModuleMapper for TensorReplacer {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(values) = self.values.remove(&param.id) else { return param };
        param.map(|_| Tensor::from_data(values, &Device::flex()))
    }
}

/// The weights of `pen` as a safetensors file. Reads the device synchronously: a browser's GPU cannot be read so, hence
/// `on_cpu`.
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

/// A weights file with its matrices in half precision (F16), half the size; vectors (norms, biases) stay F32. What is
/// read from it differs by 1/2048 of each weight at most.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole safetensors file.
pub fn halved(bytes: &[u8]) -> Result<Vec<u8>> {
    let narrow = |values: &[u8]| {
        let values = values.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        values.flat_map(|value| f16::from_f32(value).to_le_bytes()).collect()
    };
    rewritten(bytes, |rank, dtype| (dtype == Dtype::F32 && rank > 1).then_some(Dtype::F16), narrow)
}

/// A weights file with its half-precision tensors in F32.
fn widened(bytes: &[u8]) -> Result<Vec<u8>> {
    let widen = |values: &[u8]| {
        let values = values.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]));
        values.flat_map(|value| value.to_f32().to_le_bytes()).collect()
    };
    rewritten(bytes, |_, dtype| (dtype == Dtype::F16).then_some(Dtype::F32), widen)
}

/// A tensor of a file: name, type, shape, values.
type Entry<'a> = (String, Dtype, Vec<usize>, Cow<'a, [u8]>);

/// The file with those tensors in another type that `other` (of rank and type) names one for.
fn rewritten(
    bytes: &[u8],
    other: impl Fn(usize, Dtype) -> Option<Dtype>,
    convert: impl Fn(&[u8]) -> Vec<u8>,
) -> Result<Vec<u8>> {
    let file = opened(bytes)?;
    let tensors: Vec<Entry<'_>> = (file.iter())
        .map(|(name, view)| match other(view.shape().len(), view.dtype()) {
            Some(dtype) => (name.into(), dtype, view.shape().to_vec(), Cow::Owned(convert(view.data()))),
            None => (name.into(), view.dtype(), view.shape().to_vec(), Cow::Borrowed(view.data())),
        })
        .collect();
    written(&tensors)
}

fn refuse(error: SafeTensorError) -> Error {
    Error::WeightsFile { reason: error.to_string() }
}

fn opened(bytes: &[u8]) -> Result<SafeTensors<'_>> {
    SafeTensors::deserialize(bytes).map_err(refuse)
}

/// The file of a network that there is not.
///
/// # Errors
/// None.
pub fn nothing() -> Result<Vec<u8>> {
    written(&[])
}

/// The file of `tensors`.
fn written(tensors: &[Entry<'_>]) -> Result<Vec<u8>> {
    written_with(tensors, ["format", "pt"])
}

/// The same with another entry beside them. (Several would be written in an order that changes from call to call.)
fn written_with(tensors: &[Entry<'_>], [key, value]: [&str; 2]) -> Result<Vec<u8>> {
    let views = tensors
        .iter()
        .map(|(name, dtype, shape, data)| Ok((name, TensorView::new(*dtype, shape.clone(), data).map_err(refuse)?)));
    let metadata = HashMap::from([(key.to_string(), value.to_string())]);
    safetensors::serialize(views.collect::<Result<Vec<_>>>()?, Some(metadata)).map_err(refuse)
}

/// Prefixes of the tensors of the second networks in a file of several: the verifier's and the motion network's.
const PREFIXES: [&str; 2] = ["verifier.", "motion."];

/// The networks of a weights file, each as a file: the detector's, the verifier's and the motion network's, which are empty where there
/// are none.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole safetensors file.
pub fn parted(bytes: &[u8]) -> Result<[Vec<u8>; 3]> {
    let file = opened(bytes)?;
    let mut parts = [vec![], vec![], vec![]];
    for (name, view) in file.iter() {
        let entry = |name: &str| (name.to_string(), view.dtype(), view.shape().to_vec(), Cow::Borrowed(view.data()));
        let second =
            PREFIXES.iter().enumerate().find_map(|(index, prefix)| Some((index + 1, name.strip_prefix(prefix)?)));
        let (part, name) = second.unwrap_or((0, name));
        parts[part].push(entry(name));
    }
    let [own, verifier, motion] = parts;
    Ok([written(&own)?, written(&verifier)?, written(&motion)?])
}

/// The file of several networks, as [`parted`] gives them.
///
/// # Errors
/// As [`parted`].
pub fn joined(parts: [&[u8]; 3]) -> Result<Vec<u8>> {
    let mut entries = vec![];
    for (bytes, prefix) in parts.into_iter().zip(["", PREFIXES[0], PREFIXES[1]]) {
        let file = opened(bytes)?;
        let named = file.iter().map(|(name, view)| {
            (format!("{prefix}{name}"), view.dtype(), view.shape().to_vec(), Cow::Owned(view.data().to_vec()))
        });
        entries.extend(named.collect::<Vec<_>>());
    }
    written(&entries)
}

/// The entry of a bundle that holds its text.
const ABOUT: &str = "about";

/// One file of several networks' files, each under a name without a dot, and a text beside them.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole safetensors file.
pub fn bundled(parts: &[(&str, Vec<u8>)], about: &str) -> Result<Vec<u8>> {
    let mut entries = vec![];
    for (part, bytes) in parts {
        let file = opened(bytes)?;
        entries.extend(file.iter().map(|(name, view)| {
            (format!("{part}.{name}"), view.dtype(), view.shape().to_vec(), Cow::Owned(view.data().to_vec()))
        }));
    }
    written_with(&entries, [ABOUT, about])
}

/// The networks' files of a bundle by their names, and its text.
///
/// # Errors
/// [`Error::WeightsFile`] for bytes that are no whole bundle.
pub fn unbundled(bytes: &[u8]) -> Result<(BTreeMap<String, Vec<u8>>, String)> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(refuse)?;
    let missing = || Error::WeightsFile { reason: "holds no training state".into() };
    let about = header.metadata().as_ref().and_then(|entries| entries.get(ABOUT)).ok_or_else(missing)?.clone();
    let file = opened(bytes)?;
    let mut parts: BTreeMap<String, Vec<Entry<'_>>> = BTreeMap::new();
    for (name, view) in file.iter() {
        let (part, name) = name.split_once('.').ok_or_else(missing)?;
        let entry = (name.to_string(), view.dtype(), view.shape().to_vec(), Cow::Borrowed(view.data()));
        parts.entry(part.into()).or_default().push(entry);
    }
    let parts = parts.into_iter().map(|(part, entries)| Ok((part, written(&entries)?)));
    Ok((parts.collect::<Result<_>>()?, about))
}

/// A store over `bytes` that speaks PyTorch's names, its tensors checked to be whole and finite.
fn checked_store(bytes: Vec<u8>) -> Result<SafetensorsStore> {
    let mut store = SafetensorsStore::from_bytes(Some(widened(&bytes)?))
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
