//! A video's frames in, its ball out: what moves ([`BallTracker`]), verified by a network ([`Localiser`]).

use std::sync::Arc;

use crate::localise::Localiser;
use gravisight_geometry::camera::{Camera, CourtFollower, Detection, Outline};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_physics::Scene;
use gravisight_track::{BallTracker, FrameId, Hypotheses, Query, TrackedVideo, TrackerConfig};

/// Frames between searches of the whole picture for large balls, while no small one is followed: differences between frames split a large ball
/// into its edges, and do not show one that hardly moves.
const SEARCH_EVERY: usize = 8;

/// Follows the ball through the frames of a video, one after the other; of a camera that stays where it is, and may turn and zoom.
///
/// ```no_run
/// # async fn tracked(pictures: Vec<gravisight::Picture>, localiser: gravisight::Localiser) -> gravisight::Result<()> {
/// use std::sync::Arc;
///
/// use gravisight::{Camera, FitOptions, Forecaster, Scene, VideoTracker};
///
/// let camera = Camera::from_file("camera.json".as_ref())?;
/// let scene = Scene::named("tennis")?;
/// let mut tracker = VideoTracker::new(Arc::new(localiser), Some(camera.clone()));
/// for (frame, picture) in pictures.into_iter().enumerate() {
///     tracker.add(picture, frame as f64 / 50.0).await?;
/// }
/// tracker.end().await?;
/// let mut tracked = tracker.track(&[], Some((&camera, &scene)))?;
/// tracked.fit(&Forecaster::new(&scene)?, &camera, &FitOptions::default(), |_, _| {})?;
/// println!("seen in {} frames: {}", tracked.found(), tracked.verdict);
/// # Ok(())
/// # }
/// ```
pub struct VideoTracker {
    localiser: Arc<Localiser>,
    camera: Option<Camera>,
    /// The court by which the camera is followed; taken with the first frame.
    court: Option<CourtFollower>,
    follower: BallTracker,
    /// The last search of a whole picture.
    searched: Option<Search>,
    ended: bool,
}

/// A search of a whole picture.
struct Search {
    frame: FrameId,
    /// The large balls that were found.
    balls: Vec<Detection>,
    /// Whether one of them has moved.
    moves: bool,
}

/// What the networks say of a query.
struct Answer {
    /// The motion network's probability of a ball; none of what is no candidate, or without that network.
    motion: Option<f64>,
    /// The ball that is measured there.
    ball: Option<Detection>,
}

impl VideoTracker {
    /// Without any frame yet; `localiser` reads sizes, as `any` does. The `camera` that films, if it is known, tells how balls
    /// away from the middle are drawn out.
    pub fn new(localiser: Arc<Localiser>, camera: Option<Camera>) -> Self {
        Self { localiser, camera, court: None, follower: BallTracker::new(), searched: None, ended: false }
    }

    /// The same, with numbers of one's own: before the first frame.
    ///
    /// # Errors
    /// As [`TrackerConfig::check`].
    pub fn with_config(mut self, config: TrackerConfig) -> Result<Self> {
        config.check()?;
        self.follower = BallTracker::with_config(config);
        Ok(self)
    }

    /// The same where the video shows a court ([`Court::names`](crate::camera::Court::names)) whose lines tell how a camera turns and zooms: before
    /// the first frame. Without a camera nothing follows from it.
    ///
    /// # Errors
    /// [`Error::Calibration`] for an unknown court, or one whose lines are not known.
    pub fn with_court(mut self, court: &str) -> Result<Self> {
        self.court = Some(CourtFollower::new(court)?);
        Ok(self)
    }

    /// Takes the next frame, of `time` s.
    ///
    /// # Errors
    /// [`Error::Data`] for a frame of another size than the first, [`Error::Value`] after [`Self::end`] and for a model that
    /// reads no sizes; [`Error::CameraMismatch`] for a camera of another shape; [`Error::OutputNotFinite`] and [`Error::Device`].
    pub async fn add(&mut self, picture: Picture, time: f64) -> Result<()> {
        if self.ended {
            let reason = "comes after the end of the video; use a new tracker for another video";
            return Err(Error::value("video", "frame", reason));
        }
        self.localiser.must_read_sizes()?;
        if let Some(camera) = &self.camera
            && camera.size() != picture.size()
        {
            self.camera = Some(camera.for_picture(picture.size())?);
        }
        if let (Some(court), Some(camera)) = (self.court.take(), &self.camera) {
            self.follower.see_court(court, camera.clone());
        }
        self.follower.watch(picture, time)?;
        let newest = self.follower.newest();
        let is_due = match (&self.searched, newest) {
            (Some(last), Some(newest)) => newest >= FrameId(last.frame.0 + SEARCH_EVERY),
            (last, newest) => last.is_none() && newest.is_some(),
        };
        // A small ball that is followed needs no search.
        if is_due && (self.searched.as_ref().is_some_and(|last| last.moves) || !self.follower.sees_ball()) {
            self.search_whole().await?;
        }
        self.verify_regions().await
    }

    /// There are no more frames. Harmless twice.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub async fn end(&mut self) -> Result<()> {
        if self.ended {
            return Ok(());
        }
        self.ended = true;
        self.follower.settle();
        self.search_whole().await?;
        self.follower.end();
        self.verify_regions().await
    }

    /// The ball in the frames so far; [`TrackedVideo::fit`] makes flights of it. `seeds` are frames and positions (px) at which a person
    /// saw it: what flies through them is the ball. Where the camera (of these pictures) and the scene are known they help to
    /// tell it.
    ///
    /// # Errors
    /// [`Error::Value`] for a seed in a frame that was not given, or outside the picture.
    pub fn track(&self, seeds: &[(usize, [f64; 2])], place: Option<(&Camera, &Scene)>) -> Result<TrackedVideo> {
        Ok(TrackedVideo::new(&self.follower.hypotheses(seeds)?, place))
    }

    /// All that flew.
    ///
    /// # Errors
    /// None.
    #[doc(hidden)]
    pub fn hypotheses(&self) -> Result<Hypotheses<'_>> {
        self.follower.hypotheses(&[])
    }

    /// Asks the networks about what the follower wants to know.
    async fn verify_regions(&mut self) -> Result<()> {
        loop {
            let queries = self.follower.queries();
            if queries.is_empty() {
                return Ok(());
            }
            let answers = self.localiser.find_each(&queries, async |query| self.answer(query).await).await?;
            for (query, Answer { motion, ball }) in queries.iter().zip(answers) {
                if let Some(probability) = motion {
                    self.follower.tell_motion(query, probability);
                }
                if !query.measured {
                    self.follower.tell(query, ball);
                }
            }
        }
    }

    /// What the networks say of a query: first whether it moves as a ball does, and where it may, the ball that is measured.
    async fn answer(&self, query: &Query) -> Result<Answer> {
        let motion = match query.is_of_blob().then(|| self.follower.stack(query)).flatten() {
            Some(stack) => self.localiser.moves_as_a_ball(&stack.pictures).await?,
            None => None,
        };
        let is_measured =
            !query.measured && motion.is_none_or(|probability| self.follower.is_worth_measuring(probability));
        let ball = match self.follower.picture(query).filter(|_| is_measured) {
            Some(picture) => {
                let Query { image, radius_px, reach_px, .. } = *query;
                self.localiser.detect_near(picture, self.camera.as_ref(), image, radius_px, reach_px).await?
            }
            None => None,
        };
        Ok(Answer { motion, ball })
    }

    /// The large balls that the detector proposes in a frame.
    async fn proposals(&self, frame: FrameId) -> Result<Vec<Detection>> {
        match self.follower.held(frame) {
            Some(picture) => self.localiser.propose(picture, self.camera.as_ref()).await,
            None => Ok(vec![]),
        }
    }

    /// Searches the whole of the newest picture for large balls. If one has moved since the search before, the pictures between are searched, too;
    /// for one that hardly moved, where it must have been.
    async fn search_whole(&mut self) -> Result<()> {
        let Some(newest) = self.follower.newest() else { return Ok(()) };
        let balls = self.proposals(newest).await?;
        let Some(Search { frame: last, balls: before, .. }) = self.searched.take() else {
            self.searched = Some(Search { frame: newest, balls, moves: false });
            return Ok(());
        };
        let has_moved = |ball: &Detection| self.follower.has_moved(newest, ball, last, &before);
        let moving: Vec<Detection> = balls.iter().filter(|ball| has_moved(ball)).copied().collect();
        for frame in (last.0 + 1..newest.0).map(FrameId).filter(|_| !moving.is_empty()) {
            for ball in self.proposals(frame).await? {
                if self.follower.has_moved(frame, &ball, last, &before)
                    || self.follower.has_moved(frame, &ball, newest, &balls)
                {
                    self.follower.propose(frame, ball);
                }
            }
        }
        moving.iter().for_each(|&ball| self.follower.propose(newest, ball));
        let slow = self.follower.slow_balls((last, &before), (newest, &balls));
        self.searched = Some(Search { frame: newest, balls, moves: !moving.is_empty() });
        for (frame, Outline { centre, radius }) in slow {
            let Some(picture) = self.follower.held(frame) else { continue };
            let camera = self.camera.as_ref();
            let found = self.localiser.detect_near(picture, camera, centre.coords.into(), radius, radius).await?;
            found.into_iter().for_each(|found| self.follower.found(frame, found));
        }
        Ok(())
    }
}
