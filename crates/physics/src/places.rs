//! Scenes of common sports.

use super::scene::{Bounds, Contact, Cuboid, Floor, Scene, Wall};
use gravisight_geometry::error::{Error, Result};

/// Standard gravity, m/s².
const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// What a sport is played on, in the world frame of the court of its name, and with which ball.
struct NamedScene {
    name: &'static str,
    ball: &'static str,
    /// Where it is not the ball's own.
    contact: Option<Contact>,
    /// Whether there is a floor at z = 0.
    floor: bool,
    walls: &'static [Wall],
    boxes: &'static [Cuboid],
    lines: &'static [[[f64; 3]; 2]],
    net: &'static [[f64; 3]],
    /// The area that the rules keep free around the court, and the height of play.
    bounds: Option<Bounds>,
}

const EMPTY: NamedScene = NamedScene {
    name: "",
    ball: "",
    contact: None,
    floor: true,
    walls: &[],
    boxes: &[],
    lines: &[],
    net: &[],
    bounds: None,
};

/// An area that reaches so far to each side of the middle, m, up to a height.
const fn around([x, y]: [f64; 2], height: f64) -> Option<Bounds> {
    Some(Bounds { low: [-x, -y, 0.0], high: [x, y, height] })
}

/// Every place.
const PLACES: [NamedScene; 12] = [
    // ITF court, hard, doubles; the world as in the court `tennis`: origin in its middle, x right, y away.
    NamedScene {
        name: "tennis",
        ball: "tennis",
        lines: &[
            [[-5.485, -11.885, 0.0], [5.485, -11.885, 0.0]],
            [[5.485, -11.885, 0.0], [5.485, 11.885, 0.0]],
            [[5.485, 11.885, 0.0], [-5.485, 11.885, 0.0]],
            [[-5.485, 11.885, 0.0], [-5.485, -11.885, 0.0]],
            [[-4.115, -11.885, 0.0], [-4.115, 11.885, 0.0]],
            [[4.115, -11.885, 0.0], [4.115, 11.885, 0.0]],
            [[-4.115, -6.4, 0.0], [4.115, -6.4, 0.0]],
            [[-4.115, 6.4, 0.0], [4.115, 6.4, 0.0]],
            [[0.0, -6.4, 0.0], [0.0, 6.4, 0.0]],
        ],
        net: &[[-6.399, 0.0, 1.07], [0.0, 0.0, 0.914], [6.399, 0.0, 1.07]],
        // ITF: 40.23 x 20.11 m at the largest events. A lob outdoors goes higher than any ceiling that is asked for.
        bounds: around([10.06, 20.12], 15.0),
        ..EMPTY
    },
    // ITTF table, its surface 0.76 m above the floor, which is z = 0.
    NamedScene {
        name: "table-tennis",
        ball: "table-tennis",
        boxes: &[Cuboid::upright([0.0, 0.0, 0.745], [0.7625, 1.37, 0.015], 0.0)],
        lines: &[
            [[-0.7625, -1.37, 0.76], [0.7625, -1.37, 0.76]],
            [[0.7625, -1.37, 0.76], [0.7625, 1.37, 0.76]],
            [[0.7625, 1.37, 0.76], [-0.7625, 1.37, 0.76]],
            [[-0.7625, 1.37, 0.76], [-0.7625, -1.37, 0.76]],
            [[0.0, -1.37, 0.76], [0.0, 1.37, 0.76]],
        ],
        net: &[[-0.915, 0.0, 0.9125], [0.915, 0.0, 0.9125]],
        // ITTF: a playing space of 14 x 7 m, 5 m high.
        bounds: around([3.5, 7.0], 5.0),
        ..EMPTY
    },
    // FIBA court with its two boards; the rings are not modelled: what they do is a hit.
    NamedScene {
        name: "basketball",
        ball: "basketball",
        boxes: &[
            Cuboid::upright([0.0, -12.825, 3.425], [0.9, 0.025, 0.525], 0.0),
            Cuboid::upright([0.0, 12.825, 3.425], [0.9, 0.025, 0.525], 0.0),
        ],
        lines: &[
            [[-7.5, -14.0, 0.0], [7.5, -14.0, 0.0]],
            [[7.5, -14.0, 0.0], [7.5, 14.0, 0.0]],
            [[7.5, 14.0, 0.0], [-7.5, 14.0, 0.0]],
            [[-7.5, 14.0, 0.0], [-7.5, -14.0, 0.0]],
            [[-7.5, 0.0, 0.0], [7.5, 0.0, 0.0]],
            [[-2.45, -14.0, 0.0], [-2.45, -8.2, 0.0]],
            [[2.45, -14.0, 0.0], [2.45, -8.2, 0.0]],
            [[-2.45, -8.2, 0.0], [2.45, -8.2, 0.0]],
            [[-2.45, 14.0, 0.0], [-2.45, 8.2, 0.0]],
            [[2.45, 14.0, 0.0], [2.45, 8.2, 0.0]],
            [[-2.45, 8.2, 0.0], [2.45, 8.2, 0.0]],
        ],
        // FIBA: 2 m around the lines, 7 m high.
        bounds: around([9.5, 16.0], 8.0),
        ..EMPTY
    },
    // IFAB pitch of 105 x 68 m, grass; posts are not modelled.
    NamedScene {
        name: "football",
        ball: "football",
        contact: Some(Contact::Bounce {
            restitution: 0.62,
            friction: 0.6,
            restitution_sigma: Some(0.15),
            friction_sigma: Some(0.25),
        }),
        lines: &[
            [[-34.0, -52.5, 0.0], [34.0, -52.5, 0.0]],
            [[34.0, -52.5, 0.0], [34.0, 52.5, 0.0]],
            [[34.0, 52.5, 0.0], [-34.0, 52.5, 0.0]],
            [[-34.0, 52.5, 0.0], [-34.0, -52.5, 0.0]],
            [[-34.0, 0.0, 0.0], [34.0, 0.0, 0.0]],
            [[-20.16, -52.5, 0.0], [-20.16, -36.0, 0.0]],
            [[20.16, -52.5, 0.0], [20.16, -36.0, 0.0]],
            [[-20.16, -36.0, 0.0], [20.16, -36.0, 0.0]],
            [[-20.16, 52.5, 0.0], [-20.16, 36.0, 0.0]],
            [[20.16, 52.5, 0.0], [20.16, 36.0, 0.0]],
            [[-20.16, 36.0, 0.0], [20.16, 36.0, 0.0]],
        ],
        // A board's distance and a stand's row around the lines; a goal kick's height.
        bounds: around([42.0, 62.0], 40.0),
        ..EMPTY
    },
    // FIVB court, net of 2.43 m.
    NamedScene {
        name: "volleyball",
        ball: "volleyball",
        lines: &[
            [[-4.5, -9.0, 0.0], [4.5, -9.0, 0.0]],
            [[4.5, -9.0, 0.0], [4.5, 9.0, 0.0]],
            [[4.5, 9.0, 0.0], [-4.5, 9.0, 0.0]],
            [[-4.5, 9.0, 0.0], [-4.5, -9.0, 0.0]],
            [[-4.5, -3.0, 0.0], [4.5, -3.0, 0.0]],
            [[-4.5, 0.0, 0.0], [4.5, 0.0, 0.0]],
            [[-4.5, 3.0, 0.0], [4.5, 3.0, 0.0]],
        ],
        net: &[[-4.5, 0.0, 2.43], [4.5, 0.0, 2.43]],
        // FIVB: a free zone of 5 and 6.5 m, 12.5 m high.
        bounds: around([9.5, 15.5], 12.5),
        ..EMPTY
    },
    // BWF court, a shuttle of feathers (its drag is its flight).
    NamedScene {
        name: "badminton",
        ball: "badminton",
        lines: &[
            [[-3.05, -6.7, 0.0], [3.05, -6.7, 0.0]],
            [[3.05, -6.7, 0.0], [3.05, 6.7, 0.0]],
            [[3.05, 6.7, 0.0], [-3.05, 6.7, 0.0]],
            [[-3.05, 6.7, 0.0], [-3.05, -6.7, 0.0]],
            [[-2.59, -6.7, 0.0], [-2.59, 6.7, 0.0]],
            [[2.59, -6.7, 0.0], [2.59, 6.7, 0.0]],
            [[-3.05, -1.98, 0.0], [3.05, -1.98, 0.0]],
            [[-3.05, -5.94, 0.0], [3.05, -5.94, 0.0]],
            [[-3.05, 1.98, 0.0], [3.05, 1.98, 0.0]],
            [[-3.05, 5.94, 0.0], [3.05, 5.94, 0.0]],
            [[0.0, -1.98, 0.0], [0.0, -6.7, 0.0]],
            [[0.0, 1.98, 0.0], [0.0, 6.7, 0.0]],
        ],
        net: &[[-3.05, 0.0, 1.55], [0.0, 0.0, 1.524], [3.05, 0.0, 1.55]],
        // BWF: 2 m around the lines, 12 m high.
        bounds: around([5.05, 8.7], 12.0),
        ..EMPTY
    },
    // WSF court, 9.75 x 6.40 m; the front wall is the far one.
    NamedScene {
        name: "squash",
        ball: "squash",
        walls: &[
            Wall { point: [0.0, 4.875, 0.0], normal: [0.0, -1.0, 0.0] },
            Wall { point: [0.0, -4.875, 0.0], normal: [0.0, 1.0, 0.0] },
            Wall { point: [-3.2, 0.0, 0.0], normal: [1.0, 0.0, 0.0] },
            Wall { point: [3.2, 0.0, 0.0], normal: [-1.0, 0.0, 0.0] },
        ],
        lines: &[
            [[-3.2, -4.875, 0.0], [3.2, -4.875, 0.0]],
            [[3.2, -4.875, 0.0], [3.2, 4.875, 0.0]],
            [[3.2, 4.875, 0.0], [-3.2, 4.875, 0.0]],
            [[-3.2, 4.875, 0.0], [-3.2, -4.875, 0.0]],
            [[-3.2, -0.615, 0.0], [3.2, -0.615, 0.0]],
            [[0.0, -4.875, 0.0], [0.0, -0.615, 0.0]],
            [[-3.2, 4.875, 0.48], [3.2, 4.875, 0.48]],
            [[-3.2, 4.875, 1.78], [3.2, 4.875, 1.78]],
            [[-3.2, 4.875, 4.57], [3.2, 4.875, 4.57]],
        ],
        // WSF: 5.64 m high at least.
        bounds: around([3.2, 4.875], 8.0),
        ..EMPTY
    },
    // USA Pickleball court, 44 x 20 ft.
    NamedScene {
        name: "pickleball",
        ball: "pickleball",
        lines: &[
            [[-3.048, -6.7056, 0.0], [3.048, -6.7056, 0.0]],
            [[3.048, -6.7056, 0.0], [3.048, 6.7056, 0.0]],
            [[3.048, 6.7056, 0.0], [-3.048, 6.7056, 0.0]],
            [[-3.048, 6.7056, 0.0], [-3.048, -6.7056, 0.0]],
            [[-3.048, -2.1336, 0.0], [3.048, -2.1336, 0.0]],
            [[-3.048, 2.1336, 0.0], [3.048, 2.1336, 0.0]],
            [[0.0, -6.7056, 0.0], [0.0, -2.1336, 0.0]],
            [[0.0, 6.7056, 0.0], [0.0, 2.1336, 0.0]],
        ],
        net: &[[-3.353, 0.0, 0.914], [0.0, 0.0, 0.864], [3.353, 0.0, 0.914]],
        // USA Pickleball: 64 x 34 ft at the largest events.
        bounds: around([5.19, 9.76], 8.0),
        ..EMPTY
    },
    // FIP court, 20 x 10 m between walls: glass and fence to 3 and 4 m, which are taken to be higher than any ball; a fence's bounce is a
    // hit.
    NamedScene {
        name: "padel",
        ball: "padel",
        walls: &[
            Wall { point: [0.0, 10.0, 0.0], normal: [0.0, -1.0, 0.0] },
            Wall { point: [0.0, -10.0, 0.0], normal: [0.0, 1.0, 0.0] },
            Wall { point: [-5.0, 0.0, 0.0], normal: [1.0, 0.0, 0.0] },
            Wall { point: [5.0, 0.0, 0.0], normal: [-1.0, 0.0, 0.0] },
        ],
        lines: &[
            [[-5.0, -10.0, 0.0], [5.0, -10.0, 0.0]],
            [[5.0, -10.0, 0.0], [5.0, 10.0, 0.0]],
            [[5.0, 10.0, 0.0], [-5.0, 10.0, 0.0]],
            [[-5.0, 10.0, 0.0], [-5.0, -10.0, 0.0]],
            [[-5.0, -6.95, 0.0], [5.0, -6.95, 0.0]],
            [[-5.0, 6.95, 0.0], [5.0, 6.95, 0.0]],
            [[0.0, -7.15, 0.0], [0.0, 7.15, 0.0]],
        ],
        net: &[[-5.0, 0.0, 0.92], [0.0, 0.0, 0.88], [5.0, 0.0, 0.92]],
        // FIP: 6 m free above the court, 8 m in new halls. Balls leave the cage; they come back as another flight.
        bounds: around([5.0, 10.0], 12.0),
        ..EMPTY
    },
    // MCC pitch; the wickets are not modelled.
    NamedScene {
        name: "cricket",
        ball: "cricket",
        lines: &[
            [[-1.83, -8.84, 0.0], [1.83, -8.84, 0.0]],
            [[-1.83, 8.84, 0.0], [1.83, 8.84, 0.0]],
            [[-1.32, -10.06, 0.0], [1.32, -10.06, 0.0]],
            [[-1.32, 10.06, 0.0], [1.32, 10.06, 0.0]],
        ],
        // ICC: boundaries of at most 82.3 m from the pitch's middle.
        bounds: around([82.3, 82.3], 60.0),
        ..EMPTY
    },
    // A level floor at z = 0 and a tennis ball; another with --ball.
    NamedScene { name: "floor", ball: "tennis", ..EMPTY },
    // Free flight, nothing to touch; a tennis ball, another with --ball.
    NamedScene { name: "free", ball: "tennis", floor: false, ..EMPTY },
];

impl Scene {
    /// Names of the scenes of common sports, `floor` (nothing but a level one) and `free` (nothing to touch).
    pub fn names() -> Vec<&'static str> {
        PLACES.iter().map(|place| place.name).collect()
    }

    /// The scene of a common sport.
    ///
    /// # Errors
    /// [`Error::Value`] with the names there are.
    pub fn named(name: &str) -> Result<Self> {
        let place = PLACES.into_iter().find(|place| place.name == name).ok_or_else(|| {
            Error::value("scene", "name", format!("cannot be `{name}`; choose one of {}", Self::names().join(", ")))
        })?;
        let scene = Self {
            contact: place.contact.unwrap_or_default(),
            floor: place.floor.then_some(Floor { height: 0.0 }),
            walls: place.walls.to_vec(),
            boxes: place.boxes.to_vec(),
            lines: place.lines.to_vec(),
            net: place.net.to_vec(),
            bounds: place.bounds,
            ..Self::new(GRAVITY, 1.0)
        };
        scene.with_ball(place.ball)
    }

    /// The scene of a common sport, or the one that a file holds: what the command takes for a scene.
    ///
    /// # Errors
    /// As [`Self::from_file`]; [`Error::Value`] for neither a file nor a name.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn open(name_or_path: &std::path::Path) -> Result<Self> {
        match name_or_path.to_str() {
            Some(name) if Self::names().contains(&name) && !name_or_path.exists() => Self::named(name),
            Some(name) if !name_or_path.exists() && name_or_path.extension().is_none() => Self::named(name),
            _ => Self::from_file(name_or_path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_one_that_can_be_fitted() {
        assert_eq!(Scene::names().len(), 12);
        for name in Scene::names() {
            let scene = Scene::named(name).unwrap();
            scene.check(name).unwrap();
            assert!(scene.ball.spin_sigma.is_some() && matches!(scene.contact, Contact::Bounce { .. }), "{name}");
            let written = serde_json::to_string(&scene).unwrap();
            assert_eq!(Scene::from_json(&written, name).unwrap(), scene);
        }
        let error = Scene::named("curling").unwrap_err().to_string();
        assert!(error.contains("table-tennis"), "{error}");
    }
}
