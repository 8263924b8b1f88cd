//! The kernels as operations of Burn's flex backend, forward and backward.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, ExtensionType, Flex, TensorMetadata, backend_extension};
use burn::tensor::{DType, TensorData};

use gravisight_kernels::{
    Extent, Map, MapMut, NormInput, UnitShape, Vectors, unit_forward, upsample as upsample_map, zeros,
};
use gravisight_kernels::{Forward, UnitGradients, Wanted, unit_backward, upsample_backward};

/// A normalised unit's output and its batch's statistics.
pub type Normalised<B> = (FloatTensor<B>, FloatTensor<B>, FloatTensor<B>);

/// What is added to a unit's result before its activation.
#[derive(ExtensionType, Debug, Clone)]
pub enum Skip<B: Backend> {
    /// Nothing.
    Without,
    /// A map of the result's size.
    With(FloatTensor<B>),
}

impl<B: Backend> Skip<B> {
    fn into_option(self) -> Option<FloatTensor<B>> {
        match self {
            Self::Without => None,
            Self::With(map) => Some(map),
        }
    }
}

/// Layers with kernels of their own. Maps are `[batch, height, width, channels]`, weights `[output,
/// input, kernel, kernel]`, shifts and scales `[output]`, all f32.
#[backend_extension(Flex, Autodiff)]
pub trait UnitOps: Backend {
    /// Convolution, bias, skip, activation.
    fn unit(
        x: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        #[extension_type] skip: Skip<Self>,
        shape: UnitShape,
    ) -> FloatTensor<Self>;

    /// Convolution, batch norm over the batch's own statistics, skip, activation; and the channels' mean
    /// and (biased) variance, which carry no gradient.
    fn norm_unit(
        x: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        shift: FloatTensor<Self>,
        scale: FloatTensor<Self>,
        #[extension_type] skip: Skip<Self>,
        shape: UnitShape,
        epsilon: f32,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);

    /// Bilinear upsampling by a whole factor.
    fn upsample_map(x: FloatTensor<Self>, factor: usize) -> FloatTensor<Self>;
}

type FlexTensor = FloatTensor<Flex>;

/// A tensor's values in a row.
fn contiguous(tensor: FlexTensor) -> FlexTensor {
    assert_eq!(tensor.dtype(), DType::F32, "PEN computes in f32");
    if tensor.as_slice::<f32>().is_some() { tensor } else { tensor.to_contiguous() }
}

/// The values of a [`contiguous`] tensor.
fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice::<f32>().unwrap_or_else(|| unreachable!("a contiguous f32 tensor"))
}

fn extent(tensor: &FlexTensor) -> Extent {
    Extent::new(tensor.shape().dims::<4>())
}

fn map(tensor: &FlexTensor) -> Map<'_> {
    Map::new(extent(tensor), values(tensor))
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

fn dims(extent: &Extent) -> [usize; 4] {
    [extent.batch, extent.height, extent.width, extent.channels]
}

/// A unit's inputs and what its backward pass needs.
#[derive(Debug, Clone)]
struct UnitRun {
    shape: UnitShape,
    x: FlexTensor,
    weights: FlexTensor,
    scale: Option<(FlexTensor, f32)>,
    saved: gravisight_kernels::Saved,
    output: FlexTensor,
}

impl UnitRun {
    fn forward(
        shape: UnitShape,
        [x, weights, shift]: [FlexTensor; 3],
        scale: Option<(FlexTensor, f32)>,
        skip: Option<FlexTensor>,
    ) -> Self {
        let [x, weights, shift] = [x, weights, shift].map(contiguous);
        let scale = scale.map(|(scale, epsilon)| (contiguous(scale), epsilon));
        let skip = skip.map(contiguous);
        let norm = scale.as_ref().map(|(scale, epsilon)| NormInput { scale: values(scale), epsilon: *epsilon });
        let (output, saved) = unit_forward(
            Vectors::best(),
            &shape,
            values(&weights),
            values(&shift),
            norm,
            map(&x),
            skip.as_ref().map(map),
        );
        let output = tensor(output, dims(&shape.conv.output(extent(&x))));
        Self { shape, x, weights, scale, saved, output }
    }

    fn statistics(&self) -> [FlexTensor; 2] {
        [&self.saved.mean, &self.saved.variance].map(|values| tensor(values.clone(), [values.len()]))
    }
}

impl UnitOps for Flex {
    fn unit(x: FlexTensor, weights: FlexTensor, bias: FlexTensor, skip: Skip<Self>, shape: UnitShape) -> FlexTensor {
        UnitRun::forward(shape, [x, weights, bias], None, skip.into_option()).output
    }

    fn norm_unit(
        x: FlexTensor,
        weights: FlexTensor,
        shift: FlexTensor,
        scale: FlexTensor,
        skip: Skip<Self>,
        shape: UnitShape,
        epsilon: f32,
    ) -> Normalised<Flex> {
        let run = UnitRun::forward(shape, [x, weights, shift], Some((scale, epsilon)), skip.into_option());
        let [mean, variance] = run.statistics();
        (run.output, mean, variance)
    }

    fn upsample_map(x: FlexTensor, factor: usize) -> FlexTensor {
        let x = contiguous(x);
        let [batch, height, width, channels] = x.shape().dims::<4>();
        let fine = Extent::new([batch, height * factor, width * factor, channels]);
        let mut out = zeros(fine.len());
        upsample_map(Vectors::best(), map(&x), factor, None, MapMut::new(fine, &mut out));
        tensor(out, dims(&fine))
    }
}

mod backward {
    use burn::backend::Autodiff;
    use burn::backend::autodiff::NodeId;
    use burn::backend::autodiff::checkpoint::base::Checkpointer;
    use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
    use burn::backend::autodiff::grads::Gradients;
    use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
    use burn::tensor::Shape;

    use super::*;

    type Tracked = FloatTensor<Autodiff<Flex>>;

    /// Gradients of x, weights, shift, scale and skip. Without a norm or a skip, x takes their place
    /// among the parents and nothing is registered for it.
    #[derive(Debug)]
    struct UnitBackward;

    /// A unit's run, and whether it has a skip.
    type UnitState = (UnitRun, bool);

    impl Backward<Flex, 5> for UnitBackward {
        type State = UnitState;

        fn backward(self, ops: Ops<UnitState, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
            let dz = contiguous(grads.consume::<Flex>(&ops.node));
            let (run, has_skip) = ops.state;
            let [x, weights, shift, scale, skip] = ops.parents;
            let norm = run.scale.as_ref().map(|(scale, epsilon)| NormInput { scale: values(scale), epsilon: *epsilon });
            let forward = Forward {
                shape: &run.shape,
                weights: values(&run.weights),
                norm,
                saved: &run.saved,
                x: map(&run.x),
                z: values(&run.output),
            };
            let wanted = Wanted { x: x.is_some(), skip: has_skip && skip.is_some() };
            let UnitGradients { x: dx, weights: dw, shift: dshift, scale: dscale, skip: dskip } =
                unit_backward(Vectors::best(), forward, values(&dz), wanted);
            let mut register = |id: NodeId, gradient: Vec<f32>, shape: Shape| {
                grads.register::<Flex>(id, FlexTensor::from_data(TensorData::new(gradient, shape)));
            };
            if let (Some(node), Some(dx)) = (x, dx) {
                register(node.id, dx, run.x.shape());
            }
            if let Some(node) = weights {
                register(node.id, dw, run.weights.shape());
            }
            let channels = Shape::new([run.shape.conv.channels[1]]);
            if let Some(node) = shift {
                register(node.id, dshift, channels.clone());
            }
            if let (Some(node), Some(_)) = (scale, &run.scale) {
                register(node.id, dscale, channels);
            }
            if let (Some(node), Some(dskip)) = (skip, dskip) {
                register(node.id, dskip, run.output.shape());
            }
        }
    }

    /// Runs a unit and enters it into the graph.
    fn tracked<C: CheckpointStrategy>(
        shape: UnitShape,
        [x, weights, shift]: [Tracked; 3],
        scale: Option<(Tracked, f32)>,
        skip: Option<Tracked>,
    ) -> (Tracked, [FlexTensor; 2]) {
        let scale_node = scale.as_ref().map_or_else(|| x.node(), |(scale, _)| scale.node());
        let skip_node = skip.as_ref().map_or_else(|| x.node(), |skip| skip.node());
        let nodes = [x.node(), weights.node(), shift.node(), scale_node, skip_node];
        let prepared = UnitBackward.prepare::<C>(nodes).compute_bound().stateful();
        let has_skip = skip.is_some();
        let run = UnitRun::forward(
            shape,
            [x, weights, shift].map(|tensor| tensor.into_primitive()),
            scale.map(|(scale, epsilon)| (scale.into_primitive(), epsilon)),
            skip.map(|skip| skip.into_primitive()),
        );
        let (statistics, output) = (run.statistics(), run.output.clone());
        let output = match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((run, has_skip), output),
            OpsKind::UnTracked(prepared) => prepared.finish(output),
        };
        (output, statistics)
    }

    impl<C: CheckpointStrategy> UnitOps for Autodiff<Flex, C> {
        fn unit(x: Tracked, weights: Tracked, bias: Tracked, skip: Skip<Self>, shape: UnitShape) -> Tracked {
            tracked::<C>(shape, [x, weights, bias], None, skip.into_option()).0
        }

        fn norm_unit(
            x: Tracked,
            weights: Tracked,
            shift: Tracked,
            scale: Tracked,
            skip: Skip<Self>,
            shape: UnitShape,
            epsilon: f32,
        ) -> Normalised<Self> {
            let (output, [mean, variance]) =
                tracked::<C>(shape, [x, weights, shift], Some((scale, epsilon)), skip.into_option());
            (output, Tracked::new(mean), Tracked::new(variance))
        }

        fn upsample_map(x: Tracked, factor: usize) -> Tracked {
            #[derive(Debug)]
            struct UpsampleBackward;

            impl Backward<Flex, 1> for UpsampleBackward {
                type State = (Extent, usize);

                fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
                    let (coarse, factor) = ops.state;
                    unary::<Flex, _>(ops.parents, ops.node, grads, |dy| {
                        let dy = contiguous(dy);
                        let mut dx = zeros(coarse.len());
                        upsample_backward(Vectors::best(), map(&dy), factor, MapMut::new(coarse, &mut dx));
                        tensor(dx, dims(&coarse))
                    });
                }
            }

            let coarse = Extent::new(x.primitive().shape().dims::<4>());
            let prepared = UpsampleBackward.prepare::<C>([x.node()]).compute_bound().stateful();
            let output = Flex::upsample_map(x.into_primitive(), factor);
            match prepared {
                OpsKind::Tracked(prepared) => prepared.finish((coarse, factor), output),
                OpsKind::UnTracked(prepared) => prepared.finish(output),
            }
        }
    }
}
