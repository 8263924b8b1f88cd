//! Inference on the CPU: a network's layers worked out once for a size of picture, then run in buffers
//! that are used again.
//!
//! Norms are folded into weights, weights lie in the kernels' own order, biases, skips and activations
//! are part of the convolutions, and each map is written with the halo that the next layer reads.

use std::sync::{Mutex, PoisonError};

use burn::nn::LayerNorm;
use burn::tensor::{ElementConversion as _, Tensor};

use super::layers::{Layers, RESPONSE_NORM_EPSILON, ResponseNorm, Slope, Unit};
use super::tensors::{fold, shape};
use gravisight_geometry::size::Size;
use gravisight_kernels::{
    Buffer, Convolution, Extent, Map, MapMut, SLACK, Vectors, for_each, gelu, layer_norm, max_pool, response_norm,
    threads, upsample, with_threads_awake,
};

/// A network for one size of picture, ready to run.
#[derive(Debug)]
pub(super) struct Plan {
    vectors: Vectors,
    steps: Vec<PlannedLayer>,
    /// Sets of maps for one picture, with halos, that nobody uses at the moment.
    idle: Mutex<Vec<Vec<Buffer>>>,
    /// Lengths of the buffers.
    lengths: Vec<usize>,
    /// A picture's layout.
    picture: Extent,
    outputs: Vec<BufferSlot>,
}

/// A map and the buffer that it is in.
#[derive(Debug, Clone, Copy)]
struct BufferSlot {
    extent: Extent,
    buffer: usize,
}

#[derive(Debug, Clone)]
struct PlannedLayer {
    task: Task,
    /// The picture without.
    x: Option<BufferSlot>,
    other: Option<BufferSlot>,
    out: BufferSlot,
}

#[derive(Debug, Clone)]
enum Task {
    Unit { conv: Box<Convolution>, slope: f32 },
    Upsample { factor: usize },
    MaxPool,
    LayerNorm { scale: Vec<f32>, shift: Vec<f32>, epsilon: f32, slope: f32 },
    Gelu,
    ResponseNorm { weight: Vec<f32>, bias: Vec<f32> },
}

impl Plan {
    /// The plan of a network that takes a picture of `size`, `[1, height, width, channels]`; `network` names its layers and
    /// returns its outputs.
    pub(super) fn new(size: Size, channels: usize, network: impl FnOnce(&mut Recorder, &usize) -> Vec<usize>) -> Self {
        let mut recorder = Recorder::new(size, channels);
        let outputs = network(&mut recorder, &PICTURE);
        recorder.finish(&outputs)
    }

    /// Values of the maps of such a network: of those that a batch norm makes, and of the others.
    pub(super) fn map_values(
        size: Size,
        channels: usize,
        network: impl FnOnce(&mut Recorder, &usize) -> Vec<usize>,
    ) -> [usize; 2] {
        let mut recorder = Recorder::new(size, channels);
        network(&mut recorder, &PICTURE);
        let all: usize = recorder.maps.iter().map(Extent::len).sum();
        [recorder.normalised, all - recorder.normalised]
    }

    /// Runs the network on pictures `[batch, height, width, channels]`; its outputs' layouts and values.
    ///
    /// Enough pictures go through the network one to a thread: their maps stay in the thread's cache.
    ///
    /// # Panics
    /// Where `pictures` are not whole pictures.
    pub(super) fn run(&self, pictures: &[f32]) -> Vec<(Extent, Vec<f32>)> {
        let each = self.picture.len();
        assert!(pictures.len().is_multiple_of(each), "{} values are not pictures of {each}", pictures.len());
        let batch = pictures.len() / each;
        let lanes = threads().min(batch).max(1);
        let found = Mutex::new(vec![Vec::new(); batch]);
        with_threads_awake(|| {
            for_each(lanes, |lane| {
                let mut buffers = self.buffers();
                for image in lane * batch / lanes..(lane + 1) * batch / lanes {
                    let outputs = self.run_one(&mut buffers, &pictures[image * each..(image + 1) * each]);
                    found.lock().unwrap_or_else(PoisonError::into_inner)[image] = outputs;
                }
                self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(buffers);
            });
        });
        let found: Vec<Vec<Vec<f32>>> = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        let outputs = self.outputs.iter().enumerate().map(|(index, output)| {
            let extent = Extent { batch, ..output.extent.with_halo(0) };
            (extent, found.iter().map(|outputs| &outputs[index][..]).collect::<Vec<_>>().concat())
        });
        outputs.collect()
    }

    /// A set of maps: one used before, or a new one.
    fn buffers(&self) -> Vec<Buffer> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.unwrap_or_else(|| self.lengths.iter().map(|&len| Buffer::zeros(len)).collect())
    }

    /// Runs the network on one picture; its outputs' values, without halo.
    fn run_one(&self, buffers: &mut [Buffer], picture: &[f32]) -> Vec<Vec<f32>> {
        let Self { vectors, steps, .. } = self;
        for step in steps {
            let mut out = std::mem::take(&mut buffers[step.out.buffer]);
            let read = |place: BufferSlot| Map::new(place.extent, buffers[place.buffer].values());
            let (x, other) = (step.x.map_or(Map::new(self.picture, picture), read), step.other.map(read));
            let write = MapMut::new(step.out.extent, out.values_mut());
            match &step.task {
                Task::Unit { conv, slope } => conv.run(x, other, *slope, write),
                Task::Upsample { factor } => upsample(*vectors, x, *factor, other, write),
                Task::MaxPool => max_pool(*vectors, x, write),
                Task::LayerNorm { scale, shift, epsilon, slope } => {
                    layer_norm(*vectors, x, [scale, shift], *epsilon, *slope, write);
                }
                Task::Gelu => gelu(x, write),
                Task::ResponseNorm { weight, bias } => {
                    response_norm(x, [weight, bias], RESPONSE_NORM_EPSILON, write);
                }
            }
            buffers[step.out.buffer] = out;
        }
        let outputs = self.outputs.iter().map(|output| {
            let map = Map::new(output.extent, buffers[output.buffer].values());
            (0..output.extent.height).map(|row| map.row(0, row)).collect::<Vec<_>>().concat()
        });
        outputs.collect()
    }
}

/// The picture's number among the maps.
const PICTURE: usize = 0;

/// A layer before it is known where maps lie.
struct Record {
    task: Task,
    x: usize,
    other: Option<usize>,
    out: usize,
}

/// Notes a network's layers; a map is its number.
pub(super) struct Recorder {
    vectors: Vectors,
    maps: Vec<Extent>,
    records: Vec<Record>,
    /// Values of the maps of units with a batch norm.
    normalised: usize,
}

impl Recorder {
    fn new(size: Size, channels: usize) -> Self {
        let picture = Extent::new([1, size.height as usize, size.width as usize, channels]);
        Self { vectors: Vectors::best(), maps: vec![picture], records: Vec::new(), normalised: 0 }
    }

    fn record(&mut self, task: Task, x: usize, other: Option<usize>, out: Extent) -> usize {
        self.maps.push(out);
        let out = self.maps.len() - 1;
        self.records.push(Record { task, x, other, out });
        out
    }

    /// Gives each map the halo that its readers need and a buffer that nobody needs any more.
    fn finish(mut self, outputs: &[usize]) -> Plan {
        let mut last_use = vec![0; self.maps.len()];
        for (index, record) in self.records.iter().enumerate() {
            // Pictures are padded bit by bit as they are read.
            if let Task::Unit { conv, .. } = &record.task
                && record.x != PICTURE
            {
                self.maps[record.x].halo = self.maps[record.x].halo.max(conv.halo());
            }
            for map in [Some(record.x), record.other, Some(record.out)].into_iter().flatten() {
                last_use[map] = index;
            }
        }
        outputs.iter().for_each(|&output| last_use[output] = usize::MAX);
        let mut lengths = Vec::new();
        // The map that each buffer holds. Another one may take it over only if it has the same layout:
        // then the halo's zeros stay where they are.
        let mut held: Vec<usize> = Vec::new();
        let mut places: Vec<Option<BufferSlot>> = vec![None; self.maps.len()];
        let mut settle = |map: usize, now: usize| {
            let extent = self.maps[map];
            let free = held.iter().position(|&held| self.maps[held] == extent && last_use[held] < now);
            let buffer = free.unwrap_or_else(|| {
                lengths.push(extent.len() + SLACK);
                held.push(map);
                lengths.len() - 1
            });
            held[buffer] = map;
            let place = BufferSlot { extent, buffer };
            places[map] = Some(place);
            place
        };
        let mut steps = Vec::with_capacity(self.records.len());
        let outs: Vec<BufferSlot> =
            self.records.iter().enumerate().map(|(now, record)| settle(record.out, now)).collect();
        let place = |map: usize| places[map].unwrap_or_else(|| unreachable!("a layer reads what an earlier one wrote"));
        for (record, out) in self.records.into_iter().zip(outs) {
            let x = (record.x != PICTURE).then(|| place(record.x));
            steps.push(PlannedLayer { task: record.task, x, other: record.other.map(place), out });
        }
        let outputs = outputs.iter().map(|&map| place(map)).collect();
        Plan { vectors: self.vectors, steps, idle: Mutex::default(), lengths, picture: self.maps[PICTURE], outputs }
    }
}

/// A parameter's values. The CPU's tensors are there at once, in a browser too.
fn read<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().map(|value| value.elem()).collect()
}

impl Layers for Recorder {
    type Map = usize;

    fn unit(&mut self, &x: &usize, unit: Unit<'_>, skip: Option<&usize>) -> usize {
        let shape = shape(&unit);
        let (weight, bias) = match unit.norm {
            Some(norm) => {
                let (weight, bias) = fold(unit.weight, norm);
                (weight, Some(bias))
            }
            None => (unit.weight, unit.bias),
        };
        let output = shape.conv.output(self.maps[x].with_halo(0));
        if unit.norm.is_some() {
            self.normalised += output.len();
        }
        let bias = bias.map(read);
        let conv = Convolution::new(self.vectors, shape.conv, &read(weight), bias.as_deref(), &output);
        self.record(Task::Unit { conv: Box::new(conv), slope: shape.slope }, x, skip.copied(), output)
    }

    fn upsample(&mut self, &x: &usize, factor: usize, add: Option<&usize>) -> usize {
        let coarse = self.maps[x];
        let fine = Extent { height: coarse.height * factor, width: coarse.width * factor, halo: 0, ..coarse };
        self.record(Task::Upsample { factor }, x, add.copied(), fine)
    }

    fn max_pool(&mut self, &x: &usize) -> usize {
        let fine = self.maps[x];
        let coarse = Extent { height: fine.height.div_ceil(2), width: fine.width.div_ceil(2), halo: 0, ..fine };
        self.record(Task::MaxPool, x, None, coarse)
    }

    fn gelu(&mut self, &x: &usize) -> usize {
        self.record(Task::Gelu, x, None, self.maps[x].with_halo(0))
    }

    fn response_norm(&mut self, &x: &usize, norm: &ResponseNorm) -> usize {
        let [weight, bias] = [&norm.weight, &norm.bias].map(|values| read(values.val()));
        self.record(Task::ResponseNorm { weight, bias }, x, None, self.maps[x].with_halo(0))
    }

    fn layer_norm(&mut self, &x: &usize, norm: &LayerNorm, epsilon: f64, slope: Slope) -> usize {
        let scale = read(norm.gamma.val());
        let shift = norm.beta.as_ref().map_or_else(|| vec![0.0; scale.len()], |beta| read(beta.val()));
        let task = Task::LayerNorm { scale, shift, epsilon: epsilon as f32, slope: slope.0 };
        self.record(task, x, None, self.maps[x].with_halo(0))
    }
}
