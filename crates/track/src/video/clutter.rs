//! How often something moves at a place of the first view: clutter is what keeps being there.

use std::collections::HashMap;

use super::blobs::Blob;
use super::config::ClutterConfig;
use super::state::{Frame, FrameId, State};
use super::view::{FirstView, Place};

/// Counts of candidates by place, over all frames so far.
pub(super) struct Clutter {
    config: ClutterConfig,
    counts: HashMap<[i32; 2], u32>,
    frames: usize,
}

impl Clutter {
    /// Without any candidate yet.
    pub fn new(config: ClutterConfig) -> Self {
        Self { config, counts: HashMap::new(), frames: 0 }
    }

    /// Adds a frame's candidates.
    pub fn add(&mut self, blobs: &[Blob<FirstView>]) {
        self.frames += 1;
        for blob in blobs {
            *self.counts.entry(self.cell(&blob.at)).or_default() += 1;
        }
    }

    /// Candidates a px² and frame about a place in all frames but those about `frame`.
    pub fn density(&self, state: &State, frame: FrameId, at: &Place<FirstView>) -> f64 {
        let ClutterConfig { cell, own_frames, .. } = self.config;
        let [column, row] = self.cell(at);
        let cells = || (-1..=1).flat_map(move |y| (-1..=1).map(move |x| [column + x, row + y]));
        let all: u32 = cells().filter_map(|cell| self.counts.get(&cell)).sum();
        let frames = frame.0.saturating_sub(own_frames)..(frame.0 + own_frames + 1).min(state.segmented());
        let count = frames.len();
        let is_near = |[x, y]: [i32; 2]| (x - column).abs() <= 1 && (y - row).abs() <= 1;
        let blobs = state.frames()[frames].iter().flat_map(Frame::candidates);
        let own = blobs.filter(|(_, blob)| is_near(self.cell(&blob.at))).count();
        let others = f64::from(all) - own as f64;
        others.max(0.0) / (self.frames.saturating_sub(count).max(own_frames) as f64 * (3.0 * cell).powi(2))
    }

    fn cell(&self, at: &Place<FirstView>) -> [i32; 2] {
        at.xy.map(|at| (at / self.config.cell).floor() as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_keeps_being_there_is_clutter_and_what_passes_is_not() {
        let blob = |x: f64, y: f64| Blob {
            at: Place::new([x, y]),
            radius: 3.0,
            reach: 3.0,
            direction: 0.0,
            is_ball: false,
            sigma: 1.0,
        };
        let frames = (0..200).map(|frame| {
            let blobs = vec![blob(100.0 + f64::from(frame % 3), 50.0), blob(5.0 * f64::from(frame), 80.0)];
            (f64::from(frame) / 25.0, blobs)
        });
        let state = State::of([1280, 720], frames);
        let density = |at: [f64; 2]| state.clutter().density(&state, FrameId(100), &Place::new(at));
        let [still, flies] = [[101.0, 50.0], [500.0, 80.0]].map(density);
        assert!((still * 144.0 - 1.0).abs() < 0.05 && flies == 0.0, "{still} {flies}");
    }
}
