//! Small films drawn here, whose balls are known.

mod cameras;

use image::{Rgb, RgbImage};
use nalgebra::{Matrix2, Point2, Vector2};

use super::*;
use gravisight_geometry::camera::{Detection, Outline};
use gravisight_geometry::image::Picture;

const SIZE: [u32; 2] = [320, 200];
const FPS: f64 = 30.0;

/// A still ground with texture, the same in every frame but for the last bit.
fn ground(frame: usize) -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let texture = ((x * 7 + y * 13) % 31 + (x / 9 + y / 7) % 17) as u8;
        let noise = ((x as usize * 31 + y as usize * 17 + frame * 101) % 7 / 6) as u8;
        Rgb([90 + texture + noise, 110 + texture, 80 + texture])
    })
}

fn disc(rgb: &mut RgbImage, [x, y]: [f64; 2], radius: f64, colour: [u8; 3]) {
    for row in 0..SIZE[1] {
        for column in 0..SIZE[0] {
            let fraction = (0.5 + radius - (f64::from(column) - x).hypot(f64::from(row) - y)).clamp(0.0, 1.0);
            let pixel = rgb.get_pixel_mut(column, row);
            for (level, colour) in pixel.0.iter_mut().zip(colour) {
                let value = f64::from(*level);
                *level = (value + fraction * (f64::from(colour) - value)).round() as u8;
            }
        }
    }
}

/// Thrown from the left, and bounced at frame 25.
fn ball_at(frame: usize) -> [f64; 2] {
    let t = frame as f64;
    let y =
        if frame < 25 { 150.0 - 9.0 * t + 0.36 * t * t } else { 150.0 - 6.0 * (t - 25.0) + 0.36 * (t - 25.0).powi(2) };
    [30.0 + 6.0 * t, y]
}

const FRAMES: usize = 40;
const RADIUS: f64 = 4.0;
const YELLOW: [u8; 3] = [230, 240, 60];

/// A detector for these films: what is yellow about a query, by its moments.
fn yellow_near(picture: &Picture, query: &Query) -> Option<Detection> {
    let reach = query.reach_px + 2.0 * query.radius_px + 4.0;
    let is_near = |x: u32, y: u32| (f64::from(x) - query.image[0]).hypot(f64::from(y) - query.image[1]) < reach;
    // From half of a pixel on.
    let is_yellow = |pixel: &[u8]| pixel[0] > 165 && pixel[1] > 180 && pixel[2] < 115;
    let pixels = picture.rgb().pixels().zip(0_u32..).map(|(pixel, index)| (pixel, index % SIZE[0], index / SIZE[0]));
    let yellow: Vec<Point2<f64>> = pixels
        .filter(|&(pixel, x, y)| is_near(x, y) && is_yellow(&pixel.0))
        .map(|(_, x, y)| Point2::new(f64::from(x), f64::from(y)))
        .collect();
    if yellow.len() < 12 {
        return None;
    }
    let count = yellow.len() as f64;
    let centre = Point2::from(yellow.iter().map(|at| at.coords).sum::<Vector2<f64>>() / count);
    let spread = yellow.iter().map(|at| (at - centre) * (at - centre).transpose()).sum::<Matrix2<f64>>() / count;
    let outline = Outline { centre, radius: 2.0 * spread.symmetric_eigenvalues().min().sqrt() };
    Some(Detection { outline, log_sigma: 0.1, confidence: 0.95 })
}

/// Answers all queries, as a detector and a motion network that know yellow do.
fn answer(follower: &mut BallTracker) {
    while let queries = follower.queries()
        && !queries.is_empty()
    {
        for query in queries {
            let ball = yellow_near(follower.picture(&query).unwrap(), &query);
            follower.tell_motion(&query, if ball.is_some() { 0.9 } else { 0.02 });
            if !query.measured {
                follower.tell(&query, ball);
            }
        }
    }
}

/// Watches the pictures of a film, at [`FPS`].
fn watched(pictures: impl Iterator<Item = RgbImage>) -> BallTracker {
    watched_by(BallTracker::new(), pictures)
}

fn watched_by(mut follower: BallTracker, pictures: impl Iterator<Item = RgbImage>) -> BallTracker {
    for (frame, rgb) in pictures.enumerate() {
        follower.watch(Picture::from_rgb(rgb), frame as f64 / FPS).unwrap();
        answer(&mut follower);
    }
    follower.end();
    answer(&mut follower);
    follower
}

fn film(draw: impl Fn(usize, &mut RgbImage)) -> BallTracker {
    watched((0..FRAMES).map(|frame| {
        let mut rgb = ground(frame);
        draw(frame, &mut rgb);
        rgb
    }))
}

/// The frames of what was followed, with clicks.
fn frames_of(follower: &BallTracker, seeds: &[(usize, [f64; 2])]) -> Vec<FollowedFrame> {
    follower.hypotheses(seeds).unwrap().followed(None).frames
}

fn with_ball() -> BallTracker {
    film(|frame, rgb| disc(rgb, ball_at(frame), RADIUS, YELLOW))
}

#[test]
fn of_two_balls_one_is_reported_and_the_other_is_listed() {
    // It comes from the right, above the first one.
    let other_at = |frame: usize| [290.0 - 6.0 * frame as f64, ball_at(frame)[1] - 40.0];
    let follower = film(|frame, rgb| {
        disc(rgb, ball_at(frame), RADIUS, YELLOW);
        disc(rgb, other_at(frame), RADIUS, YELLOW);
    });
    let Followed { frames, tracks: others, .. } = follower.hypotheses(&[]).unwrap().followed(None);
    let [first, second] = [ball_at, other_at].map(|at| counted(&frames, at));
    let near = |at: fn(usize) -> [f64; 2]| {
        let is_near = |frame: &&OtherFrame| {
            let [x, y] = at(frame.frame);
            (frame.image[0] - x).hypot(frame.image[1] - y) < 1.0
        };
        others.iter().map(|track| track.frames.iter().filter(is_near).count()).max().unwrap_or(0)
    };
    let [listed_first, listed_second] = [near(ball_at), near(other_at)];
    // Each ball is in one of the two, and no other track mixes them.
    assert!(first[0].max(listed_first) > 30 && second[0].max(listed_second) > 25, "{first:?} {second:?} {others:?}");
    assert!(others.iter().all(|track| (0.0..=1.0).contains(&track.probability) && track.frames.len() > 4));
    assert!(with_ball().hypotheses(&[]).unwrap().followed(None).tracks.is_empty());
}

/// Frames in which the ball is followed to a pixel, those in which anything is, and those in all.
fn counted(frames: &[FollowedFrame], at: impl Fn(usize) -> [f64; 2]) -> [usize; 3] {
    let off = |frame: usize, ball: &TrackedBlob| {
        let [x, y] = at(frame);
        (ball.image[0] - x).hypot(ball.image[1] - y)
    };
    let seen = || frames.iter().enumerate().filter_map(|(number, frame)| Some((number, frame.ball?)));
    [seen().filter(|(number, ball)| off(*number, ball) < 1.0).count(), seen().count(), frames.len()]
}

#[test]
fn a_ball_is_followed_through_a_bounce_with_its_radius() {
    let frames = frames_of(&with_ball(), &[]);
    let [right, seen, all] = counted(&frames, ball_at);
    assert!(all == FRAMES && right >= 36 && seen - right <= 1, "{right} right of {seen} seen of {all}");
    for frame in frames.iter().filter(|frame| frame.ball.is_some()) {
        let ball = frame.ball.unwrap();
        assert!((ball.radius_px / RADIUS).ln().abs() < 0.25, "{ball:?}");
        assert!(frame.confidence > 0.75);
    }
}

#[test]
fn without_a_ball_there_is_none() {
    let still = frames_of(&film(|_, _| {}), &[]);
    assert!(still.iter().all(|frame| frame.ball.is_none() && frame.confidence == 0.0));
    // A ball that lies there, and a lamp that flickers.
    let lying = film(|frame, rgb| {
        disc(rgb, [100.0, 150.0], RADIUS, YELLOW);
        disc(rgb, [250.0, 40.0], 5.0, if frame % 3 == 0 { [255, 255, 250] } else { [120, 120, 110] });
    });
    let frames = frames_of(&lying, &[]);
    assert!(frames.iter().all(|frame| frame.ball.is_none()));
    assert!(frames_of(&BallTracker::new(), &[]).is_empty());
}

/// Of a film of 25 a second shown as 30, every sixth is shown again.
fn shown_at_thirty(frame: usize) -> RgbImage {
    let source = frame + 1 - (frame + 1) / 6;
    let mut rgb = ground(source);
    disc(&mut rgb, ball_at(source), RADIUS, YELLOW);
    rgb
}

#[test]
fn repeated_frames_are_detected_and_cost_nothing() {
    let frames = frames_of(&watched((0..FRAMES).map(shown_at_thirty)), &[]);
    let repeated: Vec<usize> = (0..FRAMES).filter(|&frame| frames[frame].repeated).collect();
    assert_eq!(repeated, [5, 11, 17, 23, 29, 35]);
    let seen = frames.iter().filter(|frame| frame.ball.is_some()).count();
    assert!(seen >= 30, "{seen}");
}

#[test]
fn repeated_frames_that_were_encoded_again_are_detected() {
    let encoded_again = |frame: usize| {
        let mut rgb = shown_at_thirty(frame);
        // Each time every third pixel is encoded a little otherwise.
        for (index, level) in rgb.iter_mut().enumerate().filter(|(index, _)| (index / 3 + frame).is_multiple_of(3)) {
            *level = level.saturating_add((index / 7 % 5) as u8);
        }
        rgb
    };
    let frames = frames_of(&watched((0..FRAMES).map(encoded_again)), &[]);
    let repeated: Vec<usize> = (0..FRAMES).filter(|&frame| frames[frame].repeated).collect();
    assert_eq!(repeated, [5, 11, 17, 23, 29, 35]);
}

/// Where the ball of [`with_cut`] is.
fn before_and_after(frame: usize) -> [f64; 2] {
    if frame < 30 { ball_at(frame) } else { ball_at(frame - 30) }
}

/// A film with a cut at frame 30.
fn with_cut() -> impl Iterator<Item = RgbImage> {
    (0..80).map(|frame| {
        let mut rgb = ground(frame);
        if frame >= 30 {
            image::imageops::invert(&mut rgb);
        }
        disc(&mut rgb, before_and_after(frame), RADIUS, YELLOW);
        rgb
    })
}

#[test]
fn pictures_that_are_held_for_longer_change_no_result() {
    let found = |pictures: Pictures| {
        let follower = watched_by(BallTracker { pictures, ..BallTracker::new() }, with_cut());
        let candidates: Vec<Vec<Query>> = (0..80).map(|frame| follower.candidates(FrameId(frame))).collect();
        (frames_of(&follower, &[]), candidates)
    };
    assert_eq!(found(Pictures::holding(24)), found(Pictures::holding(80)));
}

#[test]
fn a_cut_loses_no_frame() {
    let follower = watched(with_cut());
    let flying = follower.hypotheses(&[]).unwrap();
    assert!(matches!(flying.cuts()[..], [30 | 31]), "{:?}", flying.cuts());
    let frames = flying.followed(None).frames;
    let [right, seen, all] = counted(&frames[..70], before_and_after);
    assert!(frames.len() == 80 && right >= 55 && seen - right <= 2, "{right} right of {seen} seen of {all}");
}

/// What a network sees in a frame.
type Network<'a> = &'a dyn Fn(usize, &Query) -> Option<Detection>;

/// A ball and, of it, a shadow; a network, if there is one, that looks at what moves.
fn with_shadow(network: Option<Network<'_>>) -> (BallTracker, fn(usize) -> [f64; 2]) {
    let shadow = |frame: usize| -> [f64; 2] {
        let t = frame as f64;
        [40.0 + 5.5 * t, 170.0 - 2.0 * t + 0.04 * t * t]
    };
    let draw = |frame: usize, rgb: &mut RgbImage| {
        disc(rgb, shadow(frame), 4.5, [20, 20, 20]);
        // Behind something for a while.
        if network.is_none() || !HIDDEN.contains(&frame) {
            disc(rgb, ball_at(frame), RADIUS, YELLOW);
        }
    };
    let mut follower = BallTracker::new();
    for frame in 0..=FRAMES {
        if frame < FRAMES {
            let mut rgb = ground(frame);
            draw(frame, &mut rgb);
            follower.watch(Picture::from_rgb(rgb), frame as f64 / FPS).unwrap();
        } else {
            follower.end();
        }
        loop {
            let queries = follower.queries();
            if queries.is_empty() {
                break;
            }
            for query in queries {
                let picture = follower.picture(&query).unwrap();
                assert_eq!(picture.size().width, SIZE[0]);
                let found = network.and_then(|network| network(query.frame().0, &query));
                if network.is_some() {
                    follower.tell(&query, found);
                }
            }
        }
    }
    (follower, shadow)
}

/// Frames in which nothing shows the ball.
const HIDDEN: std::ops::Range<usize> = 14..17;

#[test]
fn a_detector_separates_the_ball_from_its_shadow_and_finds_it_where_nothing_moves() {
    let network = |frame: usize, query: &Query| {
        let [[x, y], [u, v]] = [query.image, ball_at(frame)];
        let outline = Outline { centre: [u, v].into(), radius: RADIUS };
        ((x - u).hypot(y - v) < 3.0).then_some(Detection { outline, log_sigma: 0.1 / RADIUS, confidence: 0.9 })
    };
    let (follower, _) = with_shadow(Some(&network));
    let frames = frames_of(&follower, &[]);
    let [right, seen, _] = counted(&frames, ball_at);
    // Where they touch they are one blob, whose middle is between.
    assert!(right >= 36 && seen - right <= 4, "{right} right of {seen}");
    assert!(frames[HIDDEN].iter().all(|frame| frame.ball.is_some() && frame.point.radius == Some(RADIUS)));
}

#[test]
fn one_click_decides_which_is_the_ball() {
    for (seed, is_shadow) in [(12, true), (12, false)] {
        let (follower, shadow) = with_shadow(None);
        let at = if is_shadow { shadow(seed) } else { ball_at(seed) };
        let frames = frames_of(&follower, &[(seed, at)]);
        let [right, seen, _] = counted(&frames, if is_shadow { shadow } else { ball_at });
        assert!(right >= 20, "shadow {is_shadow}: {right} right of {seen}");
        let ball = frames[seed].ball.unwrap();
        assert!((ball.image[0] - at[0]).hypot(ball.image[1] - at[1]) < 2.0);
    }
    let refused = |seed: (usize, [f64; 2])| with_ball().hypotheses(&[seed]).err().unwrap().to_string();
    assert!(refused((40, [10.0, 10.0])).contains("the last frame is 39"));
    assert!(refused((3, [10.0, 500.0])).contains("outside the picture"));
}

#[test]
fn a_frame_of_another_size_is_refused() {
    let mut follower = BallTracker::new();
    follower.watch(Picture::from_rgb(ground(0)), 0.0).unwrap();
    let error = follower.watch(Picture::from_rgb(RgbImage::new(64, 64)), 0.1).unwrap_err().to_string();
    assert!(error.contains("frame 1") && error.contains("320×200"), "{error}");
}

#[test]
fn a_streak_has_its_middle_its_width_and_its_direction() {
    let follower = film(|frame, rgb| {
        let [x, y] = ball_at(frame);
        for part in -8..=8 {
            disc(rgb, [x + f64::from(part), y + 0.5 * f64::from(part)], RADIUS, YELLOW);
        }
    });
    let frames = frames_of(&follower, &[]);
    let [right, seen, _] = counted(&frames, ball_at);
    assert!(right >= 34 && seen - right <= 1, "{right} right of {seen}");
    let ball = frames[15].ball.unwrap();
    assert!((ball.radius_px - RADIUS).abs() < 1.0 && ball.reach_px > 9.0, "{ball:?}");
}

#[test]
fn of_two_clicks_in_a_frame_the_last_counts() {
    let (follower, shadow) = with_shadow(None);
    for (wrong, right) in [(shadow as fn(usize) -> [f64; 2], ball_at as fn(usize) -> [f64; 2]), (ball_at, shadow)] {
        let clicks = [(12, wrong(12)), (12, right(12))];
        let [own, _, _] = counted(&frames_of(&follower, &clicks), right);
        assert!(own >= 20, "{own}");
        assert_eq!(follower.hypotheses(&clicks).unwrap().unused_seeds(), []);
    }
}

#[test]
fn a_candidate_is_kept_however_long_the_video_is() {
    let mut follower = BallTracker::new();
    let mut early = vec![];
    for frame in 0..2200 {
        let mut rgb = if frame < 100 { ground(frame) } else { ground(frame % 7) };
        if frame < FRAMES {
            disc(&mut rgb, ball_at(frame), RADIUS, YELLOW);
            disc(&mut rgb, [250.0, 40.0 + 30.0 * (frame % 2) as f64], 5.0, [20, 20, 20]);
        }
        follower.watch(Picture::from_rgb(rgb), frame as f64 / FPS).unwrap();
        while let queries = follower.queries()
            && !queries.is_empty()
        {
            queries.iter().for_each(|query| follower.tell(query, None));
        }
        if frame == 100 {
            early = (0..FRAMES).map(|place| follower.candidates(FrameId(place))).collect();
        }
    }
    follower.end();
    assert!(
        early.iter().map(Vec::len).sum::<usize>() >= 2 * FRAMES - 10,
        "{}",
        early.iter().map(Vec::len).sum::<usize>()
    );
    let late: Vec<Vec<Query>> = (0..FRAMES).map(|place| follower.candidates(FrameId(place))).collect();
    assert_eq!(early, late);
}

#[test]
fn a_click_that_no_path_goes_through_is_answered() {
    let tracker = with_ball();
    let at = |seed| tracker.hypotheses(&[seed]).unwrap().unused_seeds().to_vec();
    assert_eq!(at((12, ball_at(12))), []);
    assert_eq!(at((12, [20.0, 20.0])), [(12, [20.0, 20.0])]);
}
