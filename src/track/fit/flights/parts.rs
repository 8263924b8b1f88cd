//! Long tracks: solved window by window. Two windows overlap by some flights and are joined at a contact that both have found,
//! so that what is found about it was found with what comes before and after.

use std::ops::Range;

use super::motion::Laws;
use super::task::Priors;
use super::whole::{Seam, Whole};
use super::{Solved, fitted_window};
use crate::camera::Camera;
use crate::error::Result;
use crate::physics::{Forecaster, Surface};
use crate::track::fit::{Fit, FitOptions, FittedFrame, Observation};

/// Time without a label after which a track begins anew, s: what happens then says nothing about what was before.
const PAUSE: f64 = 0.6;
/// Fewest labels between two pauses.
const SHORTEST: usize = 6;
/// Labels of a window, as few of the track as are left at its end to make it longer by, and the most where windows do not meet:
/// the search takes far longer for twice as many contacts.
const WINDOW: usize = 240;
const REST: usize = 60;
const LONGEST: usize = 4 * WINDOW;
/// Contacts of a window before the one that it is joined at, from its first on, and of the window before after it.
const BEFORE: usize = 2;
const AFTER: usize = 1;
/// How far two windows' findings of the same contact, and of the frame after it, may be apart: frames; m, and standard
/// deviations.
const FRAMES_APART: f64 = 2.0;
const CLOCK_APART: f64 = 0.5;
const METRES_APART: f64 = 0.01;
const SIGMAS_APART: f64 = 3.0;

/// What is to be fitted, and how.
struct Job<'a> {
    forecaster: &'a Forecaster,
    laws: &'a Laws,
    camera: &'a Camera,
    observations: &'a [Observation],
    options: &'a FitOptions,
}

/// Some frames of a track, fitted by themselves.
pub struct Window {
    pub frames: Range<usize>,
    pub solved: Solved,
    /// By how much the clock has slipped before, s, and how many hits there may be from here on.
    clock: f64,
    hits: Option<usize>,
}

/// What the ball touches when, s; a hit where it is nothing of the scene.
#[derive(Clone, Copy)]
struct Touch {
    time: f64,
    surface: Option<Surface>,
}

impl Window {
    /// By time.
    fn touches(&self) -> Vec<Touch> {
        let Fit { impacts, hits, .. } = &self.solved.fit;
        let bounces = impacts.iter().map(|impact| Touch { time: impact.time, surface: Some(impact.surface) });
        let mut all: Vec<Touch> =
            bounces.chain(hits.iter().map(|hit| Touch { time: hit.time, surface: None })).collect();
        all.sort_by(|a, b| a.time.total_cmp(&b.time));
        all
    }

    /// The first frame after a time.
    fn frame_after(&self, time: f64) -> usize {
        self.frames.start + self.solved.fit.frames.partition_point(|frame| frame.time <= time)
    }

    /// Seconds from a frame to the next.
    fn interval(&self) -> f64 {
        let frames = &self.solved.fit.frames;
        (frames[frames.len() - 1].time - frames[0].time) / (frames.len() - 1).max(1) as f64
    }

    fn frame(&self, number: usize) -> Option<&FittedFrame> {
        self.solved.fit.frames.get(number.checked_sub(self.frames.start)?)
    }

    /// Whether both put the ball at the same place in a frame, and the frame at the same time, as far as they know.
    fn meets(&self, other: &Self, frame: usize) -> bool {
        let (Some(a), Some(b)) = (self.frame(frame), other.frame(frame)) else { return false };
        let off = (a.state.position - b.state.position).norm();
        (a.time - b.time).abs() < CLOCK_APART * self.interval()
            && off < METRES_APART + SIGMAS_APART * a.sigma().hypot(b.sigma())
    }
}

/// The flights that explain the observations best.
pub fn fitted(
    forecaster: &Forecaster,
    laws: &Laws,
    camera: &Camera,
    observations: &[Observation],
    options: &FitOptions,
) -> Result<Fit> {
    let job = Job { forecaster, laws, camera, observations, options };
    let mut whole = Whole::new(Priors::of(forecaster.scene()).forces[0]);
    for part in job.parts() {
        let hits = options.hits.map(|most| most.saturating_sub(whole.hits()));
        let clock = part.start.checked_sub(1).map_or(0.0, |last| whole.end() - observations[last].time);
        let (mut window, mut from) =
            (job.solved(part.start..job.end(part.start, WINDOW, part.end), clock, hits)?, None);
        while window.frames.end < part.end {
            let (seam, next) = match job.joined(&window, from, part.end) {
                Some(found) => found,
                None => {
                    if let Some(longer) = job.longer(&window, part.end) {
                        window = longer?;
                        continue;
                    }
                    job.cut(&window, from, part.end)?
                }
            };
            whole.append(&window, from, Some(seam));
            (window, from) = (next, Some(seam));
        }
        whole.append(&window, from, None);
    }
    Ok(whole.fit(laws))
}

impl Job<'_> {
    /// Ranges of frames between pauses.
    fn parts(&self) -> Vec<Range<usize>> {
        let observations = self.observations;
        let seen: Vec<usize> = (0..observations.len()).filter(|&frame| observations[frame].image.is_some()).collect();
        let (mut starts, mut count) = (vec![0], 1);
        for (index, pair) in seen.windows(2).enumerate() {
            let pause = observations[pair[1]].time - observations[pair[0]].time > PAUSE;
            let left = seen.len() - index - 1;
            if pause && count >= SHORTEST && left >= SHORTEST {
                starts.push(pair[1]);
                count = 0;
            }
            count += 1;
        }
        let ends = starts[1..].iter().copied().chain([observations.len()]);
        starts.iter().zip(ends).map(|(&start, end)| start..end).collect()
    }

    /// Where a window of so many labels from `start` ends, before `last`.
    fn end(&self, start: usize, labels: usize, last: usize) -> usize {
        let mut seen = (start..last).filter(|&frame| self.observations[frame].image.is_some());
        match seen.nth(labels) {
            Some(end) if seen.count() >= REST => end,
            _ => last,
        }
    }

    fn solved(&self, frames: Range<usize>, clock: f64, hits: Option<usize>) -> Result<Window> {
        let slipped = |seen: &Observation| Observation { time: seen.time + clock, ..*seen };
        let observations: Vec<Observation> = self.observations[frames.clone()].iter().map(slipped).collect();
        let options = FitOptions { hits, ..self.options.clone() };
        let solved = fitted_window(self.forecaster, self.laws, self.camera, &observations, &options)?;
        Ok(Window { frames, solved, clock, hits })
    }

    /// The same window with twice as many labels; none where it is as long as can be.
    fn longer(&self, window: &Window, last: usize) -> Option<Result<Window>> {
        let labels = self.observations[window.frames.clone()].iter().filter(|seen| seen.image.is_some()).count();
        let frames = window.frames.start..self.end(window.frames.start, 2 * labels, last);
        (2 * labels <= LONGEST).then(|| self.solved(frames, window.clock, window.hits))
    }

    /// Where the window is joined to the one that follows, and that; none where they share no contact.
    fn joined(&self, window: &Window, from: Option<Seam>, last: usize) -> Option<(Seam, Window)> {
        let touches = window.touches();
        let join = touches.len().checked_sub(1 + AFTER)?;
        let begin = join.checked_sub(BEFORE)?;
        let is_later = |touch: &&Touch| from.is_none_or(|seam| touch.time > seam.after);
        if !is_later(&&touches[join]) {
            return None;
        }
        let next = self.following(window, touches[begin].time, last).ok()?;
        let others = next.touches();
        let seam = |touch: &Touch| {
            let near = |other: &&Touch| (other.time - touch.time).abs() < FRAMES_APART * window.interval();
            let same = others.iter().filter(near).find(|other| other.surface == touch.surface)?;
            let frame = window.frame_after(touch.time);
            let seam = Seam { frame, before: touch.time, after: same.time, hit: touch.surface.is_none(), cut: false };
            window.meets(&next, frame).then_some(seam)
        };
        let seam = touches[begin + 1..=join].iter().rev().filter(is_later).find_map(seam)?;
        Some((seam, next))
    }

    /// The window of what follows a contact at `time`, or this one's end.
    fn following(&self, window: &Window, time: f64, last: usize) -> Result<Window> {
        let begin = window.frame_after(time);
        let near = begin.min(window.frames.end - 1);
        let clock = window.frame(near).map_or(window.clock, |frame| frame.time - self.observations[near].time);
        let before = window.solved.fit.hits.iter().filter(|hit| hit.time <= time).count();
        let hits = window.hits.map(|most| most.saturating_sub(before));
        self.solved(begin..self.end(begin, WINDOW, last), clock, hits)
    }

    /// Where nothing joins them: the window of what follows this one's last contact but one, or its end.
    fn cut(&self, window: &Window, from: Option<Seam>, last: usize) -> Result<(Seam, Window)> {
        let touches = window.touches();
        let touch = touches.len().checked_sub(1 + AFTER).map(|index| touches[index]);
        let touch = touch.filter(|touch| from.is_none_or(|seam| touch.time > seam.after));
        let time = touch.map_or(f64::INFINITY, |touch| touch.time);
        let next = self.following(window, time, last)?;
        let hit = touch.is_some_and(|touch| touch.surface.is_none());
        Ok((Seam { frame: next.frames.start, before: time, after: f64::NEG_INFINITY, hit, cut: true }, next))
    }
}
