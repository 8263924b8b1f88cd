//! `Simulator`: the paper's scenes, drawn and simulated.

use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::physics::start_of;
use super::{js_error, object_of, untyped};
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::Scene;
use gravisight_synth::{Engine as _, Shot, Site, Split, Studio};

/// A random clip's labels.
#[derive(Serialize, Tsify)]
pub struct SimulatedClip {
    /// Frames a second.
    pub fps: f64,
    /// Its frames.
    pub frames: Vec<SimulatedFrame>,
}

/// The labels of a frame; its picture is the simulator's at `world`.
#[derive(Serialize, Tsify)]
pub struct SimulatedFrame {
    /// Seconds.
    pub t: f64,
    /// The ball's centre, pixels.
    pub image: [f64; 2],
    /// Whether any of the ball is seen.
    pub visible: bool,
    /// The ball's centre, metres.
    pub world: [f64; 3],
}

/// One scene and camera of the paper's synthetic sets, by the built-in engine.
#[wasm_bindgen(js_name = Simulator)]
pub struct JsSimulator(Studio);

#[wasm_bindgen(js_class = Simulator)]
impl JsSimulator {
    /// Environment 1 to 3 (none: the spring) seen by camera 1 to 9.
    #[wasm_bindgen(constructor)]
    pub fn new(environment: Option<usize>, camera: usize) -> std::result::Result<Self, JsValue> {
        let site = environment.map_or(Site::Spring, Site::Environment);
        Studio::new(Shot { site, camera }).map(Self).map_err(js_error)
    }

    /// The camera, as a `camera.json`.
    #[wasm_bindgen(getter, unchecked_return_type = "Camera")]
    pub fn camera(&self) -> std::result::Result<JsValue, JsValue> {
        untyped(self.0.camera()).map_err(js_error)
    }

    /// The place and its ball, as a `scene.json`.
    #[wasm_bindgen(getter)]
    pub fn scene(&self) -> std::result::Result<Ts<Scene>, JsValue> {
        object_of(self.0.scene()).map_err(js_error)
    }

    /// Centres of a ball (x, y, z of each, m) at `times` (s, rising), thrown with the state `start` (position in m,
    /// velocity in m/s).
    pub fn path(&self, start: Vec<f64>, times: Vec<f64>) -> std::result::Result<Vec<f64>, JsValue> {
        let path = start_of(self.0.scene(), &start).and_then(|start| {
            let path = self.0.builtin().path(&start, &times);
            path.ok_or_else(|| Error::value("state", "start", "cannot be followed: is it inside a box or the floor?"))
        });
        let path = path.map_err(js_error)?;
        Ok(path.iter().flat_map(|point| <[f64; 3]>::from(point.coords)).collect())
    }

    /// The picture with the ball at `centre` (m): RGBA, row-major, of the camera's size.
    pub fn picture(&self, centre: Vec<f64>) -> std::result::Result<Vec<u8>, JsValue> {
        let &[x, y, z] = centre.as_slice() else {
            return Err(js_error(Error::value("state", "centre", "must be three numbers: x, y, z (m)")));
        };
        let drawn = self.0.builtin().picture(&[x, y, z].into()).map_err(js_error)?;
        Ok(drawn.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], 255]).collect())
    }

    /// Clip `number` of the set of seed `seed`: its labels. Its pictures are [`Self::picture`] at its frames' positions.
    pub fn clip(&self, seed: u32, number: usize) -> std::result::Result<Ts<SimulatedClip>, JsValue> {
        let run = || {
            let mut engine = self.0.builtin();
            let clip = self.0.clip(&mut engine, u64::from(seed), Split::Val, number)?;
            let frames = clip.frames.into_iter().map(|frame| match (frame.image, frame.world) {
                (Some(image), Some(world)) => Ok(SimulatedFrame { t: frame.t, image, visible: frame.visible, world }),
                _ => Err(Error::Data { what: clip.id.clone(), reason: "lacks the label of a frame".into() }),
            });
            object_of(&SimulatedClip { fps: clip.fps, frames: frames.collect::<Result<_>>()? })
        };
        run().map_err(js_error)
    }
}
