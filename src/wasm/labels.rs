//! Proposals for 2D labels.

use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::held::Held;
use super::{js_error, object_of};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::size::Size;
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

    /// The next frame, as RGBA pixels.
    #[wasm_bindgen(js_name = addPicture)]
    pub fn add_picture(&mut self, rgba: Vec<u8>, width: u32, height: u32) -> std::result::Result<(), JsValue> {
        self.frames.add(Picture::from_rgba(&rgba, Size { width, height }))
    }

    /// The next frame, as a PNG, JPEG or WebP file.
    #[wasm_bindgen(js_name = addFile)]
    pub fn add_file(&mut self, file: Vec<u8>) -> std::result::Result<(), JsValue> {
        self.frames.add(Picture::decode(&file))
    }

    /// A proposal (`{ image, radius_px, confidence, doubtful }`) or null for each frame.
    #[wasm_bindgen(js_name = propose)]
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
        let proposals: Vec<serde_json::Value> = found
            .iter()
            .map(|proposal| match proposal {
                None => serde_json::Value::Null,
                Some(it) => serde_json::json!({"image": it.image, "radiusPx": it.radius_px,
                    "confidence": it.confidence, "doubtful": it.doubtful}),
            })
            .collect();
        object_of(&proposals)
    }
}
