//! A third look: the ball's edge, to a tenth of a pixel. The network reads a size from all that it sees, and is wrong by a
//! few per cent alike over similar pictures; where the edge is sharp and whole, it says more.
//!
//! How far which of the two is to be trusted was fitted on random renderings with photographs behind (not the paper's scenes,
//! nor real pictures): heavy-tailed likelihood of what is left, by how well the edge lies on a cone, how much of it is seen,
//! how sure the network is and how far apart the two are.

use image::RgbImage;
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};

use super::size::Reading;
use crate::camera::{Camera, Distortion, Outline};
use crate::contour::{Circle, Contour, Finder};
use crate::size::Size;

/// Smallest difference of two levels that is an edge, of 255.
const CONTRAST: f32 = 6.0;
/// Smallest rms of an edge about its cone that means something, px: below, all are as good.
const LEAST_RMS: f64 = 0.05;
/// Least standard deviation of log(radius) that a network is believed: one that was fine-tuned to a few clips is surer of itself
/// than of other pictures it should be.
const LEAST_SIGMA: f64 = 0.015;
/// Difference of the two logs of the radius from which the edge is another thing's.
const MOST_APART: f64 = 0.3;
/// Largest surprise that a difference can be.
const MOST_SURPRISE: f64 = 9.0;
/// Log of the odds that the edge is right and not the network: of nothing known, and by each of [`Signs`].
const TRUST: [f64; 5] = [-4.45, 0.0, -2.03, -3.66, -0.71];
/// Log of the standard deviation of log(radius): the same.
const SIGMA: [f64; 5] = [1.77, 1.01, 0.75, 1.76, 0.22];
/// What the network's own standard deviation is worth where no edge is found.
const ALONE: f64 = 1.8;
/// Focal length over a picture's sides of a camera that sees every ball as a circle.
const LONG: f64 = 50.0;

/// Logs of what tells how good an edge is.
struct Signs {
    /// The network's standard deviation of log(radius).
    sigma: f64,
    /// The edge's rms as a share of the radius.
    rms: f64,
    /// Share of the directions without an edge (no log).
    missing: f64,
    /// By how many of those deviations the two differ: log(1 + their square).
    surprise: f64,
}

impl Signs {
    fn weigh(&self, weights: &[f64; 5]) -> f64 {
        let signs = [1.0, self.sigma, self.rms, self.missing, self.surprise];
        signs.iter().zip(weights).map(|(sign, weight)| sign * weight).sum()
    }
}

/// `reading` after edge refinement in `rgb`, which `camera` took; without a camera, balls are circles.
pub(super) fn refined(rgb: &RgbImage, camera: Option<&Camera>, reading: Reading) -> Reading {
    let reading = Reading { log_sigma: reading.log_sigma.max(LEAST_SIGMA), ..reading };
    let long = if camera.is_none() { long_lens(rgb) } else { None };
    let Some(camera) = camera.or(long.as_ref()) else { return reading };
    let Outline { centre, radius } = reading.outline;
    let finder = Finder { rgb, still: None, contrast: &|_, _| CONTRAST, camera };
    let seen = finder.contour(&Circle { x: centre.x, y: centre.y, radius }, None);
    let seen = seen.and_then(|contour| {
        let edge = outline_of(&contour, camera)?;
        let apart = (edge.radius / radius).ln();
        (apart.abs() < MOST_APART).then_some((contour, edge, apart))
    });
    let Some((contour, edge, apart)) = seen else {
        return Reading { log_sigma: ALONE * reading.log_sigma, ..reading };
    };
    let signs = Signs {
        sigma: reading.log_sigma.ln(),
        rms: (contour.rms.max(LEAST_RMS) / radius).ln(),
        missing: 1.0 - contour.coverage,
        surprise: (apart / reading.log_sigma).powi(2).ln_1p().min(MOST_SURPRISE),
    };
    let share = 1.0 / (1.0 + (-signs.weigh(&TRUST)).exp());
    Reading {
        outline: Outline { centre: centre + share * (edge.centre - centre), radius: radius * (share * apart).exp() },
        log_sigma: signs.weigh(&SIGMA).exp().hypot(contour.inside / radius),
        ..reading
    }
}

/// The outline, as a network reads it, of the ball whose edge this is.
fn outline_of(contour: &Contour, camera: &Camera) -> Option<Outline> {
    let ray = camera.camera_from_image(&Point2::new(contour.circle.x, contour.circle.y), 1.0).ok()?;
    let centre = ray.coords.normalize() / contour.half_angle.sin();
    camera.outline(&Point3::from(centre), 1.0).ok()
}

/// A camera of so long a lens that every ball is a circle.
fn long_lens(rgb: &RgbImage) -> Option<Camera> {
    let size = Size::new(rgb.width(), rgb.height());
    let [width, height] = size.xy();
    let focal = LONG * width.max(height);
    let intrinsic = Matrix3::new(focal, 0.0, (width - 1.0) / 2.0, 0.0, focal, (height - 1.0) / 2.0, 0.0, 0.0, 1.0);
    Camera::new(size, intrinsic, Distortion::default(), Rotation3::identity().into(), Vector3::zeros()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { width: 160, height: 120 };
    /// Parts of a pixel's side by which it is drawn.
    const PARTS: u32 = 8;

    /// That sees 60° in a picture as wide as this; and one whose axis is beside the picture, so that balls are longer than wide.
    fn camera(principal_x: f64) -> Camera {
        let intrinsic = Matrix3::new(140.0, 0.0, principal_x, 0.0, 140.0, 59.5, 0.0, 0.0, 1.0);
        Camera::new(SIZE, intrinsic, Distortion::default(), Rotation3::identity().into(), Vector3::zeros()).unwrap()
    }

    /// A ball of 1 m, lighter than what is behind it but for a dark side; what is right of `hidden` (px) is behind a wall.
    fn drawn(camera: &Camera, centre: &Point3<f64>, hidden: f64, blur: f32) -> RgbImage {
        let part = |at: u32, part: u32| f64::from(at) + (f64::from(part) + 0.5) / f64::from(PARTS) - 0.5;
        let picture = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let parts = (0..PARTS * PARTS).map(|index| Point2::new(part(x, index % PARTS), part(y, index / PARTS)));
            let level = |at: Point2<f64>| {
                let ray = camera.camera_from_image(&at, 1.0).unwrap().coords.normalize();
                match centre.coords.cross(&ray).norm() < 1.0 {
                    _ if at.x > hidden => 120.0,
                    true => 215.0 - 60.0 * (at.y - SIZE.xy()[1] / 2.0) / 40.0,
                    false => 70.0,
                }
            };
            let mean = parts.map(level).sum::<f64>() / f64::from(PARTS * PARTS);
            image::Rgb([mean.round() as u8; 3])
        });
        if blur > 0.0 { image::imageops::blur(&picture, blur) } else { picture }
    }

    fn reading(outline: Outline, ratio: f64) -> Reading {
        let centre = outline.centre + nalgebra::Vector2::new(0.4, -0.3);
        Reading { outline: Outline { centre, radius: ratio * outline.radius }, log_sigma: 0.04, confidence: 0.9 }
    }

    #[test]
    fn an_edge_tells_the_radius_that_the_network_read_wrong() {
        for (principal_x, centre, hidden, blur, most) in [
            (79.5, Point3::new(0.2, -0.3, 9.0), 1e9, 0.0, 0.003),
            (79.5, Point3::new(0.2, -0.3, 9.0), 82.5, 0.0, 0.02), // half of it
            (79.5, Point3::new(0.2, -0.3, 24.0), 1e9, 0.0, 0.01), // 6 px
            (79.5, Point3::new(0.2, -0.3, 24.0), 1e9, 1.2, 0.015),
            (-60.0, Point3::new(9.0, 0.4, 9.0), 1e9, 0.0, 0.005), // 45° off the axis
        ] {
            let camera = camera(principal_x);
            let truth = camera.outline(&centre, 1.0).unwrap();
            let rgb = drawn(&camera, &centre, hidden, blur);
            for ratio in [0.95, 1.05] {
                let first = reading(truth, ratio);
                let found = refined(&rgb, Some(&camera), first);
                let off = (found.outline.radius / truth.radius).ln();
                let moved = (found.outline.centre - truth.centre).norm();
                println!(
                    "{centre}: radius {:.2} px, {:+.2} % off, sigma {:.2} %",
                    truth.radius,
                    100.0 * off,
                    100.0 * found.log_sigma
                );
                assert!(off.abs() < most && moved < 0.3, "{centre} {hidden} {blur}: {off} {moved}");
                assert!(off.abs() < 2.0 * found.log_sigma && found.log_sigma < first.log_sigma, "{}", found.log_sigma);
            }
        }
    }

    #[test]
    fn a_ball_that_fades_into_the_dark_looks_smaller_and_says_so() {
        // Lit from the camera, before black: nothing is seen of its rim.
        let camera = camera(79.5);
        let truth = camera.outline(&Point3::new(0.0, 0.0, 19.0), 1.0).unwrap();
        let rgb = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let parts = (0..PARTS * PARTS).map(|index| {
                let at = |at: u32, part: u32| f64::from(at) + (f64::from(part) + 0.5) / f64::from(PARTS) - 0.5;
                let [dx, dy] = [at(x, index % PARTS) - truth.centre.x, at(y, index / PARTS) - truth.centre.y];
                let share = dx.hypot(dy) / truth.radius;
                if share < 1.0 { 10.0 + 160.0 * (1.0 - share * share).sqrt() } else { 0.0 }
            });
            image::Rgb([(parts.sum::<f64>() / f64::from(PARTS * PARTS)).round() as u8; 3])
        });
        let found = refined(&rgb, Some(&camera), reading(truth, 0.95));
        let off = (found.outline.radius / truth.radius).ln();
        assert!(off < -0.02, "the test's ball does not fade: {off}");
        assert!(off.abs() < 2.0 * found.log_sigma, "{off} {}", found.log_sigma);
    }

    #[test]
    fn without_an_edge_the_network_is_all_there_is_and_less_sure() {
        let outline = Outline { centre: Point2::new(80.0, 60.0), radius: 12.0 };
        let flat = RgbImage::from_pixel(SIZE.width, SIZE.height, image::Rgb([90; 3]));
        let line = RgbImage::from_pixel(1, 1, image::Rgb([90; 3]));
        for rgb in [flat, line] {
            for camera in [Some(&camera(79.5)), None] {
                let found = refined(&rgb, camera, reading(outline, 1.0));
                assert_eq!(found.outline, reading(outline, 1.0).outline);
                assert!(found.log_sigma > 0.04);
            }
        }
    }
}
