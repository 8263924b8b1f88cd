//! The windows of a track put together.

use super::motion::Laws;
use super::parts::Window;
use super::{Note, Rebound, result};
use crate::physics::Impact;
use crate::track::fit::{Fit, FittedFrame, Flight, Hit};

/// Where two windows are joined.
#[derive(Clone, Copy)]
pub struct Seam {
    /// The first frame of the later one.
    pub frame: usize,
    /// When the contact was that joins them, by the earlier one and by the later one, s.
    pub before: f64,
    pub after: f64,
    /// Whether that ends a flight.
    pub hit: bool,
    /// Whether there is none that both know.
    pub cut: bool,
}

/// What the windows say so far.
pub struct Whole {
    frames: Vec<FittedFrame>,
    flights: Vec<Flight>,
    impacts: Vec<Impact>,
    hits: Vec<Hit>,
    notes: Vec<Note>,
    rebounds: Vec<Rebound>,
    /// Of each window its drag and which part of its labels is kept.
    drags: Vec<([f64; 2], f64)>,
    /// Standard deviation of the logarithm of the drag's share, before anything is seen.
    drag_sigma: f64,
    /// Sum of the labels' variances, px², and their number.
    noise: [f64; 2],
    spin: Option<[f64; 3]>,
    /// Whether the last flight goes on in the next window.
    goes_on: bool,
}

impl Whole {
    pub fn new(drag_sigma: f64) -> Self {
        Self {
            frames: vec![],
            flights: vec![],
            impacts: vec![],
            hits: vec![],
            notes: vec![],
            rebounds: vec![],
            drags: vec![],
            drag_sigma,
            noise: [0.0; 2],
            spin: None,
            goes_on: false,
        }
    }

    /// How many hits there are.
    pub fn hits(&self) -> usize {
        self.hits.len()
    }

    /// When its last frame was taken, s.
    pub fn end(&self) -> f64 {
        self.frames.last().map_or(0.0, |frame| frame.time)
    }

    /// Adds what a window says between two seams.
    pub fn append(&mut self, window: &Window, from: Option<Seam>, to: Option<Seam>) {
        let (solved, start) = (&window.solved, window.frames.start);
        let fit = &solved.fit;
        let after = from.map_or(f64::NEG_INFINITY, |seam| seam.after);
        let before = to.map_or(f64::INFINITY, |seam| seam.before);
        let within = |time: f64| time > after && time <= before;
        // Hits end flights.
        let first = fit.hits.partition_point(|hit| hit.time <= after);
        let last = fit.hits.partition_point(|hit| hit.time < before).max(first);
        let mut flights = fit.flights[first..=last].iter().cloned();
        let base = self.flights.len() - usize::from(self.goes_on);
        if let (true, Some(earlier)) = (self.goes_on, self.flights.last_mut())
            && let Some(later) = flights.next()
        {
            earlier.end = later.end;
            earlier.explained &= later.explained;
            earlier.reason = earlier.reason.take().or(later.reason);
        }
        self.flights.extend(flights);
        let frames = from.map_or(start, |seam| seam.frame)..to.map_or(window.frames.end, |seam| seam.frame);
        let kept = &fit.frames[frames.start - start..frames.end - start];
        let numbered = |frame: &FittedFrame| {
            let flight = base + frame.flight.clamp(first, last) - first;
            FittedFrame { flight, ..frame.clone() }
        };
        self.frames.extend(kept.iter().map(numbered));
        self.impacts.extend(fit.impacts.iter().filter(|impact| within(impact.time)));
        let hits = fit.hits.iter().filter(|hit| within(hit.time));
        self.hits.extend(hits.map(|hit| Hit { frame: start + hit.frame, ..*hit }));
        self.rebounds.extend(solved.rebounds.iter().filter(|rebound| within(rebound.time)));
        let labels = |frames: &[FittedFrame]| frames.iter().filter(|frame| frame.residual_px.is_some()).count() as f64;
        self.drags.push((solved.drag, labels(kept) / labels(&fit.frames).max(1.0)));
        self.noise[0] += labels(kept) * fit.noise_px.powi(2);
        self.noise[1] += labels(kept);
        self.spin.get_or_insert(fit.spin);
        for note in &solved.notes {
            // What lasts is told once.
            let is_new = match note.time {
                Some(time) => within(time),
                None => self.notes.iter().all(|known| known.time.is_some()),
            };
            if is_new {
                self.notes.push(note.clone());
            }
        }
        if to.is_some_and(|seam| seam.cut) {
            let time = before.min(self.end());
            let words = format!("the track was cut at {time:.3} s: what is before and after was found by itself");
            self.notes.push(Note { time: Some(time), words });
        }
        self.goes_on = to.is_some_and(|seam| !seam.hit);
    }

    /// The drag by all windows: what each adds to what was known before, by the part of its labels that is its own.
    fn drag(&self) -> [f64; 2] {
        if let [(only, _)] = self.drags[..] {
            return only;
        }
        let before = self.drag_sigma.powi(-2);
        let (mut mean, mut precision) = (0.0, before);
        for ([off, variance], part) in &self.drags {
            precision += part * (variance.recip() - before).max(0.0);
            mean += part * off / variance;
        }
        [mean / precision, precision.recip()]
    }

    /// As a result.
    pub fn fit(self, laws: &Laws) -> Fit {
        let estimates = result::estimates(laws, self.drag(), &self.rebounds);
        Fit {
            noise_px: (self.noise[0] / self.noise[1].max(1.0)).sqrt(),
            rms_px: result::rms(self.frames.iter()),
            explained: self.flights.iter().all(|flight| flight.explained),
            impacts: self.impacts,
            within_lines: vec![],
            flights: self.flights,
            hits: self.hits,
            notes: self.notes.into_iter().map(|note| note.words).collect(),
            estimates,
            spin: self.spin.unwrap_or_default(),
            frames: self.frames,
        }
    }
}
