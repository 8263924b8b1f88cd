//! The clips of a fine-tuning.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::super::super::examples::TaughtClip;
use gravisight_clips::Clip;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;

/// A clip as a checkpoint knows it: the clip itself is not in it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[serde(rename_all = "camelCase")]
pub struct ClipKey {
    /// Its name.
    pub id: String,
    /// Whether it is scored with, not learned from.
    pub held_out: bool,
    /// SHA-256 of its labels, camera, scene and pictures, hexadecimal.
    pub sha256: String,
}

impl ClipKey {
    /// Of a clip and its pictures.
    pub fn of(clip: &Clip, pictures: &[Picture], held_out: bool) -> Result<Self> {
        let mut hash = Sha256::new();
        hash.update(serde_json::to_vec(clip).map_err(Error::format(&clip.id))?);
        for picture in pictures {
            hash.update(format!("\n{}\n", picture.size()));
            hash.update(picture.rgb().as_raw());
        }
        Ok(Self { id: clip.id.clone(), held_out, sha256: format!("{:x}", hash.finalize()) })
    }
}

/// A clip and what it teaches.
pub struct Here {
    pub clip: Clip,
    pub pictures: Vec<Picture>,
    /// Where physics is fitted to the clips that are learned from.
    pub taught: Option<TaughtClip>,
    /// Why it teaches nothing, in words.
    pub left_out: Option<String>,
}

/// The clips, in the order in which they were first given: batches are drawn by it.
#[derive(Default)]
pub struct Given {
    clips: Vec<(ClipKey, Content)>,
    /// Whether the run was resumed: then it takes the clips that it had, and no others.
    is_resumed: bool,
}

enum Content {
    /// To be given again.
    Awaited,
    Here(Box<Here>),
    /// In the sampler, or in the validation.
    Used,
}

impl Given {
    /// Those of a run that is resumed, all of them to be given again.
    pub fn awaited(keys: Vec<ClipKey>) -> Self {
        Self { clips: keys.into_iter().map(|key| (key, Content::Awaited)).collect(), is_resumed: true }
    }

    /// All that were given, in this run and before it was resumed.
    pub fn keys(&self) -> Vec<ClipKey> {
        self.clips.iter().map(|(key, _)| key.clone()).collect()
    }

    /// Those that are still to be given again.
    pub fn missing(&self) -> impl Iterator<Item = &ClipKey> {
        self.clips.iter().filter(|(_, content)| matches!(content, Content::Awaited)).map(|(key, _)| key)
    }

    /// Refuses a clip that comes too late, or that a resumed run did not have.
    ///
    /// # Errors
    /// [`Error::Value`].
    pub fn check(&self, key: &ClipKey) -> Result<()> {
        let refuse = |reason: String| Err(Error::value("fine-tuning", "clip", reason));
        if self.missing().any(|awaited| awaited == key) {
            return Ok(());
        }
        if self.is_resumed {
            let reason = match self.missing().any(|awaited| awaited.id == key.id) {
                true => {
                    "has changed since the run began: its labels, pictures, camera or scene, or whether it is held out"
                }
                false => "is not a clip that the resumed run needs",
            };
            return refuse(format!("`{}` {reason}", key.id));
        }
        let is_used =
            |(other, content): &(ClipKey, Content)| other.held_out == key.held_out && matches!(content, Content::Used);
        if self.clips.iter().any(is_used) {
            let reason =
                "comes too late: give all clips before the first step, and those held out before the first score";
            return refuse(reason.into());
        }
        Ok(())
    }

    /// Takes a clip that [`Self::check`] lets pass.
    pub fn take(&mut self, key: ClipKey, here: Here) {
        let content = Content::Here(Box::new(here));
        let awaited = |(other, content): &&mut (ClipKey, Content)| *other == key && matches!(content, Content::Awaited);
        match self.clips.iter_mut().find(awaited) {
            Some((_, place)) => *place = content,
            None => self.clips.push((key, content)),
        }
    }

    /// Hands out those that are `held_out`, or those that are not.
    ///
    /// # Errors
    /// [`Error::Data`] with the names of those that a resumed run still waits for, and where none of them teaches anything; then
    /// others can be given.
    pub fn hand_out(&mut self, held_out: bool) -> Result<Vec<Here>> {
        let refuse = |reason: String| Err(Error::Data { what: "clips".into(), reason });
        let missing: Vec<&str> =
            self.missing().filter(|key| key.held_out == held_out).map(|key| key.id.as_str()).collect();
        if !missing.is_empty() {
            return refuse(format!("the run was resumed; give these clips again: {}", missing.join(", ")));
        }
        let reasons: Vec<Option<&str>> = (self.clips.iter())
            .filter(|(key, _)| key.held_out == held_out)
            .filter_map(|(_, content)| match content {
                Content::Here(here) => Some(here.left_out.as_deref()),
                Content::Awaited | Content::Used => None,
            })
            .collect();
        if reasons.iter().all(Option::is_some) {
            return refuse(match reasons.first() {
                Some(first) => format!("physics explains none of them; the first: {}", first.unwrap_or_default()),
                None if held_out => "none is held out, so there is nothing to score with".into(),
                None => "none was given to learn from".into(),
            });
        }
        let wanted = self.clips.iter_mut().filter(|(key, _)| key.held_out == held_out);
        let taken = wanted.filter_map(|(_, content)| match std::mem::replace(content, Content::Used) {
            Content::Here(here) => Some(*here),
            Content::Awaited | Content::Used => None,
        });
        Ok(taken.collect())
    }
}
