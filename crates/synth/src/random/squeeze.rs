//! Pictures whose pixels are not square: data sets are often squeezed to squares, and a ball in them is an ellipse.

use rand::RngExt;

use super::Apparent;
use super::canvas::Canvas;
use gravisight_geometry::random::Random;
use gravisight_geometry::size::Size;

/// Fraction of the labelled parts that are squeezed, and by how much: 16:9 to a square at most. Chosen, not fitted.
const SQUEEZED: f64 = 0.25;
const FACTORS: std::ops::Range<f32> = 1.2..1.8;

/// One axis of a picture made shorter by a factor.
#[derive(Debug, Clone, Copy)]
pub struct Squeeze {
    axis: usize,
    factor: f32,
}

impl Squeeze {
    /// A random one; none for most pictures.
    pub fn random(random: &mut Random) -> Option<Self> {
        let is_squeezed = random.random_bool(SQUEEZED);
        is_squeezed.then(|| Self { axis: random.random_range(0..2), factor: random.random_range(FACTORS) })
    }

    /// The size that a picture needs before it, to be of `size` afterwards.
    pub fn before(self, size: Size) -> Size {
        let longer = |side: u32| (side as f32 * self.factor).round() as u32;
        match self.axis {
            0 => Size::new(longer(size.width), size.height),
            _ => Size::new(size.width, longer(size.height)),
        }
    }

    /// `canvas` as a picture of `size`, each pixel the mean of those that it covers.
    pub fn canvas(self, canvas: &Canvas, size: Size) -> Canvas {
        let mut squeezed = Canvas::new(size, [0.0; 3]);
        let (count, long) = match self.axis {
            0 => (squeezed.width, canvas.width),
            _ => (squeezed.height, canvas.height),
        };
        let step = long as f32 / count as f32;
        let lines = if self.axis == 0 { squeezed.height } else { squeezed.width };
        for at in 0..count {
            let (start, end) = (at as f32 * step, (at + 1) as f32 * step);
            for source in start as usize..(end.ceil() as usize).min(long) {
                let weight = (end.min(source as f32 + 1.0) - start.max(source as f32)) / step;
                for line in 0..lines {
                    let [to, from] = match self.axis {
                        0 => [line * squeezed.width + at, line * canvas.width + source],
                        _ => [at * squeezed.width + line, source * canvas.width + line],
                    };
                    for (plane, values) in squeezed.planes.iter_mut().zip(&canvas.planes) {
                        plane[to] += weight * values[from];
                    }
                }
            }
        }
        squeezed
    }

    /// `ball` in the squeezed picture: no longer a circle, so its radius teaches nothing.
    pub fn ball(self, ball: Apparent) -> Apparent {
        let factor = f64::from(self.factor);
        let mut squeezed = Apparent { radius: ball.radius / factor.sqrt(), is_sized: false, ..ball };
        for place in [&mut squeezed.centre, &mut squeezed.principal_point] {
            place[self.axis] = (place[self.axis] + 0.5) / factor - 0.5;
        }
        squeezed
    }
}
