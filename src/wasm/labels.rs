//! Proposals for 2D labels.

use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::held::Held;
use super::picture::{self, AnyPicture};
use super::{js_error, untyped};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::track::{LabelOptions, propose_labels};

/// The frames of a clip whose labels are to be proposed.
#[wasm_bindgen(js_name = Labeller)]
pub struct JsLabeller {
    camera: Camera,
    frames: Held,
}

#[wasm_bindgen(js_class = Labeller)]
impl JsLabeller {
    /// For frames of a camera that does not move.
    #[wasm_bindgen(constructor)]
    pub fn new(camera: &str) -> std::result::Result<Self, JsValue> {
        let camera = Camera::from_json(camera, "camera").map_err(js_error)?;
        Ok(Self { camera, frames: Held::default() })
    }

    /// The next frame.
    #[wasm_bindgen(js_name = addPicture)]
    pub async fn add_picture(&mut self, picture: AnyPicture) -> std::result::Result<(), JsValue> {
        self.frames.add(picture::read(&picture).await)
    }

    /// A proposal for each frame; null where the ball is not seen.
    #[wasm_bindgen(unchecked_return_type = "(LabelProposal | null)[]")]
    pub fn propose(&self, radii_px: Option<Vec<f64>>) -> std::result::Result<JsValue, JsValue> {
        self.proposals(radii_px).map_err(js_error)
    }
}

impl JsLabeller {
    fn proposals(&self, radii_px: Option<Vec<f64>>) -> Result<JsValue> {
        let radii_px = match radii_px.as_deref() {
            None => None,
            Some(&[least, most]) => Some([least, most]),
            Some(_) => return Err(Error::value("label", "radiiPx", "must be two numbers, the smaller first")),
        };
        let frames = self.frames.pictures();
        let read = |frame: usize| Ok(frames[frame].clone());
        let found = propose_labels(frames.len(), &self.camera, &LabelOptions { radii_px }, &read, &|| ())?;
        untyped(&found)
    }
}
