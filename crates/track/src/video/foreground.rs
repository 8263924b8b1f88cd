//! What differs from the background and from the neighbouring frames.

use std::sync::Arc;

use nalgebra::Matrix3;

use super::blobs::{self, Blob};
use super::config::{BackgroundConfig, BlobsConfig};
use super::planes::{self, Background, Planes, Spare, contrast_of};
use super::stabiliser::Stabilised;
use super::view::CanvasPixels;

/// The background, and the frames that wait for it or for the next one.
pub(super) struct Foreground {
    config: BackgroundConfig,
    blobs: BlobsConfig,
    /// Frames that wait for a background.
    waiting: Vec<Stabilised>,
    background: Option<Background>,
    /// The frame that waits for the next one, and the one before it.
    now: Option<Now>,
    previous: Option<Arc<Planes>>,
    /// Frames in a row that hardly show the background.
    moving: usize,
}

/// A frame that waits for the next one.
struct Now {
    frame: Stabilised,
    /// Its differences from the frame before.
    since: Option<Vec<u8>>,
}

/// What a frame shows before the background.
pub(super) enum Seen {
    /// Hardly any of the background; whether that was so for so long that it has to be made anew.
    Other {
        lost: bool,
    },
    Blobs(Vec<Blob<CanvasPixels>>),
}

impl Foreground {
    /// Without any frame yet.
    pub fn new(config: BackgroundConfig, blobs: BlobsConfig) -> Self {
        Self { config, blobs, waiting: vec![], background: None, now: None, previous: None, moving: 0 }
    }

    /// Whether no frame waits for another.
    pub fn is_idle(&self) -> bool {
        self.now.is_none() && self.waiting.is_empty()
    }

    pub fn has_background(&self) -> bool {
        self.background.is_some()
    }

    /// Keeps a frame until there is a background.
    pub fn wait(&mut self, frame: Stabilised) {
        self.waiting.push(frame);
    }

    /// Makes a background of the frames that wait for one, where they are as many as it takes (fewer at the video's end), and returns them.
    pub fn begin(&mut self, is_end: bool) -> Vec<Stabilised> {
        let fewest = if is_end { self.config.fewest_frames } else { self.config.first_frames };
        if self.background.is_some() || self.waiting.len() < fewest {
            return vec![];
        }
        let waiting = std::mem::take(&mut self.waiting);
        let planes: Vec<Arc<Planes>> = waiting.iter().map(|frame| frame.planes.clone()).collect();
        self.background = Background::of(&planes);
        (self.now, self.previous) = (None, None);
        waiting
    }

    /// Whether a frame waits for the next one.
    pub fn has_frame(&self) -> bool {
        self.now.is_some()
    }

    /// The differences of a frame from the one that waits for it.
    pub fn since(&self, next: &Stabilised, spare: &mut Spare) -> Option<Vec<u8>> {
        self.now.as_ref().map(|now| now.frame.planes.difference(&next.planes, spare))
    }

    /// What the frame shows that waits for its next one; `until` are the differences between the two.
    pub fn look(&mut self, until: Option<&[u8]>, spare: &mut Spare) -> Option<Seen> {
        let now = self.now.take()?;
        let seen = self.seen(&now, until, spare);
        now.since.into_iter().for_each(|bytes| spare.give(bytes));
        if let Some(planes) = self.previous.replace(now.frame.planes).and_then(Arc::into_inner) {
            planes.levels.into_iter().for_each(|bytes| spare.give(bytes));
        }
        seen
    }

    /// Keeps the next frame: until the one after it comes, or until there is a background. `since` are its differences from the frame before.
    pub fn keep(&mut self, next: Stabilised, since: Option<Vec<u8>>) {
        match self.background {
            Some(_) => self.now = Some(Now { frame: next, since }),
            // The last look found another camera's picture: this frame is the first that waits for a new background.
            None => self.waiting.push(next),
        }
    }

    /// Forgets the background: it is no longer what the last frames show.
    fn lose_background(&mut self) {
        (self.background, self.moving) = (None, 0);
    }

    /// Frames that nothing could be compared with.
    pub fn give_up(&mut self) -> usize {
        self.waiting.drain(..).count()
    }

    /// Takes all frames into the pixels of another canvas; what they do not show is as in `planes`.
    pub fn move_canvas(&mut self, old_from_new: &Matrix3<f64>, planes: &Planes, spare: &mut Spare) {
        let mut moved = |old: &Planes| Arc::new(old.warped(old_from_new, Some(planes), spare));
        if let Some(background) = &mut self.background {
            background.replace(&mut moved);
        }
        self.previous = self.previous.take().map(|previous| moved(&previous));
        self.waiting.iter_mut().for_each(|frame| frame.move_canvas(old_from_new, planes, spare));
        if let Some(now) = &mut self.now {
            now.frame.move_canvas(old_from_new, planes, spare);
            if let Some(previous) = &self.previous {
                now.since = Some(previous.difference(&now.frame.planes, spare));
            }
        }
    }

    /// The blobs of a frame that has one before and one after it; without either they are what differs from the background.
    fn seen(&mut self, now: &Now, until: Option<&[u8]>, spare: &mut Spare) -> Option<Seen> {
        let background = self.background.as_mut()?;
        let width = now.frame.planes.width;
        let mut differences = background.follow(&now.frame.planes, spare);
        let tolerance = (!now.frame.as_taken).then(|| background.edges(self.config.edge_tolerance, spare));
        let contrast = contrast_of(now.since.as_deref().or(until).unwrap_or(&differences), &self.config);
        if let Some(tolerance) = &tolerance {
            planes::subtract(&mut differences, tolerance);
        }
        if planes::fraction_above(&differences, contrast) > self.config.moved {
            self.moving += 1;
            let lost = self.moving >= self.config.moving_frames;
            if lost {
                self.lose_background();
            }
            return Some(Seen::Other { lost });
        }
        self.moving = 0;
        let mut found = blobs::blobs(&differences, width, contrast, &self.blobs);
        if let (Some(since), Some(until)) = (&now.since, until) {
            found.retain(|blob| moves(blob, [since, until], width, contrast, self.blobs.moves_at));
            let mut both = planes::less_of(since, until, spare);
            if let Some(tolerance) = &tolerance {
                planes::subtract(&mut both, tolerance);
            }
            for blob in blobs::blobs(&both, width, contrast, &self.blobs) {
                let BlobsConfig { same, same_least, same_radius, .. } = self.blobs;
                let known = |other: &Blob<CanvasPixels>| {
                    other.at.distance(&blob.at) < same * blob.radius.max(same_least)
                        && other.radius < same_radius * blob.radius
                };
                if !found.iter().any(known) {
                    found.push(blob);
                }
            }
            spare.give(both);
        }
        spare.give(differences);
        tolerance.into_iter().for_each(|bytes| spare.give(bytes));
        Some(Seen::Blobs(found))
    }
}

/// Whether anything of a blob changes from the frame before or to the one after: its middle, or what is `away` from there, radii.
fn moves(blob: &Blob<CanvasPixels>, differences: [&[u8]; 2], width: usize, contrast: u8, away: f64) -> bool {
    let steps = [-away, 0.0, away];
    let at = |x: f64, y: f64| {
        let (x, y) = (x.round().max(0.0) as usize, y.round().max(0.0) as usize);
        y * width + x.min(width - 1)
    };
    let [x, y] = blob.at.xy;
    steps.iter().flat_map(|u| steps.iter().map(move |v| (u, v))).any(|(u, v)| {
        let index = at(x + u * blob.radius, y + v * blob.radius);
        differences.iter().any(|differences| differences.get(index).is_some_and(|&it| it > contrast))
    })
}
