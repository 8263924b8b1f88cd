//! What physics says of a run's clips, kept in a file, so that a resumed run need not fit them again.

use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::super::recipe::FitConfig;
use super::TaughtClip;
use super::teacher::options;
use gravisight_clips::Clip;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::files::write_whole;
use gravisight_track::SOLVER_VERSION;

/// Fits with the hash of all that they depend on (the solver and its configuration, labels, cameras, scenes): a line that holds it, then a line a clip.
pub struct Fits {
    text: String,
    /// Whether they come from the file.
    kept: bool,
}

#[derive(Serialize, Deserialize)]
struct Inputs {
    /// SHA-256, hexadecimal.
    inputs: String,
}

impl Fits {
    /// Of `clips` (as they are fitted) by `config`.
    pub fn new(clips: &[Clip], config: &FitConfig, fits: &[TaughtClip]) -> Result<Self> {
        let failed = || Error::format("fits");
        let mut text = serde_json::to_string(&inputs(SOLVER_VERSION, clips, config)?).map_err(failed())? + "\n";
        for fit in fits {
            text += &(serde_json::to_string(fit).map_err(failed())? + "\n");
        }
        Ok(Self { text, kept: false })
    }

    /// Those in `file`; none where there is no file, or one of other inputs or of another solver.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn read(file: &Path, clips: &[Clip], config: &FitConfig) -> Result<Option<Self>> {
        Self::of_solver(SOLVER_VERSION, file, clips, config)
    }

    /// The same of any version of the solver.
    pub(super) fn of_solver(version: u32, file: &Path, clips: &[Clip], config: &FitConfig) -> Result<Option<Self>> {
        if !file.exists() {
            return Ok(None);
        }
        let text = gravisight_geometry::files::read_text(file)?;
        let kept = text.lines().next().and_then(|line| serde_json::from_str::<Inputs>(line).ok());
        let inputs = inputs(version, clips, config)?.inputs;
        Ok(kept.filter(|kept| kept.inputs == inputs).map(|_| Self { text, kept: true }))
    }

    /// The fits, one a clip. A run learns from these even where it has just found them: a number that was written and
    /// read may differ in its last bit.
    ///
    /// # Errors
    /// [`Error::Format`] for a damaged file.
    pub fn clips(&self) -> Result<Vec<TaughtClip>> {
        let lines = self.text.lines().skip(1);
        lines
            .map(|line| {
                serde_json::from_str(line).map_err(Error::format("fits.jsonl is damaged; delete it and run again"))
            })
            .collect()
    }

    /// Writes them, whole, unless they come from there.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn save(&self, file: &Path) -> Result<()> {
        if self.kept { Ok(()) } else { write_whole(file, self.text.as_bytes()) }
    }
}

fn inputs(version: u32, clips: &[Clip], config: &FitConfig) -> Result<Inputs> {
    let mut hash = Sha256::new();
    hash.update(format!("solver {version}, {:?}\n", options(config)));
    hash.update(serde_json::to_vec(config).map_err(Error::format("fits"))?);
    for clip in clips {
        hash.update(serde_json::to_vec(clip).map_err(Error::format(&clip.id))?);
    }
    Ok(Inputs { inputs: format!("{:x}", hash.finalize()) })
}
