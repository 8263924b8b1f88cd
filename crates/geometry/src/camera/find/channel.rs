//! One channel of a picture as numbers, and the channels in which paint of some colour is bright.

use image::RgbImage;

/// Standard deviations that a Gaussian's kernel reaches to either side, as in OpenCV for floats.
const REACH: f64 = 4.0;
/// Weight of the least colour in [`Paint::White`]; the rest is brightness. Measured on 41 scenes.
const LEAST_COLOUR: f32 = 0.5;
/// Factor on chroma, so that it spans the same levels as brightness.
const CHROMA: f32 = 2.0;
/// D65, the white point of sRGB.
const WHITE_POINT: [f32; 3] = [0.950_456, 1.0, 1.088_754];
/// Above this, CIE L* and f follow the cube root; below, a straight line with this slope.
const CUBE_ROOT: f32 = 0.008_856;
const SLOPE: f32 = 7.787;

/// The colour of paint to search for. Each has a channel in which such paint is brighter than the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Paint {
    /// Bright in all of red, green and blue.
    White,
    /// Red or violet: CIE a*.
    Red,
    /// Blue: −b*.
    Blue,
    /// Darker than the ground.
    Dark,
    /// Yellow: b*.
    Yellow,
}

/// Values of one channel, rows from the top.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    pub values: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

impl Paint {
    /// The channel in which this paint is bright, about 0 to 255.
    pub(super) fn channel(self, rgb: &RgbImage) -> Channel {
        let linear = linear_levels();
        let value = |pixel: [u8; 3]| match self {
            Self::White => white(pixel),
            Self::Dark => 255.0 - white(pixel),
            Self::Red => CHROMA * lab(&linear, pixel.map(f32::from))[1],
            Self::Yellow => CHROMA * lab(&linear, pixel.map(f32::from))[2],
            Self::Blue => -CHROMA * lab(&linear, pixel.map(f32::from))[2],
        };
        let values = rgb.pixels().map(|pixel| value(pixel.0)).collect();
        Channel { values, width: rgb.width() as usize, height: rgb.height() as usize }
    }

    /// Whether the channel is chroma, which spans fewer levels than brightness.
    pub(super) fn is_chroma(self) -> bool {
        !matches!(self, Self::White | Self::Dark)
    }
}

/// Half the least colour and half the brightness (ITU-R BT.601), 0 to 255.
fn white([red, green, blue]: [u8; 3]) -> f32 {
    let least = f32::from(red.min(green).min(blue));
    let [red, green, blue] = [red, green, blue].map(f32::from);
    LEAST_COLOUR * least + (1.0 - LEAST_COLOUR) * (0.299 * red + 0.587 * green + 0.114 * blue)
}

/// Linear light of each of the 256 levels of sRGB (IEC 61966-2-1).
pub(super) fn linear_levels() -> [f32; 256] {
    std::array::from_fn(|level| {
        let level = level as f32 / 255.0;
        if level <= 0.040_45 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
    })
}

/// CIE L* (scaled to 255), a* and b* of levels 0 to 255; `linear` is [`linear_levels`].
pub(super) fn lab(linear: &[f32; 256], levels: [f32; 3]) -> [f32; 3] {
    let [red, green, blue] = levels.map(|level| linear[level.round().clamp(0.0, 255.0) as usize]);
    let xyz = [
        0.412_453 * red + 0.357_580 * green + 0.180_423 * blue,
        0.212_671 * red + 0.715_160 * green + 0.072_169 * blue,
        0.019_334 * red + 0.119_193 * green + 0.950_227 * blue,
    ];
    let [x, y, z] = std::array::from_fn(|axis| {
        let share = xyz[axis] / WHITE_POINT[axis];
        if share > CUBE_ROOT { share.cbrt() } else { SLOPE * share + 16.0 / 116.0 }
    });
    [(116.0 * y - 16.0) * 2.55, 500.0 * (x - y), 200.0 * (y - z)]
}

impl Channel {
    /// Value between pixels (bilinear). Places outside count as the nearest place in the picture.
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        let (x, y) = (x.clamp(0.0, self.width as f32 - 1.0), y.clamp(0.0, self.height as f32 - 1.0));
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f32, y - row as f32);
        let (right, below) = ((column + 1).min(self.width - 1), (row + 1).min(self.height - 1));
        let value = |column: usize, row: usize| self.values[row * self.width + column];
        let above = value(column, row) * (1.0 - u) + value(right, row) * u;
        above * (1.0 - v) + (value(column, below) * (1.0 - u) + value(right, below) * u) * v
    }

    /// The channel convolved with a Gaussian of standard deviation `sigma`, px; its edges continue outside.
    pub(super) fn blurred(&self, sigma: f64) -> Self {
        let radius = (REACH * sigma).ceil() as usize;
        let weight = |offset: usize| (-0.5 * ((offset as f64 - radius as f64) / sigma).powi(2)).exp();
        let sum: f64 = (0..=2 * radius).map(weight).sum();
        let kernel: Vec<f32> = (0..=2 * radius).map(|offset| (weight(offset) / sum) as f32).collect();
        let (width, height) = (self.width, self.height);
        let mut across = vec![0.0; width * height];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in self.values.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (weight, shifted) in kernel.iter().zip(padded.windows(width)) {
                out.iter_mut().zip(shifted).for_each(|(out, value)| *out += weight * value);
            }
        }
        let mut values = vec![0.0; width * height];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (offset, weight) in kernel.iter().enumerate() {
                let row = (y + offset).saturating_sub(radius).min(height - 1);
                let row = &across[row * width..][..width];
                out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
            }
        }
        Self { values, width, height }
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_blurred_channel_keeps_its_sum_and_spreads_a_point_by_sigma() {
        let mut channel = Channel { values: vec![0.0; 61 * 51], width: 61, height: 51 };
        channel.values[25 * 61 + 30] = 1.0;
        let blurred = channel.blurred(2.9);
        let moment = |power: i32| -> f64 {
            let all = blurred.values.iter().enumerate();
            all.map(|(at, value)| f64::from(*value) * ((at % 61) as f64 - 30.0).powi(power)).sum()
        };
        assert!((moment(0) - 1.0).abs() < 1e-5 && moment(1).abs() < 1e-4, "{} {}", moment(0), moment(1));
        assert!((moment(2).sqrt() - 2.9).abs() < 0.02, "{}", moment(2).sqrt());
    }

    #[test]
    fn each_paint_is_bright_in_its_own_channel() {
        let ground = [70, 120, 90];
        let paints = [
            (Paint::White, [230, 230, 225]),
            (Paint::Red, [200, 60, 70]),
            (Paint::Blue, [50, 70, 200]),
            (Paint::Dark, [20, 30, 25]),
            (Paint::Yellow, [220, 200, 40]),
        ];
        for (paint, colour) in paints {
            let mut rgb = RgbImage::from_pixel(2, 1, Rgb(ground));
            rgb.put_pixel(1, 0, Rgb(colour));
            let channel = paint.channel(&rgb);
            assert!(channel.values[1] > channel.values[0] + 20.0, "{paint:?}: {:?}", channel.values);
        }
    }

    #[test]
    fn lab_is_that_of_the_standard() {
        // CIE L*a*b* of pure sRGB red (D65): 53.24, 80.09, 67.20.
        let [lightness, a, b] = lab(&linear_levels(), [255.0, 0.0, 0.0]);
        assert!((lightness / 2.55 - 53.24).abs() < 0.1 && (a - 80.09).abs() < 0.2 && (b - 67.20).abs() < 0.2);
    }
}
