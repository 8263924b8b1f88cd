//! `FineTuner`.

use js_sys::{Object, Uint8Array};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::held::Held;
use super::localiser::{JsLocaliser, device_of};
use super::{js_error, object_of, set};
use crate::clips::Clip;
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::model::Card;
use crate::size::Size;
use crate::train::{FineTuneOptions, FineTuner};

/// A model that learns from clips given to it.
#[wasm_bindgen(js_name = FineTuner)]
pub struct JsFineTuner {
    tuner: FineTuner,
    device_name: String,
    held: Held,
}

#[wasm_bindgen(js_class = FineTuner)]
impl JsFineTuner {
    /// Starts from the model of `card` and `weights` on `device` ("cpu" or "webgpu"); `options` is JSON.
    pub async fn create(
        card: String,
        weights: Vec<u8>,
        options: String,
        device: String,
    ) -> std::result::Result<Self, JsValue> {
        let create = async || -> Result<Self> {
            let options: FineTuneOptions = serde_json::from_str(&options).map_err(Error::format("options"))?;
            let (device, device_name) = device_of(&device).await?;
            let tuner = FineTuner::new(Card::from_json(&card, "model card")?, weights, &options, &device)?;
            Ok(Self { tuner, device_name, held: Held::default() })
        };
        create().await.map_err(js_error)
    }

    /// The next picture of the clip that [`Self::add_clip`] ends, as RGBA pixels.
    #[wasm_bindgen(js_name = addPicture)]
    pub fn add_picture(&mut self, rgba: Vec<u8>, width: u32, height: u32) -> std::result::Result<(), JsValue> {
        self.held.add(Picture::from_rgba(&rgba, Size { width, height }))
    }

    /// The next picture of the clip that [`Self::add_clip`] ends, as a PNG, JPEG or WebP file.
    #[wasm_bindgen(js_name = addFile)]
    pub fn add_file(&mut self, file: Vec<u8>) -> std::result::Result<(), JsValue> {
        self.held.add(Picture::decode(&file))
    }

    /// Forgets the pictures of a clip that will not come.
    #[wasm_bindgen(js_name = dropPictures)]
    pub fn drop_pictures(&mut self) {
        self.held.forget();
    }

    /// A clip (a line of `clips.jsonl`) whose pictures were given; `held_out` to score with, else to learn from.
    #[wasm_bindgen(js_name = addClip)]
    pub fn add_clip(&mut self, clip: &str, held_out: bool) -> std::result::Result<JsValue, JsValue> {
        let added =
            self.held.use_up(|pictures| self.tuner.add_clip(Clip::from_json(clip, "clip")?, pictures, held_out));
        added.and_then(|added| object_of(&added)).map_err(js_error)
    }

    /// One step; undefined after the last.
    pub async fn step(&mut self) -> std::result::Result<JsValue, JsValue> {
        match self.tuner.step().await.map_err(js_error)? {
            Some(tuned) => object_of(&tuned).map_err(js_error),
            None => Ok(JsValue::UNDEFINED),
        }
    }

    /// Scores the averaged weights on the clips held out.
    pub async fn evaluate(&mut self) -> std::result::Result<JsValue, JsValue> {
        let score = self.tuner.evaluate().await.map_err(js_error)?;
        object_of(&score).map_err(js_error)
    }

    /// The averaged weights as they are now, for pictures.
    pub fn localiser(&self) -> JsLocaliser {
        JsLocaliser::named(self.tuner.localiser(), self.device_name.clone())
    }

    /// `{ card: string, weights: Uint8Array }` of the weights that scored best on the clips held out.
    pub async fn export(&self) -> std::result::Result<JsValue, JsValue> {
        let export = async || -> Result<JsValue> {
            let (card, weights) = self.tuner.export().await?;
            let object = Object::new();
            set(&object, "card", &JsValue::from_str(&card.to_json()?));
            set(&object, "weights", &Uint8Array::from(weights.as_slice()));
            Ok(object.into())
        };
        export().await.map_err(js_error)
    }

    /// The device, in words.
    #[wasm_bindgen(getter, js_name = deviceName)]
    pub fn device_name(&self) -> String {
        self.device_name.clone()
    }
}
