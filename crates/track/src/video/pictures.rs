//! The pictures of the last frames, for the networks. What is forgotten frees memory and changes no result.

use std::collections::VecDeque;

use super::state::FrameId;
use gravisight_geometry::image::Picture;

/// The pictures of the last frames.
pub(super) struct Pictures {
    held: VecDeque<(FrameId, Picture)>,
    most: usize,
}

impl Pictures {
    /// Of so many frames at most.
    pub fn holding(most: usize) -> Self {
        Self { held: VecDeque::new(), most }
    }

    /// Takes the next frame's picture, and forgets the oldest.
    pub fn add(&mut self, frame: FrameId, picture: Picture) {
        self.held.push_back((frame, picture));
        while self.held.len() > self.most {
            self.held.pop_front();
        }
    }

    /// The last frame.
    pub fn newest(&self) -> Option<FrameId> {
        self.held.back().map(|(frame, _)| *frame)
    }

    /// The picture of a frame; none where it is too old.
    pub fn of(&self, frame: FrameId) -> Option<&Picture> {
        self.held.iter().find(|(held, _)| *held == frame).map(|(_, picture)| picture)
    }
}
