//! Cameras that turn.

use nalgebra::{Rotation3, Vector3};

use super::*;
use gravisight_geometry::camera::{Court, Distortion, homography_between};
use gravisight_geometry::size::Size;

#[test]
fn a_slow_pan_is_another_view_until_it_is_back() {
    // Half a pixel a frame from frame 40 on, and back again from frame 70 on.
    let shift =
        |frame: usize| (frame.saturating_sub(40) / 2).min(15) as i32 - (frame.saturating_sub(70) / 2).min(15) as i32;
    let follower = watched((0..120).map(|frame| {
        let still = ground(frame);
        let mut rgb = RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
            let column = (x as i32 + shift(frame)).min(SIZE[0] as i32 - 1);
            *still.get_pixel(column as u32, y)
        });
        disc(&mut rgb, ball_at(frame % 40), RADIUS, YELLOW);
        rgb
    }));
    let frames = frames_of(&follower, &[]);
    let elsewhere: Vec<bool> = frames.iter().map(|frame| frame.elsewhere.is_some()).collect();
    assert!(!elsewhere[..40].contains(&true) && !elsewhere[106..].contains(&true), "{elsewhere:?}");
    let seen = |frame: &usize| !frames[*frame].repeated;
    assert!((47..94).filter(seen).all(|frame| elsewhere[frame]), "{elsewhere:?}");
    let most = frames.iter().filter_map(|frame| match frame.elsewhere {
        Some(CameraMotion::Moved(px)) => Some(px),
        _ => None,
    });
    let most = most.fold(0.0, f64::max);
    // It stands at 15 px for less than there are frames between two looks.
    assert!((13.0..15.5).contains(&most), "{most}");
}

#[test]
fn before_a_camera_that_sways_the_ball_is_followed_and_nothing_else() {
    let shift = |frame: usize| (14.0 * (frame as f64 / 5.0).sin()).round() as i32;
    let swaying = |with_ball: bool| {
        let film = (0..FRAMES).map(|frame| {
            let mut still = ground(frame);
            if with_ball {
                disc(&mut still, ball_at(frame), RADIUS, YELLOW);
            }
            RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
                let column = (x as i32 + shift(frame)).clamp(0, SIZE[0] as i32 - 1);
                *still.get_pixel(column as u32, y)
            })
        });
        frames_of(&watched(film), &[])
    };
    let frames = swaying(true);
    let at = |frame: usize| [ball_at(frame)[0] - f64::from(shift(frame)), ball_at(frame)[1]];
    let [right, seen, _] = counted(&frames, at);
    assert!(right >= 30 && seen - right <= 1, "{right} right of {seen}");
    assert!(swaying(false).iter().all(|frame| frame.ball.is_none()));
    // In the first view it flies as if the camera stood still.
    for (number, frame) in frames.iter().enumerate() {
        let Some((ball, view)) = frame.ball.zip(frame.view) else { continue };
        let [x, y] = view.first(&Place::new(ball.image)).xy;
        assert!((x - ball_at(number)[0]).hypot(y - ball_at(number)[1]) < 1.5, "frame {number}");
    }
}

#[test]
fn a_still_ball_before_a_panning_camera_does_not_move() {
    // Two pixels a frame.
    let shift = |frame: usize| 2.0 * frame as f64;
    let still = [200.0, 100.0];
    let rolling = |frame: usize| [100.0 + 0.6 * frame as f64, 150.0];
    let mut follower = BallTracker::new();
    for frame in 0..18 {
        let ground = ground(frame);
        let rgb = RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
            *ground.get_pixel((x + shift(frame) as u32).min(SIZE[0] - 1), y)
        });
        follower.watch(Picture::from_rgb(rgb), frame as f64 / FPS).unwrap();
    }
    follower.settle();
    let found = |frame: usize, [x, y]: [f64; 2]| {
        let outline = Outline { centre: [x - shift(frame), y].into(), radius: 6.0 };
        Detection { outline, log_sigma: 0.02, confidence: 0.9 }
    };
    let [before, after] = [8, 16].map(|frame| [found(frame, still), found(frame, rolling(frame))]);
    let places = follower.slow_balls((FrameId(8), &before), (FrameId(16), &after));
    assert_eq!(places.iter().map(|(frame, _)| frame.0).collect::<Vec<_>>(), (8..=16).collect::<Vec<_>>());
    for (FrameId(frame), outline) in places {
        let off = (outline.centre - found(frame, rolling(frame)).outline.centre).norm();
        assert!(off < 0.5 && (outline.radius - 6.0).abs() < 0.1, "frame {frame}: {off} px, {outline:?}");
    }
}

#[test]
fn a_courts_lines_hold_the_views_of_a_camera_that_pans_before_a_moving_crowd() {
    let (width, height) = (640_u32, 360_u32);
    let intrinsic = Matrix3::new(760.0, 0.0, 319.5, 0.0, 760.0, 179.5, 0.0, 0.0, 1.0);
    let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
    let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.3).into_inner() * level;
    let translation = -rotation * Vector3::new(0.5, -24.0, 9.0);
    let lens = Distortion::default();
    let first = Camera::new(Size::new(width, height), intrinsic, lens, rotation, translation).unwrap();
    let camera = |frame: usize| first.turned(&Rotation3::new(Vector3::new(0.0, -0.004 * frame as f64, 0.0)));
    let picture = |frame: usize| {
        let camera = camera(frame);
        let mut rgb = RgbImage::from_fn(width, height, |x, y| {
            // The crowd is another one in each frame.
            let noise = (x / 3 * 7919 + y / 3 * 104_729 + frame as u32 * 1_299_709) % 97;
            Rgb(if y < 90 { [60 + noise as u8; 3] } else { [70, 100, 90] })
        });
        for line in &Court::named("tennis").unwrap().lines {
            let corner = |share: f64, edge: usize| camera.image_from_world(&line.edges(share).unwrap()[edge]).unwrap();
            let corners = [corner(0.0, 0), corner(0.0, 1), corner(1.0, 1), corner(1.0, 0)];
            let side = |at: &Point2<f64>, index: usize| {
                let (from, to) = (corners[index], corners[(index + 1) % 4]);
                (to - from).perp(&(at - from)) / (to - from).norm()
            };
            let turn = side(&corners[2], 0).signum();
            for (x, y, pixel) in rgb.enumerate_pixels_mut() {
                let at = Point2::new(f64::from(x), f64::from(y));
                let inside: f64 = (0..4).map(|edge| (turn * side(&at, edge) + 0.5).clamp(0.0, 1.0)).product();
                pixel.0.iter_mut().for_each(|level| *level += ((230.0 - f64::from(*level)) * inside) as u8);
            }
        }
        Picture::from_rgb(rgb)
    };
    let mut tracker = BallTracker::new();
    tracker.see_court(CourtFollower::new("tennis").unwrap(), first.clone());
    (0..16).for_each(|frame| tracker.watch(picture(frame), frame as f64 / FPS).unwrap());
    tracker.end();
    for (frame, frame_from_first) in tracker.views_from_first().iter().enumerate() {
        let truth = homography_between(&first, &camera(frame)).unwrap();
        for at in [Point2::new(100.0, 150.0), Point2::new(320.0, 180.0), Point2::new(600.0, 330.0)] {
            let off = (frame_from_first.transform_point(&at) - truth.transform_point(&at)).norm();
            assert!(off < 0.6, "frame {frame}: {off} px at {at}");
        }
    }
}
