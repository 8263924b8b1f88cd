//! From a scene to the bytes of a file: lens, exposure, noise, compression.

use rand::RngExt;

use super::canvas::Canvas;
use super::noise::Normals;
use crate::random::Random;

/// Largest standard deviation of the noise, shares of full scale.
const NOISE: f32 = 0.04;
/// Largest standard deviation of the lens's blur, px.
const BLUR: f32 = 1.1;
/// Levels of the table of a gamma curve.
const LEVELS: usize = 256;
/// JPEG's luminance table (ITU-T T.81, K.1) at quality 50, by row.
const QUANTA: [f32; 64] = [
    16., 11., 10., 16., 24., 40., 51., 61., 12., 12., 14., 19., 26., 58., 60., 55., 14., 13., 16., 24., 40., 57., 69.,
    56., 14., 17., 22., 29., 51., 87., 80., 62., 18., 22., 37., 56., 68., 109., 103., 77., 24., 35., 55., 64., 81.,
    104., 113., 92., 49., 64., 78., 87., 103., 121., 120., 101., 72., 92., 95., 98., 112., 100., 103., 99.,
];

/// What a camera and a file make of the scene on `canvas`.
pub fn expose(canvas: &mut Canvas, normals: &Normals, random: &mut Random) {
    if random.random_bool(0.75) {
        blur(canvas, random.random_range(0.0..BLUR));
    }
    if random.random_bool(0.15) {
        rescale(canvas, random.random_range(0.45..0.95));
    }
    develop(canvas, random);
    if random.random_bool(0.2) {
        sharpen(canvas, random.random_range(0.2..1.0));
    }
    if random.random_bool(0.7) {
        add_noise(canvas, NOISE * random.random_range(0.0..1.0_f32).powi(2), normals, random);
    }
    if random.random_bool(0.15) {
        grey(canvas);
    }
    canvas.planes.iter_mut().flatten().for_each(|value| *value = value.clamp(0.0, 1.0));
    if random.random_bool(0.35) {
        // Quality of about 90 down to 25.
        compress(canvas, (random.random_range(0.2_f32.ln()..2.0_f32.ln())).exp(), random);
    }
    for value in canvas.planes.iter_mut().flatten() {
        *value = nearest(value.clamp(0.0, 1.0) * 255.0) / 255.0;
    }
}

/// Gaussian blur of standard deviation `sigma` px.
pub fn blur(canvas: &mut Canvas, sigma: f32) {
    if sigma < 0.15 {
        return;
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let taps: Vec<f32> = (0..=reach).map(|at| (-0.5 * (at as f32 / sigma).powi(2)).exp()).collect();
    let total = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    let taps: Vec<f32> = taps.iter().map(|tap| tap / total).collect();
    let (width, height) = (canvas.width, canvas.height);
    let mut padded = vec![0.0; width + 2 * reach];
    let mut sums = vec![0.0; width * height];
    for plane in &mut canvas.planes {
        for line in plane.chunks_exact_mut(width) {
            padded[..reach].fill(line[0]);
            padded[reach..reach + width].copy_from_slice(line);
            padded[reach + width..].fill(line[width - 1]);
            line.iter_mut().zip(&padded[reach..]).for_each(|(value, middle)| *value = taps[0] * middle);
            for (at, tap) in taps.iter().enumerate().skip(1) {
                let sides = padded[reach - at..].iter().zip(&padded[reach + at..]);
                line.iter_mut().zip(sides).for_each(|(value, (left, right))| *value += tap * (left + right));
            }
        }
        for (row, out) in sums.chunks_exact_mut(width).enumerate() {
            let line = |row: usize| &plane[row * width..(row + 1) * width];
            out.iter_mut().zip(line(row)).for_each(|(value, middle)| *value = taps[0] * middle);
            for (at, tap) in taps.iter().enumerate().skip(1) {
                let (above, below) = (line(row.saturating_sub(at)), line((row + at).min(height - 1)));
                out.iter_mut().zip(above.iter().zip(below)).for_each(|(value, (a, b))| *value += tap * (a + b));
            }
        }
        plane.copy_from_slice(&sums);
    }
}

/// Makes the picture `share` as large and as large as before again.
fn rescale(canvas: &mut Canvas, share: f32) {
    // A smaller picture's pixels are means: the blur that antialiases, and bilinear interpolation back.
    blur(canvas, 0.45 / share);
    let (width, height) = (canvas.width, canvas.height);
    let small = [width, height].map(|side| ((side as f32 * share) as usize).max(2));
    let place = |at: usize, from: usize, to: usize| {
        let at = ((at as f32 + 0.5) * to as f32 / from as f32 - 0.5).clamp(0.0, to as f32 - 1.0);
        ((at as usize).min(to - 2), at - (at as usize).min(to - 2) as f32)
    };
    let resample = |values: &[f32], [from_width, from_height]: [usize; 2], [to_width, to_height]: [usize; 2]| {
        let columns: Vec<(usize, f32)> = (0..to_width).map(|column| place(column, to_width, from_width)).collect();
        let mut found = Vec::with_capacity(to_width * to_height);
        for row in 0..to_height {
            let (above, v) = place(row, to_height, from_height);
            let (upper, lower) = (&values[above * from_width..], &values[(above + 1) * from_width..]);
            found.extend(columns.iter().map(|&(left, u)| {
                let a = upper[left] + u * (upper[left + 1] - upper[left]);
                let b = lower[left] + u * (lower[left + 1] - lower[left]);
                a + v * (b - a)
            }));
        }
        found
    };
    for plane in &mut canvas.planes {
        let shrunk = resample(plane, [width, height], small);
        *plane = resample(&shrunk, small, [width, height]);
    }
}

/// Gamma, gain, contrast and a colour cast.
fn develop(canvas: &mut Canvas, random: &mut Random) {
    let gamma = (random.random_range(0.7_f32.ln()..1.5_f32.ln())).exp();
    let gain = random.random_range(0.6..1.25_f32);
    let lift = if random.random_bool(0.2) { random.random_range(0.0..0.15_f32) } else { 0.0 };
    // A power by a table: it is asked for every pixel.
    let table: Vec<f32> = (0..=LEVELS).map(|level| (level as f32 / LEVELS as f32).powf(gamma)).collect();
    for plane in &mut canvas.planes {
        let gain = gain * random.random_range(0.9..1.1_f32);
        for value in plane {
            let level = LEVELS as f32 * value.clamp(0.0, 1.0);
            let low = (level as usize).min(LEVELS - 1);
            let curved = table[low] + (level - low as f32) * (table[low + 1] - table[low]);
            *value = lift + (1.0 - lift) * gain * curved;
        }
    }
}

/// Adds `strength` of the difference from a blurred picture, as cameras do.
fn sharpen(canvas: &mut Canvas, strength: f32) {
    let mut soft = canvas.clone();
    blur(&mut soft, 1.0);
    for (plane, soft) in canvas.planes.iter_mut().zip(&soft.planes) {
        plane.iter_mut().zip(soft).for_each(|(value, soft)| *value += strength * (*value - soft));
    }
}

/// Noise of every pixel, in part the same in all channels, sometimes coarse.
fn add_noise(canvas: &mut Canvas, sigma: f32, normals: &Normals, random: &mut Random) {
    let count = canvas.width * canvas.height;
    let size = crate::size::Size::new(canvas.width as u32, canvas.height as u32);
    let mut noise = Canvas::new(size, [0.0; 3]);
    let shared = random.random_range(0.0..1.0_f32);
    let mut luminance = vec![0.0; count];
    normals.add(&mut luminance, sigma * shared, random);
    for plane in &mut noise.planes {
        plane.copy_from_slice(&luminance);
        normals.add(plane, sigma * (1.0 - shared * shared).sqrt(), random);
    }
    if random.random_bool(0.3) {
        blur(&mut noise, random.random_range(0.4..0.9));
    }
    for (plane, noise) in canvas.planes.iter_mut().zip(&noise.planes) {
        plane.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
    }
}

fn grey(canvas: &mut Canvas) {
    let [red, green, blue] = &mut canvas.planes;
    for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
        let level = 0.299 * *red + 0.587 * *green + 0.114 * *blue;
        (*red, *green, *blue) = (level, level, level);
    }
}

/// What JPEG's quantisation of 8×8 blocks leaves, at `scale` times the standard's steps.
fn compress(canvas: &mut Canvas, scale: f32, random: &mut Random) {
    let [red, green, blue] = &mut canvas.planes;
    for ((red, green), blue) in red.iter_mut().zip(green.iter_mut()).zip(blue.iter_mut()) {
        let level = 0.299 * *red + 0.587 * *green + 0.114 * *blue;
        (*red, *green, *blue) = (level, 0.564 * (*blue - level), 0.713 * (*red - level));
    }
    // Blocks do not start at the crop's corner.
    let offset = [random.random_range(0..8), random.random_range(0..8)];
    let (width, height) = (canvas.width, canvas.height);
    for (number, plane) in canvas.planes.iter_mut().enumerate() {
        // Chroma has coarser steps.
        quantise(plane, [width, height], offset, scale * if number == 0 { 1.0 } else { 1.8 });
    }
    let [level, blue_part, red_part] = &mut canvas.planes;
    for ((level, b), r) in level.iter_mut().zip(blue_part).zip(red_part) {
        let [red, blue] = [*level + *r / 0.713, *level + *b / 0.564];
        let green = (*level - 0.299 * red - 0.114 * blue) / 0.587;
        (*level, *b, *r) = (red, green, blue);
    }
}

/// The nearest whole number of one that is not large.
fn nearest(value: f32) -> f32 {
    // Beyond this a float has no fraction: adding it rounds.
    const WHOLE: f32 = 12_582_912.0;
    (value + WHOLE) - WHOLE
}

fn quantise(plane: &mut [f32], [width, height]: [usize; 2], offset: [usize; 2], scale: f32) {
    // Rows: the cosines of the discrete cosine transform, orthonormal.
    let cosines: [[f32; 8]; 8] = std::array::from_fn(|wave| {
        let norm = if wave == 0 { (1.0_f32 / 8.0).sqrt() } else { 0.5 };
        std::array::from_fn(|at| norm * ((at as f32 + 0.5) * wave as f32 * std::f32::consts::PI / 8.0).cos())
    });
    let transposed: [[f32; 8]; 8] = std::array::from_fn(|row| std::array::from_fn(|column| cosines[column][row]));
    let product = |a: &[[f32; 8]; 8], b: &[[f32; 8]; 8]| -> [[f32; 8]; 8] {
        std::array::from_fn(|row| {
            let mut sums = [0.0; 8];
            for (share, line) in a[row].iter().zip(b) {
                sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += share * value);
            }
            sums
        })
    };
    let steps: [[f32; 8]; 8] =
        std::array::from_fn(|row| std::array::from_fn(|at| scale * QUANTA[8 * row + at] / 255.0));
    for top in (0..height + offset[1]).step_by(8) {
        for left in (0..width + offset[0]).step_by(8) {
            let place = |row: usize, column: usize| {
                let y = (top + row).saturating_sub(offset[1]).min(height - 1);
                let x = (left + column).saturating_sub(offset[0]).min(width - 1);
                y * width + x
            };
            let block: [[f32; 8]; 8] =
                std::array::from_fn(|row| std::array::from_fn(|column| plane[place(row, column)]));
            let mut waves = product(&product(&cosines, &block), &transposed);
            for (waves, steps) in waves.iter_mut().zip(&steps) {
                for (wave, step) in waves.iter_mut().zip(steps) {
                    *wave = nearest(*wave / step) * step;
                }
            }
            let found = product(&product(&transposed, &waves), &cosines);
            for (row, line) in found.iter().enumerate() {
                for (column, &value) in line.iter().enumerate() {
                    // Only where the block lies in the picture.
                    if top + row >= offset[1]
                        && left + column >= offset[0]
                        && top + row - offset[1] < height
                        && left + column - offset[0] < width
                    {
                        plane[place(row, column)] = value;
                    }
                }
            }
        }
    }
}
