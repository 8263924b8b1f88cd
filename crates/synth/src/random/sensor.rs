//! From a scene to the bytes of a file: lens, exposure, noise, compression.

use rand::RngExt;

use super::canvas::Canvas;
use super::noise::Normals;
use gravisight_geometry::random::Random;

/// Largest standard deviation of the noise, fractions of full scale: by day, and in a dim hall, where the gain is high.
const NOISE: [f32; 2] = [0.04, 0.08];
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

/// H.264's quantiser at parameter 0, levels of 255; it doubles every 6 (ITU-T H.264, table 8-15).
const VIDEO_STEP: f32 = 0.625;
/// Quantiser parameters of videos: about the constant rate factors of cameras, broadcasts and web pages.
const VIDEO_QUANTISERS: [f32; 2] = [18.0, 34.0];
/// What is added before a video's quantiser rounds down: encoders drop what is small (x264's dead zone of pictures and of differences).
const VIDEO_ROUNDING: [f32; 2] = [1.0 / 6.0, 1.0 / 3.0];
/// How much coarser a JPEG's steps are for colour than for brightness.
const CHROMA_COARSER: f32 = 1.8;

/// What a camera and a file make of the scene on `canvas`.
pub fn expose(canvas: &mut Canvas, normals: &Normals, random: &mut Random) {
    if random.random_bool(0.75) {
        blur(canvas, random.random_range(0.0..BLUR));
    }
    if random.random_bool(0.15) {
        rescale(canvas, random.random_range(0.45..0.95));
    }
    if random.random_bool(0.2) {
        light_mixed(canvas, random);
    }
    let dim = random.random_bool(0.1);
    if dim {
        let fraction = random.random_range(0.2..0.7_f32);
        canvas.planes.iter_mut().flatten().for_each(|value| *value *= fraction);
    }
    develop(canvas, random);
    if random.random_bool(0.3) {
        sharpen(canvas, random.random_range(0.2..1.6), random.random_range(0.6..1.8));
    }
    if random.random_bool(0.03) {
        interlace(canvas, random);
    }
    if random.random_bool(0.7) {
        let sigma = NOISE[usize::from(dim)] * random.random_range(0.0..1.0_f32).powi(2);
        add_noise(canvas, sigma, normals, random);
    }
    if random.random_bool(0.15) {
        grey(canvas);
    }
    canvas.planes.iter_mut().flatten().for_each(|value| *value = value.clamp(0.0, 1.0));
    if random.random_bool(0.55) {
        compress(canvas, random);
    }
    for value in canvas.planes.iter_mut().flatten() {
        *value = nearest(value.clamp(0.0, 1.0) * 255.0) / 255.0;
    }
}

/// Lamps of two colours, one to each side.
fn light_mixed(canvas: &mut Canvas, random: &mut Random) {
    let mut lamp = || -> [f32; 3] { std::array::from_fn(|_| random.random_range(0.7..1.15)) };
    let lamps = [lamp(), lamp()];
    let (sin, cos) = random.random_range(0.0..std::f32::consts::TAU).sin_cos();
    let (width, height) = (canvas.width as f32, canvas.height as f32);
    for (channel, plane) in canvas.planes.iter_mut().enumerate() {
        for (index, value) in plane.iter_mut().enumerate() {
            let [x, y] = [(index % canvas.width) as f32 / width - 0.5, (index / canvas.width) as f32 / height - 0.5];
            let fraction = (0.5 + 0.7 * (cos * x + sin * y)).clamp(0.0, 1.0);
            *value *= lamps[0][channel] + fraction * (lamps[1][channel] - lamps[0][channel]);
        }
    }
}

/// Every other row as it was a moment later, when the camera had turned on.
fn interlace(canvas: &mut Canvas, random: &mut Random) {
    let moved = random.random_range(1..=3_usize).min(canvas.width - 1);
    for plane in &mut canvas.planes {
        for line in plane.chunks_exact_mut(canvas.width).skip(1).step_by(2) {
            line.copy_within(moved.., 0);
        }
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

/// Makes the picture `fraction` as large and as large as before again.
fn rescale(canvas: &mut Canvas, fraction: f32) {
    // A smaller picture's pixels are means: the blur that antialiases, and bilinear interpolation back.
    blur(canvas, 0.45 / fraction);
    let (width, height) = (canvas.width, canvas.height);
    let small = [width, height].map(|side| ((side as f32 * fraction) as usize).max(2));
    for plane in &mut canvas.planes {
        let shrunk = resample(plane, [width, height], small);
        *plane = resample(&shrunk, small, [width, height]);
    }
}

/// A plane of one size in another, by bilinear interpolation.
fn resample(values: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let place = |at: usize, axis: usize| {
        let [from, to] = [from[axis], to[axis]];
        let at = ((at as f32 + 0.5) * from as f32 / to as f32 - 0.5).clamp(0.0, from as f32 - 1.0);
        let first = (at as usize).min(from - 2);
        (first, at - first as f32)
    };
    let columns: Vec<(usize, f32)> = (0..to[0]).map(|column| place(column, 0)).collect();
    let mut found = Vec::with_capacity(to[0] * to[1]);
    for row in 0..to[1] {
        let (above, v) = place(row, 1);
        let (upper, lower) = (&values[above * from[0]..], &values[(above + 1) * from[0]..]);
        found.extend(columns.iter().map(|&(left, u)| {
            let a = upper[left] + u * (upper[left + 1] - upper[left]);
            let b = lower[left] + u * (lower[left + 1] - lower[left]);
            a + v * (b - a)
        }));
    }
    found
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

/// Adds `strength` of the difference from a picture blurred by `sigma` px, as cameras do: edges get halos.
fn sharpen(canvas: &mut Canvas, strength: f32, sigma: f32) {
    let mut soft = canvas.clone();
    blur(&mut soft, sigma);
    for (plane, soft) in canvas.planes.iter_mut().zip(&soft.planes) {
        plane.iter_mut().zip(soft).for_each(|(value, soft)| *value += strength * (*value - soft));
    }
}

/// Noise of every pixel, in part the same in all channels, sometimes coarse.
fn add_noise(canvas: &mut Canvas, sigma: f32, normals: &Normals, random: &mut Random) {
    let count = canvas.width * canvas.height;
    let size = gravisight_geometry::size::Size::new(canvas.width as u32, canvas.height as u32);
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

/// How a codec rounds the waves of a block.
struct Rounding {
    /// Steps of brightness, fractions of full scale, by row.
    steps: [f32; 64],
    /// The same of colour over those of brightness.
    chroma: f32,
    /// What is added before rounding down.
    up: f32,
    /// Whether edges between blocks are smoothed afterwards, where they are no larger than a step.
    smooths: bool,
}

impl Rounding {
    fn random(random: &mut Random) -> Self {
        if random.random_bool(0.5) {
            // A JPEG of quality about 90 down to 25.
            let scale = random.random_range(0.2_f32.ln()..2.0_f32.ln()).exp();
            Self { steps: QUANTA.map(|step| scale * step / 255.0), chroma: CHROMA_COARSER, up: 0.5, smooths: false }
        } else {
            let quantiser = random.random_range(VIDEO_QUANTISERS[0]..VIDEO_QUANTISERS[1]);
            // Of the High profile's transform of 8×8 blocks, orthonormal as the one here.
            let step = VIDEO_STEP * (quantiser / 6.0).exp2() / 255.0;
            let up = random.random_range(VIDEO_ROUNDING[0]..VIDEO_ROUNDING[1]);
            Self { steps: [step; 64], chroma: 1.0, up, smooths: true }
        }
    }
}

/// What a JPEG's or a video's quantisation of 8×8 blocks leaves, mostly with colours at half the resolution (4:2:0).
fn compress(canvas: &mut Canvas, random: &mut Random) {
    let rounding = Rounding::random(random);
    let [red, green, blue] = &mut canvas.planes;
    for ((red, green), blue) in red.iter_mut().zip(green.iter_mut()).zip(blue.iter_mut()) {
        let level = 0.299 * *red + 0.587 * *green + 0.114 * *blue;
        (*red, *green, *blue) = (level, 0.564 * (*blue - level), 0.713 * (*red - level));
    }
    // Blocks do not start at the crop's corner.
    let offset = [random.random_range(0..8), random.random_range(0..8)];
    let (width, height) = (canvas.width, canvas.height);
    let halved = random.random_bool(0.75);
    for (number, plane) in canvas.planes.iter_mut().enumerate() {
        if number == 0 || !halved {
            let scale = if number == 0 { 1.0 } else { rounding.chroma };
            quantise(plane, [width, height], offset, &rounding, scale);
            continue;
        }
        let half = [width, height].map(|side| side.div_ceil(2).max(2));
        let mut small: Vec<f32> = (0..half[0] * half[1])
            .map(|index| {
                let [x, y] = [2 * (index % half[0]), 2 * (index / half[0])];
                let at = |x: usize, y: usize| plane[y.min(height - 1) * width + x.min(width - 1)];
                (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) / 4.0
            })
            .collect();
        quantise(&mut small, half, offset, &rounding, rounding.chroma);
        *plane = resample(&small, half, [width, height]);
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

fn quantise(plane: &mut [f32], [width, height]: [usize; 2], offset: [usize; 2], rounding: &Rounding, scale: f32) {
    // Rows: the cosines of the discrete cosine transform, orthonormal.
    let cosines: [[f32; 8]; 8] = std::array::from_fn(|wave| {
        let norm = if wave == 0 { (1.0_f32 / 8.0).sqrt() } else { 0.5 };
        std::array::from_fn(|at| norm * ((at as f32 + 0.5) * wave as f32 * std::f32::consts::PI / 8.0).cos())
    });
    let transposed: [[f32; 8]; 8] = std::array::from_fn(|row| std::array::from_fn(|column| cosines[column][row]));
    let product = |a: &[[f32; 8]; 8], b: &[[f32; 8]; 8]| -> [[f32; 8]; 8] {
        std::array::from_fn(|row| {
            let mut sums = [0.0; 8];
            for (fraction, line) in a[row].iter().zip(b) {
                sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += fraction * value);
            }
            sums
        })
    };
    let steps: [[f32; 8]; 8] =
        std::array::from_fn(|row| std::array::from_fn(|at| scale * rounding.steps[8 * row + at]));
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
                    // Down to a whole number of steps, towards zero.
                    let size = (wave.abs() / step + rounding.up) as u32 as f32;
                    *wave = size.copysign(*wave) * step;
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
    if rounding.smooths {
        smooth_edges(plane, [width, height], offset, scale * rounding.steps[0]);
    }
}

/// Brings the pixels on both sides of an edge between blocks nearer to each other where they differ by less than `most`.
fn smooth_edges(plane: &mut [f32], [width, height]: [usize; 2], offset: [usize; 2], most: f32) {
    let mut meet = |a: usize, b: usize| {
        let difference = plane[b] - plane[a];
        if difference.abs() < most {
            plane[a] += difference / 4.0;
            plane[b] -= difference / 4.0;
        }
    };
    let edges = |offset: usize, side: usize| (1..side).filter(move |at| (at + offset).is_multiple_of(8));
    for x in edges(offset[0], width) {
        (0..height).for_each(|y| meet(y * width + x - 1, y * width + x));
    }
    for y in edges(offset[1], height) {
        (0..width).for_each(|x| meet((y - 1) * width + x, y * width + x));
    }
}
