//! Physics that a run learns along with its network: numbers of the scenes that are known only roughly.

use super::super::examples::{Start, Window};
use super::super::recipe::Law;
use gravisight_geometry::error::Result;
use gravisight_physics::{Contact, Forecaster, Scene};

/// Decays of Adam's moments, as the network's.
const DECAYS: [f64; 2] = [0.9, 0.999];
/// Against a division by a gradient that is zero.
const EPSILON: f64 = 1e-8;

/// The laws of a run, each as a factor of what the scenes say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LearnedLaws {
    learned: Vec<Learned>,
    /// Steps made.
    steps: i32,
}

/// A number that is learned, by Adam on its logarithm.
#[derive(Debug, Clone, PartialEq)]
struct Learned {
    law: Law,
    log_factor: f64,
    /// Running means of the gradient and of its square.
    moments: [f64; 2],
}

impl LearnedLaws {
    /// As the scenes say, `learned` to be learned.
    pub fn new(learned: &[Law]) -> Self {
        let fresh = |&law: &Law| Learned { law, log_factor: 0.0, moments: [0.0; 2] };
        Self { learned: learned.iter().map(fresh).collect(), steps: 0 }
    }

    /// How many are learned.
    pub fn count(&self) -> usize {
        self.learned.len()
    }

    /// Each law that is learned, and its factor.
    pub fn factors(&self) -> impl Iterator<Item = (Law, f64)> + '_ {
        self.learned.iter().map(|learned| (learned.law, learned.log_factor.exp()))
    }

    /// `scene` under these laws.
    pub fn scene(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        for (law, factor) in self.factors() {
            match (law, &mut scene.contact) {
                (Law::Gravity, _) => scene.gravity = scene.gravity.map(|part| part * factor),
                (Law::Drag, _) => scene.ball.drag_coefficient *= factor,
                // More than what came in does not come out.
                (Law::Restitution, Contact::Bounce { restitution, .. }) => {
                    *restitution = (*restitution * factor).min(1.0);
                }
                (Law::Restitution, _) => {}
            }
        }
        scene
    }

    /// The same with the logarithm of law `index` greater by `by`.
    pub fn nudged(&self, index: usize, by: f64) -> Self {
        let mut nudged = self.clone();
        nudged.learned[index].log_factor += by;
        nudged
    }

    /// `window` under these laws.
    ///
    /// # Errors
    /// As [`Forecaster::in_scene`].
    pub fn window(&self, window: &Window) -> Result<Window> {
        let mut window = window.clone();
        if self.learned.is_empty() {
            return Ok(window);
        }
        let under = |forecaster: &Forecaster| forecaster.in_scene(&self.scene(forecaster.scene()));
        window.forecaster = under(&window.forecaster)?.into();
        if let Start::Track { free, .. } = &mut window.start {
            *free = under(free)?.into();
        }
        Ok(window)
    }

    /// A step of Adam against `gradient`, by the logarithms.
    pub fn advance(&mut self, gradient: &[f64], learning_rate: f64) {
        self.steps = self.steps.saturating_add(1);
        for (learned, &slope) in self.learned.iter_mut().zip(gradient) {
            let powers = [slope, slope * slope];
            let mut corrected = [0.0; 2];
            for order in 0..2 {
                let decay = DECAYS[order];
                learned.moments[order] = decay * learned.moments[order] + (1.0 - decay) * powers[order];
                corrected[order] = learned.moments[order] / (1.0 - decay.powi(self.steps));
            }
            learned.log_factor -= learning_rate * corrected[0] / (corrected[1].sqrt() + EPSILON);
        }
    }

    /// Their numbers, from which [`Self::with_numbers`] makes them again to the bit.
    pub fn numbers(&self) -> (i32, Vec<[f64; 3]>) {
        let numbers = |learned: &Learned| [learned.log_factor, learned.moments[0], learned.moments[1]];
        (self.steps, self.learned.iter().map(numbers).collect())
    }

    /// These laws with `numbers`; none where they are of other laws.
    pub fn with_numbers(mut self, (steps, numbers): (i32, Vec<[f64; 3]>)) -> Option<Self> {
        if numbers.len() != self.learned.len() {
            return None;
        }
        self.steps = steps;
        for (learned, [log_factor, first, second]) in self.learned.iter_mut().zip(numbers) {
            (learned.log_factor, learned.moments) = (log_factor, [first, second]);
        }
        Some(self)
    }
}
