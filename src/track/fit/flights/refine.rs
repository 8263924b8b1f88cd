//! The course near another that explains a track best, and how sure it is.

use std::convert::Infallible;

use nalgebra::{DMatrix, DVector, Vector3};

use super::course::{Course, Event, Kind, OF_EVENT, OF_FORCES, OF_START, Path};
use super::motion::Moving;
use super::result::{Covariances, of_place};
use super::task::{OF_CONTACT, OF_FRAME, TAIL, Task};
use crate::least_squares::{Damping, LeastSquares, minimised};
use crate::track::fit::loss::Loss;

/// Step of a frame's differences, m.
const NEAR: f64 = 1e-6;
/// Longest steps of a search: m, m/s, rad/s, s, logarithm.
const LONGEST: [f64; 5] = [1.0, 10.0, 400.0, 0.02, 0.3];
const DAMPING: Damping =
    Damping { first: 1e-3, relax: 0.2, least: 1e-9, stiffen: 5.0, most: 1e6, steps: 0, converged: 1e-3 };

/// A course on its way to the least cost.
struct Search<'a> {
    task: &'a Task<'a>,
    course: Course,
    path: Path,
    times: Vec<f64>,
    rows: Vec<f64>,
    /// Of each event the standard deviations of the law's normal and tangential velocity and of its spin.
    laxness: Vec<[f64; 3]>,
    loss: Loss,
    cost: f64,
    /// The first flight that is searched; those before stay.
    from: usize,
}

impl<'a> Task<'a> {
    /// The course, or one near it that explains the track better, and its cost.
    pub fn refined(&self, course: &Course, loss: Loss, steps: usize) -> Option<(Course, f64)> {
        self.refined_from(0, course, loss, steps)
    }

    /// The same with the flights before `from` left as they are.
    pub fn refined_from(&self, from: usize, course: &Course, loss: Loss, steps: usize) -> Option<(Course, f64)> {
        let start = Search { from, ..Search::new(self, course.clone(), loss)? };
        let Ok(found) = minimised(start, &Damping { steps, ..DAMPING });
        Some((found.course, found.cost))
    }

    /// How far a course is from what is known before anything is seen, in squared standard deviations, and of how many
    /// numbers: of its forces, of what begins its first flight, of each event.
    pub fn strains(&self, course: &Course) -> Option<Vec<(f64, usize)>> {
        let search = Search::new(self, course.clone(), Loss::Huber(1.0))?;
        let square = |rows: &[f64]| rows.iter().map(|row| row * row).sum::<f64>();
        let (events, tail) =
            search.rows[OF_FRAME * search.path.frames.len()..].split_at(OF_CONTACT * course.events.len());
        let of = |(event, rows): (&Event, &[f64])| match event.kind {
            Kind::Bounce(_) => (square(rows), 7), // velocity across the normal has two numbers in three rows
            Kind::Hit => (square(rows), 3),
        };
        let forces = (square(&tail[3..TAIL]), OF_FORCES);
        let events = course.events.iter().zip(events.chunks(OF_CONTACT)).map(of);
        Some([forces, (square(&tail[..3]), 3)].into_iter().chain(events).collect())
    }

    /// Covariances of the numbers that describe a course, and of its position at each frame.
    pub fn covariances(&self, course: &Course, loss: Loss) -> Option<Covariances> {
        let search = Search::new(self, course.clone(), loss)?;
        let (normal, _) = search.normal()?;
        let covariance = normal.cholesky()?.inverse();
        let mut columns: Vec<Vec<Vector3<f64>>> = Vec::with_capacity(course.count());
        for number in 0..course.count() {
            let (changed, step) = search.stepped(number)?;
            let by = |(a, b): (&Moving, &Moving)| (a.position - b.position) / step;
            columns.push(changed.frames.iter().zip(&search.path.frames).map(by).collect());
        }
        let at = |frame: usize| {
            let own: Vec<Vector3<f64>> = columns.iter().map(|column| column[frame]).collect();
            of_place(&own, &covariance)
        };
        let positions = (0..search.path.frames.len()).map(at).collect();
        Some((covariance, positions))
    }
}

impl<'a> Search<'a> {
    fn new(task: &'a Task<'a>, course: Course, loss: Loss) -> Option<Self> {
        let times = task.times_of(&course);
        if !course.in_order(&times) {
            return None;
        }
        let path = course.path(&task.laws, &times);
        let laxness = task.laxness(&course, &path);
        let mut rows = vec![];
        task.fill(&course, &path, &laxness, &mut rows)?;
        let (_, cost) = task.weighed(path.frames.len(), &rows, loss);
        Some(Self { task, course, path, times, rows, laxness, loss, cost, from: 0 })
    }

    /// The path with one number changed a little, and by how much.
    fn stepped(&self, number: usize) -> Option<(Path, f64)> {
        let step = step_of(&self.course, number);
        let mut course = self.course.clone();
        *course.number(number) += step;
        Some((self.path_of(&course, number).0, step))
    }

    /// The path of a course that differs in one number, and the index of the first frame that differs.
    fn path_of(&self, course: &Course, number: usize) -> (Path, usize) {
        match course.slips == self.course.slips {
            true => course.changed(&self.task.laws, &self.times, number, &self.path),
            false => (self.task.path(course), 0),
        }
    }

    /// The numbers that are searched.
    fn active(&self) -> Vec<usize> {
        (0..self.course.count())
            .filter(|&number| self.from == 0 || self.course.flight_of(number) >= self.from)
            .collect()
    }

    /// J'WJ and J'Wr, by the numbers that are searched.
    fn normal(&self) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let active = self.active();
        let frames = self.path.frames.len();
        let (weights, _) = self.task.weighed(frames, &self.rows, self.loss);
        // Rows of frames that say something, and how they depend on the place.
        let mut used = vec![];
        for (index, moving) in self.path.frames.iter().enumerate() {
            let at = OF_FRAME * index;
            let measured = self.task.measured(self.course.first + index);
            // A label that is met exactly says as much as any; the ball that is in nothing says nothing.
            let says = |&which: &usize| measured[which] || self.rows[at + which] != 0.0;
            let says: Vec<usize> = (0..OF_FRAME).filter(says).collect();
            if says.is_empty() {
                continue;
            }
            let beside =
                |axis| self.task.frame(self.course.first + index, &(moving.position + Vector3::ith(axis, NEAR)));
            let [along_x, along_y, along_z] = [beside(0)?, beside(1)?, beside(2)?];
            let slope = |which: usize| {
                let row = Vector3::new(along_x[which], along_y[which], along_z[which]);
                row.add_scalar(-self.rows[at + which]) / NEAR
            };
            used.extend(says.into_iter().map(|which| (index, slope(which), at + which)));
        }
        let rest = OF_FRAME * frames;
        let others = self.rows.len() - rest;
        let mut jacobian = DMatrix::zeros(used.len() + others, active.len());
        let mut events = vec![0.0; others];
        for (column, &number) in active.iter().enumerate() {
            let step = step_of(&self.course, number);
            let mut course = self.course.clone();
            *course.number(number) += step;
            let (path, from) = self.path_of(&course, number);
            // An event that moves across a frame's time changes the frame before it, too.
            let from = from.saturating_sub(1);
            let mut out = jacobian.column_mut(column);
            let first = used.partition_point(|&(frame, ..)| frame < from);
            for (line, (frame, slope, row)) in used.iter().enumerate().skip(first) {
                let by = (path.frames[*frame].position - self.path.frames[*frame].position) / step;
                out[line] = slope.dot(&by) * weights[*row].sqrt();
            }
            self.task.events(&course, &path, &self.laxness, &mut events);
            for (index, new) in events.iter().enumerate() {
                out[used.len() + index] = (new - self.rows[rest + index]) / step;
            }
        }
        let weighted = used.iter().map(|&(.., row)| self.rows[row] * weights[row].sqrt());
        let weighted: Vec<f64> = weighted.chain(self.rows[rest..].iter().copied()).collect();
        let transposed = jacobian.transpose();
        let mut normal = &transposed * &jacobian;
        (0..active.len()).for_each(|at| normal[(at, at)] += 1e-9);
        Some((normal, transposed * DVector::from_vec(weighted)))
    }
}

/// Which kind of number it is: position, velocity, spin, time, logarithm.
fn kind_of(course: &Course, number: usize) -> usize {
    let Some(beyond) = number.checked_sub(OF_START) else { return number / 3 };
    match beyond < OF_EVENT * course.events.len() {
        true => [3, 1, 1, 1, 2, 2, 2][beyond % OF_EVENT],
        false if beyond - OF_EVENT * course.events.len() < OF_FORCES => 4,
        false => 3,
    }
}

/// Step of a number's differences.
fn step_of(course: &Course, number: usize) -> f64 {
    [1e-6, 1e-5, 1e-2, 1e-7, 1e-5][kind_of(course, number)]
}

impl LeastSquares for Search<'_> {
    type Normal = (DMatrix<f64>, DVector<f64>);
    type Step = DVector<f64>;
    type Error = Infallible;

    fn cost(&self) -> f64 {
        self.cost
    }

    fn linearised(&mut self) -> Result<Option<Self::Normal>, Infallible> {
        self.laxness = self.task.laxness(&self.course, &self.path);
        let filled = self.task.fill(&self.course, &self.path, &self.laxness, &mut self.rows);
        self.cost = self.task.weighed(self.path.frames.len(), &self.rows, self.loss).1;
        Ok(filled.and_then(|()| self.normal()))
    }

    fn step(&self, (normal, gradient): &Self::Normal, damping: f64) -> Option<DVector<f64>> {
        let mut damped = normal.clone();
        (0..damped.nrows()).for_each(|at| damped[(at, at)] *= 1.0 + damping);
        let mut step = damped.cholesky()?.solve(&-gradient);
        let active = self.active();
        let longest = step.iter().zip(&active).map(|(value, &at)| value.abs() / LONGEST[kind_of(&self.course, at)]);
        step /= longest.fold(1.0, f64::max);
        step.iter().all(|value| value.is_finite()).then_some(step)
    }

    fn moved(&self, _: &Self::Normal, step: &DVector<f64>) -> Result<Option<Self>, Infallible> {
        let mut course = self.course.clone();
        for (number, by) in self.active().into_iter().zip(step.iter()) {
            *course.number(number) += by;
        }
        let times = self.task.times_of(&course);
        if !course.in_order(&times) {
            return Ok(None);
        }
        let path = course.path(&self.task.laws, &times);
        let mut rows = vec![];
        let filled = self.task.fill(&course, &path, &self.laxness, &mut rows);
        Ok(filled.map(|()| {
            let (_, cost) = self.task.weighed(path.frames.len(), &rows, self.loss);
            Self { course, path, times, rows, laxness: self.laxness.clone(), cost, ..*self }
        }))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, Rotation3};

    use super::super::motion::Laws;
    use super::super::task::Priors;
    use super::*;
    use crate::camera::{Camera, Distortion};
    use crate::physics::Scene;
    use crate::size::Size;
    use crate::track::fit::Observation;

    #[test]
    fn labels_that_are_met_exactly_say_as_much_as_any() {
        let scene = Scene::named("free").unwrap();
        let laws = Laws::of(&scene).unwrap();
        let intrinsic = Matrix3::new(800.0, 0.0, 319.5, 0.0, 800.0, 239.5, 0.0, 0.0, 1.0);
        let level = Rotation3::from_matrix(&Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0));
        let to = Vector3::new(0.0, 0.0, 6.0);
        let camera =
            Camera::new(Size::new(640, 480), intrinsic, Distortion::default(), level.into_inner(), to).unwrap();
        let times: Vec<f64> = (0..20).map(|frame| 0.02 * f64::from(frame)).collect();
        let start = Moving {
            position: Vector3::new(-1.0, 0.3, 0.5),
            velocity: Vector3::new(4.0, 0.5, 1.0),
            spin: Vector3::zeros(),
        };
        let course = Course { first: 0, last: 19, start, events: vec![], off: [0.0; 3], slips: vec![] };
        let frames = course.path(&laws, &times).frames;
        let sigma_with = |off: f64| {
            let label = |(moving, &time): (&Moving, &f64)| {
                let image = camera.image_from_world(&Point3::from(moving.position)).unwrap();
                Observation { time, image: Some(image.map(|at| at + off)), radius: None }
            };
            let observations: Vec<Observation> = frames.iter().zip(&times).map(label).collect();
            let task = Task {
                laws: laws.clone(),
                obstacles: &[],
                camera: &camera,
                eye: camera.world_from_camera(&Point3::origin()).coords,
                observations: &observations,
                times: times.clone(),
                slips: vec![],
                interval: 0.02,
                depths: vec![None; 20],
                sigma: 0.5,
                priors: Priors { spin: 100.0, forces: [0.1, 0.1, 0.01], restitution: 0.1, friction: 0.2 },
            };
            let (_, positions) = task.covariances(&course, Loss::Cauchy(2.5)).unwrap();
            positions[10].trace().sqrt()
        };
        let (exact, near) = (sigma_with(0.0), sigma_with(1e-6));
        assert!((exact / near - 1.0).abs() < 1e-3 && near < 1.0, "{exact} m, {near} m beside it");
    }
}
