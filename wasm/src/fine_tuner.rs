//! `FineTuner`.

use js_sys::Uint8Array;
use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::device::{AdapterInfo, Named, device_of};
use super::held::Held;
use super::localiser::JsLocaliser;
use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use gravisight::model::Card;
use gravisight::train::{Added, ClipKey, FineTuneOptions, FineTuner, Score, Tuned};
use gravisight_clips::Clip;
use gravisight_geometry::error::{Error, Result};

/// A model in memory.
#[derive(Serialize, Tsify)]
pub struct Model {
    /// The JSON card's text.
    pub card: String,
    /// The content of the `.safetensors` file.
    #[serde(with = "serde_wasm_bindgen::preserve")]
    #[tsify(type = "Uint8Array")]
    pub weights: Uint8Array,
}

/// Where a run is.
#[derive(Serialize, Tsify)]
pub struct TuneProgress {
    /// Steps done.
    pub step: usize,
    /// Steps in all.
    pub steps: usize,
    /// The clips that a resumed run had and that are still to be given again.
    pub awaited: Vec<ClipKey>,
}

/// A model that learns from clips given to it.
#[wasm_bindgen(js_name = FineTuner)]
pub struct JsFineTuner {
    tuner: FineTuner,
    device: Named,
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
            let device = device_of(&device).await?;
            let tuner = FineTuner::new(Card::from_json(&card, "model card")?, weights, &options, &device.device)?;
            Ok(Self { tuner, device, held: Held::default() })
        };
        create().await.map_err(js_error)
    }

    /// Goes on from what [`Self::checkpoint`] gave, on `device`, once its clips are given again.
    pub async fn resume(checkpoint: Vec<u8>, device: String) -> std::result::Result<Self, JsValue> {
        let resume = async || -> Result<Self> {
            let device = device_of(&device).await?;
            let tuner = FineTuner::resume(&checkpoint, &device.device)?;
            Ok(Self { tuner, device, held: Held::default() })
        };
        resume().await.map_err(js_error)
    }

    /// All that is needed to go on later but for the clips.
    pub async fn checkpoint(&self) -> std::result::Result<Uint8Array, JsValue> {
        self.tuner.checkpoint().await.map(|bytes| bytes.as_slice().into()).map_err(js_error)
    }

    /// Where the run is.
    pub fn progress(&self) -> std::result::Result<Ts<TuneProgress>, JsValue> {
        let [step, steps] = self.tuner.progress();
        object_of(&TuneProgress { step, steps, awaited: self.tuner.awaited() }).map_err(js_error)
    }

    /// The next picture of the clip that [`Self::add_clip`] ends.
    #[wasm_bindgen(js_name = addPicture)]
    pub async fn add_picture(&mut self, picture: AnyPicture) -> std::result::Result<(), JsValue> {
        self.held.add(picture::read(&picture).await)
    }

    /// Forgets the pictures of a clip that will not come.
    #[wasm_bindgen(js_name = dropPictures)]
    pub fn drop_pictures(&mut self) {
        self.held.forget();
    }

    /// A clip (a line of `clips.jsonl`) whose pictures were given; `held_out` to score with, else to learn from.
    #[wasm_bindgen(js_name = addClip)]
    pub fn add_clip(&mut self, clip: &str, held_out: bool) -> std::result::Result<Ts<Added>, JsValue> {
        let added =
            self.held.use_up(|pictures| self.tuner.add_clip(Clip::from_json(clip, "clip")?, pictures, held_out));
        added.and_then(|added| object_of(&added)).map_err(js_error)
    }

    /// One step; undefined after the last.
    pub async fn step(&mut self) -> std::result::Result<Option<Ts<Tuned>>, JsValue> {
        let made = self.tuner.step().await.map_err(js_error)?;
        made.map(|tuned| object_of(&tuned)).transpose().map_err(js_error)
    }

    /// Scores the averaged weights on the clips held out.
    pub async fn evaluate(&mut self) -> std::result::Result<Ts<Score>, JsValue> {
        self.tuner.evaluate().await.and_then(|score| object_of(&score)).map_err(js_error)
    }

    /// The averaged weights as they are now, for pictures.
    pub fn localiser(&self) -> JsLocaliser {
        JsLocaliser::new(self.tuner.localiser(), self.device.clone())
    }

    /// The weights that scored best on the clips held out.
    pub async fn export(&self) -> std::result::Result<Ts<Model>, JsValue> {
        let export = async || -> Result<Ts<Model>> {
            let (card, weights) = self.tuner.export().await?;
            object_of(&Model { card: card.to_json()?, weights: weights.as_slice().into() })
        };
        export().await.map_err(js_error)
    }

    /// The device, in words.
    #[wasm_bindgen(getter, js_name = deviceName)]
    pub fn device_name(&self) -> String {
        self.device.name.clone()
    }

    /// The WebGPU adapter of the device; undefined on the CPU.
    #[wasm_bindgen(getter)]
    pub fn adapter(&self) -> std::result::Result<Option<Ts<AdapterInfo>>, JsValue> {
        self.device.adapter.as_ref().map(object_of).transpose().map_err(js_error)
    }
}
