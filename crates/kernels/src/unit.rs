//! What is trained as one: a convolution, batch norm or bias, a skip and a (leaky) ReLU, forward and
//! backward. Together they pass over memory half as often as one by one.

use super::conv::{ConvShape, Epilogue, split, with_padded};
use super::depthwise::PackedDepthwise;
use super::gradient::{InputGradient, gradient_len, unpack};
use super::map::{Extent, Map, MapMut};
use super::norm::{
    Moments, before_activation, norm_gradient, normalise_rows, per_channel, sum_gradient, sum_norm_gradient, widen,
};
use super::parallel::{for_each_of, threads, with_scratch, zeros};
use super::simd::{SLACK, Vectors};
use super::winograd::{self, Winograd};
use super::{Convolution, depthwise};

/// Winograd tiles for which a task reads the weights once.
const GROUP_TILES: usize = 56;

/// A unit's fixed part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitShape {
    /// The convolution.
    pub conv: ConvShape,
    /// Negative results are multiplied by it, 0 to 1 (1: no activation).
    pub slope: f32,
}

/// Batch norm's parameters; without them `shift` is the convolution's bias.
#[derive(Debug, Clone, Copy)]
pub struct NormInput<'a> {
    /// γ.
    pub scale: &'a [f32],
    /// Added to the variance.
    pub epsilon: f32,
}

/// What [`unit_backward`] needs of the forward pass besides its inputs and its output.
#[derive(Debug, Clone)]
pub struct Saved {
    /// The convolution's output, before the norm; empty without one.
    pub convolved: Vec<f32>,
    /// Mean of each channel; empty without a norm.
    pub mean: Vec<f32>,
    /// Variance of each channel (biased); empty without a norm.
    pub variance: Vec<f32>,
}

/// Gradients of a unit's inputs.
#[derive(Debug, Clone)]
pub struct UnitGradients {
    /// Of the input, where asked for.
    pub x: Option<Vec<f32>>,
    /// Of the weights.
    pub weights: Vec<f32>,
    /// Of the bias, or of batch norm's β.
    pub shift: Vec<f32>,
    /// Of batch norm's γ; empty without one.
    pub scale: Vec<f32>,
    /// Of the skip, where asked for.
    pub skip: Option<Vec<f32>>,
}

/// Pictures that a task takes at once, so that few tiles do not read all transformed weights.
fn group(output: &Extent) -> usize {
    let tiles = output.height.div_ceil(4) * output.width.div_ceil(4);
    GROUP_TILES.div_ceil(tiles).min(output.batch.div_ceil(threads())).max(1)
}

/// Training's forward pass: output and what the backward pass needs. `x` and `skip` have no halo.
///
/// # Panics
/// Where sizes do not fit.
pub fn unit_forward(
    vectors: Vectors,
    shape: &UnitShape,
    weights: &[f32],
    shift: &[f32],
    norm: Option<NormInput<'_>>,
    x: Map<'_>,
    skip: Option<Map<'_>>,
) -> (Vec<f32>, Saved) {
    let extent = shape.conv.output(x.extent);
    assert!(x.extent.halo == 0 && skip.is_none_or(|skip| skip.extent == extent), "maps of {shape:?}");
    let whole = |values: &[f32]| values.len() == extent.channels;
    assert!(whole(shift) && norm.is_none_or(|norm| whole(norm.scale)), "shift and scale of {shape:?}");
    let group = group(&extent);
    let grouped = Extent { batch: group, ..extent };
    let members = |index: usize| (index * group, group.min(extent.batch - index * group));
    let bias = norm.is_none().then_some(shift);
    let conv = Convolution::new(vectors, shape.conv, weights, bias, &grouped);
    let convolve = |index: usize, skip: Option<Map<'_>>, slope: f32, out: &mut [f32]| {
        let (first, count) = members(index);
        let out = MapMut::new(Extent { batch: count, ..extent }, out);
        let skip = skip.map(|skip| skip.images(first, count));
        let run = |x: Map<'_>| conv.run(x, skip, slope, out);
        let x = x.images(first, count);
        if shape.conv.depthwise { with_padded(x, conv.halo(), run) } else { run(x) }
    };
    let mut output = zeros(extent.len());
    let Some(norm) = norm else {
        for_each_of(output.chunks_mut(grouped.len()).collect(), |index, out| convolve(index, skip, shape.slope, out));
        return (output, Saved { convolved: Vec::new(), mean: Vec::new(), variance: Vec::new() });
    };
    let mut convolved = zeros(extent.len());
    let row = extent.pitch();
    let mut moments: Vec<Option<Moments>> = vec![None; extent.batch];
    let parts = convolved.chunks_mut(grouped.len()).zip(moments.chunks_mut(group)).collect();
    for_each_of(parts, |index, (values, moments): (&mut [f32], &mut [Option<Moments>])| {
        convolve(index, None, 1.0, values);
        for (image, moments) in values.chunks_exact(extent.image()).zip(moments) {
            *moments = Some(Moments::of(vectors, image, row, extent.channels));
        }
    });
    let moments = moments.into_iter().flatten().reduce(|all, image| all.merge(&image));
    let [mean, variance] = moments.map_or_else(|| [Vec::new(), Vec::new()], Moments::mean_and_variance);
    let factors: Vec<f64> = (norm.scale.iter().zip(&variance))
        .map(|(&scale, &variance)| f64::from(scale) / f64::from(variance + norm.epsilon).sqrt())
        .collect();
    let offsets: Vec<f64> = (shift.iter().zip(&mean).zip(&factors))
        .map(|((&shift, &mean), factor)| f64::from(shift) - f64::from(mean) * factor)
        .collect();
    let (factors, offsets) = (widen(&factors, row), widen(&offsets, row));
    for_each_of(output.chunks_exact_mut(extent.image()).collect(), |image, out| {
        let at = image * extent.image();
        let values = &convolved[at..at + extent.image()];
        let skip = skip.map_or(&[][..], |skip| &skip.values[at..at + extent.image()]);
        normalise_rows(vectors, values, &factors, &offsets, skip, shape.slope, out);
    });
    (output, Saved { convolved, mean, variance })
}

/// How the input's gradient is computed.
enum Backward {
    Direct(InputGradient),
    Winograd(Winograd),
    Depthwise(PackedDepthwise),
}

impl Backward {
    fn new(vectors: Vectors, shape: &ConvShape, weights: &[f32], input: &Extent) -> Self {
        if shape.depthwise {
            return Self::Depthwise(PackedDepthwise::new(vectors, shape, weights, true));
        }
        let direct = InputGradient::new(vectors, *shape, weights);
        let [from, to] = shape.channels;
        match direct.mirrored().filter(|_| winograd::pays(shape.kernel, shape.stride, [to, from], input)) {
            Some(mirrored) => Self::Winograd(Winograd::new(vectors, shape.kernel, [to, from], mirrored)),
            None => Self::Direct(direct),
        }
    }

    fn halo(&self, shape: &ConvShape, input: Extent) -> usize {
        match self {
            Self::Direct(direct) => direct.halo(input),
            Self::Winograd(_) => 0,
            Self::Depthwise(_) => shape.kernel - 1 - shape.padding,
        }
    }

    fn run(&self, vectors: Vectors, shape: &ConvShape, dy: Map<'_>, dx: MapMut<'_>) {
        let padding = shape.kernel - 1 - shape.padding;
        match self {
            Self::Direct(direct) => direct.run(vectors, dy, dx),
            Self::Winograd(winograd) => winograd.run(vectors, padding, dy, Epilogue::NONE, dx),
            Self::Depthwise(packed) => depthwise::forward(vectors, shape, padding, packed, dy, Epilogue::NONE, dx),
        }
    }
}

/// How the weights' gradient is summed.
#[derive(Clone, Copy)]
enum WeightMethod {
    Direct,
    Winograd,
    Depthwise,
}

impl WeightMethod {
    fn of(shape: &ConvShape, output: &Extent) -> Self {
        if shape.depthwise {
            Self::Depthwise
        } else if shape.kernel == 3 && winograd::pays(shape.kernel, shape.stride, shape.channels, output) {
            Self::Winograd
        } else {
            Self::Direct
        }
    }

    fn len(self, vectors: Vectors, shape: &ConvShape) -> usize {
        match self {
            Self::Direct => gradient_len(vectors, shape.kernel, shape.kernel * shape.channels[0], shape.channels[1]),
            Self::Winograd => winograd::gradient_sums_len(vectors, shape.channels),
            Self::Depthwise => depthwise::gradient_len(vectors, shape),
        }
    }

    /// Adds a group's part; `dy` has slack, `x` neither halo nor slack.
    fn add(self, vectors: Vectors, shape: &ConvShape, x: Map<'_>, dy: Map<'_>, sums: &mut [f32]) {
        match self {
            Self::Direct if shape.padding == 0 => super::gradient::add_weight_gradient(vectors, shape, x, dy, sums),
            Self::Direct => {
                with_padded(x, shape.padding, |x| super::gradient::add_weight_gradient(vectors, shape, x, dy, sums))
            }
            Self::Winograd => winograd::add_weight_gradient(vectors, shape.channels, shape.padding, x, dy, sums),
            Self::Depthwise => {
                with_padded(x, shape.padding, |x| depthwise::add_weight_gradient(vectors, shape, x, dy, sums))
            }
        }
    }

    fn unpack(self, vectors: Vectors, shape: &ConvShape, sums: &[f32]) -> Vec<f32> {
        match self {
            Self::Direct => unpack(vectors, shape, sums),
            Self::Winograd => winograd::unpack(vectors, shape.channels, sums),
            Self::Depthwise => depthwise::unpack(vectors, shape, sums),
        }
    }
}

/// A unit's forward pass as its backward pass sees it.
#[derive(Clone, Copy)]
pub struct Forward<'a> {
    /// The unit.
    pub shape: &'a UnitShape,
    /// Its weights.
    pub weights: &'a [f32],
    /// Its norm.
    pub norm: Option<NormInput<'a>>,
    /// What [`unit_forward`] saved.
    pub saved: &'a Saved,
    /// Its input.
    pub x: Map<'a>,
    /// Its output.
    pub z: &'a [f32],
}

/// Which gradients [`unit_backward`] works out besides those of the parameters.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// Of the input.
    pub x: bool,
    /// Of the skip.
    pub skip: bool,
}

/// Training's backward pass: gradients from that of the output, `dz`.
pub fn unit_backward(vectors: Vectors, forward: Forward<'_>, dz: &[f32], wanted: Wanted) -> UnitGradients {
    let Forward { shape, weights, norm, saved, x, z } = forward;
    let conv = &shape.conv;
    let extent = conv.output(x.extent);
    let (row, channels, slope) = (extent.pitch(), extent.channels, shape.slope);
    // Sums over all pixels: of the gradient before the activation, and of its product with the
    // normalised convolution's output.
    let mean: Vec<f64> = saved.mean.iter().map(|&mean| f64::from(mean)).collect();
    let deviation: Vec<f64> = norm.map_or_else(Vec::new, |norm| {
        saved.variance.iter().map(|&variance| f64::from(variance + norm.epsilon).sqrt()).collect()
    });
    let wide_mean = widen(&mean, row);
    let mut skip = wanted.skip.then(|| zeros(extent.len()));
    let mut totals = vec![[Vec::new(), Vec::new()]; extent.batch];
    let mut skips = skip.as_mut().map(|skip| skip.chunks_exact_mut(extent.image()));
    let parts = totals.iter_mut().map(|totals| (totals, skips.as_mut().and_then(Iterator::next))).collect();
    for_each_of(parts, |image, (totals, skip): (&mut [Vec<f64>; 2], Option<&mut [f32]>)| {
        let at = image * extent.image()..(image + 1) * extent.image();
        let (z, dz) = (&z[at.clone()], &dz[at.clone()]);
        let mut sums = [vec![0.0_f32; row], Vec::new()];
        if norm.is_some() {
            let mut products = vec![0.0; row];
            let values = &saved.convolved[at.clone()];
            sum_norm_gradient(vectors, z, dz, slope, values, &wide_mean, &mut sums[0], &mut products);
            sums[1] = products;
        } else {
            sum_gradient(vectors, z, dz, slope, &mut sums[0]);
        }
        if let Some(skip) = skip {
            before_activation(vectors, z, dz, slope, skip);
        }
        *totals = sums.map(|sums| per_channel(&sums, channels));
    });
    let mut shift_gradient = vec![0.0_f64; channels];
    let mut scale_gradient = vec![0.0_f64; if norm.is_some() { channels } else { 0 }];
    for [shift, scale] in totals {
        shift_gradient.iter_mut().zip(shift).for_each(|(total, part)| *total += part);
        scale_gradient.iter_mut().zip(scale).for_each(|(total, part)| *total += part);
    }
    scale_gradient.iter_mut().zip(&deviation).for_each(|(total, deviation)| *total /= deviation);

    // Gradient of the convolution's output: `a·passed + b·value + c` with a norm, `passed` without.
    let pixels = (extent.len() / channels) as f64;
    let linear = norm.map(|norm| {
        let a: Vec<f64> =
            norm.scale.iter().zip(&deviation).map(|(&scale, deviation)| f64::from(scale) / deviation).collect();
        let b: Vec<f64> = (0..channels).map(|c| -a[c] * scale_gradient[c] / (deviation[c] * pixels)).collect();
        let c: Vec<f64> = (0..channels).map(|c| -a[c] * shift_gradient[c] / pixels - b[c] * mean[c]).collect();
        [widen(&a, row), widen(&b, row), widen(&c, row)]
    });
    let gradient_row = |line: usize, out: &mut [f32]| {
        let at = line * row..(line + 1) * row;
        let (z, dz) = (&z[at.clone()], &dz[at.clone()]);
        match &linear {
            Some([a, b, c]) => norm_gradient(vectors, z, dz, slope, &saved.convolved[at], [a, b, c], out),
            None => before_activation(vectors, z, dz, slope, out),
        }
    };

    let group = group(&extent);
    let groups = extent.batch.div_ceil(group);
    let grouped_input = Extent { batch: group, ..x.extent };
    let backward = wanted.x.then(|| Backward::new(vectors, conv, weights, &grouped_input));
    let method = WeightMethod::of(conv, &Extent { batch: group, ..extent });
    let halo = backward.as_ref().map_or(0, |backward| backward.halo(conv, x.extent));
    let mut dx = backward.as_ref().map(|_| zeros(x.extent.len()));
    // Each task sums its own groups' weight gradients, in order, so that a run can be repeated.
    let tasks = threads().min(groups);
    let len = method.len(vectors, conv);
    let mut sums = vec![0.0; tasks * len];
    let mut rest = dx.as_deref_mut();
    let parts = sums.chunks_exact_mut(len).enumerate().map(|(task, sums)| {
        let groups = split(groups, tasks, task);
        let [first, end] = groups.map(|index| (index * group).min(extent.batch) * x.extent.image());
        let dx = rest.take().map(|all| {
            let (dx, after) = all.split_at_mut(end - first);
            rest = Some(after);
            dx
        });
        (groups, sums, dx)
    });
    for_each_of(parts.collect(), |_, ([from, to], sums, mut dx)| {
        for index in from..to {
            let first = index * group;
            let count = group.min(extent.batch - first);
            let padded = Extent { batch: count, ..extent }.with_halo(halo);
            with_scratch(padded.len() + SLACK, |scratch| {
                fill_padded(&padded, first, &gradient_row, scratch);
                let dy = Map::new(padded, scratch);
                let x = x.images(first, count);
                method.add(vectors, conv, x, dy, sums);
                if let (Some(backward), Some(dx)) = (&backward, dx.as_deref_mut()) {
                    let input = Extent { batch: count, ..x.extent };
                    let at = (index - from) * group * input.image();
                    backward.run(vectors, conv, dy, MapMut::new(input, &mut dx[at..at + input.len()]));
                }
            });
        }
    });
    let (total, rest) = sums.split_at_mut(len);
    for part in rest.chunks_exact(len) {
        total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
    }
    let narrow = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
    UnitGradients {
        x: dx,
        weights: method.unpack(vectors, conv, total),
        shift: narrow(shift_gradient),
        scale: narrow(scale_gradient),
        skip,
    }
}

/// Fills a group's padded gradient: its rows from `row`, zeros around them and after them.
fn fill_padded(padded: &Extent, first: usize, row: &(impl Fn(usize, &mut [f32]) + Sync), out: &mut [f32]) {
    let (values, rest) = out.split_at_mut(padded.len());
    rest.fill(0.0);
    let edge = padded.halo * padded.channels;
    for (index, line) in values.chunks_exact_mut(padded.pitch()).enumerate() {
        let (image, y) = (index / (padded.height + 2 * padded.halo), index % (padded.height + 2 * padded.halo));
        match y.checked_sub(padded.halo).filter(|&y| y < padded.height) {
            Some(y) => {
                let (left, inner) = line.split_at_mut(edge);
                let (inner, right) = inner.split_at_mut(inner.len() - edge);
                left.fill(0.0);
                right.fill(0.0);
                row((first + image) * padded.height + y, inner);
            }
            None => line.fill(0.0),
        }
    }
}
