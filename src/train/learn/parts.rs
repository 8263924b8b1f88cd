//! A training's state as bytes: its networks as weights files, and the rest as text.

use std::collections::BTreeMap;

use burn::module::Module as _;
use serde::{Deserialize, Serialize};

use super::super::recipe::Recipe;
use super::knowledge::Knowledge;
use super::trainer::{LossWatch, TrainerState};
use crate::model::{self, Pen};
use gravisight_geometry::error::{Error, Result};

/// Names of the networks in a checkpoint.
const MODEL: &str = "model";
const AVERAGE: &str = "average";
const MOMENTS: [&str; 2] = ["first-moments", "second-moments"];

/// What a state is besides its networks. Numbers are text, from which they are read to the bit: JSON would round, and has no
/// infinity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Beside {
    step: usize,
    /// Mean and lowest mean.
    watch: Option<[String; 2]>,
    knowledge: String,
}

impl TrainerState {
    /// Its networks as files, each by its name, and the rest. A GPU is read asynchronously.
    ///
    /// # Errors
    /// [`Error::Device`] for a device that cannot be read.
    pub async fn parts(&self) -> Result<(Vec<(&'static str, Vec<u8>)>, Beside)> {
        let Self { step, model, average, moments: [first, second], watch, knowledge } = self;
        let mut parts = vec![];
        for (name, pen) in [(MODEL, model), (AVERAGE, average), (MOMENTS[0], first), (MOMENTS[1], second)] {
            parts.push((name, model::save(&model::on_cpu(pen).await?)?));
        }
        let watch = watch.map(|LossWatch { mean, lowest }| [mean.to_string(), lowest.to_string()]);
        Ok((parts, Beside { step: *step, watch, knowledge: knowledge.text() }))
    }

    /// The state of these parts in a training by `recipe`; `blank` is a network of its architecture on its device. `what` names
    /// the parts in errors.
    ///
    /// # Errors
    /// [`Error::Data`] for parts that are no training's; as [`model::load`] for a network of another architecture.
    pub fn of_parts(
        mut parts: BTreeMap<String, Vec<u8>>,
        beside: &Beside,
        blank: &Pen,
        recipe: &Recipe,
        what: &str,
    ) -> Result<Self> {
        let damaged = |reason: &str| Error::Data { what: what.into(), reason: reason.into() };
        let mut load = |name: &str, blank: Pen| {
            let bytes = parts.remove(name).ok_or_else(|| damaged(&format!("holds no `{name}`")))?;
            model::load_into(blank, bytes)
        };
        let numbers =
            |[mean, lowest]: &[String; 2]| Some(LossWatch { mean: mean.parse().ok()?, lowest: lowest.parse().ok()? });
        let watch = match &beside.watch {
            Some(watch) => Some(numbers(watch).ok_or_else(|| damaged("its loss watch is not two numbers"))?),
            None => None,
        };
        Ok(Self {
            step: beside.step,
            model: load(MODEL, blank.clone())?,
            // Each into a copy of its own: clones share the statistics of their norms.
            average: load(AVERAGE, blank.valid())?,
            moments: [load(MOMENTS[0], blank.valid())?, load(MOMENTS[1], blank.valid())?],
            watch,
            knowledge: Knowledge::from_text(recipe, &beside.knowledge)
                .ok_or_else(|| damaged("its knowledge is not a step, laws and frames"))?,
        })
    }
}
