//! What was found in a video, in a sentence.

use super::{OtherView, TrackedVideo};
use crate::video::CameraMotion;
use gravisight_geometry::statistics::median;

/// Items of a list that are named, at most.
const MOST_LISTED: usize = 5;

impl TrackedVideo {
    /// The verdict: what was found and whether it is explained, in one sentence.
    pub(super) fn verdict_text(&self) -> String {
        let repeated = self.frames.iter().filter(|frame| frame.repeated).count();
        let repeated = match repeated {
            0 => String::new(),
            count => format!(" ({count} more repeat the previous ones)"),
        };
        let all = self.frames.iter().filter(|frame| !frame.repeated).count();
        let seen = match self.found() {
            0 => format!("no flying ball was found in these {all} frames{repeated}"),
            found => format!("the ball was found in {found} of {all} frames{repeated}"),
        };
        let message = match self.segments.as_slice() {
            _ if self.explained.is_none() || self.found() == 0 => seen,
            [] => format!("not explained: the ball was never found for long enough to fit a flight; {seen}"),
            [segment] => format!("{}; {seen}", segment.verdict()),
            segments => {
                let wrong = segments.iter().enumerate().filter(|(_, segment)| !segment.explained());
                let wrong: Vec<String> =
                    wrong.map(|(number, segment)| format!("segment {}: {}", number + 1, segment.verdict())).collect();
                let head = if wrong.is_empty() { "explained" } else { "not all explained" };
                let (explained, all) = (segments.len() - wrong.len(), segments.len());
                let wrong = if wrong.is_empty() { String::new() } else { format!("; {}", listed(&wrong, "; ")) };
                format!("{head}: {explained} of {all} segments; {seen}{wrong}")
            }
        };
        message
            + &self.other_tracks_message()
            + &self.cuts_message()
            + &self.camera_motion_message()
            + &self.unused_seeds_message()
    }

    /// The part of the verdict about a camera that moves.
    fn camera_motion_message(&self) -> String {
        let moved: Vec<String> = (self.elsewhere.iter())
            .filter_map(|view| Some(format!("{} to {} (by up to {:.0} px)", view.from, view.to, view.moved_px?)))
            .collect();
        let lost = self.elsewhere.iter().filter(|view| view.moved_px.is_none());
        let lost: Vec<String> = lost.map(|OtherView { from, to, .. }| format!("{from} to {to}")).collect();
        let mut message = String::new();
        if !moved.is_empty() {
            let hold = match self.camera_sigmas() {
                Some([middle, most]) if self.explained.is_some() => {
                    format!(", which is accounted for (to ± {middle:.1} px, at worst ± {most:.1} px)")
                }
                _ => String::new(),
            };
            message += &format!("; the camera moves in frames {}{hold}", listed(&moved, ", "));
        }
        if !lost.is_empty() {
            let hold = if self.explained.is_some() { ", so there are no positions in metres there" } else { "" };
            message += &format!("; a different view from the first is shown in frames {}{hold}", listed(&lost, ", "));
        }
        message
    }

    /// 1-σ of the views while the camera moves, px: the median, and the greatest.
    fn camera_sigmas(&self) -> Option<[f64; 2]> {
        let moved = self.frames.iter().filter(|frame| matches!(frame.followed.elsewhere, Some(CameraMotion::Moved(_))));
        let sigmas: Vec<f64> = moved.filter_map(|frame| frame.camera_sigma_px).collect();
        Some([median(sigmas.iter().copied())?, sigmas.iter().copied().fold(0.0, f64::max)])
    }

    /// The part of the verdict about clicks that no tracklet goes through.
    fn unused_seeds_message(&self) -> String {
        if self.unused_seeds.is_empty() {
            return String::new();
        }
        let clicks = self.unused_seeds.iter().map(|(frame, [x, y])| format!("({x:.0}, {y:.0}) px in frame {frame}"));
        let clicks: Vec<String> = clicks.collect();
        format!(
            "; no moving object passes through the ball marked at {}: these marks were ignored; mark the ball in a frame in which it flies",
            clicks.join(", ")
        )
    }

    /// The part of the verdict about other balls.
    fn other_tracks_message(&self) -> String {
        match self.tracks.as_slice() {
            [] => String::new(),
            [_] => "; another ball may fly at the same time (`tracks`)".into(),
            tracks => format!("; {} other balls may fly at the same time (`tracks`)", tracks.len()),
        }
    }

    /// The part of the verdict about cuts.
    fn cuts_message(&self) -> String {
        if self.cuts.is_empty() {
            return String::new();
        }
        let frames: Vec<String> = self.cuts.iter().map(usize::to_string).collect();
        format!("; most of the picture changes at frame {}: a cut, or the camera moved", listed(&frames, ", "))
    }
}

/// Joins items; of a long list the first few, and how many more there are.
pub(crate) fn listed(items: &[String], separator: &str) -> String {
    let (first, others) = items.split_at(items.len().min(MOST_LISTED));
    let others = if others.is_empty() { String::new() } else { format!(" and {} more", others.len()) };
    first.join(separator) + &others
}
