//! The network against PyTorch and TensorFlow.js, its weights files, its decoding.

use burn::tensor::{Device, Tensor, TensorData};
use proptest::prelude::*;

use super::backbone::Backbone;
use super::tensors::Tensors;
use super::{
    BackboneConfig, Card, HeadConfig, HeatmapConfig, Pen, PenConfig, PenOutput, confidence, decode, halved, joined,
    load, load_backbone, parted, save, sha256_hex,
};
use crate::testing::{formula, formula_tensor, golden, safetensors_of, tiny_card, vector};
use gravisight_geometry::error::Error;
use gravisight_geometry::size::Size;

const HEIGHT: usize = 64;
const WIDTH: usize = 96;
/// Largest difference from PyTorch's maps and coordinates.
const TOLERANCE: f32 = 1e-4;

fn picture(device: &Device) -> Tensor<4> {
    let values: Vec<f32> = formula("picture", 3 * HEIGHT * WIDTH).into_iter().map(|value| value as f32).collect();
    Tensor::from_data(TensorData::new(values, [1, 3, HEIGHT, WIDTH]), device).permute([0, 2, 3, 1])
}

fn largest_difference(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// A small compact network, the one of tests/golden/pen.py.
fn small() -> PenConfig {
    let backbone = BackboneConfig::Compact { stem: 6, stages: [6, 8, 10, 12], pyramid: 8, input_channels: 3 };
    PenConfig { backbone, ..PenConfig::compact(7.5) }
}

/// Weights by the formula for every tensor of `config`'s network.
fn formula_weights(config: &PenConfig, device: &Device) -> Vec<u8> {
    let bytes = save(&Pen::new(config, device).unwrap()).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let tensors = file.tensors().into_iter().map(|(name, view)| {
        let values = formula_tensor(&name, view.shape());
        (name, view.shape().to_vec(), values)
    });
    safetensors_of(tensors.collect())
}

/// The maps of `pen` and the coordinates decoded from them equal the golden's, run as tensors and by the
/// CPU's plan, the second time in buffers already used.
fn assert_golden(pen: &Pen, file: &str, beta: f64, device: &Device) {
    let pictures: Vec<f32> = picture(device).into_data().iter::<f32>().collect();
    let runner = pen.clone().runner(Size::new(WIDTH as u32, HEIGHT as u32), device);
    runner.run(pictures.iter().rev().copied().collect());
    for output in [pen.forward(picture(device)), runner.run(pictures)] {
        let read = |tensor: Tensor<3>| tensor.into_data().try_to_vec::<f32>().unwrap();
        assert!(largest_difference(&read(output.heatmap.clone()), &expected(file, "heatmap")) < TOLERANCE);
        assert!(largest_difference(&read(output.depth.clone()), &expected(file, "depth")) < TOLERANCE);
        assert_decoded(output, pen.config(), beta, &expected(file, "decoded"));
    }
}

/// `output` decoded with `beta` gives x, y in px and depth in m.
fn assert_decoded(output: PenOutput, config: &PenConfig, beta: f64, expected: &[f32]) {
    let config = PenConfig { heatmap: HeatmapConfig { beta }, ..config.clone() };
    let decoded = decode(output, &config);
    let mut found = decoded.image.into_data().try_to_vec::<f32>().unwrap();
    found.extend(decoded.depth.into_data().try_to_vec::<f32>().unwrap());
    assert!(largest_difference(&found, expected) < TOLERANCE, "{found:?} {expected:?}");
}

/// A tensor of a golden file.
fn expected(file: &str, name: &str) -> Vec<f32> {
    let bytes = golden(file);
    vector(&safetensors::SafeTensors::deserialize(&bytes).unwrap().tensor(name).unwrap())
}

#[test]
fn the_compact_network_equals_pytorch() {
    let device = Device::flex();
    let pen = load(&small(), formula_weights(&small(), &device), &device).unwrap();
    assert_golden(&pen, "pen_compact.safetensors", 1.0, &device);
}

/// The network with heads from our own file and the backbone from a file with timm's names, unused ones included.
fn with_timm_backbone(config: &PenConfig, names: &str, device: &Device) -> Pen {
    let pen = load(config, formula_weights(config, device), device).unwrap();
    let shapes: std::collections::BTreeMap<String, Vec<usize>> = serde_json::from_slice(&golden(names)).unwrap();
    let timm = shapes.into_iter().filter(|(name, _)| !name.ends_with("num_batches_tracked")).map(|(name, shape)| {
        let values = formula_tensor(&name, &shape);
        (name, shape, values)
    });
    load_backbone(pen, safetensors_of(timm.collect())).unwrap()
}

#[test]
fn the_paper_network_with_timm_weights_equals_pytorch() {
    let device = Device::flex();
    let pen = with_timm_backbone(&PenConfig::paper(), "timm_resnet34.json", &device);
    assert_golden(&pen, "pen_paper.safetensors", 2.0, &device);
}

#[test]
fn the_convnext_networks_with_timm_weights_equal_pytorch() {
    let device = Device::flex();
    let networks = [(PenConfig::convnext_nano(), "convnext_nano"), (PenConfig::convnextv2_nano(), "convnextv2_nano")];
    for (config, name) in networks {
        let pen = with_timm_backbone(&config, &format!("timm_{name}.json"), &device);
        assert_golden(&pen, &format!("pen_{name}.safetensors"), 2.0, &device);
    }
}

#[test]
fn a_backbone_has_the_strides_and_channels_that_it_tells() {
    let device = Device::flex();
    let narrow = |response_norm| BackboneConfig::ConvNext { depths: [1; 4], widths: [4, 6, 8, 10], response_norm };
    for config in [small().backbone, BackboneConfig::ResNet34 { width: 4 }, narrow(false), narrow(true)] {
        let features = Backbone::new(&config, &device).forward(&mut Tensors, &picture(&device));
        let found: Vec<[usize; 4]> = features.iter().map(Tensor::dims).collect();
        let told = config.shape().features;
        let told: Vec<_> = told.iter().map(|it| [1, HEIGHT / it.stride, WIDTH / it.stride, it.channels]).collect();
        assert_eq!(found, told, "{config:?}");
    }
}

#[test]
fn decoding_with_the_published_temperature_equals_pytorch() {
    // On PyTorch's maps: at β = 10 the last bits of a map decide between a random network's peaks.
    let device = Device::flex();
    let file = "pen_paper.safetensors";
    let map = |name| Tensor::from_data(TensorData::new(expected(file, name), [1, HEIGHT, WIDTH]), &device);
    let output = PenOutput { heatmap: map("heatmap"), depth: map("depth"), log_scale: None };
    assert_decoded(output, &PenConfig::paper(), 10.0, &expected(file, "decoded_sharp"));
}

#[test]
fn a_timm_file_without_a_tensor_is_refused_by_its_name() {
    let device = Device::flex();
    let backbone = BackboneConfig::ResNet34 { width: 4 };
    let head = HeadConfig::Paper { channels: [4, 4, 4] };
    let config = PenConfig { backbone, head, ..PenConfig::paper() };
    let pen = Pen::new(&config, &device).unwrap();
    let bytes = save(&pen).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let timm = file.tensors().into_iter().filter_map(|(name, view)| {
        let name = name.strip_prefix("backbone.")?;
        (name != "layer2.0.downsample.0.weight").then(|| (name.to_string(), view.shape().to_vec(), vector(&view)))
    });
    let error = load_backbone(pen, safetensors_of(timm.collect())).unwrap_err();
    assert!(matches!(&error, Error::WeightsArchitecture { .. }), "{error}");
    assert!(error.to_string().contains("layer2.0.downsample.0.weight"), "{error}");
    let compact = Pen::new(&small(), &device).unwrap();
    let error = load_backbone(compact, safetensors_of(vec![])).unwrap_err();
    assert!(matches!(&error, Error::WeightsArchitecture { .. }) && error.to_string().contains("timm"), "{error}");
}

#[test]
fn saved_weights_load_back_to_the_same_network() {
    let device = Device::flex();
    device.seed(3);
    let pen = Pen::new(&small(), &device).unwrap();
    let again = load(&small(), save(&pen).unwrap(), &device).unwrap();
    let read = |pen: &Pen| pen.forward(picture(&device)).heatmap.into_data().try_to_vec::<f32>().unwrap();
    assert_eq!(read(&pen), read(&again));
}

#[test]
fn one_runner_serves_many_threads_and_batches_alike() {
    use rayon::iter::{IntoParallelIterator, ParallelIterator};
    let device = Device::flex();
    let runner =
        load(&small(), formula_weights(&small(), &device), &device).unwrap().runner(Size::new(64, 32), &device);
    let values =
        |index: usize| -> Vec<f32> { formula(&format!("{index}"), 32 * 64 * 3).iter().map(|&x| x as f32).collect() };
    let depth = |values: Vec<f32>| runner.run(values).depth.into_data().try_to_vec::<f32>().unwrap();
    let alone: Vec<Vec<f32>> = (0..12).map(|index| depth(values(index))).collect();
    let together: Vec<Vec<f32>> = (0..12).into_par_iter().map(|index| depth(values(index))).collect();
    assert_eq!(alone, together);
    assert_eq!(alone.concat(), depth((0..12).flat_map(values).collect()));
}

#[test]
fn halved_weights_are_half_the_size_and_nearly_the_same_network() {
    let device = Device::flex();
    device.seed(3);
    let pen = Pen::new(&PenConfig::compact(7.0), &device).unwrap();
    let whole = save(&pen).unwrap();
    let half = halved(&whole).unwrap();
    assert!(half.len() < whole.len() * 53 / 100, "{} {}", half.len(), whole.len());
    assert_eq!(halved(&whole).unwrap(), half, "the same bytes each time");
    let again = load(&PenConfig::compact(7.0), half, &device).unwrap();
    let read = |pen: &Pen| pen.forward(picture(&device)).heatmap.into_data().try_to_vec::<f32>().unwrap();
    let (exact, rounded) = (read(&pen), read(&again));
    let scale = exact.iter().map(|value| value.abs()).fold(0.0, f32::max);
    let largest = exact.iter().zip(&rounded).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest > 0.0 && largest < 5e-3 * scale, "{largest} of {scale}");
}

#[test]
fn weights_of_another_type_are_refused_with_what_to_do() {
    let bytes = formula_weights(&small(), &Device::flex());
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let zeros = vec![0_u8; 1 << 20];
    let halves = file.tensors().into_iter().map(|(name, view)| {
        let length = view.data().len() / 2;
        let half =
            safetensors::tensor::TensorView::new(safetensors::Dtype::BF16, view.shape().to_vec(), &zeros[..length]);
        (name, half.unwrap())
    });
    let error = load(&small(), safetensors::serialize(halves, None).unwrap(), &Device::flex()).unwrap_err();
    assert!(error.to_string().contains("BF16") && error.to_string().contains("F32"), "{error}");
}

#[test]
fn truncated_weights_are_refused_as_such() {
    let device = Device::flex();
    let bytes = formula_weights(&small(), &device);
    for length in [0, 4, 100, bytes.len() - 1] {
        let error = load(&small(), bytes[..length].to_vec(), &device).unwrap_err();
        assert!(matches!(error, Error::WeightsFile { .. }), "{length}: {error}");
    }
}

#[test]
fn weights_of_another_architecture_are_refused_with_the_tensor() {
    let device = Device::flex();
    let bytes = formula_weights(&small(), &device);
    let wider = PenConfig {
        backbone: BackboneConfig::Compact { stem: 8, stages: [6, 8, 10, 12], pyramid: 8, input_channels: 3 },
        ..small()
    };
    let error = load(&wider, bytes, &device).unwrap_err();
    assert!(matches!(error, Error::WeightsArchitecture { .. }), "{error}");
    assert!(error.to_string().contains("stem"), "{error}");
}

#[test]
fn nan_and_infinite_weights_are_refused_with_the_tensor() {
    let device = Device::flex();
    for bad in [f32::NAN, f32::INFINITY] {
        let bytes = formula_weights(&small(), &device);
        let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let tensors = file.tensors().into_iter().map(|(name, view)| {
            let mut values = vector(&view);
            if name == "depth_head.last.bias" {
                values[0] = bad;
            }
            (name, view.shape().to_vec(), values)
        });
        let error = load(&small(), safetensors_of(tensors.collect()), &device).unwrap_err();
        let Error::WeightsNotFinite { tensor } = &error else { panic!("{error}") };
        assert_eq!(tensor, "depth_head.last.bias");
    }
}

#[test]
fn weights_that_are_not_the_cards_are_refused_with_both_sums() {
    let card = tiny_card();
    let weights = golden("tiny.safetensors");
    card.check_weights(&weights).unwrap();
    let mut altered = weights.clone();
    *altered.last_mut().unwrap() ^= 1;
    let error = card.check_weights(&altered).unwrap_err();
    let Error::WeightsSha256 { expected, found } = &error else { panic!("{error}") };
    assert_eq!(expected, &card.sha256);
    assert_eq!(found, &sha256_hex(&altered));
    // A download that broke off says so, not that it is another file.
    let error = card.check_weights(&weights[..weights.len() / 2]).unwrap_err();
    assert!(matches!(error, Error::WeightsFile { .. }), "{error}");
}

#[test]
fn cards_of_another_version_are_refused_with_what_to_do() {
    let text = String::from_utf8(golden("tiny.json")).unwrap();
    let older = text.replace("  \"version\": 2,\n", "").replace("\"input\": {", "\"closer\": {}, \"input\": {");
    for (card, found) in [(older, "not 1"), (text.replace("\"version\": 2", "\"version\": 3"), "not 3")] {
        let error = Card::from_json(&card, "card").unwrap_err().to_string();
        assert!(error.contains("version") && error.contains(found) && error.contains("migrate-models"), "{error}");
    }
}

#[test]
fn cards_with_unknown_fields_or_senseless_numbers_are_refused() {
    let text = String::from_utf8(golden("tiny.json")).unwrap();
    for (from, to, named) in [
        ("\"name\"", "\"nome\"", "nome"),
        ("\"width\": 64", "\"width\": 65", "input"),
        ("\"stem\": 4", "\"stem\": 0", "channels"),
        ("\"beta\": 1.0", "\"beta\": -1.0", "beta"),
        ("\"depthwise\"", "\"deepwise\"", "deepwise"),
        ("\"depthwise\"", "\"paper\", \"channels\": [4, 4, 4]", "head"),
        ("\"stem\"", "\"stern\"", "stern"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = Card::from_json(&text.replace(from, to), "card").unwrap_err();
        assert!(error.to_string().contains(named), "{error}");
    }
}

#[test]
fn the_presets_have_the_published_and_promised_sizes() {
    use burn::module::Module as _;
    let device = Device::flex();
    let parameters = |config| Pen::new(&config, &device).unwrap().num_params();
    let paper = parameters(PenConfig::paper());
    assert!((18_000_000..18_150_000).contains(&paper), "{paper}");
    let compact = parameters(PenConfig::compact(7.0));
    assert!(compact < 2_000_000, "{compact}");
}

/// Maps of one picture: a heatmap whose softmax is a Gaussian, a depth plane.
fn gaussian_maps(centre: [f64; 2], sigma: f64, [height, width]: [usize; 2]) -> PenOutput {
    let device = Device::flex();
    let stride = 4.0;
    let at = |index: usize| ((index % width) as f64 * stride + 1.5, (index / width) as f64 * stride + 1.5);
    let heatmap: Vec<f32> = (0..height * width)
        .map(|index| {
            let (x, y) = at(index);
            (-((x - centre[0]).powi(2) + (y - centre[1]).powi(2)) / (2.0 * sigma * sigma)) as f32
        })
        .collect();
    let depth: Vec<f32> = (0..height * width).map(|index| (3.0 + 0.01 * at(index).0) as f32).collect();
    let map = |values| Tensor::from_data(TensorData::new(values, [1, height, width]), &device);
    PenOutput { heatmap: map(heatmap), depth: map(depth), log_scale: None }
}

proptest! {
    #[test]
    fn the_soft_argmax_finds_a_gaussian_and_the_depth_under_it(x in 20.0..100.0_f64, y in 20.0..70.0_f64) {
        let decoded = decode(gaussian_maps([x, y], 4.0, [24, 32]), &small());
        let image = decoded.image.into_data().try_to_vec::<f32>().unwrap();
        prop_assert!((f64::from(image[0]) - x).abs() < 0.01 && (f64::from(image[1]) - y).abs() < 0.01);
        let depth = decoded.depth.into_data().try_to_vec::<f32>().unwrap()[0];
        prop_assert!((f64::from(depth) - (3.0 + 0.01 * x)).abs() < 1e-3);
        let probability = decoded.probability.into_data().try_to_vec::<f32>().unwrap();
        prop_assert!(confidence(&probability, 32, 4, [x, y]) > 0.95);
    }
}

#[test]
fn an_empty_heatmap_gives_little_confidence() {
    let flat = vec![1.0 / 3136.0; 3136];
    assert!(confidence(&flat, 56, 4, [111.5, 111.5]) < 0.02);
}

#[test]
fn two_networks_in_a_file_are_the_two() {
    let alone = golden("tiny.safetensors");
    let [own, none, _] = parted(&alone).unwrap();
    assert_eq!(parted(&joined([&own, &none, &none]).unwrap()).unwrap(), [own.clone(), none.clone(), none.clone()]);
    let both = joined([&own, &alone, &none]).unwrap();
    assert!(both.len() > alone.len());
    let [first, verifier, _] = parted(&both).unwrap();
    assert_eq!((&first, &verifier), (&own, &own));
    assert!(matches!(parted(&both[..both.len() - 1]), Err(Error::WeightsFile { .. })));
}
