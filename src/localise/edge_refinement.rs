//! Edge refinement: the ball's edge, to a tenth of a pixel. The network's size has an error of a few per cent that is common to
//! similar pictures; where the edge is sharp and complete, the edge is more accurate.
//!
//! The two are combined by a mixture: with some probability the edge is right, else the network is. That probability's log-odds
//! and the logarithm of the combination's σ are linear in four features ([`EdgeFeatures`]).

use image::RgbImage;
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};

#[cfg(not(target_arch = "wasm32"))]
use super::Localiser;
#[cfg(not(target_arch = "wasm32"))]
use super::candidate::MAX_CANDIDATES;
use crate::model::DetectionCalibration;
use gravisight_geometry::camera::{Camera, Detection, Distortion, Outline};
use gravisight_geometry::contour::{Circle, Contour, Finder};
#[cfg(not(target_arch = "wasm32"))]
use gravisight_geometry::error::Result;
#[cfg(not(target_arch = "wasm32"))]
use gravisight_geometry::image::Picture;
use gravisight_geometry::size::Size;

/// Smallest difference of two levels that is an edge, of 255.
const MIN_CONTRAST: f32 = 6.0;
/// Smallest rms distance of the edge points from the fitted cone that is informative, px: smaller ones count as this.
const MIN_RMS: f64 = 0.05;
/// Smallest standard deviation of log(radius) that a network is credited with: one that was fine-tuned to a few clips understates
/// its error on other pictures.
const MIN_NETWORK_SIGMA: f64 = 0.015;
/// Difference of edge and network in log(radius) from which the edge is another object's.
const MAX_DIFFERENCE: f64 = 0.3;
/// Largest value of the feature [`EdgeFeatures::disagreement`].
const MAX_DISAGREEMENT: f64 = 9.0;
/// Focal length of a camera to which every ball is a circle, over the picture's longer side.
const LONG_FOCAL_LENGTH: f64 = 50.0;

/// How good an edge is, and how well it agrees with the network.
struct EdgeFeatures {
    /// Logarithm of the network's standard deviation of log(radius).
    log_sigma: f64,
    /// Logarithm of the edge's rms over the radius.
    log_rms: f64,
    /// Fraction of the directions in which no edge was found.
    missing: f64,
    /// log(1 + d²), where d is the difference of edge and network in log(radius), in the network's standard deviations.
    disagreement: f64,
}

impl EdgeFeatures {
    fn new(contour: &Contour, detection: &Detection, difference: f64) -> Self {
        Self {
            log_sigma: detection.log_sigma.ln(),
            log_rms: (contour.rms.max(MIN_RMS) / detection.outline.radius).ln(),
            missing: 1.0 - contour.coverage,
            disagreement: (difference / detection.log_sigma).powi(2).ln_1p().min(MAX_DISAGREEMENT),
        }
    }

    /// The constant 1, and the features.
    fn row(&self) -> [f64; 5] {
        [1.0, self.log_sigma, self.log_rms, self.missing, self.disagreement]
    }

    fn dot(&self, weights: &[f64; 5]) -> f64 {
        self.row().iter().zip(weights).map(|(feature, weight)| feature * weight).sum()
    }
}

/// The edge of a detected ball.
struct FoundEdge {
    contour: Contour,
    outline: Outline,
    /// Of edge and network in log(radius).
    difference: f64,
}

/// `detection` after edge refinement in `rgb`, which `camera` took; without a camera, balls are circles.
pub(super) fn refine_by_edge(
    rgb: &RgbImage,
    camera: Option<&Camera>,
    detection: Detection,
    calibration: &DetectionCalibration,
) -> Detection {
    let detection = Detection { log_sigma: detection.log_sigma.max(MIN_NETWORK_SIGMA), ..detection };
    let long = if camera.is_none() { long_lens(rgb) } else { None };
    let Some(camera) = camera.or(long.as_ref()) else { return detection };
    let Outline { centre, radius } = detection.outline;
    let Some(FoundEdge { contour, outline: edge, difference }) = edge_of(rgb, camera, &detection) else {
        return Detection { log_sigma: calibration.network_sigma_factor * detection.log_sigma, ..detection };
    };
    let features = EdgeFeatures::new(&contour, &detection, difference);
    let weight = 1.0 / (1.0 + (-features.dot(&calibration.edge_log_odds)).exp());
    Detection {
        outline: Outline {
            centre: centre + weight * (edge.centre - centre),
            radius: radius * (weight * difference).exp(),
        },
        log_sigma: features.dot(&calibration.edge_log_sigma).exp().hypot(contour.inside / radius),
        ..detection
    }
}

/// The ball's edge, if there is one of about the detection's radius.
fn edge_of(rgb: &RgbImage, camera: &Camera, detection: &Detection) -> Option<FoundEdge> {
    let Outline { centre, radius } = detection.outline;
    let finder = Finder { rgb, contrast: MIN_CONTRAST, camera };
    let contour = finder.contour(&Circle { x: centre.x, y: centre.y, radius })?;
    let outline = outline_of(&contour, camera)?;
    let difference = (outline.radius / radius).ln();
    (difference.abs() < MAX_DIFFERENCE).then_some(FoundEdge { contour, outline, difference })
}

/// The outline, in the network's terms, of the ball whose edge this is.
fn outline_of(contour: &Contour, camera: &Camera) -> Option<Outline> {
    let ray = camera.camera_from_image(&Point2::new(contour.circle.x, contour.circle.y), 1.0).ok()?;
    let centre = ray.coords.normalize() / contour.half_angle.sin();
    camera.outline(&Point3::from(centre), 1.0).ok()
}

/// A camera of so long a lens that every ball is a circle.
fn long_lens(rgb: &RgbImage) -> Option<Camera> {
    let size = Size::new(rgb.width(), rgb.height());
    let [width, height] = size.xy();
    let focal = LONG_FOCAL_LENGTH * width.max(height);
    let intrinsic = Matrix3::new(focal, 0.0, (width - 1.0) / 2.0, 0.0, focal, (height - 1.0) / 2.0, 0.0, 0.0, 1.0);
    Camera::new(size, intrinsic, Distortion::default(), Rotation3::identity().into(), Vector3::zeros()).ok()
}

/// A candidate before edge refinement, and its edge: what [`DetectionCalibration`]'s weights are fitted to.
#[doc(hidden)]
#[cfg(not(target_arch = "wasm32"))]
#[derive(Debug, Clone, Copy)]
pub struct EdgeEvidence {
    /// The network's outline, px.
    pub outline: Outline,
    /// The network's standard deviation of log(radius).
    pub log_sigma: f64,
    /// Where an edge was found: its log(radius) less the network's, the features (the constant 1 first), and the standard deviation
    /// of log(radius) that is added for a rim that fades into the background.
    pub edge: Option<(f64, [f64; 5], f64)>,
}

#[cfg(not(target_arch = "wasm32"))]
impl Localiser {
    /// The likeliest candidates of `picture`, which `camera` took, after the second pass, with their edges.
    ///
    /// # Errors
    /// As [`Localiser::detect_near`].
    #[doc(hidden)]
    pub async fn edge_evidence(&self, picture: &Picture, camera: &Camera) -> Result<Vec<EdgeEvidence>> {
        let first = self.first_pass(picture, None, MAX_CANDIDATES, false).await?;
        let mut found = vec![];
        for Detection { outline, .. } in first.candidates.into_iter().take(MAX_CANDIDATES) {
            let Some(detection) = self.detect_in_crop(picture.rgb(), None, &outline, outline.radius).await? else {
                continue;
            };
            let detection = Detection { log_sigma: detection.log_sigma.max(MIN_NETWORK_SIGMA), ..detection };
            let edge = edge_of(picture.rgb(), camera, &detection).map(|FoundEdge { contour, difference, .. }| {
                let row = EdgeFeatures::new(&contour, &detection, difference).row();
                (difference, row, contour.inside / detection.outline.radius)
            });
            found.push(EdgeEvidence { outline: detection.outline, log_sigma: detection.log_sigma, edge });
        }
        Ok(found)
    }
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

    fn detection(outline: Outline, ratio: f64) -> Detection {
        let centre = outline.centre + nalgebra::Vector2::new(0.4, -0.3);
        Detection { outline: Outline { centre, radius: ratio * outline.radius }, log_sigma: 0.04, confidence: 0.9 }
    }

    #[test]
    fn an_edge_corrects_a_wrong_radius_of_the_network() {
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
                let first = detection(truth, ratio);
                let found = refine_by_edge(&rgb, Some(&camera), first, &DetectionCalibration::default());
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
    fn a_ball_that_fades_into_the_dark_looks_smaller_and_sigma_grows() {
        // Lit from the camera, before black: nothing is seen of its rim.
        let camera = camera(79.5);
        let truth = camera.outline(&Point3::new(0.0, 0.0, 19.0), 1.0).unwrap();
        let rgb = RgbImage::from_fn(SIZE.width, SIZE.height, |x, y| {
            let parts = (0..PARTS * PARTS).map(|index| {
                let at = |at: u32, part: u32| f64::from(at) + (f64::from(part) + 0.5) / f64::from(PARTS) - 0.5;
                let [dx, dy] = [at(x, index % PARTS) - truth.centre.x, at(y, index / PARTS) - truth.centre.y];
                let fraction = dx.hypot(dy) / truth.radius;
                if fraction < 1.0 { 10.0 + 160.0 * (1.0 - fraction * fraction).sqrt() } else { 0.0 }
            });
            image::Rgb([(parts.sum::<f64>() / f64::from(PARTS * PARTS)).round() as u8; 3])
        });
        let found = refine_by_edge(&rgb, Some(&camera), detection(truth, 0.95), &DetectionCalibration::default());
        let off = (found.outline.radius / truth.radius).ln();
        assert!(off < -0.02, "the test's ball does not fade: {off}");
        assert!(off.abs() < 2.0 * found.log_sigma, "{off} {}", found.log_sigma);
    }

    #[test]
    fn without_an_edge_the_networks_radius_stays_and_sigma_grows() {
        let outline = Outline { centre: Point2::new(80.0, 60.0), radius: 12.0 };
        let flat = RgbImage::from_pixel(SIZE.width, SIZE.height, image::Rgb([90; 3]));
        let line = RgbImage::from_pixel(1, 1, image::Rgb([90; 3]));
        for rgb in [flat, line] {
            for camera in [Some(&camera(79.5)), None] {
                let found = refine_by_edge(&rgb, camera, detection(outline, 1.0), &DetectionCalibration::default());
                assert_eq!(found.outline, detection(outline, 1.0).outline);
                assert!(found.log_sigma > 0.04);
            }
        }
    }
}
