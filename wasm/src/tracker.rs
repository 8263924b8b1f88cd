//! A ball through a video.

use std::sync::Arc;

use js_sys::Function;
use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use gravisight::VideoTracker;
use gravisight::localise::Localiser;
use gravisight_geometry::camera::Camera;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::size::Size;
use gravisight_physics::{Forecaster, Scene};
use gravisight_track::findings::Findings;
use gravisight_track::{FitOptions, TrackedVideo, TrackerConfig};

/// What is known of a video's place, and of the ball in it.
#[derive(Deserialize, Tsify)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct Known {
    /// For metres: of the pictures' aspect.
    #[tsify(type = "Camera", optional)]
    camera: Option<serde_json::Value>,
    /// The place and its ball.
    #[tsify(type = "Scene", optional)]
    scene: Option<serde_json::Value>,
    /// The camera moved by one standard deviation along each independent direction.
    #[serde(default)]
    #[tsify(optional)]
    camera_sigma: Vec<Camera>,
    /// Whether the camera is assumed and not measured: its uncertainty then enters σ and rejects no flight.
    #[serde(default)]
    #[tsify(optional)]
    camera_assumed: bool,
    /// Most hits between two pauses; as many as the track needs where missing.
    #[tsify(optional)]
    hits: Option<usize>,
    /// Frames (from 0) and pixels in which a person saw the ball.
    #[serde(default)]
    #[tsify(optional)]
    seeds: Vec<(usize, [f64; 2])>,
    /// Whether the frames' times are the video's own, and none was left out.
    #[serde(default)]
    #[tsify(optional)]
    times_known: bool,
}

/// A ball through a video, and what a person is told of it.
#[derive(Serialize, Tsify)]
#[tsify(hashmap_as_object, missing_as_null)]
pub struct ToldVideo {
    #[serde(flatten)]
    video: TrackedVideo,
    /// The same in words, for people.
    findings: Findings,
}

/// Follows the ball through frames that come one after the other.
#[wasm_bindgen(js_name = VideoTracker)]
pub struct JsVideoTracker {
    tracker: VideoTracker,
    size: Option<Size>,
}

#[wasm_bindgen(js_class = VideoTracker)]
impl JsVideoTracker {
    /// Takes the next frame, of `time` s.
    pub async fn add(&mut self, picture: AnyPicture, time: f64) -> std::result::Result<(), JsValue> {
        self.watch(picture::read(&picture).await, time).await.map_err(js_error)
    }

    /// The ball in all frames, of which no more will come. `known` (JSON): camera, scene, hits, seeds, timesKnown.
    /// `on_progress` hears how many segments are fitted, and of how many.
    pub async fn track(&mut self, known: String, on_progress: Function) -> std::result::Result<Ts<ToldVideo>, JsValue> {
        self.tracked(&known, &on_progress).await.map_err(js_error)
    }
}

impl JsVideoTracker {
    pub(super) fn new(
        localiser: Arc<Localiser>,
        camera: Option<Camera>,
        config: TrackerConfig,
        court: Option<&str>,
    ) -> Result<Self> {
        let tracker = VideoTracker::new(localiser, camera).with_config(config)?;
        let tracker = match court {
            Some(court) => tracker.with_court(court)?,
            None => tracker,
        };
        Ok(Self { tracker, size: None })
    }

    async fn watch(&mut self, picture: Result<Picture>, time: f64) -> Result<()> {
        let picture = picture?;
        self.size = Some(picture.size());
        self.tracker.add(picture, time).await
    }

    async fn tracked(&mut self, known: &str, on_progress: &Function) -> Result<Ts<ToldVideo>> {
        let known: Known = serde_json::from_str(known).map_err(Error::format("options"))?;
        let place = match (&known.camera, &known.scene, self.size) {
            (Some(camera), Some(scene), Some(size)) => {
                let camera = Camera::from_json(&camera.to_string(), "camera")?.for_picture(size)?;
                Some((camera, Forecaster::new(&Scene::from_json(&scene.to_string(), "scene")?)?))
            }
            _ => None,
        };
        self.tracker.end().await?;
        let known_place = place.as_ref().map(|(camera, forecaster)| (camera, forecaster.scene()));
        let mut tracked = self.tracker.track(&known.seeds, known_place)?;
        if let Some((camera, forecaster)) = &place {
            let cameras = known.camera_sigma.iter().map(|moved| moved.for_picture(camera.size()));
            let cameras = cameras.collect::<Result<Vec<Camera>>>()?;
            let options = FitOptions {
                hits: known.hits,
                times_known: known.times_known,
                cameras,
                camera_assumed: known.camera_assumed,
                ..FitOptions::default()
            };
            tracked.fit(forecaster, camera, &options, |done, all| {
                // Nobody has to listen.
                on_progress.call2(&JsValue::NULL, &done.into(), &all.into()).ok();
            })?;
        }
        let known_place = place.as_ref().map(|(camera, forecaster)| (camera, forecaster.scene()));
        let findings = Findings::of_video(&tracked, known_place);
        object_of(&ToldVideo { video: tracked, findings })
    }
}
