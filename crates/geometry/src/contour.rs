//! A ball's outline in a picture to a part of a pixel (the sphere's apparent contour), and the image of its centre.
//!
//! A sphere's outline is a circular cone of rays around the ray of its centre. So edge points are searched for across an initial
//! circle and converted to rays; in the plane perpendicular to the initial centre's ray the outline is a circle around the image of
//! the centre. Lens and perspective, which make the outline in the picture an ellipse beside the centre's image, cancel.

use image::RgbImage;
use nalgebra::{Matrix3, Point2, Rotation3, Vector2, Vector3};

use crate::camera::Camera;
use crate::image::{Levels, levels_between};
use crate::statistics::median;

/// Directions in which an edge is searched for.
const DIRECTIONS: usize = 64;
/// Distance of samples across the edge, px.
const STEP: f64 = 0.25;
/// Half the distance of the two samples whose difference is the slope, px: an edge is about two pixels wide.
const HALF_SLOPE: f64 = 0.75;
/// Largest distance of an edge from the initial circle, px and fractions of the radius, in each round of search and fit.
const REACHES: [[f64; 2]; 3] = [[2.0, 0.2], [1.5, 0.1], [1.5, 0.1]];
/// Rounds of reweighting in a fit.
const REWEIGHTS: usize = 8;
/// Distance from the circle at which an edge point loses its weight (Tukey), px and fractions of the radius.
const OUTLIER_PX: f64 = 0.6;
const OUTLIER_FRACTION: f64 = 0.03;
/// Fewest edge points that make a circle.
const FEWEST_POINTS: usize = 10;
/// Blur of an edge (standard deviation σ of a Gaussian, px), and the slope 1 px beside the edge over that on it. Not fitted: with slopes
/// as differences over 2 · [`HALF_SLOPE`] that ratio is (Φ(1.75/σ) − Φ(0.25/σ)) / (2 Φ(0.75/σ) − 1).
const SOFTNESS: [(f64, f64); 6] = [(0.3, 0.205), (0.5, 0.357), (0.75, 0.527), (1.0, 0.660), (1.5, 0.815), (2.0, 0.889)];
/// Smallest fading that is caused by shading at the rim: texture and shadows cause less. And how far inside the rim the edge of a ball
/// that fades as a lit sphere does appears, px per unit of fading beyond it (brightness as the square root of the distance from the rim,
/// blurred by half a pixel).
const LEAST_FADING: f64 = 0.15;
const INSIDE: f64 = 2.6;

/// A circle in the picture, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub x: f64,
    /// The same, down.
    pub y: f64,
    /// Its radius.
    pub radius: f64,
}

/// A fitted outline.
#[derive(Debug, Clone, Copy)]
pub struct Contour {
    /// The image of the ball's centre, and the outline's mean distance from it, px.
    pub circle: Circle,
    /// Fraction of the directions (within the picture) in which there is an edge on the circle.
    pub coverage: f64,
    /// Root mean square of the distances of those edges from the circle, px.
    pub rms: f64,
    /// Half the angle of the cone of rays about the centre's ray, rad: its sine is the ball's radius over its distance.
    pub half_angle: f64,
    /// How far inside the ball's rim that edge may lie, px: where a ball fades into a dark background towards its rim, as one lit
    /// from the camera alone.
    pub inside: f64,
}

/// The edge across a circle in one direction.
struct EdgeSlope {
    /// From the circle's centre, px.
    distance: f64,
    /// Mean of the slopes a pixel inside and outside, as a fraction of it.
    softness: Option<f64>,
    /// By how much the slope 1.5 px inside is stronger than the one outside, as a fraction of it.
    fading: Option<f64>,
}

/// Points on edges about a circle.
struct Edges {
    /// In the plane across its centre's ray.
    points: Vec<Vector2<f64>>,
    /// Of each: the slopes a pixel beside the strongest, as a fraction of that.
    softness: Vec<f64>,
    /// Of each: as [`EdgeSlope::fading`].
    fading: Vec<f64>,
    /// Directions that lie in the picture.
    directions: usize,
}

/// A circle in the plane across the guessed centre's ray, px at that ray.
struct Fitted {
    centre: Vector2<f64>,
    radius: f64,
    /// Points on it.
    inliers: usize,
    rms: f64,
}

/// Where outlines are searched for.
pub struct Finder<'a> {
    /// The picture.
    pub rgb: &'a RgbImage,
    /// Smallest difference of two levels that is not noise.
    pub contrast: f32,
    /// The camera that took the picture.
    pub camera: &'a Camera,
}

impl Finder<'_> {
    /// The outline near `guess`; none where there are too few edges or the fit diverges.
    pub fn contour(&self, guess: &Circle) -> Option<Contour> {
        let mut circle = *guess;
        let mut contour = None;
        for [px, fraction] in REACHES {
            let reach = px + fraction * circle.radius;
            let plane = TangentPlane::across(self.camera, &circle)?;
            let edges = self.edge_points(&circle, reach, &plane);
            let fitted = fit(&edges.points, circle.radius)?;
            let centre = plane.image(fitted.centre)?;
            let moved = (centre.x - guess.x).hypot(centre.y - guess.y);
            if moved > 2.0 + 0.5 * guess.radius || fitted.radius < 1.0 || fitted.radius > 2.0 * guess.radius + 2.0 {
                return None;
            }
            circle = Circle { x: centre.x, y: centre.y, radius: fitted.radius };
            contour = Some(summary(circle, edges, &fitted, plane.scale));
        }
        contour
    }

    /// The strongest edge in each direction, and the number of directions that lie in the picture.
    fn edge_points(&self, circle: &Circle, reach: f64, plane: &TangentPlane) -> Edges {
        let reach = reach.min(circle.radius - HALF_SLOPE).max(2.0 * STEP);
        let mut found =
            Edges { points: Vec::with_capacity(DIRECTIONS), softness: vec![], fading: vec![], directions: 0 };
        for index in 0..DIRECTIONS {
            let (sin, cos) = (std::f64::consts::TAU * index as f64 / DIRECTIONS as f64).sin_cos();
            let place = |distance: f64| Point2::new(circle.x + distance * cos, circle.y + distance * sin);
            let inside = levels_between(self.rgb, place(circle.radius).x, place(circle.radius).y).is_some();
            found.directions += usize::from(inside);
            let Some(EdgeSlope { distance, softness, fading }) =
                self.strongest(&place, circle.radius, reach).filter(|_| inside)
            else {
                continue;
            };
            if let Some(point) = plane.place(&place(distance)) {
                found.points.push(point);
                found.softness.extend(softness);
                found.fading.extend(fading);
            }
        }
        found
    }

    /// The strongest slope within `reach` of `radius`; none where nothing is stronger than noise.
    fn strongest(&self, place: &dyn Fn(f64) -> Point2<f64>, radius: f64, reach: f64) -> Option<EdgeSlope> {
        let count = (2.0 * reach / STEP).round() as usize + 1;
        let pad = (HALF_SLOPE / STEP).round() as usize;
        let first = radius - reach;
        let at = |index: usize| first + (index as f64 - pad as f64) * STEP;
        let places = (0..count + 2 * pad).map(|index| place(at(index)));
        let samples: Vec<Option<Levels>> = places.map(|point| levels_between(self.rgb, point.x, point.y)).collect();
        let strength: Vec<f32> = (0..count).map(|index| slope(samples[index], samples[index + 2 * pad])).collect();
        // An edge near the guess is preferred to one a little stronger at the rim.
        let weighted = |index: usize| {
            let off = (at(index + pad) - radius) / reach;
            strength[index] * (1.0 - 0.5 * off * off) as f32
        };
        let best = (0..count).max_by(|&a, &b| weighted(a).total_cmp(&weighted(b)))?;
        if best == 0 || best + 1 == count || strength[best] <= 0.0 {
            return None;
        }
        if strength[best] < self.contrast {
            return None;
        }
        let (before, peak, after) = (strength[best - 1], strength[best], strength[best + 1]);
        let bend = before - 2.0 * peak + after;
        let shift = if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-1.0, 1.0) } else { 0.0 };
        let off = |px: f64| {
            let steps = (px / STEP).round() as isize;
            best.checked_add_signed(steps).and_then(|index| strength.get(index)).map(|it| f64::from(it / peak))
        };
        let pair = |px: f64| Some((off(-px)?, off(px)?));
        let softness = pair(1.0).map(|(inside, outside)| 0.5 * (inside + outside));
        let fading = pair(1.5).map(|(inside, outside)| inside - outside);
        Some(EdgeSlope { distance: at(best + pad) + f64::from(shift) * STEP, softness, fading })
    }
}

/// Strength of the slope between two samples; 0 where one is outside the picture.
fn slope(low: Option<Levels>, high: Option<Levels>) -> f32 {
    let Some((low, high)) = low.zip(high) else { return 0.0 };
    low.iter().zip(high).map(|(low, high)| (high - low).powi(2)).sum::<f32>().sqrt()
}

/// The plane across the ray of a circle's centre.
struct TangentPlane<'a> {
    camera: &'a Camera,
    /// Turns that ray onto the z axis.
    plane_from_camera: Rotation3<f64>,
    /// Pixels at that ray that the plane's unit spans.
    scale: f64,
}

impl<'a> TangentPlane<'a> {
    fn across(camera: &'a Camera, circle: &Circle) -> Option<Self> {
        let ray = |x: f64, y: f64| camera.camera_from_image(&Point2::new(x, y), 1.0).ok().map(|ray| ray.coords);
        let axis = ray(circle.x, circle.y)?;
        let plane_from_camera = Rotation3::rotation_between(&axis, &Vector3::z())?;
        let mut plane = Self { camera, plane_from_camera, scale: 1.0 };
        // The scale that keeps areas: how far one pixel to the right and one down reach, and whether they are square.
        let [right, down] =
            [(1.0, 0.0), (0.0, 1.0)].map(|(dx, dy)| plane.place(&Point2::new(circle.x + dx, circle.y + dy)));
        let (right, down) = (right?, down?);
        plane.scale = (right.x * down.y - right.y * down.x).abs().sqrt().recip();
        plane.scale.is_finite().then_some(plane)
    }

    /// Where the ray of a pixel meets the plane.
    fn place(&self, image: &Point2<f64>) -> Option<Vector2<f64>> {
        let ray = self.plane_from_camera * self.camera.camera_from_image(image, 1.0).ok()?.coords;
        let place = ray.xy() * (self.scale / ray.z);
        (ray.z > 0.0 && place.iter().all(|part| part.is_finite())).then_some(place)
    }

    /// The pixel of a place in the plane.
    fn image(&self, place: Vector2<f64>) -> Option<Point2<f64>> {
        let ray = self.plane_from_camera.inverse() * place.push(self.scale);
        self.camera.image_from_camera(&ray.into()).ok().filter(|image| image.x.is_finite() && image.y.is_finite())
    }
}

/// The circle about edge points: Gauss–Newton with Tukey's weights, from the guess (centre 0).
fn fit(points: &[Vector2<f64>], radius: f64) -> Option<Fitted> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let narrow = OUTLIER_PX + OUTLIER_FRACTION * radius;
    let (mut centre, mut radius) = (Vector2::zeros(), radius);
    let mut scale = {
        let distance = median(points.iter().map(|point| (point.norm() - radius).abs()))?;
        (3.0 * distance).max(narrow)
    };
    for _ in 0..REWEIGHTS {
        let mut normal = Matrix3::zeros();
        let mut slope = Vector3::zeros();
        for point in points {
            let offset = point - centre;
            let distance = offset.norm().max(f64::MIN_POSITIVE);
            let residual = distance - radius;
            let fraction = 1.0 - (residual / scale).powi(2);
            if fraction > 0.0 {
                let weight = fraction * fraction;
                let row = Vector3::new(offset.x / distance, offset.y / distance, 1.0);
                normal += row * row.transpose() * weight;
                slope += row * (residual * weight);
            }
        }
        let step = normal.cholesky()?.solve(&slope);
        centre += step.xy();
        radius += step.z;
        scale = (0.7 * scale).max(narrow);
    }
    let residuals = points.iter().map(|point| (point - centre).norm() - radius);
    let kept: Vec<f64> = residuals.filter(|residual| residual.abs() < narrow).collect();
    if kept.len() < FEWEST_POINTS || !radius.is_finite() {
        return None;
    }
    let rms = (kept.iter().map(|residual| residual * residual).sum::<f64>() / kept.len() as f64).sqrt();
    Some(Fitted { centre, radius, inliers: kept.len(), rms })
}

/// Standard deviation of the blur (a Gaussian's, px) of an edge whose slopes a pixel beside the strongest are of the fraction
/// `softness` of it.
fn blur_of(softness: f64) -> f64 {
    let after = SOFTNESS.iter().position(|&(_, known)| known > softness).unwrap_or(SOFTNESS.len() - 1).max(1);
    let ((low, from), (high, to)) = (SOFTNESS[after - 1], SOFTNESS[after]);
    low + (high - low) * ((softness - from) / (to - from)).clamp(0.0, 1.0)
}

fn summary(circle: Circle, Edges { directions, softness, fading, .. }: Edges, fitted: &Fitted, scale: f64) -> Contour {
    let coverage = (fitted.inliers as f64 / directions.max(1) as f64).min(1.0);
    let blur = blur_of(median(softness).unwrap_or(0.0));
    let fading = fading.iter().map(|it| it.clamp(-1.0, 1.0)).sum::<f64>() / fading.len().max(1) as f64;
    let inside = INSIDE * (fading - LEAST_FADING).max(0.0);
    // Blur moves a round edge inwards, by half its variance times the curvature.
    let larger = 1.0 + 0.5 * (blur / fitted.radius).powi(2);
    let circle = Circle { radius: larger * circle.radius, ..circle };
    let half_angle = (larger * fitted.radius / scale).atan();
    Contour { circle, coverage, rms: fitted.rms, half_angle, inside }
}
