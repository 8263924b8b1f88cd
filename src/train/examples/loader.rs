//! Batches ahead of time, so that the network does not wait for pictures.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use super::super::recipe::Recipe;
use super::{Batch, Sampler};
use crate::error::{Error, Result};

/// Batches that wait at most.
const AHEAD: usize = 2;

/// A thread that draws the batches of a run, in order.
pub struct Loader(Receiver<Result<Batch>>);

impl Loader {
    /// Starts with the batch of step `first`. The thread ends with the run's last step, or when this is dropped.
    ///
    /// # Errors
    /// [`Error::Io`] where no thread can be started.
    pub fn start(sampler: Arc<Sampler>, recipe: &Recipe, first: usize) -> Result<Self> {
        let (sender, receiver) = sync_channel(AHEAD);
        let recipe = recipe.clone();
        let draw = move || {
            let steps = (first..).map_while(|step| Some((step, *recipe.phase(step)?.0)));
            for (step, phase) in steps {
                if sender.send(sampler.batch(&phase, step)).is_err() {
                    return;
                }
            }
        };
        thread::Builder::new().name("loader".into()).spawn(draw).map_err(Error::io("a thread for pictures"))?;
        Ok(Self(receiver))
    }

    /// The next batch.
    ///
    /// # Errors
    /// As [`Sampler::batch`].
    pub fn next(&self) -> Result<Batch> {
        let stopped = || Error::Data { what: "training pictures".into(), reason: "their thread has stopped".into() };
        self.0.recv().map_err(|_| stopped())?
    }
}
