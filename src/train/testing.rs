//! What the tests of training share.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use burn::tensor::Device;

use crate::testing::{root, scratch, seen_by};
use crate::train::{TrainConfig, TrainEvent, TrainSettings};
use gravisight_clips::Clip;
use gravisight_geometry::error::Error;

/// A run configuration on the samples, its folder, extra lines for the top level.
pub fn configuration(name: &str, extra: &str) -> PathBuf {
    let samples = root().join("tests/samples");
    let text = format!(
        r#"
name = "t"
train = {samples:?}
validation = {samples:?}
out = "out"
supervision = "3d-gt"
checkpoint_every = 2
validate_frames = 2
input = {{ width = 64, height = 64 }}
{extra}
[architecture]
backbone = {{ kind = "compact", stem = 4, stages = [4, 6, 8, 8], pyramid = 4 }}
head = {{ kind = "depthwise" }}
heatmap = {{ beta = 1.0 }}
depth = {{ activation = "exp", scale = 7.4 }}

[[phases]]
steps = 4
batch = 3
crop = 32
learning_rate = 1e-3
[[phases]]
steps = 3
batch = 2
learning_rate = 1e-3
"#
    );
    let path = scratch(name).join("run.toml");
    std::fs::write(&path, text).unwrap();
    path
}

pub fn start(path: &Path, observe: &mut dyn FnMut(TrainEvent)) -> Result<PathBuf, Error> {
    TrainConfig::start(TrainSettings::read(path)?.config()?, &Device::flex(), observe)
}

/// Clips of camera 1: see [`seen_by`].
pub fn synthetic(name: &str, count: usize, drawn: usize, change: impl Fn(&mut Clip)) -> PathBuf {
    seen_by(1, name, count, drawn, change)
}

/// A configuration with other clips and another supervision.
pub fn on(name: &str, clips: &Path, supervision: &str, extra: &str) -> PathBuf {
    let path = configuration(name, extra);
    let text = std::fs::read_to_string(&path).unwrap();
    let samples = format!("{:?}", root().join("tests/samples"));
    let text = text.replace(&samples, &format!("{clips:?}")).replace("3d-gt", supervision);
    std::fs::write(&path, text).unwrap();
    path
}
