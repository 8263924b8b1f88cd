//! A ball through a video.

use std::sync::Arc;

use js_sys::Function;
use serde::{Deserialize, Serialize};
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

use super::physics::{Flight, Hit, Impact, hits, impacts};
use super::picture::{self, AnyPicture};
use super::{js_error, object_of};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Picture;
use crate::localise::Localiser;
use crate::physics::{Forecaster, Scene};
use crate::size::Size;
use crate::track::{FitOptions, FollowedFrame, Stretch, Tracked};
use crate::video_tracker::VideoTracker;

/// The ball in a video: in each frame, and its flights.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct VideoTrack {
    /// What came out, in a sentence.
    pub verdict: String,
    /// Whether the ball was found and physics explains each of its flights; null without camera and scene.
    pub explained: Option<bool>,
    /// One a frame that was given.
    pub frames: Vec<VideoTrackFrame>,
    /// From hit to hit, bounces between.
    pub flights: Vec<Flight>,
    /// Where something that the scene does not hold changes the ball's way.
    pub hits: Vec<Hit>,
    /// Where the ball touches something, by time.
    pub impacts: Vec<Impact>,
    /// Frames, to within one, from which on most of the picture is another: a cut, or the camera moved.
    pub cuts: Vec<usize>,
    /// Frames in which the camera has moved from its first view: no metres there.
    pub elsewhere: Vec<OtherView>,
    /// What is odd about the track, in words.
    pub notes: Vec<String>,
}

/// Frames of a video that show another view than the first.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct OtherView {
    /// The first of them.
    pub from: usize,
    /// The last.
    pub to: usize,
    /// How far what stands still is away at most from where it was, pixels; null where that is not known.
    pub moved_px: Option<f64>,
}

/// The ball in a frame of a video.
#[derive(Serialize, Tsify)]
#[serde(rename_all = "camelCase")]
#[tsify(missing_as_null)]
pub struct VideoTrackFrame {
    /// Seconds.
    pub t: f64,
    /// Whether the picture is the one of the frame before again.
    pub repeated: bool,
    /// Its centre, pixels; null where it is not seen.
    pub image: Option<[f64; 2]>,
    /// Its apparent radius, pixels; null where it is not known.
    pub radius_px: Option<f64>,
    /// Probability that what was found is the ball, 0 to 1, by the odds of its motion, its size and what the network sees in it,
    /// whose weights were chosen by hand; no model's confidence. 0 where it is not seen.
    pub confidence: f64,
    /// Metres; null outside flights.
    pub world: Option<[f64; 3]>,
    /// Root mean square error of that to expect, metres.
    pub sigma: Option<f64>,
    /// Metres a second.
    pub speed: Option<f64>,
    /// Index of the flight that it belongs to.
    pub flight: Option<usize>,
    /// Whether what was seen there does not belong to that flight's trajectory.
    pub outlier: bool,
}

/// What is known of a video's place, and of the ball in it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
struct Known {
    /// For metres: of the pictures' aspect.
    camera: Option<serde_json::Value>,
    scene: Option<serde_json::Value>,
    /// The camera moved by one standard deviation along each independent direction.
    #[serde(default)]
    camera_sigma: Vec<Camera>,
    /// Most hits between two pauses; as many as the track needs where missing.
    hits: Option<usize>,
    /// Frames (from 0) and pixels in which a person saw the ball.
    #[serde(default)]
    seeds: Vec<(usize, [f64; 2])>,
    /// Whether the frames' times are the video's own, and none was left out.
    #[serde(default)]
    times_known: bool,
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
    /// `on_progress` hears how many stretches are fitted, and of how many.
    pub async fn track(
        &mut self,
        known: String,
        on_progress: Function,
    ) -> std::result::Result<Ts<VideoTrack>, JsValue> {
        self.tracked(&known, &on_progress).await.map_err(js_error)
    }
}

impl JsVideoTracker {
    pub(super) fn new(localiser: Arc<Localiser>, camera: Option<Camera>) -> Self {
        Self { tracker: VideoTracker::new(localiser, camera), size: None }
    }

    async fn watch(&mut self, picture: Result<Picture>, time: f64) -> Result<()> {
        let picture = picture?;
        self.size = Some(picture.size());
        self.tracker.add(picture, time).await
    }

    async fn tracked(&mut self, known: &str, on_progress: &Function) -> Result<Ts<VideoTrack>> {
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
            let options =
                FitOptions { hits: known.hits, times_known: known.times_known, cameras, ..FitOptions::default() };
            tracked.fit(forecaster, camera, &options, |done, all| {
                // Nobody has to listen.
                on_progress.call2(&JsValue::NULL, &done.into(), &all.into()).ok();
            })?;
        }
        object_of(&VideoTrack::of(&tracked, place.is_some()))
    }
}

impl VideoTrack {
    fn of(tracked: &Tracked, metres: bool) -> Self {
        let mut said = Self {
            verdict: tracked.verdict(),
            explained: metres.then(|| tracked.found() > 0 && tracked.explained()),
            frames: tracked.frames.iter().map(VideoTrackFrame::from).collect(),
            flights: vec![],
            hits: vec![],
            impacts: vec![],
            cuts: tracked.cuts.clone(),
            elsewhere: (tracked.elsewhere().into_iter())
                .map(|(frames, moved_px)| OtherView { from: frames.start, to: frames.end - 1, moved_px })
                .collect(),
            notes: vec![],
        };
        for Stretch { frames, fit, .. } in &tracked.stretches {
            let Ok(fit) = fit else { continue };
            for (frame, fitted) in said.frames[frames.clone()].iter_mut().zip(&fit.frames) {
                frame.world = Some(fitted.state.position.coords.into());
                frame.sigma = Some(fitted.sigma());
                frame.speed = Some(fitted.state.velocity.norm());
                frame.flight = Some(said.flights.len() + fitted.flight);
                frame.outlier = fitted.outlier;
            }
            said.hits.extend(hits(fit).map(|hit| Hit { frame: frames.start + hit.frame, ..hit }));
            said.flights.extend(fit.flights.iter().map(Flight::from));
            said.impacts.extend(impacts(fit));
            said.notes.extend(fit.notes.iter().cloned());
        }
        said
    }
}

impl From<&FollowedFrame> for VideoTrackFrame {
    fn from(FollowedFrame { point, repeated, confidence, .. }: &FollowedFrame) -> Self {
        Self {
            t: point.time.unwrap_or_default(),
            repeated: *repeated,
            image: point.image().map(|at| [at.x, at.y]),
            radius_px: point.radius,
            confidence: *confidence,
            world: None,
            sigma: None,
            speed: None,
            flight: None,
            outlier: false,
        }
    }
}
