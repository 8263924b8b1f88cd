//! The optimiser.

use burn::module::Module as _;
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

use super::flat::{Gradients, Layout};
use crate::model::Pen;

/// Decays of the two moments.
const DECAYS: [f32; 2] = [0.9, 0.999];
/// Adam with decoupled weight decay (Loshchilov and Hutter, 2019): Burn's `AdamW` to the bit (its ε is 1e-5).
///
/// Burn's own keeps its moments to itself and reads them synchronously when it is saved, which a GPU in a browser does not allow.
/// Here they are networks, which are saved as any other.
#[derive(Clone)]
pub struct AdamW {
    weight_decay: f64,
    /// Against a division by a gradient that is zero.
    epsilon: f32,
    /// Updates made.
    updates: usize,
    /// Running means of each weight's gradient and of its square.
    moments: Moments,
}

#[derive(Clone)]
enum Moments {
    /// Zero, before the first update.
    None,
    /// As they were kept.
    Networks(Box<[Pen; 2]>),
    /// As the updates have them.
    Flat(Box<(Layout, [Tensor<1>; 2])>),
}

impl AdamW {
    /// At the start of a training.
    pub fn new(weight_decay: f64, epsilon: f64) -> Self {
        // Burn's is of single precision.
        let weight_decay = f64::from(weight_decay as f32);
        Self { weight_decay, epsilon: epsilon as f32, updates: 0, moments: Moments::None }
    }

    /// After `updates` updates, with the `moments` that [`Self::moments`] gave.
    pub fn after(weight_decay: f64, epsilon: f64, updates: usize, moments: &[Pen; 2]) -> Self {
        let moments = Moments::Networks(Box::new(moments.clone()));
        Self { updates, moments, ..Self::new(weight_decay, epsilon) }
    }

    /// The moments as networks like `pen`, without gradients; zero where there are none yet.
    pub fn moments(&self, pen: &Pen) -> [Pen; 2] {
        let zeros = |values: Option<(&Layout, &Tensor<1>)>| match values {
            Some((layout, values)) => layout.scatter_over_zeros(pen.valid(), values),
            None => Layout::zeros(pen.valid()),
        };
        match &self.moments {
            Moments::None => [zeros(None), zeros(None)],
            Moments::Networks(networks) => (**networks).clone(),
            Moments::Flat(flat) => [0, 1].map(|order| zeros(Some((&flat.0, &flat.1[order])))),
        }
    }

    /// `pen` after an update against `gradients`; what has none stays.
    pub fn step(&mut self, learning_rate: f64, pen: Pen, gradients: GradientsParams) -> Pen {
        match Gradients::of(&pen, gradients) {
            Some(gradients) => self.step_by(learning_rate, pen, gradients),
            None => {
                self.updates += 1;
                pen
            }
        }
    }

    /// The same with the gradients as a vector.
    pub fn step_by(&mut self, learning_rate: f64, pen: Pen, Gradients { layout, values }: Gradients) -> Pen {
        self.updates += 1;
        let before = match std::mem::replace(&mut self.moments, Moments::None) {
            Moments::None => None,
            Moments::Flat(flat) if flat.0 == layout => Some(flat.1),
            moments => {
                self.moments = moments;
                Some(self.moments(&pen).map(|network| layout.gather(&network)))
            }
        };
        let decayed = before.map(|before| [0, 1].map(|order| before[order].clone().mul_scalar(DECAYS[order])));
        let powers = [values.clone(), values.square()];
        let moments = [0, 1].map(|order| {
            let new = powers[order].clone().mul_scalar(1.0 - DECAYS[order]);
            match &decayed {
                Some(decayed) => decayed[order].clone().add(new),
                None => new,
            }
        });
        let [mean, square] =
            [0, 1].map(|order| moments[order].clone().div_scalar(1.0 - DECAYS[order].powi(self.updates as i32)));
        let change = mean.div(square.sqrt().add_scalar(self.epsilon)).mul_scalar(learning_rate);
        let decay = learning_rate * self.weight_decay;
        let weights = layout.gather(&pen.valid());
        let kept = if decay == 0.0 { weights } else { weights.mul_scalar(1.0 - decay) };
        let moved = layout.scatter(pen, &(kept - change));
        self.moments = Moments::Flat(Box::new((layout, moments)));
        moved
    }
}
