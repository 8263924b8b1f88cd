//! Who is on the ground: players, who follow the play; judges, an umpire, ball kids, people who walk by.

use nalgebra::Point3;
use rand::RngExt;

use super::super::broadcast::Kind;
use super::person::{Body, Held, Look};
use gravisight_geometry::random::Random;

/// How long a stroke lasts before and after the ball is hit, s.
const STROKE: f64 = 0.35;
/// How far from the ball a player stands who hits it, m: rackets are longer than bats and hands.
const REACH: f64 = 1.0;
const SHORT_REACH: f64 = 0.6;
/// A step's length as a fraction of the speed, and at most, m.
const STRIDE: f64 = 0.12;
const LONGEST_STRIDE: f64 = 0.42;
/// Way of a whole step, m.
const STEP: f64 = 1.7;
/// Step of the derivative that is a speed, s.
const MOMENT: f64 = 0.04;
/// How much higher than standing people's an umpire's hips are, m: on a high chair, and on a low one beside a table.
const CHAIR: f64 = 0.9;
const LOW_CHAIR: f64 = -0.4;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Player,
    /// Bent, hands on knees.
    Judge,
    /// On a knee.
    Kid,
    Umpire,
    Walker,
}

/// Somebody.
#[derive(Debug, Clone)]
pub(super) struct Actor {
    look: Look,
    role: Role,
    held: Held,
    /// When they are where, s and m.
    way: Vec<(f64, [f64; 2])>,
    /// When they hit the ball, s, and how high it is, m.
    strokes: Vec<(f64, f64)>,
    /// Where they look, m.
    looks_at: [f64; 2],
    /// How much higher than standing their hips are where they sit, m.
    seat: f64,
    /// How often a second, and from where on, they fidget.
    fidgets: [f64; 2],
}

impl Actor {
    fn new(role: Role, home: [f64; 2], looks_at: [f64; 2], random: &mut Random) -> Self {
        Self {
            look: Look::draw(random),
            role,
            held: Held::Nothing,
            way: vec![(0.0, home)],
            strokes: vec![],
            looks_at,
            seat: 0.0,
            fidgets: [random.random_range(0.15..0.9), random.random_range(0.0..std::f64::consts::TAU)],
        }
    }

    /// Where they are at a time, m, and how far they have gone, m.
    fn place(&self, time: f64) -> ([f64; 2], f64) {
        let mut gone = 0.0;
        for pair in self.way.windows(2) {
            let ((start, a), (end, b)) = (pair[0], pair[1]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            if time < end {
                let fraction = ((time - start) / (end - start)).clamp(0.0, 1.0);
                let eased = fraction * fraction * (3.0 - 2.0 * fraction);
                return ([0, 1].map(|axis| a[axis] + eased * (b[axis] - a[axis])), gone + eased * length);
            }
            gone += length;
        }
        (self.way.last().map_or([0.0; 2], |(_, at)| *at), gone)
    }

    pub fn feet(&self, time: f64) -> Point3<f64> {
        let [x, y] = self.place(time).0;
        Point3::new(x, y, 0.0)
    }

    /// Speed, m/s, and its direction, radians.
    pub fn speed(&self, time: f64) -> [f64; 2] {
        let [a, b] = [time - MOMENT, time + MOMENT].map(|time| self.place(time).0);
        let [x, y] = [0, 1].map(|axis| (b[axis] - a[axis]) / (2.0 * MOMENT));
        [x.hypot(y), y.atan2(x)]
    }

    pub fn look(&self) -> &Look {
        &self.look
    }

    /// The body at a time.
    pub fn body(&self, time: f64) -> Body {
        let feet = self.feet(time);
        let [dx, dy] = [self.looks_at[0] - feet.x, self.looks_at[1] - feet.y];
        let mut body = Body::standing(feet, dy.atan2(dx));
        let [speed, heading] = self.speed(time);
        body.step = std::f64::consts::TAU * self.place(time).1 / STEP;
        body.stride = (STRIDE * speed).min(LONGEST_STRIDE);
        let turn = std::f64::consts::TAU * self.fidgets[0] * time + self.fidgets[1];
        let swing = 1.1 * body.stride * body.step.sin();
        body.hands = [[-0.08, swing, -0.5], [0.08, -swing, -0.5]];
        match self.role {
            Role::Player => self.play(&mut body, time, turn),
            Role::Judge => {
                (body.crouch, body.lean, body.astride) = (0.55, 0.75 + 0.05 * turn.sin(), 0.22);
                body.hands = [[-0.02, 0.12, -0.42], [0.02, 0.12, -0.42]];
            }
            Role::Kid if speed < 0.3 => {
                (body.crouch, body.lean) = (1.0, 0.25 + 0.08 * turn.sin());
                body.hands = [[0.05, 0.25, -0.35], [-0.05, 0.25, -0.3 + 0.05 * turn.sin()]];
            }
            Role::Umpire => self.sit(&mut body, turn),
            Role::Kid | Role::Walker => {
                if speed > 0.3 {
                    body.facing = heading;
                } else {
                    body.hands[0][2] += 0.15 * turn.sin().max(0.0);
                }
            }
        }
        body
    }

    /// On a chair, an arm that points now and then.
    fn sit(&self, body: &mut Body, turn: f64) {
        body.seated = true;
        body.feet.z = self.seat;
        let points = (3.0 * turn.sin() - 2.0).max(0.0);
        body.hands = [[0.05, 0.3, -0.35], [0.05 + 0.4 * points, 0.3, -0.35 + 0.6 * points]];
    }

    /// Ready on bent knees, or in a stroke.
    fn play(&self, body: &mut Body, time: f64, turn: f64) {
        let ready = 1.0 - (body.stride / LONGEST_STRIDE).min(1.0);
        body.crouch = 0.25 + 0.1 * ready * (3.0 * turn).sin();
        body.lean = 0.25;
        body.astride = 0.12 + 0.16 * ready;
        body.held = self.held;
        body.hands = [[0.12, 0.3, -0.25], [-0.1, 0.32, -0.22]];
        let Some((hit, height)) = self.strokes.iter().min_by(|a, b| (a.0 - time).abs().total_cmp(&(b.0 - time).abs()))
        else {
            return;
        };
        let phase = (time - hit) / STROKE;
        if phase.abs() > 1.0 {
            return;
        }
        let above = (height - 1.25).clamp(-0.5, 0.5);
        if self.held == Held::Nothing {
            // Both hands to the ball.
            let near = 1.0 - phase.abs();
            body.hands = [[0.1, 0.3, -0.25 + near * (above + 0.25)], [-0.1, 0.3, -0.25 + near * (above + 0.25)]];
            return;
        }
        // From behind, past the side, to the front and over the other shoulder.
        let angle = 1.9 * phase.signum() * phase.abs().powf(0.7);
        let out = 0.55;
        body.hands[1] = [out * angle.cos() - 0.1, out * angle.sin(), above + 0.3 * phase * phase.signum()];
        body.hands[0] = [-0.35, 0.25, -0.1];
        body.lean = 0.15;
    }
}

/// What is known of a play when its people are chosen.
pub(super) struct Scenario<'a> {
    pub kind: Kind,
    /// When the ball is hit, s, and where, m; the start is one.
    pub hits: &'a [(f64, Point3<f64>)],
    pub lasts: f64,
    /// Half the ground's width and length, m.
    pub room: [f64; 2],
    /// Where an umpire's chair stands, m.
    pub chair: [f64; 2],
    /// Whether there are officials.
    pub official: bool,
}

/// All who are there.
pub(super) fn cast(scenario: &Scenario, random: &mut Random) -> Vec<Actor> {
    let mut actors = players(scenario, random);
    if scenario.official && scenario.kind != Kind::Toss {
        officials(scenario, &mut actors, random);
    }
    let walkers = if scenario.official { 0..=1 } else { 0..=3 };
    for _ in 0..random.random_range(walkers) {
        let [wide, long] = scenario.room;
        let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let y = long * random.random_range(0.6..0.95);
        let mut walker = Actor::new(Role::Walker, [side * wide * random.random_range(0.3..1.0), y], [0.0; 2], random);
        walker.wander(scenario.lasts, random.random_range(0.0..4.0), random);
        actors.push(walker);
    }
    actors
}

fn players(scenario: &Scenario, random: &mut Random) -> Vec<Actor> {
    let [_, length] = scenario.kind.court();
    let (each, depth, held) = match scenario.kind {
        Kind::Tennis => (if random.random_bool(0.75) { 1 } else { 2 }, length + 0.8, Held::Racket),
        Kind::TableTennis => (1, 2.2, Held::Bat),
        Kind::Volleyball => (random.random_range(3..=6), 0.55 * length, Held::Nothing),
        Kind::Toss => (usize::from(random.random_bool(0.7)), 0.9, Held::Nothing),
    };
    let mut actors: Vec<Actor> = Vec::new();
    for side in [-1.0, 1.0] {
        if scenario.kind == Kind::Toss && side < 0.0 {
            continue;
        }
        for number in 0..each {
            let [wide, _] = scenario.kind.court();
            let spread = if each > 1 { (number as f64 + 0.5) / each as f64 * 2.0 - 1.0 } else { 0.0 };
            let reach = if scenario.kind == Kind::Volleyball { 0.4 * length } else { 0.5 };
            let home = [
                0.7 * wide * spread + random.random_range(-0.8..0.8),
                side * (depth + random.random_range(-reach..reach)),
            ];
            let mut player = Actor::new(Role::Player, home, [0.0, -side * 0.3 * depth], random);
            player.held = held;
            if let Some(first) = actors.iter().find(|other| other.way[0].1[1] * side > 0.0) {
                player.look = player.look.dressed_as(&first.look);
            }
            actors.push(player);
        }
    }
    follow_play(&mut actors, scenario, random);
    actors
}

/// Sends the nearest player of its side to each hit, and all others about.
fn follow_play(actors: &mut [Actor], scenario: &Scenario, random: &mut Random) {
    let reach = if scenario.kind == Kind::Tennis { REACH } else { SHORT_REACH };
    for (time, at) in scenario.hits {
        let away = |actor: &Actor| {
            let home = actor.way[0].1;
            let other_side = scenario.kind != Kind::Toss && home[1] * at.y < 0.0;
            (home[0] - at.x).hypot(home[1] - at.y) + if other_side { 100.0 } else { 0.0 }
        };
        let Some(actor) = actors.iter_mut().min_by(|a, b| away(a).total_cmp(&away(b))) else { return };
        let side = if actor.way[0].1[1] < 0.0 { -1.0 } else { 1.0 };
        // The ball is at the right hand's side and a little before it.
        let right = if scenario.kind == Kind::Volleyball { 0.0 } else { -side * reach };
        let behind = if scenario.kind == Kind::Toss { 0.5 } else { 0.25 };
        let place = [at.x - right * 0.9, at.y + side * behind];
        actor.strokes.push((*time, at.z));
        if *time == 0.0 {
            actor.way[0].1 = place;
        } else {
            actor.way.push((*time, place));
        }
    }
    for actor in actors {
        let home = actor.way[0].1;
        let gap = random.random_range(0.7..1.6);
        let mut time = actor.strokes.last().map_or(0.0, |(time, _)| *time) + gap;
        while time < scenario.lasts + gap {
            let last = actor.way[actor.way.len() - 1].1;
            let mut near = |axis: usize| 0.5 * (home[axis] + last[axis]) + random.random_range(-1.0..1.0);
            let next = [near(0), near(1)];
            actor.way.push((time, if scenario.kind == Kind::Toss { home } else { next }));
            time += gap;
        }
    }
}

fn officials(scenario: &Scenario, actors: &mut Vec<Actor>, random: &mut Random) {
    let [wide, length] = scenario.kind.court();
    let [room_wide, room_long] = scenario.room;
    if random.random_bool(0.8) {
        let mut umpire = Actor::new(Role::Umpire, scenario.chair, [0.0, 0.0], random);
        umpire.seat = if scenario.kind == Kind::TableTennis { LOW_CHAIR } else { CHAIR };
        actors.push(umpire);
    }
    let judges = random.random_range(0..=5);
    for number in 0..judges {
        let x = wide * (f64::from(number) / 2.0 - 1.0) + random.random_range(-0.5..0.5);
        let far = if number % 2 == 0 { 1.0 } else { -1.0 };
        let y = far * (room_long - random.random_range(0.6..1.5)).min(length + 7.0);
        actors.push(Actor::new(Role::Judge, [x, y], [x, 0.0], random));
    }
    let dressed = Look::draw(random);
    for _ in 0..random.random_range(0..=4) {
        let side = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        let at = match random.random_bool(0.4) {
            true => [side * (wide + 1.2), random.random_range(-0.6..0.6)],
            false => [side * wide * 0.8, (room_long - 0.9) * if random.random_bool(0.6) { 1.0 } else { -1.0 }],
        };
        let x = at[0].clamp(0.3 - room_wide, room_wide - 0.3);
        let mut kid = Actor::new(Role::Kid, [x, at[1]], [0.0; 2], random);
        kid.look = kid.look.dressed_as(&dressed);
        if random.random_bool(0.3) {
            kid.wander(scenario.lasts, random.random_range(1.0..4.0), random);
        }
        actors.push(kid);
    }
}

impl Actor {
    /// Goes to and fro across the picture, m/s.
    fn wander(&mut self, lasts: f64, speed: f64, random: &mut Random) {
        let (mut time, mut at) = self.way[0];
        while time < lasts {
            let rest = random.random_range(0.0..0.8);
            self.way.push((time + rest + 1e-3, at));
            let way = random.random_range(-4.0..4.0);
            let next = [at[0] + way, at[1] + random.random_range(-0.3..0.3)];
            time += rest + 2e-3 + f64::abs(way) / speed.max(0.3);
            self.way.push((time, next));
            at = next;
        }
    }
}
