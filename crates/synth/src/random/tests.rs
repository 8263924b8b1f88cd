//! What is drawn is where and as large as it says.

use nalgebra::{Rotation3, Vector3};

use super::ball::{self, Layer, Look};
use super::canvas::{Canvas, Ellipse};
use super::*;

/// Parts that a pixel's side is cut into to count what an ellipse covers of it.
const PARTS: u8 = 40;

/// Area and centre of mass of the pixels by the fractions that an ellipse covers of them.
fn moments(fraction: impl Fn(f32, f32) -> f32) -> (f64, [f64; 2]) {
    let (mut area, mut sum) = (0.0, [0.0; 2]);
    for [x, y] in (0..128 * 128).map(|index| [(index % 128) as f32, (index / 128) as f32]) {
        let fraction = fraction(x, y);
        area += f64::from(fraction);
        sum[0] += f64::from(fraction * x);
        sum[1] += f64::from(fraction * y);
    }
    (area, sum.map(|sum| sum / area))
}

/// The fraction of a pixel that an ellipse covers, by counting points.
fn counted(ellipse: &Ellipse, x: f32, y: f32) -> f32 {
    let distance = (x - ellipse.centre[0]).hypot(y - ellipse.centre[1]);
    let [least, most] = [ellipse.semi[1] - 1.0, ellipse.semi[0] + 1.0];
    if distance < least || distance > most {
        return f32::from(u8::from(distance < least));
    }
    let at = |part: u8| (f32::from(part) + 0.5) / f32::from(PARTS) - 0.5;
    let parts = (0..PARTS).flat_map(|row| (0..PARTS).map(move |column| [at(column), at(row)]));
    let inside = parts.filter(|[dx, dy]| {
        let [u, v] = ellipse.local(x + dx, y + dy);
        u.hypot(v) <= 1.0
    });
    inside.count() as f32 / f32::from(PARTS).powi(2)
}

#[test]
fn a_disc_covers_its_area_about_its_centre() {
    for radius in [1.5, 1.8, 2.3, 4.0, 9.5, 30.0_f32] {
        for shift in [[0.0, 0.0], [0.3, 0.1], [0.5, 0.5], [0.77, 0.4]] {
            let centre = [63.0 + shift[0], 64.0 + shift[1]];
            for (ratio, turn) in [(1.0, 0.0), (1.1, 0.4), (1.15, 2.0_f32)] {
                let ellipse = Ellipse { centre, semi: [ratio * radius, radius], axis: [turn.cos(), turn.sin()] };
                let (area, middle) = moments(|x, y| ellipse.coverage(x, y));
                let (_, expected) = moments(|x, y| counted(&ellipse, x, y));
                let found = (area / std::f64::consts::PI / f64::from(ratio)).sqrt();
                assert!((found - f64::from(radius)).abs() < 0.01, "radius {radius}: {found}");
                // Pixels' middles stand for what they show: not quite the ellipse's centre, however well it is drawn.
                let off = (middle[0] - expected[0]).hypot(middle[1] - expected[1]);
                assert!(off < 0.01, "radius {radius} at {centre:?}: centre is {off} px off");
            }
        }
    }
}

#[test]
fn outlines_are_those_of_spheres() {
    let mut random = Stream::Scene.of(1);
    for _ in 0..200 {
        let radius = random.random_range(1.5..60.0_f32);
        let outline = ball::place([0.0, 0.0], radius, &mut random).outline;
        // What sphere, off which axis: from the ellipse's own numbers, for any focal length.
        let [long, short] = outline.semi.map(f64::from);
        let focal: f64 = 800.0;
        // z² = 1 + f²/b²; a² = f²(|P|² − 1)/(z² − 1)²
        let z2 = 1.0 + (focal / short).powi(2);
        let p2 = 1.0 + (long / focal * (z2 - 1.0)).powi(2);
        let position = Vector3::new((p2 - z2).max(0.0).sqrt(), 0.0, z2.sqrt());
        // Its outline by rays that touch it.
        let axis = position.normalize();
        let open = (1.0 / position.norm()).asin();
        let side = axis.cross(&Vector3::y()).normalize();
        let touching: Vec<[f64; 2]> = (0..360)
            .map(|degrees| {
                let around =
                    Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(axis), f64::from(degrees).to_radians());
                let ray = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(around * side), open) * axis;
                [focal * ray.x / ray.z, focal * ray.y / ray.z]
            })
            .collect();
        let extent = |axis: usize| {
            let values = || touching.iter().map(|point| point[axis]);
            (values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)) / 2.0
        };
        assert!((extent(0) / long - 1.0).abs() < 1e-3, "{} {long}", extent(0));
        assert!((extent(1) / short - 1.0).abs() < 1e-3, "{} {short}", extent(1));
        assert!((1.0..1.2).contains(&(long / short)), "{}", long / short);
    }
}

#[test]
fn a_moving_ball_keeps_its_mass_and_its_middle() {
    let mut random = Stream::Scene.of(2);
    for _ in 0..50 {
        let mut placed = ball::place([40.3, 50.8], 6.0, &mut random);
        placed.streak = [13.0, -8.0];
        let still = Layer::still(&placed, &Look::random(6.0, &mut random));
        let area = still.area();
        let moved = still.moved(placed.streak);
        assert!((moved.area() / area - 1.0).abs() < 1e-3);
        let mut middle = [0.0; 2];
        moved.over(&Canvas::new(Size::square(128), [0.0; 3]), |_, x, y, value| {
            middle[0] += value[3] * x as f32 / area;
            middle[1] += value[3] * y as f32 / area;
        });
        assert!((middle[0] - 40.3).abs() < 0.02 && (middle[1] - 50.8).abs() < 0.02, "{middle:?}");
    }
}

#[test]
fn pictures_come_from_their_seeds_and_show_what_they_say() {
    let scenes = RandomScenes::new(vec![], 0.1);
    let size = Size::new(96, 128);
    let (mut empty, mut radii) = (0, vec![]);
    for seed in 0..300 {
        let drawing = scenes.draw(size, seed, 1);
        let pixels: Vec<[f32; 3]> = drawing.rgb().collect();
        assert_eq!(pixels.len(), size.pixels());
        assert!(pixels.iter().flatten().all(|value| (0.0..=1.0).contains(value)), "seed {seed}");
        if seed % 50 == 0 {
            assert!(scenes.draw(size, seed, 1).rgb().eq(pixels), "seed {seed}");
        }
        match drawing.balls.first() {
            None => empty += 1,
            Some(ball) => {
                assert!(ball.visible >= 0.4 && (0.0..96.0).contains(&ball.centre[0]));
                radii.push(ball.radius);
            }
        }
    }
    assert!((10..110).contains(&empty), "{empty} of 300 without a ball");
    radii.sort_by(f64::total_cmp);
    // Log-uniform from 1.5 to a third of 96: a third of them below 4.2 px.
    assert!((3.0..6.5).contains(&radii[radii.len() / 3]), "{}", radii[radii.len() / 3]);
}

#[test]
fn a_place_in_a_photograph_lies_where_it_is_said() {
    let (disc, radius) = ([210.0, 60.0_f32], 6.0_f32);
    let photograph = RgbImage::from_fn(400, 300, |x, y| {
        let inside = (x as f32 - disc[0]).hypot(y as f32 - disc[1]) < radius;
        Rgb([if inside { 255 } else { 40 }; 3])
    });
    let spot = Spot { photograph: 0, centre: disc, radius };
    let photographs = [photograph];
    let (mut shown, mut sizes) = (0, vec![]);
    for seed in 0..40 {
        let size = Size::new(128, 128);
        let (canvas, [x, y], radius) = background::draw_about(size, &photographs, &spot, &mut Stream::Scene.of(seed));
        assert!((0.0..127.0).contains(&x) && (0.0..127.0).contains(&y), "{x} {y}");
        let value = |x: f32, y: f32| canvas.planes[0][y.round() as usize * canvas.width + x.round() as usize];
        // Bright in its middle, dark beyond its edge; seldom something is before it.
        let beyond = if x > 64.0 { x - 1.6 * radius - 1.0 } else { x + 1.6 * radius + 1.0 };
        shown += usize::from(value(x, y) > 0.9 && value(beyond.clamp(0.0, 127.0), y) < 0.2);
        sizes.push(radius);
    }
    assert!(shown >= 34, "{shown} of 40");
    let [least, most] = [f32::min, f32::max].map(|pick| sizes.iter().copied().reduce(pick).unwrap());
    assert!((3.0..5.0).contains(&least) && (9.0..=12.1).contains(&most), "{least} {most}");
}

/// A white ball before black, in a photograph of 200 × 160 px.
fn labelled() -> LabelledPhotograph {
    let ball = LabelledBall { centre: [120.3, 70.8], radius: 25.0, is_sized: true };
    let disc = Ellipse { centre: ball.centre, semi: [ball.radius; 2], axis: [1.0, 0.0] };
    let rgb = RgbImage::from_fn(200, 160, |x, y| Rgb([(255.0 * disc.coverage(x as f32, y as f32)).round() as u8; 3]));
    LabelledPhotograph { rgb, balls: vec![ball] }
}

/// How far the white in a picture of 64 × 64 px is from the ball's place, and the radius of a disc of its area, px.
fn white_disc(canvas: &Canvas, ball: &Apparent) -> (f64, f64) {
    let at = |index: usize| canvas.planes[1][index];
    let area: f32 = (0..64 * 64).map(at).sum();
    let mean = |of: &dyn Fn(usize) -> usize| (0..64 * 64).map(|index| at(index) * of(index) as f32).sum::<f32>() / area;
    let [x, y] = [mean(&|index| index % 64), mean(&|index| index / 64)].map(f64::from);
    let off = (x - ball.centre[0]).hypot(y - ball.centre[1]);
    (off, f64::from(area / std::f32::consts::PI).sqrt())
}

#[test]
fn a_part_of_a_photograph_shows_its_ball_where_and_as_large_as_it_says() {
    let photograph = labelled();
    let mut whole = 0;
    for seed in 0..200 {
        let (canvas, balls) = real::part(Size::square(64), &photograph, &mut Stream::Scene.of(seed));
        let Some(ball) = balls.first().filter(|ball| ball.visible > 0.999 && ball.radius > 3.0) else { continue };
        assert!(ball.is_sized && ball.radius < 1.31 * 25.0);
        let (off, radius) = white_disc(&canvas, ball);
        assert!(off < 0.35 && (radius / ball.radius - 1.0).abs() < 0.05, "{seed}: {off} px off, {radius} of {ball:?}");
        whole += 1;
    }
    assert!(whole > 50, "{whole}");
}

#[test]
fn drawn_balls_stay_clear_of_the_labelled_one() {
    let scenes = RandomScenes::new(vec![], 0.0).with_labelled(vec![labelled()]);
    let drawings: Vec<_> = (0..300).map(|seed| scenes.draw(Size::square(128), seed, 3).balls).collect();
    // The labelled ball comes first: its streak is 0, its focal length the picture's side. Squeezed ones have no sizes.
    let is_part = |balls: &&Vec<Apparent>| balls.first().is_some_and(|it| it.focal == 128.0 && it.is_sized);
    let parts: Vec<_> = drawings.iter().filter(is_part).collect();
    let more = parts.iter().filter(|balls| balls.len() > 1).count();
    assert!(more > 10 && more < parts.len(), "{more} of {}", parts.len());
    for balls in parts {
        for ball in &balls[1..] {
            let away = (ball.centre[0] - balls[0].centre[0]).hypot(ball.centre[1] - balls[0].centre[1]);
            assert!(away > 1.2 * (ball.radius + balls[0].radius), "{away}: {balls:?}");
        }
    }
}

#[test]
fn a_squeezed_picture_keeps_its_balls_where_they_are_seen() {
    let scenes = RandomScenes::new(vec![], 0.0).with_labelled(vec![labelled()]);
    let mut squeezed = 0;
    for seed in 0..400 {
        let drawing = scenes.part(Size::square(64), &scenes.labelled[0], 0, &mut Stream::Scene.of(seed));
        assert_eq!([drawing.canvas.width, drawing.canvas.height], [64, 64]);
        let Some(ball) = drawing.balls.first().filter(|it| !it.is_sized && it.visible > 0.999 && it.radius > 3.0)
        else {
            continue;
        };
        let (off, radius) = white_disc(&drawing.canvas, ball);
        assert!(off < 0.5 && (radius / ball.radius - 1.0).abs() < 0.05, "{seed}: {off} px off, {radius} of {ball:?}");
        squeezed += 1;
    }
    assert!(squeezed > 15, "{squeezed}");
}

#[test]
fn a_cut_out_ball_covers_its_outline_with_its_own_colour() {
    let [cut_out] = &real::CutOut::all(&[labelled()])[..] else { panic!("one ball, one cut-out") };
    assert!((cut_out.largest() / 25.0 - 1.3).abs() < 1e-3);
    for (seed, radius) in [(1, 2.0_f32), (2, 7.3), (3, 30.0)] {
        let mut random = Stream::Scene.of(seed);
        let placed = ball::place([40.0, 40.0], radius, &mut random);
        let layer = cut_out.layer(&placed, &mut random);
        let [longer, shorter] = placed.outline.semi;
        let ellipse = std::f32::consts::PI * longer * shorter;
        assert!((layer.area() / ellipse - 1.0).abs() < 0.03, "radius {radius}: {} of {ellipse}", layer.area());
        // White, relit: nothing of the black around it.
        let mean = layer.values.iter().map(|value| value[1]).sum::<f32>() / layer.area();
        assert!((0.55..=1.0).contains(&mean), "radius {radius}: {mean}");
    }
}

#[test]
fn some_balls_that_are_cut_out_turn_white() {
    let mut photograph = labelled();
    // An orange ball.
    photograph.rgb.pixels_mut().for_each(|pixel| pixel.0 = [pixel.0[0], pixel.0[0] / 2, 0]);
    let [cut_out] = &real::CutOut::all(&[photograph])[..] else { panic!("one ball, one cut-out") };
    let colours = (0..200).map(|seed| {
        let mut random = Stream::Scene.of(seed);
        let placed = ball::place([40.0, 40.0], 9.0, &mut random);
        let layer = cut_out.layer(&placed, &mut random);
        [0, 1, 2].map(|channel| layer.values.iter().map(|value| value[channel]).sum::<f32>() / layer.area())
    });
    let white = colours.filter(|colour| {
        let [low, high] = [f32::min, f32::max].map(|pick| colour.iter().copied().reduce(pick).unwrap());
        low > 0.55 * high
    });
    let white = white.count();
    assert!((35..=85).contains(&white), "{white} of 200");
}

#[test]
fn a_ball_at_a_photographs_edge_or_of_unknown_size_is_not_cut_out() {
    let mut photograph = labelled();
    photograph.balls[0].centre = [10.0, 70.0];
    assert!(real::CutOut::all(&[photograph.clone()]).is_empty());
    photograph = labelled();
    photograph.balls[0].is_sized = false;
    assert!(real::CutOut::all(&[photograph]).is_empty());
}
