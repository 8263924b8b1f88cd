//! The optimiser.

use burn::module::{Module as _, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::optim::GradientsParams;
use burn::tensor::{Tensor, container::TensorContainer};

use crate::model::Pen;

/// Decays of the two moments.
const DECAYS: [f32; 2] = [0.9, 0.999];
/// Adam with decoupled weight decay (Loshchilov and Hutter, 2019): Burn's `AdamW` to the bit (its ε is 1e-5).
///
/// Burn's own keeps its moments to itself and reads them synchronously when it is saved, which a GPU in a browser does not allow.
/// Here they are networks, which are saved as any other.
pub struct AdamW {
    weight_decay: f64,
    /// Against a division by a gradient that is zero.
    epsilon: f32,
    /// Updates made.
    updates: usize,
    /// Running means of each weight's gradient and of its square.
    moments: [TensorContainer<ParamId>; 2],
}

impl AdamW {
    /// At the start of a training.
    pub fn new(weight_decay: f64, epsilon: f64) -> Self {
        // Burn's is of single precision.
        let weight_decay = f64::from(weight_decay as f32);
        let moments = [TensorContainer::new(), TensorContainer::new()];
        Self { weight_decay, epsilon: epsilon as f32, updates: 0, moments }
    }

    /// After `updates` updates, with the `moments` that [`Self::moments`] gave.
    pub fn after(weight_decay: f64, epsilon: f64, updates: usize, moments: &[Pen; 2]) -> Self {
        let moments = [0, 1].map(|order| {
            let mut collected = GradientCollector(TensorContainer::new());
            moments[order].visit(&mut collected);
            collected.0
        });
        Self { updates, moments, ..Self::new(weight_decay, epsilon) }
    }

    /// The moments as networks like `pen`, without gradients; zero where there are none yet.
    pub fn moments(&self, pen: &Pen) -> [Pen; 2] {
        [0, 1].map(|order| pen.valid().map(&mut Fill(&self.moments[order])))
    }

    /// `pen` after an update against `gradients`; what has none stays.
    pub fn step(&mut self, learning_rate: f64, pen: Pen, gradients: GradientsParams) -> Pen {
        self.updates += 1;
        pen.map(&mut Update { optimiser: self, learning_rate, gradients })
    }
}

struct Update<'a> {
    optimiser: &'a mut AdamW,
    learning_rate: f64,
    gradients: GradientsParams,
}

impl ModuleMapper for Update<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(gradient) = self.gradients.remove::<D>(param.id) else { return param };
        let AdamW { weight_decay, epsilon, updates, moments } = &mut *self.optimiser;
        let powers = [gradient.clone(), gradient.square()];
        let mut corrected = powers.into_iter().zip(moments).zip(DECAYS).map(|((power, moments), decay)| {
            let new = power.mul_scalar(1.0 - decay);
            let mean = match moments.remove::<Tensor<D>>(&param.id) {
                Some(mean) => mean.mul_scalar(decay).add(new),
                None => new,
            };
            moments.register(param.id, mean.clone());
            mean.div_scalar(1.0 - decay.powi(*updates as i32))
        });
        let (Some(mean), Some(square)) = (corrected.next(), corrected.next()) else { return param };
        let change = mean.div(square.sqrt().add_scalar(*epsilon)).mul_scalar(self.learning_rate);
        let decay = self.learning_rate * *weight_decay;
        param.map(|weights| {
            let is_learned = weights.is_require_grad();
            let weights = weights.inner();
            let kept = if decay == 0.0 { weights } else { weights.mul_scalar(1.0 - decay) };
            let moved = Tensor::from_inner(kept - change);
            if is_learned { moved.require_grad() } else { moved }
        })
    }
}

/// Gathers all float tensors by id.
pub(super) struct GradientCollector(pub TensorContainer<ParamId>);

impl ModuleVisitor for GradientCollector {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0.register(param.id, param.val());
    }
}

/// Puts tensors into the places of a network's; zeros where there are none.
struct Fill<'a>(&'a TensorContainer<ParamId>);

impl ModuleMapper for Fill<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let moment = self.0.get::<Tensor<D>>(&param.id);
        param.map(|weights| moment.unwrap_or_else(|| weights.zeros_like()))
    }
}
