//! Where a run's batches come from.

use super::super::recipe::Phase;
use super::{Batch, CandidateCrops, Renderings, Sampler, Stacks};
use gravisight_geometry::error::Result;

/// What a run draws its batches from.
pub enum Source {
    /// Labelled clips.
    Clips(Box<Sampler>),
    /// Random scenes.
    Scenes(Renderings),
    /// Crops around a detector's candidates in random scenes.
    Candidates(Box<CandidateCrops>),
    /// Stacks of frames around what moves in videos.
    Motion(Stacks),
}

impl Source {
    /// The batch of step `step`: the same for the same seed and step, whatever came before.
    ///
    /// # Errors
    /// As [`Sampler::batch`].
    pub fn batch(&self, phase: &Phase, step: usize) -> Result<Batch> {
        match self {
            Self::Clips(sampler) => sampler.batch(phase, step),
            Self::Scenes(renderings) => Ok(renderings.batch(phase, step)),
            Self::Candidates(crops) => crops.batch(phase, step),
            Self::Motion(stacks) => Ok(stacks.batch(phase, step)),
        }
    }

    /// Mean depth of what is learned, m; 1 where it is not depth.
    pub fn mean_depth(&self) -> f64 {
        match self {
            Self::Clips(sampler) => sampler.examples().depths()[1],
            Self::Scenes(_) | Self::Candidates(_) | Self::Motion(_) => 1.0,
        }
    }

    /// Photographs among the backgrounds of what is rendered.
    pub fn photographs(&self) -> usize {
        match self {
            Self::Clips(_) | Self::Motion(_) => 0,
            Self::Scenes(renderings) => renderings.photographs(),
            Self::Candidates(crops) => crops.photographs(),
        }
    }

    /// Memory of pictures that can be kept, and of empty scenes, bytes.
    pub fn picture_bytes(&self) -> [usize; 2] {
        match self {
            Self::Clips(sampler) => sampler.examples().picture_bytes(),
            Self::Scenes(_) | Self::Candidates(_) | Self::Motion(_) => [0; 2],
        }
    }
}
