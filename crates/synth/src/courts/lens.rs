//! Pictures through lenses: drawn by a finer camera without one, then bent.

use nalgebra::{Matrix3, Point2};

use super::super::random::canvas::Canvas;
use gravisight_geometry::camera::{Camera, Distortion};
use gravisight_geometry::error::Result;
use gravisight_geometry::size::Size;

/// Pixels of the finer picture in one of the final picture, along each side: lines thinner than a pixel stay exact.
const FINER: f64 = 2.0;
/// How far outside the picture the finer one reaches, px: more than a sample is blurred.
const MARGIN: f64 = 4.0;
/// Places along each side of the picture's border at which is measured how much the lens sees.
const PLACES: u32 = 32;
/// Samples of a pixel along each side: of a sharp picture and of a blurred one.
const SHARP: usize = 2;
const BLURRED: usize = 4;

/// A finer camera without a lens at the same place, which sees all that `camera` sees.
///
/// # Errors
/// [`Error::Distortion`](gravisight_geometry::error::Error::Distortion) where the lens does not reach the picture's corners.
pub fn without(camera: &Camera) -> Result<Camera> {
    let [width, height] = camera.size().xy();
    let mut reach = [0.0_f64; 2];
    for place in 0..=PLACES {
        let along = |side: f64| f64::from(place) / f64::from(PLACES) * (side + 2.0 * MARGIN) - MARGIN;
        let (x, y) = (along(width), along(height));
        for at in [[x, -MARGIN], [x, height + MARGIN], [-MARGIN, y], [width + MARGIN, y]] {
            let seen = camera.camera_from_image(&Point2::from(at), 1.0)?;
            reach = [reach[0].max(seen.x.abs()), reach[1].max(seen.y.abs())];
        }
    }
    let focal = FINER * camera.intrinsic()[(0, 0)];
    let size = reach.map(|reach| 2 * (reach * focal).ceil() as u32 + 1);
    let size = Size::new(size[0], size[1]);
    let [x, y] = size.xy().map(|side| (side - 1.0) / 2.0);
    let intrinsic = Matrix3::new(focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0);
    let translation = camera.camera_from_world(&nalgebra::Point3::origin()).coords;
    Camera::new(size, intrinsic, Distortion::default(), *camera.rotation(), translation)
}

/// The picture of `camera` from the finer one that `taken` took at the same place. `blur` px more than a pixel are averaged.
///
/// # Errors
/// As [`without`].
pub fn through(camera: &Camera, fine: &Canvas, taken: &Camera, blur: f64) -> Result<Canvas> {
    let mut bent = Canvas::new(camera.size(), [0.0; 3]);
    let intrinsic = taken.intrinsic();
    let row_of = |row: usize| -> Result<Vec<[f32; 2]>> {
        let at = |column: usize| {
            let seen = camera.camera_from_image(&Point2::new(column as f64, row as f64), 1.0)?;
            Ok([0, 1].map(|axis| (intrinsic[(axis, axis)] * seen[axis] + intrinsic[(axis, 2)]) as f32))
        };
        (0..=bent.width).map(at).collect()
    };
    let samples = if blur > 0.0 { BLURRED } else { SHARP };
    let weight = 1.0 / (samples * samples) as f32;
    let offset = |index: usize| (((index as f64 + 0.5) / samples as f64 - 0.5) * (1.0 + blur)) as f32;
    let mut here = row_of(0)?;
    for row in 0..bent.height {
        let below = row_of(row + 1)?;
        for column in 0..bent.width {
            let ([x, y], [ax, ay], [bx, by]) = (here[column], here[column + 1], below[column]);
            let mut sum = [0.0; 3];
            for sample in 0..samples * samples {
                let [u, v] = [offset(sample % samples), offset(sample / samples)];
                let at = [x + u * (ax - x) + v * (bx - x), y + u * (ay - y) + v * (by - y)];
                let colour = sampled(fine, at);
                (0..3).for_each(|channel| sum[channel] += weight * colour[channel]);
            }
            let index = row * bent.width + column;
            bent.planes.iter_mut().zip(sum).for_each(|(plane, value)| plane[index] = value);
        }
        here = below;
    }
    Ok(bent)
}

/// The colour between pixels.
fn sampled(canvas: &Canvas, [x, y]: [f32; 2]) -> [f32; 3] {
    let x = x.clamp(0.0, (canvas.width - 2) as f32);
    let y = y.clamp(0.0, (canvas.height - 2) as f32);
    let (left, top) = (x as usize, y as usize);
    let (u, v) = (x - left as f32, y - top as f32);
    let above = top * canvas.width + left;
    let below = above + canvas.width;
    [0, 1, 2].map(|channel| {
        let plane = &canvas.planes[channel];
        let upper = plane[above] + u * (plane[above + 1] - plane[above]);
        let lower = plane[below] + u * (plane[below + 1] - plane[below]);
        upper + v * (lower - upper)
    })
}
