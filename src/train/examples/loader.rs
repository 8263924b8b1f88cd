//! Batches ahead of time, so that the network does not wait for pictures.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use super::super::recipe::{Phase, Recipe};
use super::{Batch, Source};
use gravisight_geometry::error::{Error, Result};

/// Batches that wait at most.
const AHEAD: usize = 2;

/// The batches of a run, in order.
pub struct Loader {
    source: Arc<Source>,
    /// Step of the next batch.
    step: usize,
    /// A thread that draws them ahead of time.
    ahead: Option<Receiver<Result<Batch>>>,
}

impl Loader {
    /// Starts with the batch of step `first`. A thread makes the batches, and ends with the run's last step, or when this is
    /// dropped. Random scenes take every core: where the network needs them too (`on_cpu`), they are drawn between the steps.
    ///
    /// # Errors
    /// [`Error::Io`] where no thread can be started.
    pub fn start(source: Arc<Source>, recipe: &Recipe, first: usize, on_cpu: bool) -> Result<Self> {
        if on_cpu && matches!(*source, Source::Scenes(_)) {
            return Ok(Self { source, step: first, ahead: None });
        }
        let (sender, receiver) = sync_channel(AHEAD);
        let (recipe, drawn) = (recipe.clone(), source.clone());
        let draw = move || {
            let steps = (first..).map_while(|step| Some((step, *recipe.phase(step)?.0)));
            for (step, phase) in steps {
                if sender.send(drawn.batch(&phase, step)).is_err() {
                    return;
                }
            }
        };
        thread::Builder::new().name("loader".into()).spawn(draw).map_err(Error::io("a thread for pictures"))?;
        Ok(Self { source, step: first, ahead: Some(receiver) })
    }

    /// The next batch, of `phase`.
    ///
    /// # Errors
    /// As [`Source::batch`].
    pub fn next(&mut self, phase: &Phase) -> Result<Batch> {
        self.step += 1;
        let Some(ahead) = &self.ahead else { return self.source.batch(phase, self.step - 1) };
        let stopped = || Error::Data { what: "training pictures".into(), reason: "their thread has stopped".into() };
        ahead.recv().map_err(|_| stopped())?
    }
}
