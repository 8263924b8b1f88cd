//! Files of forecast cases: systems in the paper's own terms, starts and times (the schema of the
//! reference trajectories).

use nalgebra::{Matrix3, Point3, Vector3};
use serde::Deserialize;

use super::scene::{Contact, Cuboid, Floor, Rotation, Scene, Spring, Wall};
use super::state::State;
use gravisight_geometry::error::{Error, Result};

/// Radius of the ball, m: it is a point to the paper's potentials, but a scene has one.
const RADIUS: f64 = 0.2;

/// One case: where a ball starts and when it is asked for.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The paper's system as a scene with the `penalty` contact model.
    pub scene: Scene,
    /// State at t = 0.
    pub start: State,
    /// s.
    pub times: Vec<f64>,
}

/// A case as written. Its other fields (the reference's results) are not read.
#[derive(Deserialize)]
struct CaseFile {
    name: String,
    system: System,
    r0: [f64; 3],
    v0: [f64; 3],
    times: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct System {
    g: f64,
    c: f64,
    beta: f64,
    beta_o: f64,
    floor: bool,
    wall_x: Option<f64>,
    wall_y: Option<f64>,
    obstacles: Vec<Block>,
    spring: Option<SpringFile>,
}

/// `r_o = R·(r − p)`, from −l, −w, 0 to l, w, h.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Block {
    l: f64,
    w: f64,
    h: f64,
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    p: [f64; 3],
}

#[derive(Deserialize)]
struct SpringFile {
    k: f64,
    m: f64,
}

#[derive(Deserialize)]
struct CasesFile {
    cases: Vec<CaseFile>,
}

impl Case {
    /// Reads a file of cases; `what` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`], [`Error::Value`] with the case and the field.
    pub fn all_from_json(text: &str, what: &str) -> Result<Vec<Self>> {
        let file: CasesFile = serde_json::from_str(text).map_err(Error::format(what))?;
        file.cases.into_iter().map(|case| Self::from_file(case, what)).collect()
    }

    fn from_file(case: CaseFile, what: &str) -> Result<Self> {
        let system = &case.system;
        let cuboid = |block: &Block| {
            let half_size = [block.l, block.w, block.h / 2.0];
            // world_from_box is the transposed rotation; the block's own origin is in its lower face
            let turn = Matrix3::from_fn(|row, column| block.rotation[column][row]);
            let position = (Vector3::from(block.p) + turn.column(2) * half_size[2]).into();
            let [first, second, last] = block.rotation;
            let upright = last == [0.0, 0.0, 1.0] && first[2] == 0.0 && second[2] == 0.0;
            let turns = (first[0] - second[1]).abs() < 1e-9 && (first[1] + second[0]).abs() < 1e-9;
            match upright && turns {
                true => Cuboid::upright(position, half_size, first[1].atan2(first[0])),
                false => {
                    let rotation = std::array::from_fn(|row| std::array::from_fn(|column| turn[(row, column)]));
                    Cuboid { position, half_size, yaw: 0.0, rotation: Some(Rotation::Matrix(rotation)) }
                }
            }
        };
        let wall = |position: f64, axis: usize, sign: f64| {
            let (mut point, mut normal) = ([0.0; 3], [0.0; 3]);
            (point[axis], normal[axis]) = (position, sign);
            Wall { point, normal }
        };
        let x = system.wall_x.map(|x| wall(x, 0, 1.0));
        let y = system.wall_y.map(|y| wall(y, 1, -1.0));
        let mut scene = Scene::new([0.0, 0.0, -system.g], RADIUS);
        scene.contact = Contact::Penalty { c: system.c, beta: system.beta, beta_box: system.beta_o };
        // the paper's spring hangs in empty space
        scene.floor = (system.floor && system.spring.is_none()).then_some(Floor { height: 0.0 });
        scene.walls = x.into_iter().chain(y).collect();
        scene.boxes = system.obstacles.iter().map(cuboid).collect();
        if let Some(spring) = &system.spring {
            scene.ball.mass = spring.m;
            scene.spring = Some(Spring { stiffness: spring.k, anchor: [0.0; 3] });
        }
        scene.check(&format!("{what}: case `{}`", case.name))?;
        let start = scene.start(Point3::from(case.r0), Vector3::from(case.v0));
        Ok(Self { name: case.name, scene, start, times: case.times })
    }
}
