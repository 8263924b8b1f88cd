//! Exponential moving average of the weights and batch-norm statistics.

use burn::module::{Module, ModuleMapper, Param, ParamId};
use burn::tensor::{Tensor, container::TensorContainer};

use super::optimiser::GradientCollector;
use crate::model::Pen;

/// A slow copy of the network, the one that is kept.
#[derive(Debug, Clone)]
pub struct Ema {
    average: Pen,
    decay: f64,
    /// Updates seen, where the decay grows.
    updates: Option<usize>,
}

impl Ema {
    /// An average that starts at `average`. `updates` is how many it has already seen, where the decay is to grow from 1/10 to its
    /// full value, so that the random start is forgotten; else none.
    pub fn new(average: Pen, decay: f64, updates: Option<usize>) -> Self {
        Self { average, decay, updates }
    }

    /// The average, on the device without gradients.
    pub fn model(&self) -> &Pen {
        &self.average
    }

    /// Moves the average towards `model`.
    pub fn update(&mut self, model: &Pen) {
        let warm_up = self.updates.map_or(1.0, |updates| (1 + updates) as f64 / (10 + updates) as f64);
        self.updates = self.updates.map(|updates| updates + 1);
        let mut current = GradientCollector(TensorContainer::new());
        model.valid().visit(&mut current);
        let mut blend = Blend { current: current.0, decay: self.decay.min(warm_up) };
        self.average = self.average.clone().map(&mut blend);
    }
}

/// `decay`·average + (1 − `decay`)·current.
struct Blend {
    current: TensorContainer<ParamId>,
    decay: f64,
}

impl ModuleMapper for Blend {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(current) = self.current.remove::<Tensor<D>>(&param.id) else { return param };
        let decay = self.decay;
        param.map(|average| average.mul_scalar(decay) + current.mul_scalar(1.0 - decay))
    }
}
