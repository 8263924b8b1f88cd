//! Files made to hurt: archives that swell, entities that multiply, headers and tables that claim what nobody has, paths that
//! lead elsewhere. Each is refused in words, soon, and nothing is written outside.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use crate::common::{claiming_size, copy_tree, root, scratch};

/// Longest that a refusal may take: on two busy cores a start of the command takes a good part of it.
const SOON: Duration = Duration::from_secs(20);

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gravisight"));
    command.args(arguments).current_dir(root());
    let began = Instant::now();
    let output = command.output().unwrap();
    assert!(began.elapsed() < SOON, "{arguments:?} took {:?}", began.elapsed());
    output
}

/// What the command said, where it refused.
fn refused(arguments: &[&str]) -> String {
    let output = run(arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn fixtures(name: &str, to: &Path) {
    copy_tree(&root().join("tests/golden/import").join(name), &to.join(name));
}

const CAMERA: &str = "tests/golden/import/camera.json";

#[test]
fn an_archive_that_swells_is_read_to_its_first_megabyte() {
    let folder = scratch("bomb");
    fixtures("rd", &folder);
    let path = folder.join("rd/real_dataset/train/camera1/matrices.npz");
    let file = std::fs::File::create(&path).unwrap();
    let mut archive = zip::ZipWriter::new(file);
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000), }\n";
    for name in ["Mint.npy", "Mext.npy"] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(b"\x93NUMPY\x01\x00").unwrap();
        archive.write_all(&u16::try_from(header.len()).unwrap().to_le_bytes()).unwrap();
        archive.write_all(header.as_bytes()).unwrap();
        (0..200).for_each(|_| archive.write_all(&vec![0; 1 << 20]).unwrap());
    }
    archive.finish().unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() < 1 << 20, "it is small");
    let said = refused(&[
        "import",
        "--from",
        "rd",
        folder.join("rd").to_str().unwrap(),
        "--out",
        folder.join("out").to_str().unwrap(),
    ]);
    assert!(said.contains("matrices.npz") && said.contains("10000000000 numbers"), "{said}");
    assert!(!folder.join("out").exists());
}

#[test]
fn xml_may_define_no_entities() {
    let folder = scratch("entities");
    fixtures("cvat", &folder);
    let path = folder.join("cvat/images.xml");
    let text = std::fs::read_to_string(&path).unwrap();
    let [laughs, file] = [
        "<!DOCTYPE x [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\"><!ENTITY c \"&b;&b;&b;&b;&b;&b;\">]>",
        "<!DOCTYPE x [<!ENTITY c SYSTEM \"file:///etc/passwd\">]>",
    ];
    for doctype in [laughs, file] {
        let spoilt = text.replacen("<annotations>", &format!("{doctype}<annotations>"), 1).replacen("1.1", "&c;", 1);
        std::fs::write(&path, spoilt).unwrap();
        let out = folder.join("out");
        let arguments = ["import", "--from", "cvat", path.to_str().unwrap(), "--camera", CAMERA, "--fps", "50"];
        let said = refused(&[&arguments[..], &["--out", out.to_str().unwrap()]].concat());
        assert!(said.contains("images.xml") && said.contains("DTD"), "{said}");
        assert!(!out.exists());
    }
}

#[test]
fn a_table_of_billions_of_rows_and_one_without_end_are_not_read() {
    let folder = scratch("endless");
    let path = folder.join("track.csv");
    // As large as a billion rows, and takes no room.
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(b"Frame,Visibility,X,Y\n0,1,10,10\n").unwrap();
    file.set_len(12_000_000_000).unwrap();
    let scene = folder.join("scene.json");
    std::fs::write(&scene, serde_json::to_string(&gravisight::Scene::named("floor").unwrap()).unwrap()).unwrap();
    let scene = scene.to_str().unwrap();
    let fit = |track: &str| refused(&["fit", "--track", track, "--camera", CAMERA, "--scene", scene, "--fps", "50"]);
    assert!(fit(path.to_str().unwrap()).contains("512 MB"));
    #[cfg(target_os = "linux")]
    assert!(fit("/dev/zero").contains("512 MB"));
}

#[test]
fn a_header_of_billions_of_pixels_is_refused_before_anything_is_decoded() {
    let folder = scratch("pixels");
    let path = folder.join("huge.png");
    let picture = std::fs::read(root().join("tests/samples/frames").join(first_picture())).unwrap();
    let picture = claiming_size(picture, 0x7fff_ffff, 0x7fff_ffff);
    std::fs::write(&path, picture).unwrap();
    let said = refused(&["localise", path.to_str().unwrap(), "--camera", CAMERA, "--model", "models/sd-l"]);
    assert!(said.contains("pixels"), "{said}");
}

/// The first picture of the samples, below their frames.
fn first_picture() -> String {
    let clips = gravisight::Clips::read(&root().join("tests/samples")).unwrap();
    clips.clips[0].frames[0].file.strip_prefix("frames").unwrap().to_str().unwrap().into()
}

#[test]
fn clips_name_pictures_in_their_own_folder_and_names_of_theirs_write_nowhere_else() {
    let folder = scratch("elsewhere");
    let sample = std::fs::read_to_string(root().join("tests/samples/clips.jsonl")).unwrap();
    let line = sample.lines().next().unwrap();
    let clips = folder.join("clips");
    std::fs::create_dir_all(&clips).unwrap();
    for place in ["../frames/", "/etc/", "frames/../../"] {
        std::fs::write(clips.join("clips.jsonl"), line.replacen("frames/", place, 1)).unwrap();
        let said = refused(&["evaluate", "--data", clips.to_str().unwrap(), "--model", "models/sd-l"]);
        assert!(said.contains("within the clips' folder"), "{said}");
    }
    // A folder of images called `..` does not become a clip outside.
    fixtures("coco", &folder);
    let path = folder.join("coco/instances.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("\"file_name\": \"", "\"file_name\": \"../../../")).unwrap();
    let out = folder.join("deep/er/out");
    let arguments = ["import", "--from", "coco", path.to_str().unwrap(), "--camera", CAMERA, "--fps", "25"];
    let arguments = [&arguments[..], &["--category", "ball", "--out", out.to_str().unwrap()]].concat();
    let output = run(&arguments);
    assert!(matches!(output.status.code(), Some(0 | 1)));
    let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert!(names.iter().all(|name| name == "clips" || name == "coco" || name == "deep"), "{names:?}");
}
