//! Pictures of training clips, decoded once where memory allows, and the clips' empty scenes.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use gravisight_clips::{Clip, Clips};
use gravisight_geometry::error::Result;
use gravisight_geometry::image::Picture;

/// Frames of which an empty scene is the median.
const MEDIAN_FRAMES: usize = 15;
/// Reach of a ball around its label, as a fraction of the picture's longer side.
const REACH: f64 = 0.08;
/// Fraction of the frames that may show the ball at the same place; a median forgets less than half.
const MOST_COVERED: f64 = 0.34;

/// Decoded pictures of some clips.
pub struct Pictures {
    clips: Clips,
    decoded: Vec<Vec<OnceLock<Picture>>>,
    empty: Vec<OnceLock<Option<Picture>>>,
    /// Bytes that may still be kept.
    room: AtomicUsize,
}

impl Pictures {
    /// Of `clips`; at most `bytes` are kept.
    pub fn new(clips: Clips, bytes: usize) -> Self {
        let slots = |clip: &Clip| clip.frames.iter().map(|_| OnceLock::new()).collect();
        let decoded = clips.clips.iter().map(slots).collect();
        let empty = clips.clips.iter().map(|_| OnceLock::new()).collect();
        Self { clips, decoded, empty, room: AtomicUsize::new(bytes) }
    }

    /// Of `clips` whose pictures, one a frame, are in memory.
    ///
    /// # Errors
    /// As [`Clip::check_pictures`].
    pub fn in_memory(clips: Clips, pictures: Vec<Vec<Picture>>) -> Result<Self> {
        let mut all = Self::new(clips, 0);
        for (index, (clip, pictures)) in all.clips.clips.iter().zip(pictures).enumerate() {
            clip.check_pictures(&pictures)?;
            all.decoded[index] = pictures.into_iter().map(OnceLock::from).collect();
        }
        Ok(all)
    }

    /// The clips.
    pub fn clips(&self) -> &[Clip] {
        &self.clips.clips
    }

    /// What `see` makes of a frame's picture.
    ///
    /// # Errors
    /// As [`Clips::picture`].
    pub fn with<T>(&self, clip: usize, frame: usize, see: impl FnOnce(&Picture) -> T) -> Result<T> {
        let slot = &self.decoded[clip][frame];
        if let Some(picture) = slot.get() {
            return Ok(see(picture));
        }
        let clip = &self.clips.clips[clip];
        let picture = self.clips.picture(clip, &clip.frames[frame])?;
        let bytes = picture.rgb().as_raw().len();
        let fits = self.room.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |room| room.checked_sub(bytes)).is_ok();
        match fits {
            true => Ok(see(slot.get_or_init(|| picture))),
            false => Ok(see(&picture)),
        }
    }

    /// What `see` makes of the clip's scene without its ball: the median of its frames. None where the ball stays so
    /// long in one place that a median would show it.
    ///
    /// # Errors
    /// As [`Clips::picture`].
    pub fn with_empty<T>(&self, clip: usize, see: impl FnOnce(&Picture) -> T) -> Result<Option<T>> {
        let slot = &self.empty[clip];
        if slot.get().is_none() {
            let median = self.median(clip)?;
            // Another thread may have been faster, with the same picture.
            let _ = slot.set(median);
        }
        Ok(slot.get().and_then(Option::as_ref).map(see))
    }

    fn median(&self, clip: usize) -> Result<Option<Picture>> {
        let frames = &self.clips.clips[clip].frames;
        let seen: Vec<usize> = (0..frames.len()).filter(|&frame| frames[frame].image.is_some()).collect();
        if seen.len() < MEDIAN_FRAMES {
            return Ok(None);
        }
        let chosen: Vec<usize> =
            (0..MEDIAN_FRAMES).map(|index| seen[index * (seen.len() - 1) / (MEDIAN_FRAMES - 1)]).collect();
        let camera = &self.clips.clips[clip].camera;
        let reach = REACH * f64::from(camera.size().width.max(camera.size().height));
        let labels: Vec<[f64; 2]> = chosen.iter().filter_map(|&frame| frames[frame].image).collect();
        let near = |a: &[f64; 2]| labels.iter().filter(|b| (a[0] - b[0]).hypot(a[1] - b[1]) < reach).count();
        if labels.iter().map(near).max().unwrap_or(0) as f64 > MOST_COVERED * MEDIAN_FRAMES as f64 {
            return Ok(None);
        }
        let mut shown = Vec::with_capacity(chosen.len());
        for frame in chosen {
            shown.push(self.with(clip, frame, |picture| picture.rgb().clone())?);
        }
        let mut median = shown[0].clone();
        let mut levels = [0_u8; MEDIAN_FRAMES];
        for (index, value) in median.iter_mut().enumerate() {
            for (level, picture) in levels.iter_mut().zip(&shown) {
                *level = picture.as_raw()[index];
            }
            *value = *levels.select_nth_unstable(MEDIAN_FRAMES / 2).1;
        }
        Ok(Some(Picture::from_rgb(median)))
    }
}
