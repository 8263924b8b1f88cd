//! What is painted is where the camera sees it, and pictures are drawn from their names alone.

use image::RgbImage;
use nalgebra::{Point2, Point3, Vector2};

use super::*;
use crate::random::canvas::PaintColour;
use gravisight_geometry::camera::CourtLine;

/// The court whose paint is measured.
const COURT: &str = "volleyball";

/// The first pictures of a court whose lens bends, or does not.
fn pictures(court: &'static str, is_bent: bool, count: usize) -> Vec<CourtPicture> {
    let all = (0..).map(|number| CourtPicture::draw(Some(court), Split::Train, number, 5).unwrap());
    all.filter(|picture| picture.camera().distortion().is_none() != is_bent).take(count).collect()
}

/// A scene's picture with lines of a colour, without what blurs, hides, wears and compresses.
fn plain(picture: &CourtPicture, lines: &[CourtLine], colour: PaintColour) -> RgbImage {
    let random = &mut Stream::Scene.of_named(picture.seed, &picture.stream);
    let mut scenery = Scenery::draw(Some(COURT), random).unwrap();
    scenery.make_plain(lines, colour);
    scenery.picture(&mut Stream::FrameNoise.of(0)).unwrap()
}

/// Where the middle of a line is seen, px, and half the width of its paint, from which direction; none where that is not in the picture.
fn seen(camera: &Camera, line: &CourtLine, share: f64) -> Option<(Point2<f64>, f64, Vector2<f64>)> {
    let image = |share: f64| {
        let [a, b] = line.edges(share)?.map(|edge| camera.image_from_world(&edge).ok());
        Some((a?, b?))
    };
    let ((a, b), (c, d)) = (image(share)?, image(share + 0.01)?);
    let along = (nalgebra::center(&c, &d) - nalgebra::center(&a, &b)).normalize();
    let normal = Vector2::new(-along.y, along.x);
    let (middle, half) = (nalgebra::center(&a, &b), (b - a).dot(&normal).abs() / 2.0);
    let is_inside = [0, 1].iter().all(|&axis| (40.0..camera.size().xy()[axis] - 40.0).contains(&middle[axis]));
    (is_inside && half < 30.0).then_some((middle, half, normal))
}

#[test]
fn lines_are_painted_where_the_camera_sees_them_through_its_lens_too() {
    for is_bent in [false, true] {
        let (mut found, mut hidden, mut bends) = (0, 0, 0.0_f64);
        for picture in pictures(COURT, is_bent, 2) {
            let camera = picture.camera();
            let unbent = lens::without(camera).unwrap();
            // Lines that do not cross.
            let (along, across): (Vec<_>, Vec<_>) =
                markings::lines(COURT, false).unwrap().into_iter().partition(|line| line.from[0] == line.to[0]);
            for lines in [along, across] {
                let [light, dark] = [[1.0; 3], [0.0; 3]].map(|colour| plain(&picture, &lines, colour));
                for (line, share) in lines.iter().flat_map(|line| [0.1, 0.3, 0.5, 0.7, 0.9].map(|share| (line, share)))
                {
                    let Some((middle, half, normal)) = seen(camera, line, share) else { continue };
                    // The centre of the difference that the paint's colour makes across the line.
                    let (mut sum, mut moment) = (0.0, 0.0);
                    for off in (-20..=20).map(|step| (half + 3.0) * f64::from(step) / 20.0) {
                        let value = difference(&light, &dark, middle + normal * off);
                        sum += value;
                        moment += value * off;
                    }
                    if sum < 20.0 {
                        hidden += 1;
                        continue;
                    }
                    let off = moment / sum;
                    assert!(off.abs() < 0.3, "{}: paint {off} px off at {middle}", picture.name());
                    found += 1;
                    let [a, b] = line.edges(share).unwrap();
                    bends = bends.max(bend(camera, &unbent, &nalgebra::center(&a, &b), &middle));
                }
            }
        }
        assert!(found > 20 && hidden * 5 < found, "{found} places found, {hidden} hidden");
        // The test would not pass if pictures were drawn without their lenses.
        assert_eq!(bends > 3.0, is_bent, "{bends} px");
    }
}

/// How far a lens moves the image of a point, px.
fn bend(camera: &Camera, unbent: &Camera, world: &Point3<f64>, seen: &Point2<f64>) -> f64 {
    let fine = unbent.image_from_world(world).unwrap();
    let scale = camera.intrinsic()[(0, 0)] / unbent.intrinsic()[(0, 0)];
    let at = [0, 1].map(|axis| (fine[axis] - unbent.intrinsic()[(axis, 2)]) * scale + camera.intrinsic()[(axis, 2)]);
    (Point2::from(at) - seen).norm()
}

/// The difference of two pictures between their pixels, levels.
fn difference(first: &RgbImage, second: &RgbImage, at: Point2<f64>) -> f64 {
    let [x, y] = [at.x, at.y];
    let (left, top) = (x.floor(), y.floor());
    let value = |dx: f64, dy: f64| {
        let at = [(left + dx) as u32, (top + dy) as u32];
        let [a, b] = [first, second].map(|picture| picture.get_pixel(at[0], at[1]).0[1]);
        (f64::from(a) - f64::from(b)).abs()
    };
    let (u, v) = (x - left, y - top);
    let row = |dy: f64| value(0.0, dy) * (1.0 - u) + value(1.0, dy) * u;
    row(0.0) * (1.0 - v) + row(1.0) * v
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_split_number_court_or_seed_other_ones() {
    let draw = |court, split, number, seed| {
        let picture = CourtPicture::draw(court, split, number, seed).unwrap();
        (serde_json::to_string(picture.camera()).unwrap(), picture)
    };
    let (camera, first) = draw(Some("badminton"), Split::Val, 1, 7);
    let (again, second) = draw(Some("badminton"), Split::Val, 1, 7);
    assert_eq!(camera, again);
    assert_eq!(first.jpeg().unwrap(), second.jpeg().unwrap());
    let others = [
        draw(Some("badminton"), Split::Test, 1, 7),
        draw(Some("badminton"), Split::Train, 1, 7),
        draw(Some("badminton"), Split::Val, 2, 7),
        draw(Some("badminton"), Split::Val, 1, 8),
        draw(Some("tennis"), Split::Val, 1, 7),
        draw(None, Split::Val, 1, 7),
    ];
    assert!(others.iter().all(|(other, _)| *other != camera));
    assert_ne!(others[0].0, others[1].0);
}

#[test]
fn every_court_with_lines_is_seen_by_upright_cameras_above_it_a_third_of_them_with_a_lens() {
    assert!(courts().contains(&"pickleball") && !courts().contains(&"football"));
    let (mut bent, mut upright, mut focals) = (0, 0, Vec::new());
    for number in 0..30 {
        for court in courts() {
            let camera = CourtPicture::draw(Some(court), Split::Train, number, 1).unwrap().camera().clone();
            let size = camera.size();
            let focal = camera.intrinsic()[(0, 0)] / f64::from(size.width);
            let eye = camera.world_from_camera(&Point3::origin());
            assert!(eye.z > markings::extent(court).unwrap().1 && (0.49..5.01).contains(&focal), "{court} {number}");
            assert!(size.width.max(size.height) <= 1920);
            bent += usize::from(!camera.distortion().is_none());
            upright += usize::from(size.height > size.width);
            focals.push(focal);
        }
    }
    let all = focals.len();
    assert!(
        (all / 4..all * 5 / 12).contains(&bent) && (all / 20..all / 5).contains(&upright),
        "{bent} {upright} of {all}"
    );
    assert!(focals.iter().any(|focal| *focal < 0.6) && focals.iter().any(|focal| *focal > 3.0));
}

#[test]
fn a_tennis_court_for_singles_has_no_side_lines_for_doubles() {
    let [all, singles] = [false, true].map(|singles| markings::lines("tennis", singles).unwrap());
    assert_eq!([all.len(), singles.len()], [9, 7]);
    assert!(singles.iter().all(|line| line.from[0].abs() <= 4.115 && line.to[0].abs() <= 4.115));
}
