//! Exponential moving average of the weights and batch-norm statistics.

use burn::module::Module as _;
use burn::tensor::Tensor;

use super::flat::Layout;
use crate::model::Pen;

/// A slow copy of the network, the one that is kept.
#[derive(Debug, Clone)]
pub struct Ema {
    /// A network like it.
    like: Pen,
    layout: Layout,
    values: Tensor<1>,
    decay: f64,
    /// Updates seen, where the decay grows.
    updates: Option<usize>,
}

impl Ema {
    /// An average that starts at `average`, a network without gradients. `updates` is how many it has already seen, where the decay is
    /// to grow from 1/10 to its full value, so that the random start is forgotten; else none.
    pub fn new(average: Pen, decay: f64, updates: Option<usize>) -> Self {
        let layout = Layout::of(&average);
        Self { values: layout.gather(&average), like: average, layout, decay, updates }
    }

    /// A copy of the average, without gradients.
    pub fn model(&self) -> Pen {
        self.layout.scatter(self.like.valid(), &self.values)
    }

    /// Moves the average towards `model`.
    pub fn update(&mut self, model: &Pen) {
        let warm_up = self.updates.map_or(1.0, |updates| (1 + updates) as f64 / (10 + updates) as f64);
        self.updates = self.updates.map(|updates| updates + 1);
        let decay = self.decay.min(warm_up);
        let current = self.layout.gather(&model.valid());
        self.values = self.values.clone().mul_scalar(decay) + current.mul_scalar(1.0 - decay);
    }
}
