//! CVAT's annotations as a 2D track.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use roxmltree::Node;

use super::super::ImportOptions;
use super::super::ball::{Ball, is_nowhere};
use super::super::drawn::DrawnTrack;
use super::super::pictures::read_text;
use super::{Annotations, file_of};
use crate::video::frame_times;
use gravisight::internal::TrackPoint;
use gravisight::{Error, Result, Track};

/// Tracks that an error names.
const NAMED: usize = 10;

/// What the file says of a frame.
#[derive(Default)]
struct Said {
    what: String,
    /// The track's id.
    object: Option<u64>,
    /// None where it is not visible.
    ball: Option<Ball>,
    is_hidden: bool,
    is_nowhere: bool,
    is_interpolated: bool,
}

/// The ball's track in an annotation file of CVAT (XML 1.1, for video or for images). Frames in which it is outside or occluded are
/// not visible: what is drawn there is a guess. Times are those of the video `pictures`, or by `fps`, or none.
///
/// # Errors
/// [`Error::Io`], [`Error::Format`], [`Error::Value`] with file and line; [`Error::Data`] for several balls, which it names, and
/// for none.
pub fn cvat_track(source: &Path, options: &ImportOptions) -> Result<DrawnTrack> {
    let source = file_of(source);
    let text = read_text(&source)?;
    let annotations = Annotations::of(&text, &source, options)?;
    let labels = annotations.labels()?;
    let label = annotations.chosen(&labels)?;
    let said = match annotations.is_of_a_video() {
        true => annotations.said_of_video(&label)?,
        false => annotations.said_of_images(&label)?,
    };
    let is_seen = |said: &&Said| said.ball.is_some();
    if !said.values().any(|said| is_seen(&said)) {
        return Err(annotations.refused("no frame shows the ball: it is outside or occluded in all of them".into()));
    }
    let clock = Clock::of(options)?;
    let point = |(&frame, said): (&u64, &Said)| clock.point(frame, said.ball.as_ref(), &said.what);
    let track = Track::new(said.iter().map(point).collect::<Result<_>>()?)?;
    let seen = || said.values().filter(is_seen);
    let objects: BTreeSet<u64> = seen().filter_map(|said| said.object).collect();
    Ok(DrawnTrack {
        track,
        label,
        objects: objects.into_iter().collect(),
        hidden: said.values().filter(|said| said.is_hidden && said.ball.is_none()).count(),
        nowhere: said.values().filter(|said| said.is_nowhere).count(),
        interpolated: seen().filter(|said| said.is_interpolated).count(),
    })
}

impl Annotations<'_> {
    fn refused(&self, reason: String) -> Error {
        Error::Data { what: self.what.clone(), reason }
    }

    /// Labels of what is drawn around something, each with its tracks.
    fn labels(&self) -> Result<BTreeMap<String, Vec<String>>> {
        let mut labels: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for node in self.document.root_element().children().filter(Node::is_element) {
            let shapes = || node.children().filter(Node::is_element);
            match node.tag_name().name() {
                "track" if self.object.is_none() || self.is_wanted(node) => {
                    if let Some(frames) = self.frames(shapes())? {
                        let name = format!("{} ({frames})", node.attribute("id").unwrap_or("?"));
                        labels.entry(self.attribute(node, "label")?.into()).or_default().push(name);
                    }
                }
                "image" => {
                    for shape in shapes() {
                        if self.ball(shape)?.is_some() {
                            labels.entry(self.attribute(shape, "label")?.into()).or_default();
                        }
                    }
                }
                _ => (),
            }
        }
        Ok(labels)
    }

    /// The first and the last frame of some shapes; none where none of them can be a ball.
    fn frames<'a>(&self, shapes: impl Iterator<Item = Node<'a, 'a>>) -> Result<Option<String>> {
        let mut ends: Option<[u64; 2]> = None;
        for shape in shapes {
            if self.ball(shape)?.is_some() && !is_outside(shape) {
                let frame = self.count(shape, "frame")?;
                ends = Some(ends.map_or([frame; 2], |[first, last]| [first.min(frame), last.max(frame)]));
            }
        }
        Ok(ends.map(|[first, last]| format!("frames {first} to {last}")))
    }

    /// The ball's label, where there is no choice.
    fn chosen(&self, labels: &BTreeMap<String, Vec<String>>) -> Result<String> {
        let names = || labels.keys().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let reason = match (self.category, labels.len()) {
            (_, 0) => match self.object {
                Some(object) => format!("has no track {object} with an ellipse, a box or a point"),
                None => "holds no ellipse, no box and no point".into(),
            },
            (Some(wanted), _) if labels.contains_key(wanted) => return Ok(wanted.into()),
            (Some(wanted), _) => format!("has nothing with the label `{wanted}`; choose one of {}", names()),
            (None, 1) => return Ok(labels.keys().next().cloned().unwrap_or_default()),
            (None, _) => format!("holds several labels: {}; choose the ball's with --category", names()),
        };
        Err(self.refused(reason))
    }

    fn said_of_video(&self, label: &str) -> Result<BTreeMap<u64, Said>> {
        let mut all: BTreeMap<u64, Said> = BTreeMap::new();
        let root = self.document.root_element();
        let is_ball = |node: &Node<'_, '_>| {
            node.has_tag_name("track") && self.is_wanted(*node) && node.attribute("label") == Some(label)
        };
        for track in root.children().filter(is_ball) {
            let object = self.count(track, "id")?;
            for shape in track.children().filter(Node::is_element) {
                let Some(ball) = self.ball(shape)? else { continue };
                let frame = self.count(shape, "frame")?;
                let said = self.said(shape, ball, Some(object));
                match all.get(&frame) {
                    Some(Said { ball: Some(_), object: other, .. }) if said.ball.is_some() => {
                        return Err(self.several_at_once(frame, label, [other.unwrap_or_default(), object])?);
                    }
                    // A track that has ended says nothing of what another one sees.
                    Some(_) if said.ball.is_none() => (),
                    _ => drop(all.insert(frame, said)),
                }
            }
        }
        Ok(all)
    }

    fn several_at_once(&self, frame: u64, label: &str, [one, other]: [u64; 2]) -> Result<Error> {
        let labels = self.labels()?;
        let tracks = labels.get(label).map(Vec::as_slice).unwrap_or_default();
        let more = if tracks.len() > NAMED { ", …" } else { "" };
        let tracks = tracks[..tracks.len().min(NAMED)].join(", ");
        Ok(self.refused(format!(
            "shows several balls: tracks {one} and {other}, both `{label}`, are in frame {frame}; choose one with --object: {tracks}{more}"
        )))
    }

    fn said_of_images(&self, label: &str) -> Result<BTreeMap<u64, Said>> {
        let mut all: BTreeMap<u64, Said> = BTreeMap::new();
        let mut folders = BTreeSet::new();
        for node in self.document.root_element().children().filter(|node| node.has_tag_name("image")) {
            let frame = self.count(node, "id")?;
            let name = Path::new(self.attribute(node, "name")?);
            folders.insert(name.parent().unwrap_or(Path::new("")).display().to_string());
            let mut of_image = Said { what: self.line(node), ..Said::default() };
            for shape in node.children().filter(|shape| shape.attribute("label") == Some(label)) {
                let Some(ball) = self.ball(shape)? else { continue };
                let said = self.said(shape, ball, None);
                if said.ball.is_some() && of_image.ball.is_some() {
                    let reason = format!("holds a second `{label}` (the first is {}); keep one", of_image.what);
                    return Err(Error::value(said.what, "image", reason));
                }
                if said.ball.is_some() || of_image.ball.is_none() {
                    of_image = said;
                }
            }
            all.insert(frame, of_image);
        }
        if folders.len() > 1 {
            let folders: Vec<String> = folders.iter().take(NAMED).map(|folder| format!("`{folder}`")).collect();
            let reason = format!(
                "has images from several folders ({}), but a track is made from one; export each folder \
                         separately",
                folders.join(", ")
            );
            return Err(self.refused(reason));
        }
        Ok(all)
    }

    fn said(&self, shape: Node<'_, '_>, ball: Ball, object: Option<u64>) -> Said {
        let is_hidden = is_outside(shape) || is_set(shape, "occluded");
        let is_nowhere = !is_hidden && is_nowhere(&ball.centre);
        Said {
            what: self.line(shape),
            object,
            ball: (!is_hidden && !is_nowhere).then_some(ball),
            is_hidden,
            is_nowhere,
            is_interpolated: shape.attribute("keyframe").is_some_and(|keyframe| keyframe.trim() == "0"),
        }
    }
}

fn is_set(shape: Node<'_, '_>, name: &str) -> bool {
    shape.attribute(name).is_some_and(|value| value.trim() == "1")
}

fn is_outside(shape: Node<'_, '_>) -> bool {
    is_set(shape, "outside")
}

/// When frames were taken.
pub(in super::super) enum Clock {
    Unknown,
    /// Frames a second.
    Rate(f64),
    /// A video's name, and the times of its frames, s.
    Video(String, Vec<f64>),
}

impl Clock {
    pub fn of(options: &ImportOptions) -> Result<Self> {
        Ok(match (options.fps, &options.pictures) {
            (Some(fps), _) => Self::Rate(fps),
            (None, Some(folder)) if folder.is_dir() => {
                let reason = "is a folder of pictures, which have no times; give --fps, or the video".into();
                return Err(Error::Data { what: folder.display().to_string(), reason });
            }
            (None, Some(video)) => Self::Video(video.display().to_string(), frame_times(video)?),
            (None, None) => Self::Unknown,
        })
    }

    /// A track's point: the ball in a frame of which `what` speaks.
    pub fn point(&self, frame: u64, ball: Option<&Ball>, what: &str) -> Result<TrackPoint> {
        let point = match ball {
            Some(Ball { centre, radius }) => TrackPoint {
                radius: radius.map(|[radius, _]| radius),
                radius_sigma: radius.map(|[_, sigma]| sigma),
                ..TrackPoint::seen(frame, *centre)
            },
            None => TrackPoint::unseen(frame),
        };
        Ok(TrackPoint { time: self.at(frame, what)?, ..point })
    }

    /// Of a frame of which `what` speaks, s.
    fn at(&self, frame: u64, what: &str) -> Result<Option<f64>> {
        let (video, times) = match self {
            Self::Unknown => return Ok(None),
            Self::Rate(fps) => return Ok(Some(frame as f64 / fps)),
            Self::Video(video, times) => (video, times),
        };
        let reason = match usize::try_from(frame).ok().and_then(|frame| times.get(frame)) {
            Some(time) => return Ok(Some(*time)),
            None => format!(
                "is not in {video}, which has {} frames; check that labels and video count frames alike",
                times.len()
            ),
        };
        Err(Error::value(what, format!("frame {frame}"), reason))
    }
}
