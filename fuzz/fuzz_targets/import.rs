//! Files of other people's data sets, of which one is any bytes: refused, or imported as clips that can be read.
#![no_main]

use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use gravisight::{Camera, Clips};
use gravisight_cli::import::{Format, ImportOptions, drawn_track, import};
use libfuzzer_sys::fuzz_target;

/// Format, what is imported, and the file that is any bytes, below tests/golden/import.
const FILES: [(Format, &str, &str); 15] = [
    (Format::Sd, "sd", "sd/synthetic_dataset/train/xml0/camera0/7/label.csv"),
    (Format::Sd, "sd", "sd/synthetic_dataset/train/xml0/camera0/7/info.txt"),
    (Format::Sd, "sd", "sd/synthetic_dataset/train/xml0/camera0/7/image-2.png"),
    (Format::Rd, "rd", "rd/real_dataset/train/camera1/0/labels.csv"),
    (Format::Rd, "rd", "rd/real_dataset/train/camera1/0/timestamps.csv"),
    (Format::Rd, "rd", "rd/real_dataset/train/camera1/0/metadata.csv"),
    (Format::Rd, "rd", NPZ),
    (Format::Coco, "coco/instances.json", "coco/instances.json"),
    (Format::Cvat, "cvat/images.xml", "cvat/images.xml"),
    (Format::Cvat, "cvat/rally.xml", "cvat/rally.xml"),
    (Format::Tracknet, "tracknet", "tracknet/match/1_02.csv"),
    (Format::Yolo, "yolo", "yolo/data.yaml"),
    (Format::Yolo, "yolo", "yolo/labels/train/rally_004.txt"),
    (Format::Labelme, "labelme", "labelme/throw/2.json"),
    (Format::LabelStudio, "label_studio/project-4.json", "label_studio/project-4.json"),
];
const NPZ: &str = "rd/real_dataset/train/camera1/matrices.npz";

/// A copy of the fixtures for each process.
static SETS: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("gravisight-fuzz-{}", std::process::id()));
    copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/import"), &folder);
    folder
});

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &to);
        } else {
            std::fs::copy(entry.path(), to).unwrap();
        }
    }
}

/// A `.npz` whose arrays hold these bytes: a mutated archive's checksums would not let them through.
fn npz(array: &[u8]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(vec![]));
    for name in ["Mint.npy", "Mext.npy"] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(array).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fuzz_target!(|bytes: &[u8]| {
    let Some((which, rest)) = bytes.split_first() else { return };
    let (format, source, file) = FILES[usize::from(*which % 128) % FILES.len()];
    let path = SETS.join(file);
    let whole = std::fs::read(&path).unwrap();
    let spoilt = if file == NPZ && *which > 127 { npz(rest) } else { rest.to_vec() };
    std::fs::write(&path, spoilt).unwrap();
    let own = matches!(format, Format::Sd | Format::Rd);
    let camera = (!own).then(|| Camera::from_file(&SETS.join("camera.json")).unwrap());
    let fps = (!own).then_some(50.0);
    let category = (*which > 127 && !own && format != Format::Tracknet).then(|| "ball".into());
    let options = ImportOptions { camera, fps, category, ..ImportOptions::default() };
    let out = SETS.join("out");
    if let Ok(report) = import(format, &SETS.join(source), &out, &options, &mut |_, _| ()) {
        let clips = Clips::read(&out).unwrap();
        assert_eq!(clips.clips.len(), report.clips);
        std::fs::remove_dir_all(&out).unwrap();
    }
    if let Ok(found) = drawn_track(format, &SETS.join(source), &options) {
        assert!(
            found.track.points.iter().filter_map(|point| point.image()).all(|at| at.x.is_finite() && at.y.is_finite())
        );
        found.track.to_csv().unwrap();
    }
    std::fs::write(&path, whole).unwrap();
});
