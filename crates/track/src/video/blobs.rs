//! Connected parts of a picture that differ, as discs and streaks.

use nalgebra::Matrix3;
use rayon::prelude::*;

use super::config::BlobsConfig;
use super::view::{CanvasPixels, FirstView, FramePixels, Place, View, mapped, scale};
use gravisight_geometry::camera::Detection;
use gravisight_kernels::Vectors;
use gravisight_kernels::pixels::largest;

/// A part of a frame that may be the ball: a disc, or a streak that it left while the shutter was open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob<Pixels> {
    /// Its middle.
    pub at: Place<Pixels>,
    /// Half its width, px.
    pub radius: f64,
    /// From its middle to either end, px.
    pub reach: f64,
    /// Direction of its length, from -π/2 to π/2.
    pub direction: f64,
    /// Whether a network sees a ball there.
    pub is_ball: bool,
    /// Standard deviation of its place along each axis, px.
    pub sigma: f64,
}

impl<Pixels> Blob<Pixels> {
    /// The ball that a network measures in it, which is better than the middle of what differs; a streak keeps its length.
    pub fn measured_as(&self, ball: Self, config: &BlobsConfig) -> Self {
        let reach = if self.reach < config.streak * self.radius { 0.0 } else { self.reach };
        Self { reach: reach.max(ball.radius), direction: self.direction, ..ball }
    }

    /// The same in other pixels.
    fn mapped<Other>(&self, homography: &Matrix3<f64>) -> Blob<Other> {
        let [x, y] = self.at.xy;
        let at = mapped(homography, [x, y]);
        let ahead = mapped(homography, [x + self.direction.cos(), y + self.direction.sin()]);
        let direction = ((ahead[1] - at[1]) / (ahead[0] - at[0])).atan();
        let scale = scale(homography, [x, y]);
        Blob {
            at: Place::new(at),
            radius: self.radius * scale,
            reach: self.reach * scale,
            direction: if direction.is_finite() { direction } else { 0.0 },
            sigma: self.sigma * scale,
            is_ball: self.is_ball,
        }
    }
}

impl Blob<FirstView> {
    /// The same as a frame of this view shows it.
    pub fn in_frame(&self, view: &View) -> Blob<FramePixels> {
        self.mapped(&view.frame_from_first)
    }
}

impl Blob<FramePixels> {
    /// A ball that a network measured in a frame.
    pub fn of_detection(ball: &Detection, config: &BlobsConfig) -> Self {
        let radius = ball.outline.radius;
        Self {
            at: Place::new(ball.outline.centre.coords.into()),
            radius,
            reach: radius,
            direction: 0.0,
            is_ball: true,
            // A large ball is off its path by more than its edge is uncertain: frames are dropped, and blur is uneven.
            sigma: ball.sigma_px().max(config.detected_sigma).max(config.place_of_reach * radius),
        }
    }

    /// The same in the first view, of a frame of this view.
    pub fn in_first(&self, view: &View) -> Blob<FirstView> {
        self.mapped(&view.first_from_frame)
    }
}

impl Blob<CanvasPixels> {
    /// The same in the first view, of which the canvas has this view.
    pub fn in_first(&self, canvas: &View) -> Blob<FirstView> {
        if *canvas == View::FIRST {
            let Self { at, radius, reach, direction, is_ball, sigma } = *self;
            return Blob { at: Place::new(at.xy), radius, reach, direction, is_ball, sigma };
        }
        self.mapped(&canvas.first_from_frame)
    }
}

/// Rows that a thread looks at, at least, and pixels of one that are looked at together.
const LINES: usize = 32;
const FEW: usize = 64;

/// Pixels of one row.
struct Run {
    row: usize,
    start: usize,
    end: usize,
    part: usize,
}

/// Sums over the pixels of a part, with the differences as weights.
#[derive(Default, Clone, Copy)]
struct Sums {
    pixels: usize,
    weight: f64,
    first: [f64; 2],
    second: [f64; 3],
}

/// The parts of `differences` above `contrast` that may be a ball: those of most contrast.
pub(super) fn blobs(differences: &[u8], width: usize, contrast: u8, config: &BlobsConfig) -> Vec<Blob<CanvasPixels>> {
    let shorter = width.min(differences.len() / width.max(1)) as f64;
    let radii = config.least_radius..=config.most_radius * shorter;
    let (runs, parts) = connected(differences, width, contrast);
    let mut sums = vec![Sums::default(); parts];
    for Run { row, start, end, part } in runs {
        let sums = &mut sums[part];
        let y = row as f64;
        for (x, &difference) in (start..end).zip(&differences[row * width + start..row * width + end]) {
            let (weight, x) = (f64::from(difference), x as f64);
            sums.pixels += 1;
            sums.weight += weight;
            sums.first[0] += weight * x;
            sums.first[1] += weight * y;
            sums.second[0] += weight * x * x;
            sums.second[1] += weight * x * y;
            sums.second[2] += weight * y * y;
        }
    }
    let mut found: Vec<(f64, Blob<CanvasPixels>)> = sums.iter().filter_map(|sums| sums.blob(config)).collect();
    found.retain(|(_, blob)| radii.contains(&blob.radius));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(config.most);
    found.into_iter().map(|(_, blob)| blob).collect()
}

/// The runs of pixels above `contrast`, with the number of the connected part (corners count) that each belongs to, and how
/// many parts there are.
fn connected(differences: &[u8], width: usize, contrast: u8) -> (Vec<Run>, usize) {
    let mut runs: Vec<Run> = differences
        .par_chunks(width.max(1))
        .enumerate()
        .with_min_len(LINES)
        .flat_map_iter(|(row, pixels)| runs_of(row, pixels, contrast))
        .collect();
    // The part that a part was joined to, or itself.
    let mut joined: Vec<usize> = Vec::new();
    // The runs of the row above that may still touch one.
    let mut above = 0;
    for place in 0..runs.len() {
        let Run { row, start, end, .. } = runs[place];
        while runs[above].row + 1 < row || (runs[above].row + 1 == row && runs[above].end < start) {
            above += 1;
        }
        let mut part = None;
        for other in runs[above..place].iter().take_while(|other| other.row < row && other.start <= end) {
            let root = root(&mut joined, other.part);
            match part {
                None => part = Some(root),
                Some(own) if own != root => {
                    joined[own.max(root)] = own.min(root);
                    part = Some(own.min(root));
                }
                Some(_) => {}
            }
        }
        runs[place].part = part.unwrap_or_else(|| {
            joined.push(joined.len());
            joined.len() - 1
        });
    }
    for run in &mut runs {
        run.part = root(&mut joined, run.part);
    }
    (runs, joined.len())
}

/// The runs of pixels above `contrast` in a row; they belong to no part yet.
fn runs_of(row: usize, pixels: &[u8], contrast: u8) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut start = None;
    let mut most = vec![0; pixels.len().div_ceil(FEW)];
    largest(Vectors::best(), pixels, FEW, &mut most);
    for ((number, few), most) in pixels.chunks(FEW).enumerate().zip(most) {
        // Most are below, all of them.
        if most <= contrast && start.is_none() {
            continue;
        }
        for (x, &difference) in (number * FEW..).zip(few) {
            match (start, difference > contrast) {
                (None, true) => start = Some(x),
                (Some(from), false) => {
                    runs.push(Run { row, start: from, end: x, part: 0 });
                    start = None;
                }
                _ => {}
            }
        }
    }
    runs.extend(start.map(|start| Run { row, start, end: pixels.len(), part: 0 }));
    runs
}

fn root(joined: &mut [usize], mut part: usize) -> usize {
    while joined[part] != part {
        joined[part] = joined[joined[part]];
        part = joined[part];
    }
    part
}

impl Sums {
    /// The part as a blob, and by how much it differs: its mean difference times how much of its ellipse it fills.
    fn blob(&self, config: &BlobsConfig) -> Option<(f64, Blob<CanvasPixels>)> {
        if self.pixels < config.fewest_pixels {
            return None;
        }
        let at = self.first.map(|sum| sum / self.weight);
        // A pixel is a square, not a point.
        let of_pixel = 1.0 / 12.0;
        let xx = self.second[0] / self.weight - at[0] * at[0] + of_pixel;
        let xy = self.second[1] / self.weight - at[0] * at[1];
        let yy = self.second[2] / self.weight - at[1] * at[1] + of_pixel;
        let (middle, off) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        let (long, short) = (2.0 * (middle + off).sqrt(), 2.0 * (middle - off).max(0.0).sqrt());
        let filled = self.pixels as f64 / (std::f64::consts::PI * long * short);
        let contrast = self.weight / self.pixels as f64;
        let blob = Blob {
            at: Place::new(at),
            radius: short,
            reach: long,
            direction: (0.5 * (2.0 * xy).atan2(xx - yy)),
            is_ball: false,
            sigma: config.place_px + config.place_of_reach * long,
        };
        (short > 0.0 && long <= config.longest * short && filled >= config.least_filled)
            .then_some((contrast * filled, blob))
    }
}
