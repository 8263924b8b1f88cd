//! The set that others were measured on stays what it is.

use super::{Film, Kind};

/// Of the clips of seed 5: frames, place of the ball in frame 7, px, and mean level of that frame's picture.
const FRAMES: [(Kind, usize, [f64; 2], f64); 4] = [
    (Kind::Tennis, 54, [934.397, 198.078], 159.2678),
    (Kind::TableTennis, 84, [782.757, 270.613], 109.5010),
    (Kind::Volleyball, 62, [384.517, 348.082], 127.6732),
    (Kind::Toss, 73, [755.473, 289.400], 102.7240),
];

#[test]
fn the_same_clips_are_drawn_as_ever() {
    for (kind, count, image, level) in FRAMES {
        let film = Film::draw(kind, 5).unwrap();
        assert_eq!(film.count(), count);
        let (picture, truth) = film.frame(7).unwrap();
        let bytes = picture.as_raw();
        let mean = bytes.iter().map(|value| f64::from(*value)).sum::<f64>() / bytes.len() as f64;
        let near = (0..2).all(|axis| (truth.image[axis] - image[axis]).abs() < 1e-3);
        assert!(near && (mean - level).abs() < 1e-3, "{kind:?}: {:?}, {mean}", truth.image);
    }
}
