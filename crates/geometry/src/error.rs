//! The crate's one error type: what went wrong, where, and what to do about it.

use std::path::PathBuf;

use crate::size::Size;

/// Result with the crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// Why an input was refused or an operation failed.
///
/// Every variant carries the offending numbers or names; its text says what to do.
/// [`Error::code`] is the stable, machine-readable name that JavaScript sees.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{path}: {cause}", path = path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        cause: std::io::Error,
    },
    /// A JSON or TOML text does not have the expected form (unknown or missing field, wrong type).
    #[error("{what}: {message}")]
    Format {
        /// The file, or the file and line.
        what: String,
        /// The parser's message; it names the field.
        message: String,
    },
    /// A number in a file is outside its range, NaN or infinite.
    #[error("{what}: `{field}` {reason}")]
    Value {
        /// The file or object the field belongs to.
        what: String,
        /// The field's name.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A text is no `camera.json` (unknown or missing field, wrong type).
    #[error("{what}: {message}")]
    CameraFormat {
        /// The file, or where the camera came from.
        what: String,
        /// The parser's message; it names the field.
        message: String,
    },
    /// A number of a camera is outside its range, NaN or infinite.
    #[error("{what}: `{field}` {reason}")]
    CameraValue {
        /// The file, or where the camera came from.
        what: String,
        /// The field's name.
        field: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A matrix of a camera cannot be inverted.
    #[error("{what}: `{field}` is singular (determinant {determinant:e}); check its rows")]
    CameraSingular {
        /// The file, or where the camera came from.
        what: String,
        /// `intrinsic` or `camera_from_world`.
        field: &'static str,
        /// The determinant found.
        determinant: f64,
    },
    /// The camera speaks of a picture of another shape than the one given.
    #[error(
        "camera.json is for a {camera} picture, but this picture is {picture}: the aspect ratios differ, so \
         the camera cannot be scaled; give the camera of this picture (if the picture was cropped, adapt \
         camera.json)"
    )]
    CameraMismatch {
        /// The pictures' size in `camera.json`.
        camera: Size,
        /// The size of the picture.
        picture: Size,
    },
    /// A point at or behind the camera has no image.
    #[error("a point at camera depth {depth} m is not in front of the camera and has no image")]
    BehindCamera {
        /// z in the camera frame, m.
        depth: f64,
    },
    /// The lens model cannot be inverted at a pixel.
    #[error(
        "the lens distortion cannot be inverted at normalised image point ({x:.4}, {y:.4}) \
         (residual {residual:.1e} after {iterations} iterations): the point lies outside the lens model's range"
    )]
    Distortion {
        /// Distorted normalised x.
        x: f64,
        /// Distorted normalised y.
        y: f64,
        /// Remaining error, normalised units.
        residual: f64,
        /// Newton iterations spent.
        iterations: usize,
    },
    /// A point lies beyond the radius at which the lens model folds over, and has no image.
    #[error(
        "the normalised image point ({x:.4}, {y:.4}) has no image: it lies outside the lens model's range, beyond \
         the radius at which the distortion folds over"
    )]
    OutsideLens {
        /// Ideal normalised x.
        x: f64,
        /// Ideal normalised y.
        y: f64,
    },
    /// No ball has the outline that was read in a picture, or it is not found.
    #[error(
        "no ball has an outline of {radius:.1} px radius at ({x:.1}, {y:.1}) px in this camera's picture: check the camera's \
         intrinsics and distortion"
    )]
    NoBall {
        /// Centre of the outline, px.
        x: f64,
        /// Centre of the outline, px.
        y: f64,
        /// Radius of the outline, px.
        radius: f64,
    },
    /// Labelled points do not fix a camera.
    #[error("calibration: {reason}")]
    Calibration {
        /// Why, and what to do.
        reason: String,
    },
    /// The bytes are not a whole PNG, JPEG or WebP picture.
    #[error("the picture cannot be read: {reason}; give a whole PNG, JPEG or WebP file")]
    ImageDecode {
        /// The decoder's message.
        reason: String,
    },
    /// A browser does not give the pixels or the bytes of a picture.
    #[error("{what}: {cause}")]
    ImageRead {
        /// What could not be done.
        what: &'static str,
        /// What the browser said.
        cause: String,
    },
    /// The picture has too few or too many pixels.
    #[error(
        "a picture of {width}×{height} is refused: sides must be at least {min_side} px and \
         the whole at most {max_pixels} pixels"
    )]
    ImageSize {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// Smallest side accepted, px.
        min_side: u32,
        /// Largest number of pixels accepted.
        max_pixels: u64,
    },
    /// The weights are not a whole safetensors file.
    #[error("weights: not a whole safetensors file ({reason}); download or copy it again")]
    WeightsFile {
        /// The parser's message.
        reason: String,
    },
    /// The weights are not those that the card speaks of.
    #[error("weights: sha256 is {found}, but the card says {expected}; download card and weights again")]
    WeightsSha256 {
        /// From the card.
        expected: String,
        /// Of the bytes given.
        found: String,
    },
    /// The weights belong to another architecture.
    #[error("weights: not for this architecture: {reason}")]
    WeightsArchitecture {
        /// The tensor and what is wrong with it.
        reason: String,
    },
    /// A weight is NaN or infinite.
    #[error("weights: tensor `{tensor}` holds NaN or infinity; the file is damaged or its training diverged")]
    WeightsNotFinite {
        /// The tensor's name.
        tensor: String,
    },
    /// The network's output is not finite.
    #[error(
        "the network's output for this picture is not finite (NaN or infinity); the {device} device cannot be trusted with this model"
    )]
    OutputNotFinite {
        /// The device's name.
        device: String,
    },
    /// The device asked for is not there or failed.
    #[error("device `{device}`: {reason}")]
    Device {
        /// The device's name.
        device: String,
        /// What is missing or failed.
        reason: String,
    },
    /// A data set lacks what the operation needs.
    #[error("{what}: {reason}")]
    Data {
        /// The clip, frame or folder.
        what: String,
        /// What is missing.
        reason: String,
    },
    /// A track cannot be fitted.
    #[error("fit: {reason}")]
    Fit {
        /// Why, and what to do.
        reason: String,
    },
    /// Training produced a loss that is not finite, or many times what it was before.
    #[error(
        "training diverged: the loss at step {step} is {loss}; lower `learning_rate` in the run folder's run.toml and \
         continue with --resume; the best weights so far are kept in its checkpoints"
    )]
    Diverged {
        /// Optimiser step.
        step: usize,
        /// The loss found.
        loss: f64,
    },
}

/// Why a text is not the JSON that it should be, in words.
#[doc(hidden)]
pub fn json_refusal(error: &serde_json::Error) -> String {
    match error.is_data() {
        true => error.to_string(),
        false => format!("is not JSON ({error})"),
    }
}

impl Error {
    /// Stable name of the kind of error, for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Io { .. } => "io",
            Self::Format { .. } => "format",
            Self::Value { .. } => "value",
            Self::CameraFormat { .. } => "camera-format",
            Self::CameraValue { .. } => "camera-value",
            Self::CameraSingular { .. } => "camera-singular",
            Self::CameraMismatch { .. } => "camera-mismatch",
            Self::BehindCamera { .. } => "behind-camera",
            Self::NoBall { .. } => "no-ball",
            Self::Distortion { .. } | Self::OutsideLens { .. } => "distortion",
            Self::Calibration { .. } => "calibration",
            Self::ImageDecode { .. } => "image-decode",
            Self::ImageRead { .. } => "image-read",
            Self::ImageSize { .. } => "image-size",
            Self::WeightsFile { .. } => "weights-file",
            Self::WeightsSha256 { .. } => "weights-sha256",
            Self::WeightsArchitecture { .. } => "weights-architecture",
            Self::WeightsNotFinite { .. } => "weights-not-finite",
            Self::OutputNotFinite { .. } => "output-not-finite",
            Self::Device { .. } => "device",
            Self::Data { .. } => "data",
            Self::Fit { .. } => "fit",
            Self::Diverged { .. } => "diverged",
        }
    }

    /// An [`Error::Io`] at `path`, for `map_err`.
    pub fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |cause| Self::Io { path, cause }
    }

    /// An [`Error::Format`] in `what`, for `map_err`.
    pub fn format<M: std::fmt::Display>(what: impl Into<String>) -> impl FnOnce(M) -> Self {
        let what = what.into();
        move |message| Self::Format { what, message: message.to_string() }
    }

    /// This, of a text of another form: says as well what was `expected` there and where to get it.
    #[doc(hidden)]
    pub fn expecting(self, expected: &str) -> Self {
        let with = |message: String| format!("{message}; {expected}");
        match self {
            Self::Format { what, message } => Self::Format { what, message: with(message) },
            Self::CameraFormat { what, message } => Self::CameraFormat { what, message: with(message) },
            other => other,
        }
    }

    /// An [`Error::Value`] for the function's caller to return.
    pub fn value(what: impl Into<String>, field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Value { what: what.into(), field: field.into(), reason: reason.into() }
    }
}
