//! From the courses that were found to what a user is told: positions, how sure they are, flights, hits.

use nalgebra::{DMatrix, Matrix3, Point3, Vector2, Vector3};

use super::course::{Course, Event, Kind, OF_EVENT, OF_START, Path};
use super::motion::Moving;
use super::search::{FINAL, Found, price};
use super::task::Task;
use super::{Laws, Note, Rebound, Solved, suspects};
use crate::camera::Camera;
use crate::physics::{Impact, State};
use crate::track::fit::{Estimate, Fit, FittedFrame, Flight, Hit, Parameter, largest_noise};

/// Residual, in standard deviations, of an outlier.
const OUTLIER: f64 = 4.0;
/// Residuals, in standard deviations of the labels, and share of outliers with which a flight is explained.
const EXPLAINED: f64 = 2.0;
const MOST_OUTLIERS: f64 = 0.25;
/// Share of the distance below which its error is taken for a linear one, the distances tried beyond, and how firmly.
const WELL_KNOWN: f64 = 0.03;
const FACTORS: [f64; 8] = [0.55, 0.67, 0.8, 0.9, 1.1, 1.25, 1.5, 1.8];
const PINNED: f64 = 1e-3;
/// Share of the distance beyond which a position is as good as unknown, and that of the distance of what is not explained.
const UNKNOWN: f64 = 0.06;
const DISTANCE_UNKNOWN: f64 = 0.5;
/// Difference of the distances by size and by all else that is worth a word, a share, and fewest sizes for it.
const SIZE_OFF: f64 = 0.02;
const FEWEST_SIZES: usize = 8;
/// Slowest bounce that says what the restitution is, m/s.
const SLOWEST: f64 = 0.5;
/// One case in a hundred, in standard deviations.
const ODD: f64 = 2.33;
/// By how much more the labels of a whole flight may be off together than their residuals show, which the trajectory has
/// followed: a factor of variances, between rivals and of each.
const DRIFT: f64 = 1.5;
const OWN_DRIFT: f64 = 1.3;
/// Least slip of the clock that is worth a word, frames.
const NOTED: f64 = 0.5;
/// Strongest correlation of one residual with the next that is believed.
const STRONGEST: f64 = 0.9;

/// The course over all frames, those before the first label and after the last included.
fn whole(task: &Task, course: &Course) -> Course {
    let times = task.times_of(course);
    let mut course = course.clone();
    course.start = task.laws.moved(&course.start, times[0] - times[course.first], &course.off);
    course.first = 0;
    course.last = task.times.len() - 1;
    course
}

/// What the best of the courses `found` says, the others being what may be true as well; labels are noisy by `noise` px.
/// The camera may as well be one of `cameras`.
pub fn fit_of(task: &Task, found: &[Found], noise: f64, cameras: &[Camera]) -> Option<Solved> {
    let best = whole(task, &found.first()?.course);
    let path = task.path(&best);
    let times = task.times_of(&best);
    let residuals = task.residuals(&best, &path);
    let (parameters, positions) = task.covariances(&best, FINAL)?;
    let inflation = OWN_DRIFT * correlation(&residuals, task.sigma);
    let rivals = rivals(task, found, &best, &path, &positions, inflation);
    // Where each frame is by a camera that is off.
    let shifted: Vec<Vec<Moving>> = cameras
        .iter()
        .filter_map(|camera| Some(task.path(&task.with_camera(camera).refined(&best, FINAL, 20)?.0).frames))
        .collect();
    let all: f64 = rivals.iter().map(|(weight, _)| weight).sum();
    // Hits end flights; bounces do not.
    let hits: Vec<usize> = (0..best.events.len()).filter(|&event| best.events[event].kind == Kind::Hit).collect();
    let frame = |index: usize| {
        let Moving { position, velocity, spin } = path.frames[index];
        let mut covariance: Matrix3<f64> = positions[index] * inflation;
        for (weight, frames) in &rivals {
            let off = frames[index].position - position;
            covariance += off * off.transpose() * (weight / all);
        }
        for frames in &shifted {
            let off = frames[index].position - position;
            covariance += off * off.transpose();
        }
        let residual_px: Option<Vector2<f64>> = residuals[index];
        FittedFrame {
            time: times[index],
            state: State { position: Point3::from(position), velocity, spin },
            covariance,
            residual_px,
            outlier: residual_px.is_some_and(|residual| residual.norm() > OUTLIER * task.sigma),
            flight: hits.partition_point(|&event| best.events[event].time <= times[index]),
            refused: None,
        }
    };
    let mut frames: Vec<FittedFrame> = (0..path.frames.len()).map(frame).collect();
    let strains = strains(task, &best, &hits)?;
    let strained = strains.iter().any(|&strain| suspects::is_strained(strain));
    let gravity = strained.then(|| suspects::gravity(task, &best, found[0].cost - price(&best))).flatten();
    let doubts: Vec<Option<String>> = strains
        .iter()
        .enumerate()
        .map(|(number, &strain)| {
            let own: Vec<&FittedFrame> = frames.iter().filter(|frame| frame.flight == number).collect();
            let gravity = gravity.as_ref().filter(|_| suspects::is_strained(strain)).map(|it| it.0.clone());
            gravity.or_else(|| unexplained(task, &own, strain))
        })
        .collect();
    frames.iter_mut().filter(|frame| doubts[frame.flight].is_some()).for_each(|frame| widen(task.camera, frame));
    let end = |number: usize| hits.get(number).map_or(times[times.len() - 1], |&event| best.events[event].time);
    let flight = |number: usize| {
        let (start, first, moving) = match number.checked_sub(1) {
            None => (times[0], 3, best.start),
            Some(before) => {
                let event = &best.events[hits[before]];
                let position = path.before[hits[before]].position;
                let moving = Moving { position, velocity: event.velocity, spin: event.spin };
                (event.time, OF_START + OF_EVENT * hits[before] + 1, moving)
            }
        };
        let sigma = |at: usize| (parameters[(at, at)] * inflation).max(0.0).sqrt();
        let along = moving.velocity.normalize();
        let speed = parameters.fixed_view::<3, 3>(first, first);
        let speed = ((along.transpose() * speed * along)[(0, 0)] * inflation).max(0.0).sqrt();
        let own: Vec<&FittedFrame> = frames.iter().filter(|frame| frame.flight == number).collect();
        let doubt = doubts[number].clone();
        let reason = doubt.or_else(|| unknown(task, &own));
        Flight {
            start,
            end: end(number),
            speed: [moving.velocity.norm(), speed],
            spin: moving.spin.into(),
            spin_sigma: [0, 1, 2].map(|axis| sigma(first + 3 + axis)),
            explained: reason.is_none(),
            reason,
        }
    };
    let flights: Vec<Flight> = (0..=hits.len()).map(flight).collect();
    let hit = |&event: &usize| {
        let time = best.events[event].time;
        let frame = times.partition_point(|&at| at < time);
        Hit { time, frame, position: Point3::from(path.before[event].position) }
    };
    let impact = |(event, before): (&Event, &Moving)| {
        let Kind::Bounce(index) = event.kind else { return None };
        let obstacle = &task.obstacles[index];
        let normal = obstacle.nearest(&before.position).normal;
        let speed = -normal.dot(&before.velocity);
        let (surface, position) = (obstacle.surface, before.position);
        Some(Impact { time: event.time, surface, position, speed, time_gradient: None })
    };
    let fit = Fit {
        noise_px: noise,
        rms_px: rms(frames.iter()),
        explained: flights.iter().all(|flight| flight.explained),
        impacts: best.events.iter().zip(&path.before).filter_map(impact).collect(),
        within_lines: vec![],
        hits: hits.iter().map(hit).collect(),
        notes: vec![],
        flights,
        estimates: vec![],
        spin: best.start.spin.into(),
        frames,
    };
    let forces = OF_START + OF_EVENT * best.events.len();
    Some(Solved {
        fit,
        notes: notes(task, &best, &path, &times),
        drag: [best.off[0], parameters[(forces, forces)] * inflation],
        rebounds: rebounds(task, &best, &path, &parameters, inflation),
        cost: found[0].cost,
        gravity: gravity.map(|(_, cost)| cost + price(&best)),
        doubtful: doubts.iter().any(Option::is_some),
    })
}

/// Adds to a position's covariance that nobody knows where it is: the laws do not hold, or the camera is another.
pub fn widen(camera: &Camera, frame: &mut FittedFrame) {
    let off = DISTANCE_UNKNOWN * camera.camera_from_world(&frame.state.position).coords.norm();
    frame.covariance += Matrix3::identity() * (off * off / 3.0);
}

/// Of each flight how far it is from what is known before, in squared standard deviations, and of how many numbers.
fn strains(task: &Task, course: &Course, hits: &[usize]) -> Option<Vec<(f64, usize)>> {
    let all = task.strains(course)?;
    let [forces, start, events @ ..] = all.as_slice() else { return None };
    let mut flights = vec![(forces.0 + start.0, forces.1 + start.1)];
    for (index, event) in events.iter().enumerate() {
        if hits.contains(&index) {
            flights.push(*forces);
        }
        if let Some(flight) = flights.last_mut() {
            *flight = (flight.0 + event.0, flight.1 + event.1);
        }
    }
    Some(flights)
}

/// Root mean square residual of labels that are no outliers, px.
pub fn rms<'a>(frames: impl Iterator<Item = &'a FittedFrame>) -> f64 {
    let squares: Vec<f64> = frames
        .filter(|frame| !frame.outlier)
        .filter_map(|frame| Some(frame.residual_px?.norm_squared() / 2.0))
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// Why a flight through `frames`, its events and the forces `strain`ed so much, is not explained, in words.
fn unexplained(task: &Task, frames: &[&FittedFrame], (strain, numbers): (f64, usize)) -> Option<String> {
    let seen: Vec<&&FittedFrame> = frames.iter().filter(|frame| frame.residual_px.is_some()).collect();
    if seen.is_empty() {
        return Some("the ball is not seen".into());
    }
    if task.sigma > largest_noise(task.camera) {
        return Some(format!("its labels are off by {:.0} px from one to the next, which no ball's are", task.sigma));
    }
    let outliers = seen.iter().filter(|frame| frame.outlier).count();
    if outliers as f64 > MOST_OUTLIERS * seen.len() as f64 {
        return Some(format!("{outliers} of its {} labels lie far off", seen.len()));
    }
    let rms = rms(frames.iter().copied());
    if rms > EXPLAINED * task.sigma {
        return Some(format!("its labels are off by {rms:.2} px, though they are known to {:.2} px", task.sigma));
    }
    (strain > largest_strain(numbers))
        .then(|| format!("it takes spins and bounces that this ball has not (χ² {strain:.0} of {numbers})"))
}

/// What squares of so many standard deviations add up to once in a hundred times (Wilson and Hilferty 1931).
pub fn largest_strain(numbers: usize) -> f64 {
    let n = numbers as f64;
    n * (1.0 - 2.0 / (9.0 * n) + ODD * (2.0 / (9.0 * n)).sqrt()).powi(3)
}

/// That a flight's distance is not known, in words.
fn unknown(task: &Task, frames: &[&FittedFrame]) -> Option<String> {
    let seen = frames.iter().filter(|frame| frame.residual_px.is_some());
    let depth = |frame: &FittedFrame| task.camera.camera_from_world(&frame.state.position).z.abs();
    let mut shares: Vec<(f64, f64)> = seen.map(|frame| (frame.sigma() / depth(frame), frame.sigma())).collect();
    shares.sort_by(|a, b| a.0.total_cmp(&b.0));
    let &(share, sigma) = shares.get(shares.len() / 2)?;
    (share > UNKNOWN).then(|| {
        format!(
            "how far away the ball is stays unknown (±{sigma:.1} m): its spin is, and it touches nothing of the scene"
        )
    })
}

/// What the bounces say of the restitution.
fn rebounds(task: &Task, course: &Course, path: &Path, covariance: &DMatrix<f64>, inflation: f64) -> Vec<Rebound> {
    let of = |(index, (event, before)): (usize, (&Event, &Moving))| {
        let Kind::Bounce(obstacle) = event.kind else { return None };
        let normal = task.obstacles[obstacle].nearest(&before.position).normal;
        let closing = -normal.dot(&before.velocity);
        let first = OF_START + OF_EVENT * index + 1;
        let velocity = covariance.fixed_view::<3, 3>(first, first);
        let variance = (normal.transpose() * velocity * normal)[(0, 0)] * inflation / (closing * closing);
        let restitution = normal.dot(&event.velocity) / closing;
        (closing > SLOWEST && variance > 0.0).then_some(Rebound { time: event.time, restitution, variance })
    };
    course.events.iter().zip(&path.before).enumerate().filter_map(of).collect()
}

/// What a track says of drag (by the logarithm of its share of the scene's: mean, variance) and, where the ball bounces, of
/// restitution: the laws' own, as far as it says no more.
pub fn estimates(laws: &Laws, [off, variance]: [f64; 2], rebounds: &[Rebound]) -> Vec<Estimate> {
    let drag = laws.drag_coefficient() * off.exp();
    let mut found = vec![Estimate { parameter: Parameter::Drag, value: drag, sigma: drag * variance.max(0.0).sqrt() }];
    let weights: f64 = rebounds.iter().map(|it| it.variance.recip()).sum();
    if weights > 0.0 {
        let value = rebounds.iter().map(|it| it.restitution / it.variance).sum::<f64>() / weights;
        found.push(Estimate { parameter: Parameter::Restitution, value, sigma: weights.sqrt().recip() });
    }
    found
}

/// What is odd about the track.
fn notes(task: &Task, course: &Course, path: &Path, times: &[f64]) -> Vec<Note> {
    let of = |((frame, _), by): (&(usize, f64), &f64)| {
        let (frames, at) = (by / task.interval, times[*frame]);
        let words = match frames > 0.0 {
            true => format!("about {frames:.1} frames are missing before {at:.3} s: later times are moved by as much"),
            false => format!(
                "about {:.1} frames are there twice before {at:.3} s: later times are moved by as much",
                -frames
            ),
        };
        Note { time: Some(at), words }
    };
    let slips = task.slips.iter().zip(&course.slips);
    let sizes = sizes(task, path).map(|words| Note { time: None, words });
    sizes.into_iter().chain(slips.filter(|(_, by)| by.abs() >= NOTED * task.interval).map(of)).collect()
}

/// That the ball's apparent size says another distance than all else, in words.
fn sizes(task: &Task, path: &Path) -> Option<String> {
    let share = |(moving, depth): (&Moving, &Option<[f64; 2]>)| {
        let (depth, own) = ((*depth)?[0], task.camera.camera_from_world(&Point3::from(moving.position)).z);
        Some(depth / own - 1.0)
    };
    let mut shares: Vec<f64> = path.frames.iter().zip(&task.depths).filter_map(share).collect();
    shares.sort_by(f64::total_cmp);
    let median = *shares.get(shares.len() / 2)?;
    (median.abs() > SIZE_OFF && shares.len() >= FEWEST_SIZES).then(|| {
        format!(
            "by its apparent size the ball is {:.0} % {} than its flight and contacts say: check the heights of the scene, \
             the ball's radius, the camera and the frame rate",
            100.0 * median.abs(),
            if median > 0.0 { "farther" } else { "nearer" }
        )
    })
}

/// What may be true as well as the best, with weights: the other courses, by how much worse they explain the track (which
/// errors of the labels that last exaggerate), and what is true if the ball is nearer or farther where least is known of that.
fn rivals(
    task: &Task,
    found: &[Found],
    best: &Course,
    path: &Path,
    positions: &[Matrix3<f64>],
    inflation: f64,
) -> Vec<(f64, Vec<Moving>)> {
    let least = found[0].cost;
    let weight = |cost: f64| (-0.5 * (cost - least) / (DRIFT * inflation)).exp().min(1.0);
    let others = found.iter().map(|it| (weight(it.cost), it)).filter(|(weight, _)| *weight > 1e-4);
    let mut rivals: Vec<(f64, Vec<Moving>)> =
        others.map(|(weight, it)| (weight, task.path(&whole(task, &it.course)).frames)).collect();
    let depth = |frame: usize| task.camera.camera_from_world(&Point3::from(path.frames[frame].position)).z;
    let share = |frame: usize| positions[frame].trace().sqrt() / depth(frame);
    let seen = (0..path.frames.len()).filter(|&frame| task.observations[frame].image.is_some());
    let Some(frame) = seen.max_by(|&a, &b| share(a).total_cmp(&share(b))) else { return rivals };
    if share(frame) > WELL_KNOWN {
        // Without a contact the distance is known so badly that its error is no linear one.
        rivals.extend(FACTORS.into_iter().filter_map(|factor| {
            let mut depths = task.depths.clone();
            depths[frame] = Some([factor * depth(frame), PINNED * depth(frame)]);
            let (course, cost) = task.with_depths(depths).refined(best, FINAL, 20)?;
            let weight = weight(cost + price(&course));
            (weight > 1e-4).then(|| (weight, task.path(&course).frames))
        }));
    }
    rivals
}

/// By how much errors that last over frames make variances larger: of residuals that follow one another like a first-order
/// process, (1 + ρ)/(1 − ρ).
fn correlation(residuals: &[Option<Vector2<f64>>], sigma: f64) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    let capped = |residual: Vector2<f64>| residual * (3.0 * sigma / residual.norm().max(3.0 * sigma));
    for pair in residuals.windows(2) {
        let (Some(a), Some(b)) = (pair[0], pair[1]) else { continue };
        let (a, b) = (capped(a), capped(b));
        product += a.dot(&b);
        square += (a.norm_squared() + b.norm_squared()) / 2.0;
    }
    let rho = if square > 0.0 { (product / square).clamp(0.0, STRONGEST) } else { 0.0 };
    (1.0 + rho) / (1.0 - rho)
}

/// Covariances of the numbers of a course, and of its position at each frame.
pub type Covariances = (DMatrix<f64>, Vec<Matrix3<f64>>);

/// Covariance of a place that depends on numbers of that `covariance` by `columns`.
pub fn of_place(columns: &[Vector3<f64>], covariance: &DMatrix<f64>) -> Matrix3<f64> {
    let jacobian = DMatrix::from_fn(3, columns.len(), |row, column| columns[column][row]);
    let found = &jacobian * covariance * jacobian.transpose();
    Matrix3::from_fn(|row, column| found[(row, column)])
}
