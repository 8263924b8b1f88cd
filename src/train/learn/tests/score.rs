//! How many clips a score looks at.

use super::super::score::clips_with;
use crate::clips::Clips;
use crate::testing::root;

#[test]
fn however_many_frames_are_asked_for_no_more_than_all_clips_are_scored() {
    let clips = Clips::read(&root().join("tests/samples")).unwrap().clips;
    assert_eq!(clips.len(), 2);
    // Twice the third is the first number that a `usize` does not hold.
    for (frames, expected) in [(1, 1), (usize::MAX, 2), (usize::MAX / 2 + 1, 2)] {
        assert_eq!(clips_with(frames, &clips), expected, "{frames}");
    }
}
