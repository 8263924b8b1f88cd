//! Tracks (`Frame,Visibility,X,Y`) beside their frames or videos.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::ImportOptions;
use super::draft::{Draft, Job};
use super::pictures::{files_below, has_extension, id_of};
use super::video::{Labelled, Media, draft};
use gravisight::Track;
use gravisight::internal::TrackPoint;
use gravisight::{Error, Result};

/// A job for every track.
pub(super) fn jobs(source: &Path, options: &ImportOptions) -> Result<Vec<Job>> {
    let camera = options.camera()?;
    let tracks = match source.is_dir() {
        true => files_below(source, &|path| has_extension(path, &["csv"]))?,
        false => vec![source.to_path_buf()],
    };
    if options.pictures.is_some() && tracks.len() > 1 {
        let reason = format!(
            "cannot be used: {} holds {} tracks, and each has its own pictures",
            source.display(),
            tracks.len()
        );
        return Err(Error::value("import", "pictures", reason));
    }
    let root = if source.is_dir() { source } else { source.parent().unwrap_or(Path::new("")) };
    let job = |path: PathBuf| {
        let name = path.strip_prefix(root).unwrap_or(&path).with_extension("");
        let id = id_of(name.iter().filter_map(|part| part.to_str()));
        let (camera, options) = (camera.clone(), options.clone());
        let read = move |scratch: &Path| {
            let media = Media::beside(&path, &options, None)?;
            let track = Track::from_file(&path)?;
            let draft = draft(&labels(&track, &path), &media, &camera, &options, scratch)?;
            Ok(Draft { nowhere: track.nowhere, ..draft })
        };
        Job { id, read: Box::new(read) }
    };
    Ok(tracks.into_iter().map(job).collect())
}

fn labels(track: &Track, path: &Path) -> BTreeMap<u64, Labelled> {
    let label = |point: &TrackPoint| {
        let what = format!("{}: frame {}", path.display(), point.frame);
        (point.frame, Labelled { what, image: point.image(), time: point.time, carried: false })
    };
    track.points.iter().map(label).collect()
}
