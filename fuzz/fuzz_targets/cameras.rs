//! Cameras of other tools, in files of any bytes: refused, or a camera that can be written and read again.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use gravisight::{Camera, Size};
use gravisight_cli::cameras::{Lens, Stated, Units, World, import};
use libfuzzer_sys::fuzz_target;

/// By which the reader is chosen. Of COLMAP's two files one is the fixture.
const NAMES: [&str; 6] = ["camera.yml", "camera.json", "camera.xml", "camera.npz", "colmap/cameras.txt", "colmap/images.txt"];

/// A folder for each process.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("gravisight-fuzz-cameras-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("colmap")).unwrap();
    for (name, text) in [
        ("cameras.txt", include_str!("../../cli/tests/cameras/colmap/cameras.txt")),
        ("images.txt", include_str!("../../cli/tests/cameras/colmap/images.txt")),
    ] {
        std::fs::write(folder.join("colmap").join(name), text).unwrap();
    }
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let Some((&which, rest)) = bytes.split_first() else { return };
    let name = NAMES[usize::from(which % 16) % NAMES.len()];
    let path = FOLDER.join(name);
    let before = name.starts_with("colmap").then(|| std::fs::read(&path).unwrap());
    std::fs::write(&path, rest).unwrap();
    let stated = Stated {
        units: (which & 16 != 0).then_some(Units::Mm),
        world: (which & 32 != 0).then_some(World::YUp),
        size: (which & 64 != 0).then_some(Size::new(1280, 720)),
        lens: (which & 128 != 0).then_some(Lens::Fisheye),
        image: None,
    };
    let given = if before.is_some() { FOLDER.join("colmap") } else { path.clone() };
    if let Ok((camera, _)) = import(&given, &stated, None) {
        Camera::from_json(&serde_json::to_string(&camera).unwrap(), "camera").unwrap();
    }
    if let Some(before) = before {
        std::fs::write(&path, before).unwrap();
    }
});
