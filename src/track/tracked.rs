//! A video's ball: where it is in each frame, and the flights of each stretch of them.

use std::ops::Range;

use serde_json::{Value, json};

use super::file::Track;
use super::fit::{Fit, FitOptions, Observation};
use super::follow::{Elsewhere, Flying, FollowedFrame, stretches};
use crate::camera::Camera;
use crate::error::Result;
use crate::physics::{Forecaster, Scene};

/// The ball in a video ([`VideoTracker::track`](crate::VideoTracker::track)): in each frame, and its flights.
pub struct Tracked {
    /// The ball in each frame.
    pub frames: Vec<FollowedFrame>,
    /// Frames, to within one, from which on most of the picture is another.
    pub cuts: Vec<usize>,
    /// The frames between pauses; none without [`Self::fit`].
    pub stretches: Vec<Stretch>,
    metres: bool,
}

/// What was fitted of a stretch of frames.
pub struct Stretch {
    /// By index.
    pub frames: Range<usize>,
    /// The labels of these frames.
    pub observations: Vec<Observation>,
    /// Why it could not be fitted, in words.
    pub fit: std::result::Result<Fit, String>,
}

impl Tracked {
    /// The ball in 2D. Where the camera (of these pictures) and the scene are known they help to tell it.
    pub(crate) fn new(flying: &Flying<'_>, place: Option<(&Camera, &Scene)>) -> Self {
        Self { frames: flying.frames(place), cuts: flying.cuts().to_vec(), stretches: vec![], metres: false }
    }

    /// The 2D track.
    pub fn track(&self) -> Track {
        Track { points: self.frames.iter().map(|frame| frame.point).collect() }
    }

    /// Frames that show the ball.
    pub fn found(&self) -> usize {
        self.frames.iter().filter(|frame| frame.point.visibility > 0).count()
    }

    /// Finds the flights, stretch by stretch; `progress` hears how many are done, and of how many.
    ///
    /// # Errors
    /// As [`Track::observations`]. That a stretch cannot be fitted is a result ([`Stretch::fit`]).
    pub fn fit(
        &mut self,
        forecaster: &Forecaster,
        camera: &Camera,
        options: &FitOptions,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<()> {
        // Of a rate that was raised, a video's own times are no longer those of the frames.
        let times_known = options.times_known && !self.frames.iter().any(|frame| frame.repeated);
        let options = FitOptions { times_known, ..options.clone() };
        let (_, mut observations) = self.track().observations(None)?;
        // What another view shows is not where this camera would put it.
        for (observation, frame) in observations.iter_mut().zip(&self.frames) {
            if frame.elsewhere.is_some() {
                (observation.image, observation.radius) = (None, None);
            }
        }
        let ranges = stretches(&observations);
        let count = ranges.len();
        self.metres = true;
        self.stretches.clear();
        for (number, frames) in ranges.into_iter().enumerate() {
            let observations = observations[frames.clone()].to_vec();
            let fit = forecaster.fit(camera, &observations, &options).map_err(|error| error.to_string());
            self.stretches.push(Stretch { frames, observations, fit });
            progress(number + 1, count);
        }
        Ok(())
    }

    /// Whether physics explains each stretch.
    pub fn explained(&self) -> bool {
        self.stretches.iter().all(Stretch::explained)
    }

    /// What came out, in a sentence.
    pub fn verdict(&self) -> String {
        let repeated = self.frames.iter().filter(|frame| frame.repeated).count();
        let repeated = match repeated {
            0 => String::new(),
            count => format!(" ({count} more show the one before again)"),
        };
        let all = self.frames.iter().filter(|frame| !frame.repeated).count();
        let seen = match self.found() {
            0 => format!("no ball: nothing flies in these {all} frames{repeated}"),
            found => format!("the ball is seen in {found} of {all} frames{repeated}"),
        };
        let said = match self.stretches.as_slice() {
            _ if !self.metres || self.found() == 0 => seen,
            [] => format!("{seen}, nowhere long enough to say more"),
            [stretch] => format!("{}; {seen}", stretch.verdict()),
            stretches => {
                let wrong = stretches.iter().enumerate().filter(|(_, stretch)| !stretch.explained());
                let wrong: String =
                    wrong.map(|(number, stretch)| format!("; stretch {}: {}", number + 1, stretch.verdict())).collect();
                let head = if wrong.is_empty() { "explained" } else { "not all explained" };
                let explained = stretches.iter().filter(|stretch| stretch.explained()).count();
                format!("{head}: {explained} of {} stretches; {seen}{wrong}", stretches.len())
            }
        };
        said + &self.cuts_in_words() + &self.moved_in_words()
    }

    /// Frames in which the camera looks elsewhere than at first, first and last, and how far what stands still is away there at
    /// most, px; none where that is not known.
    pub fn elsewhere(&self) -> Vec<(Range<usize>, Option<f64>)> {
        let mut found: Vec<(Range<usize>, Option<f64>)> = Vec::new();
        let frames = self.frames.iter().enumerate().filter(|(_, frame)| !frame.repeated);
        let mut goes_on = false;
        for (number, frame) in frames {
            let px = match frame.elsewhere {
                None => {
                    goes_on = false;
                    continue;
                }
                Some(Elsewhere::Moved(px)) => Some(px),
                Some(Elsewhere::Cut) => None,
            };
            match found.last_mut().filter(|_| goes_on) {
                Some((range, most)) => {
                    range.end = number + 1;
                    *most = most.zip(px).map(|(most, px)| most.max(px));
                }
                None => found.push((number..number + 1, px)),
            }
            goes_on = true;
        }
        found
    }

    /// What a camera that does not stand still means.
    fn moved_in_words(&self) -> String {
        let moved = self.elsewhere();
        let part = |(frames, px): &(Range<usize>, Option<f64>)| match px {
            Some(px) => format!("{} to {} (by up to {px:.0} px)", frames.start, frames.end - 1),
            None => format!("{} to {}", frames.start, frames.end - 1),
        };
        let parts: Vec<String> = moved.iter().map(part).collect();
        match parts.is_empty() {
            true => String::new(),
            false => {
                let hold = if self.metres { ", so there are no metres there" } else { "" };
                format!("; the camera looks elsewhere than at first in frames {}{hold}", parts.join(", "))
            }
        }
    }

    /// What a change of the whole picture means.
    fn cuts_in_words(&self) -> String {
        if self.cuts.is_empty() {
            return String::new();
        }
        let frames: Vec<String> = self.cuts.iter().map(usize::to_string).collect();
        format!("; most of the picture changes at frame {}: a cut, or the camera moved", frames.join(", "))
    }

    /// As `gravisight track --json` prints it: a stretch's flights, hits and bounces count on from those before. Frames, hits and
    /// bounces that are not `explained` belong to a flight that is not: where they are is doubtful.
    pub fn as_json(&self) -> Value {
        let frame = |(number, FollowedFrame { point, confidence, .. }): (usize, &FollowedFrame)| {
            json!({"frame": number, "time": point.time, "image": point.image().map(|at| [at.x, at.y]),
                "radius_px": point.radius, "world": null, "sigma": null, "flight": null, "explained": null,
                "confidence": confidence})
        };
        let mut frames: Vec<Value> = self.frames.iter().enumerate().map(frame).collect();
        let (mut flights, mut hits, mut bounces, mut notes) = (vec![], vec![], vec![], vec![]);
        for Stretch { frames: range, fit, .. } in &self.stretches {
            let Ok(fit) = fit else { continue };
            let mut said = fit.as_json();
            for (frame, fitted) in frames[range.clone()].iter_mut().zip(&fit.frames) {
                frame["world"] = json!(<[f64; 3]>::from(fitted.state.position.coords));
                frame["sigma"] = json!(fitted.sigma());
                frame["flight"] = json!(flights.len() + fitted.flight);
                frame["speed"] = json!(fitted.state.velocity.norm());
                frame["explained"] = json!(fit.is_explained(fitted));
            }
            for (value, hit) in said["hits"].as_array_mut().into_iter().flatten().zip(&fit.hits) {
                value["frame"] = json!(range.start + hit.frame);
                hits.push(value.take());
            }
            flights.extend(said["flights"].as_array_mut().into_iter().flatten().map(Value::take));
            bounces.extend(fit.impacts.iter().zip(&fit.within_lines).map(|(impact, within)| {
                json!({"time": impact.time, "surface": impact.surface.to_string(),
                    "world": <[f64; 3]>::from(impact.position), "speed": impact.speed,
                    "sigma": fit.sigma_at(impact.time), "within_lines": within,
                    "explained": fit.is_explained_at(impact.time)})
            }));
            notes.extend(fit.notes.iter().cloned());
        }
        let verdict = self.verdict();
        let elsewhere = self.elsewhere().into_iter();
        let elsewhere =
            elsewhere.map(|(frames, px)| json!({"from": frames.start, "to": frames.end - 1, "moved_px": px}));
        let elsewhere: Vec<Value> = elsewhere.collect();
        json!({"verdict": verdict, "elsewhere": elsewhere, "frames": frames, "flights": flights, "hits": hits, "bounces": bounces, "notes": notes})
    }
}

impl Stretch {
    /// Whether physics explains it.
    pub fn explained(&self) -> bool {
        self.fit.as_ref().is_ok_and(|fit| fit.explained)
    }

    fn verdict(&self) -> String {
        match &self.fit {
            Ok(fit) => fit.verdict(),
            Err(error) => format!("not explained: {error}"),
        }
    }
}
