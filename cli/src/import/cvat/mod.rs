//! CVAT's annotation files (XML 1.1), for images and for video: as clips, and as a 2D track with the ball's radii.

mod track;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Point2;
use roxmltree::{Document, Node, ParsingOptions};

pub(super) use self::track::{Clock, cvat_track};
use super::ImportOptions;
use super::ball::Ball;
use super::draft::{Draft, Job, Shot, fps_of_numbers};
use super::pictures::{id_of, read_text};
use super::video::{Labelled, Media, draft};
use gravisight::{Error, Result, Size};

/// Name of the file in an export.
const NAME: &str = "annotations.xml";

/// The file.
struct Annotations<'a> {
    document: Document<'a>,
    what: String,
    category: Option<&'a str>,
    /// Id of the ball's track.
    object: Option<u64>,
}

/// An image of a file for images.
struct Image {
    name: String,
    frame: u64,
    what: String,
    label: Option<Point2<f64>>,
}

/// One job for a video, else one for every folder of images.
pub(super) fn jobs(source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
    let source = file_of(source);
    let text = read_text(&source)?;
    let annotations = Annotations::of(&text, &source, options)?;
    match annotations.is_of_a_video() {
        true => Ok(vec![annotations.video(&source, options)?]),
        false => annotations.images(&source, options),
    }
}

/// The annotations of an export, which may be its folder.
fn file_of(source: &Path) -> PathBuf {
    if source.is_dir() { source.join(NAME) } else { source.to_path_buf() }
}

impl<'a> Annotations<'a> {
    fn of(text: &'a str, source: &Path, options: &'a ImportOptions) -> Result<Self> {
        let what = source.display().to_string();
        let parsing = ParsingOptions { allow_dtd: false, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, parsing).map_err(Error::format(&what))?;
        if document.root_element().tag_name().name() != "annotations" {
            let message = "is not a CVAT file: its first element must be `annotations` (export as CVAT for images or for video 1.1)";
            return Err(Error::Format { what, message: message.into() });
        }
        let annotations = Self { document, what, category: options.category.as_deref(), object: options.object };
        if annotations.object.is_some() && !annotations.is_of_a_video() {
            let reason = "cannot be used here: shapes in images belong to no track (export as CVAT for video 1.1)";
            return Err(Error::value(annotations.what, "object", reason));
        }
        Ok(annotations)
    }

    fn is_of_a_video(&self) -> bool {
        self.document.root_element().children().any(|node| node.has_tag_name("track"))
    }

    /// File and line.
    fn line(&self, node: Node<'_, '_>) -> String {
        format!("{}:{}", self.what, self.document.text_pos_at(node.range().start).row)
    }

    fn attribute<'n>(&self, node: Node<'n, '_>, name: &str) -> Result<&'n str> {
        let missing = || {
            let message = format!("`{}` has no `{name}`", node.tag_name().name());
            Error::Format { what: self.line(node), message }
        };
        node.attribute(name).ok_or_else(missing)
    }

    fn number(&self, node: Node<'_, '_>, name: &str, text: &str) -> Result<f64> {
        match text.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(Error::value(self.line(node), name, format!("must be a finite number, not `{text}`"))),
        }
    }

    fn count(&self, node: Node<'_, '_>, name: &str) -> Result<u64> {
        let text = self.attribute(node, name)?;
        let refuse = |_| Error::value(self.line(node), name, format!("must be a whole number, not `{text}`"));
        text.trim().parse().map_err(refuse)
    }

    /// Whether a shape is of the ball, or a track.
    fn is_wanted(&self, node: Node<'_, '_>) -> bool {
        let id = || node.attribute("id").and_then(|id| id.trim().parse().ok());
        self.category.is_none_or(|wanted| node.attribute("label") == Some(wanted))
            && (!node.has_tag_name("track") || self.object.is_none_or(|wanted| id() == Some(wanted)))
    }

    /// The ball by a shape; none for a shape of another kind.
    fn ball(&self, shape: Node<'_, '_>) -> Result<Option<Ball>> {
        let attribute = |name: &str| self.number(shape, name, self.attribute(shape, name)?);
        Ok(Some(match shape.tag_name().name() {
            "points" => {
                let points = self.attribute(shape, "points")?;
                let first = points.split(';').next().unwrap_or_default();
                let (x, y) = first.split_once(',').ok_or_else(|| {
                    Error::value(self.line(shape), "points", format!("must be x,y;x,y;…, not `{points}`"))
                })?;
                Ball::at([self.number(shape, "points", x)?, self.number(shape, "points", y)?])
            }
            "box" => {
                let [left, top, right, bottom] =
                    [attribute("xtl")?, attribute("ytl")?, attribute("xbr")?, attribute("ybr")?];
                Ball::in_box([(left + right) / 2.0, (top + bottom) / 2.0], [right - left, bottom - top])
            }
            "ellipse" => Ball::in_ellipse([attribute("cx")?, attribute("cy")?], [attribute("rx")?, attribute("ry")?]),
            _ => return Ok(None),
        }))
    }

    /// Refuses a size of the pictures that is not the camera's.
    fn check_size(&self, node: Node<'_, '_>, size: Size) -> Result<()> {
        for (name, expected) in ["width", "height"].into_iter().zip([size.width, size.height]) {
            let child = node.children().find(|child| child.has_tag_name(name)).and_then(|child| child.text());
            let Some(text) = node.attribute(name).or(child) else { continue };
            if self.number(node, name, text)? != f64::from(expected) {
                return Err(Error::value(
                    self.line(node),
                    name,
                    format!("is {text} px, but the camera is for {expected} px"),
                ));
            }
        }
        Ok(())
    }

    fn video(&self, source: &Path, options: &ImportOptions) -> Result<Job> {
        let root = self.document.root_element();
        let camera = options.camera()?;
        if let Some(size) = self.document.descendants().find(|node| node.has_tag_name("original_size")) {
            self.check_size(size, camera.size())?;
        }
        let mut labels: BTreeMap<u64, Labelled> = BTreeMap::new();
        for track in root.children().filter(|node| node.has_tag_name("track") && self.is_wanted(*node)) {
            for shape in track.children().filter(Node::is_element) {
                let outside = shape.attribute("outside").is_some_and(|outside| outside.trim() == "1");
                let Some(ball) = self.ball(shape)? else { continue };
                let (frame, what) = (self.count(shape, "frame")?, self.line(shape));
                let label = (!outside).then_some(ball.centre);
                match labels.get(&frame).map(|other| (other.image.is_some(), &other.what)) {
                    // A track that has ended says nothing of what another one sees.
                    Some(_) if outside => continue,
                    Some((true, other)) => {
                        let reason = format!("already has a ball ({other}); keep one, or give --category or --object");
                        return Err(Error::value(what, format!("frame {frame}"), reason));
                    }
                    _ => drop(labels.insert(frame, Labelled { what, image: label, time: None, carried: false })),
                }
            }
        }
        let name = self.document.descendants().find(|node| node.has_tag_name("source"));
        let media = Media::beside(source, options, name.and_then(|name| name.text()))?;
        let id = id_of([source.file_stem().unwrap_or_default().to_string_lossy().as_ref()]);
        let options = options.clone();
        let read = move |scratch: &Path| draft(&labels, &media, &camera, &options, scratch);
        Ok(Job { id, read: Box::new(read) })
    }

    fn images(&self, source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
        let (camera, fps) = (options.camera()?, options.fps()?);
        let own = source.parent().unwrap_or(Path::new(""));
        let beside = Some(own.join("images")).filter(|folder| folder.is_dir());
        let folder = options.pictures.clone().or(beside).unwrap_or_else(|| own.to_path_buf());
        let mut groups: BTreeMap<PathBuf, Vec<Image>> = BTreeMap::new();
        for node in self.document.root_element().children().filter(|node| node.has_tag_name("image")) {
            self.check_size(node, camera.size())?;
            let image = self.image(node)?;
            let group = Path::new(&image.name).parent().unwrap_or(Path::new("")).to_path_buf();
            groups.entry(group).or_default().push(image);
        }
        let stem = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let job = |(group, mut images): (PathBuf, Vec<Image>)| {
            images.sort_by_key(|image| image.frame);
            let first = images.first().map_or(0, |image| image.frame);
            let parts = || group.iter().filter_map(|part| part.to_str()).filter(|part| *part != "..");
            let id = if parts().next().is_some() { id_of(parts()) } else { id_of([stem.as_str()]) };
            let shot = |image: &Image| Shot {
                picture: folder.join(&image.name),
                what: image.what.clone(),
                t: (image.frame - first) as f64 / fps,
                image: image.label,
                world: None,
            };
            let shots: Vec<Shot> = images.iter().map(shot).collect();
            let fps = fps_of_numbers(images.iter().map(|image| image.frame), fps);
            let (camera, scene) = (camera.clone(), options.scene.clone());
            let read = move |_: &Path| Ok(Draft::new(camera.clone(), scene.clone(), fps, shots.clone()));
            Job { id, read: Box::new(read) }
        };
        Ok(groups.into_iter().map(job).collect())
    }

    fn image(&self, node: Node<'_, '_>) -> Result<Image> {
        let mut label = None;
        for shape in node.children().filter(|shape| shape.is_element() && self.is_wanted(*shape)) {
            let Some(Ball { centre: found, .. }) = self.ball(shape)? else { continue };
            if label.is_some() {
                let reason = format!("holds a second ball at ({}, {}); keep one, or give --category", found.x, found.y);
                return Err(Error::value(self.line(shape), "image", reason));
            }
            label = Some(found);
        }
        let name = self.attribute(node, "name")?.to_string();
        Ok(Image { name, frame: self.count(node, "id")?, what: self.line(node), label })
    }
}
