//! A trajectory of several flights: what it is described by, and its way.

use nalgebra::Vector3;

use super::motion::{Laws, Moving, Off};

/// What ends a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The ball meets the obstacle of this index.
    Bounce(usize),
    /// Something that the scene does not hold: a racket, a foot, the net's cord.
    Hit,
}

/// The end of a flight and the start of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    pub kind: Kind,
    /// s.
    pub time: f64,
    /// Velocity and spin after it.
    pub velocity: Vector3<f64>,
    pub spin: Vector3<f64>,
}

/// Flights over frames `first..=last`, and by what the forces and the clock are off.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    pub first: usize,
    pub last: usize,
    /// At the first frame.
    pub start: Moving,
    pub events: Vec<Event>,
    pub off: Off,
    /// Seconds that the clock jumps by at each of the task's slips.
    pub slips: Vec<f64>,
}

/// Numbers that describe a start, an event, and the forces.
pub const OF_START: usize = 9;
pub const OF_EVENT: usize = 7;
pub const OF_FORCES: usize = 3;

/// Where a course leads.
#[derive(Debug, Clone)]
pub struct Path {
    /// At each frame.
    pub frames: Vec<Moving>,
    /// At each event, before it.
    pub before: Vec<Moving>,
}

impl Course {
    /// Numbers that describe it.
    pub fn count(&self) -> usize {
        OF_START + OF_EVENT * self.events.len() + OF_FORCES + self.slips.len()
    }

    /// The flight that a number describes first: earlier ones do not depend on it.
    pub fn flight_of(&self, number: usize) -> usize {
        let Some(beyond) = number.checked_sub(OF_START) else { return 0 };
        let event = beyond / OF_EVENT;
        match event < self.events.len() {
            // An event's time is the end of the flight before.
            true => event + usize::from(beyond % OF_EVENT > 0),
            false => 0,
        }
    }

    /// A number that describes it: position, velocity, spin of the start; time, velocity, spin of each event; the forces; the clock.
    pub fn number(&mut self, index: usize) -> &mut f64 {
        let Some(beyond) = index.checked_sub(OF_START) else {
            let Moving { position, velocity, spin } = &mut self.start;
            return &mut [position, velocity, spin][index / 3][index % 3];
        };
        let events = self.events.len();
        match self.events.get_mut(beyond / OF_EVENT) {
            Some(event) => match beyond % OF_EVENT {
                0 => &mut event.time,
                other if other < 4 => &mut event.velocity[other - 1],
                other => &mut event.spin[other - 4],
            },
            None => match beyond - OF_EVENT * events {
                force if force < OF_FORCES => &mut self.off[force],
                slip => &mut self.slips[slip - OF_FORCES],
            },
        }
    }

    /// When each frame was taken, s: by its number, and by the slips of the clock before it.
    pub fn times(&self, times: &[f64], slips: &[usize]) -> Vec<f64> {
        let mut times = times.to_vec();
        for (&frame, by) in slips.iter().zip(&self.slips) {
            times[frame..].iter_mut().for_each(|time| *time += by);
        }
        times
    }

    /// Whether its events come one after the other, each between the first frame and the last.
    pub fn in_order(&self, times: &[f64]) -> bool {
        let mut last = times[self.first];
        let rising = self.events.iter().all(|event| {
            let later = event.time > last;
            last = event.time;
            later
        });
        rising && last < times[self.last]
    }

    /// The way of the ball at `times` (of all frames).
    pub fn path(&self, laws: &Laws, times: &[f64]) -> Path {
        let mut path = Path { frames: Vec::with_capacity(self.last - self.first + 1), before: vec![] };
        self.follow(laws, times, 0, self.events.len(), self.last, &mut path);
        path
    }

    /// The way of a course that differs from that of `path` in one number, and the index of the first frame that does.
    pub fn changed(&self, laws: &Laws, times: &[f64], number: usize, path: &Path) -> (Path, usize) {
        let first = self.flight_of(number);
        let last = match number.checked_sub(OF_START) {
            Some(beyond) if beyond >= OF_EVENT * self.events.len() => return (self.path(laws, times), 0),
            // When a flight begins changes how long it lasts.
            Some(beyond) if beyond % OF_EVENT == 0 => first + 1,
            _ => first,
        };
        let start_of = |flight: usize| match flight.checked_sub(1) {
            None => 0,
            Some(event) => times[self.first..=self.last].partition_point(|&time| time < self.events[event].time),
        };
        let kept = start_of(first);
        let mut changed = Path { frames: path.frames[..kept].to_vec(), before: path.before[..first].to_vec() };
        if last == self.events.len() {
            self.follow(laws, times, first, last, self.last, &mut changed);
            return (changed, kept);
        }
        let rest = start_of(last + 1);
        self.follow(laws, times, first, last, self.first + rest - 1, &mut changed);
        // The flights after it begin elsewhere and are the same otherwise: nothing depends on the place.
        let by = changed.before[last].position - path.before[last].position;
        let elsewhere = |moving: &Moving| Moving { position: moving.position + by, ..*moving };
        changed.frames.extend(path.frames[rest..].iter().map(elsewhere));
        changed.before.extend(path.before[last + 1..].iter().map(elsewhere));
        (changed, kept)
    }

    /// Works out the flights from `flight` to `until`, up to the frame `last` and the event that ends them; `path` holds
    /// what comes before.
    fn follow(&self, laws: &Laws, times: &[f64], flight: usize, until: usize, last: usize, path: &mut Path) {
        let (mut at, mut time) = match flight.checked_sub(1) {
            None => (self.start, times[self.first]),
            Some(last) => {
                let event = &self.events[last];
                (
                    Moving { position: path.before[last].position, velocity: event.velocity, spin: event.spin },
                    event.time,
                )
            }
        };
        let ends = &self.events[flight..self.events.len().min(until + 1)];
        let mut events = ends.iter().peekable();
        let end = |at: &mut Moving, time: &mut f64, event: &Event, path: &mut Path| {
            *at = laws.moved(at, event.time - *time, &self.off);
            path.before.push(*at);
            *at = Moving { position: at.position, velocity: event.velocity, spin: event.spin };
            *time = event.time;
        };
        for &next in &times[self.first + path.frames.len()..=last] {
            while let Some(event) = events.next_if(|event| event.time <= next) {
                end(&mut at, &mut time, event, path);
            }
            at = if next > time { laws.moved(&at, next - time, &self.off) } else { at };
            time = next;
            path.frames.push(at);
        }
        events.for_each(|event| end(&mut at, &mut time, event, path));
    }
}
