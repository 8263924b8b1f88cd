//! A camera that nobody calibrated: a phone's, held level. Every number is an assumption with a standard deviation.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;

use super::{Camera, Distortion};
use crate::error::{Error, Result};
use crate::size::Size;

/// 35 mm equivalent of a phone's main camera, mm. Makers state 22 to 30 mm, which is read as ± 2 σ
/// (thesmartphonephotographer.com/types-of-mobile-phone-cameras; 26 mm of most iPhones from 2018 to 2021).
const PHONE_FOCAL: [f64; 2] = [26.0, 2.0];
/// Standard deviation of a 35 mm equivalent that a file states, mm. Chosen: EXIF's `FocalLengthIn35mmFilm` is a whole number, and makers
/// round a lens's nominal length.
const STATED_FOCAL_SIGMA: f64 = 0.5;
/// Diagonal of a 35 mm film's picture of 36 × 24 mm, mm: equivalents compare diagonals (CIPA DCG-001-2005, 3.3).
const FILM_DIAGONAL: f64 = 43.266_615;
/// Sides of a phone's sensor: its videos of 16:9 are cut from it, as wide as it is.
const SENSOR_ASPECT: f64 = 4.0 / 3.0;
/// A picture longer than this is cut from a sensor of [`SENSOR_ASPECT`]: film and most other sensors have 3:2.
const LONGEST_WHOLE: f64 = 1.55;
/// How much longer stabilisation makes a video's focal length, and its standard deviation: it cuts off 0 to 10 % of the picture
/// (gizmohopper.com/glossary/eis: "usually 5-10 %"; phones with optical stabilisation cut less).
const STABILISED: [f64; 2] = [1.05, 0.05];
/// Height of a phone above the ground, m. Chosen: between an adult's chest and eyes, 1.3 to 1.7 m.
const HEIGHT: [f64; 2] = [1.5, 0.2];
/// Standard deviation of a height that a person states, m. Chosen: a hand's breadth.
const STATED_HEIGHT_SIGMA: f64 = 0.1;
/// Standard deviation of the direction up or down in which a phone is held, degrees. Chosen: nothing in the picture shows it.
const PITCH_SIGMA: f64 = 5.0;
/// Standard deviation of its tilt to one side, degrees. Chosen: people notice 1° (Gallagher, "Using vanishing points to correct camera
/// rotation in images", 2005).
const ROLL_SIGMA: f64 = 2.0;
/// 35 mm equivalents that lenses have, mm.
const FOCAL_RANGE: [f64; 2] = [5.0, 3000.0];
/// Heights that a camera can have, m.
const HEIGHT_RANGE: [f64; 2] = [0.0, 1000.0];

/// What is known of a camera that nobody calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnownOfCamera {
    /// 35 mm equivalent of the focal length, mm, as EXIF's `FocalLengthIn35mmFilm`; of a phone's main camera if missing.
    pub focal_35mm: Option<f64>,
    /// Height of the lens above the ground, m; that of a phone in a person's hands if missing.
    pub height: Option<f64>,
    /// Whether the picture is a video's, which stabilisation crops.
    pub video: bool,
}

/// A number that was assumed.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
pub struct Assumption {
    /// What it is, in words.
    pub what: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// The unit of both.
    pub unit: String,
}

/// A camera that is assumed, and how unsure it is.
#[derive(Debug, Clone, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), serde(rename_all = "camelCase"))]
pub struct AssumedCamera {
    /// The camera. The world's origin is on the ground below the lens; y points where the camera looks, x to its right, z up.
    pub camera: Camera,
    /// The camera moved by one standard deviation along each of the assumptions, as
    /// [`Calibration::one_sigma`](super::Calibration::one_sigma).
    pub one_sigma: Vec<Camera>,
    /// What was assumed, each with its standard deviation.
    pub assumptions: Vec<Assumption>,
    /// The same in words, for people.
    pub note: String,
}

/// The camera of pictures of `size`: a phone's main camera, held level about 1.5 m above the ground, unless more is `known`.
///
/// Pitch and roll are 0° within 5° and 2°; the focal length has 8 %, or what is known of it.
/// It is for distances and speeds near the camera, not for places on a court.
///
/// # Errors
/// [`Error::Value`] for a focal length or a height that no camera has; [`Error::CameraValue`] for a size of zero.
///
/// ```
/// # mod gravisight { pub use gravisight_geometry::{camera, size::*}; }
/// use gravisight::Size;
/// use gravisight::camera::{KnownOfCamera, assumed_camera};
///
/// let assumed = assumed_camera(Size::new(4032, 3024), &KnownOfCamera::default())?;
/// assert_eq!(assumed.one_sigma.len(), 4);
/// assert!((assumed.camera.intrinsic()[(0, 0)] - 3028.7).abs() < 0.1);
/// # Ok::<(), gravisight_geometry::error::Error>(())
/// ```
pub fn assumed_camera(size: Size, known: &KnownOfCamera) -> Result<AssumedCamera> {
    let focal_35mm = checked("focal35mm", known.focal_35mm, FOCAL_RANGE, "mm, the 35 mm equivalent")?;
    let height = checked("heightAboveGround", known.height, HEIGHT_RANGE, "m")?;
    let stated = |value: Option<f64>, sigma: f64, else_: [f64; 2]| value.map_or(else_, |value| [value, sigma]);
    let [focal_35mm, focal_35mm_sigma] = stated(focal_35mm, STATED_FOCAL_SIGMA, PHONE_FOCAL);
    let [height, height_sigma] = stated(height, STATED_HEIGHT_SIGMA, HEIGHT);
    let [crop, crop_sigma] = if known.video { STABILISED } else { [1.0, 0.0] };
    let focal = crop * focal_35mm * diagonal(size) / FILM_DIAGONAL;
    let focal_sigma = focal * (focal_35mm_sigma / focal_35mm).hypot(crop_sigma / crop);
    let camera = |focal: f64, [pitch, roll]: [f64; 2], height: f64| {
        let [cx, cy] = size.xy().map(|side| (side - 1.0) / 2.0);
        let intrinsic = Matrix3::new(focal, 0.0, cx, 0.0, focal, cy, 0.0, 0.0, 1.0);
        let level = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);
        let tilt = Rotation3::from_axis_angle(&Vector3::z_axis(), roll.to_radians())
            * Rotation3::from_axis_angle(&Vector3::x_axis(), pitch.to_radians());
        let rotation = tilt.matrix() * level;
        Camera::new(size, intrinsic, Distortion::default(), rotation, -rotation * Vector3::new(0.0, 0.0, height))
    };
    let assumption = |what: &str, value: f64, sigma: f64, unit: &str| Assumption {
        what: what.into(),
        value,
        sigma,
        unit: unit.into(),
    };
    let assumptions = vec![
        assumption("focal length", focal, focal_sigma, "px"),
        assumption("tilt up or down", 0.0, PITCH_SIGMA, "degrees"),
        assumption("tilt to one side", 0.0, ROLL_SIGMA, "degrees"),
        assumption("height above the ground", height, height_sigma, "m"),
    ];
    let whose = match known.focal_35mm {
        Some(_) => format!("A lens of {focal_35mm:.0} mm equivalent, which the file or a person states"),
        None => format!("The main camera of a phone, {focal_35mm:.0} mm equivalent"),
    };
    let note = format!(
        "Assumed, not measured. {whose}: focal length {focal:.0} ± {focal_sigma:.0} px. Held level within {PITCH_SIGMA:.0}° up or down and \
         {ROLL_SIGMA:.0}° to one side, {height:.1} ± {height_sigma:.1} m above the ground. The world’s origin is on the ground below the lens. \
         Each ± includes all of this."
    );
    Ok(AssumedCamera {
        camera: camera(focal, [0.0; 2], height)?,
        one_sigma: vec![
            camera(focal + focal_sigma, [0.0; 2], height)?,
            camera(focal, [PITCH_SIGMA, 0.0], height)?,
            camera(focal, [0.0, ROLL_SIGMA], height)?,
            camera(focal, [0.0; 2], height + height_sigma)?,
        ],
        assumptions,
        note,
    })
}

/// Diagonal of the sensor of which a picture shows the whole width, px.
fn diagonal(size: Size) -> f64 {
    let [width, height] = size.xy();
    let (long, short) = (width.max(height), width.min(height));
    if long > LONGEST_WHOLE * short { long.hypot(long / SENSOR_ASPECT) } else { long.hypot(short) }
}

fn checked(field: &str, value: Option<f64>, [least, most]: [f64; 2], unit: &str) -> Result<Option<f64>> {
    match value {
        Some(value) if !(least..=most).contains(&value) => {
            Err(Error::value("assumed camera", field, format!("must be from {least} to {most} {unit}, not {value}")))
        }
        value => Ok(value),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    const PHONE: Size = Size::new(4032, 3024);

    #[test]
    fn a_phone_that_nobody_calibrated_is_level_and_sees_as_wide_as_phones_do() {
        let AssumedCamera { camera, one_sigma, assumptions, note } =
            assumed_camera(PHONE, &KnownOfCamera::default()).unwrap();
        // ARKit reports 1440 to 1450 px for the 26 mm camera of iPhones in pictures of 1920 × 1440.
        assert!((camera.intrinsic()[(0, 0)] * 1920.0 / 4032.0 - 1445.0).abs() < 10.0);
        // What is as high as the lens is on the middle row, however far away.
        for distance in [2.0, 50.0] {
            let seen = camera.image_from_world(&Point3::new(0.0, distance, 1.5)).unwrap();
            assert!((seen.x - 2015.5).abs() < 1e-9 && (seen.y - 1511.5).abs() < 1e-9, "{seen}");
        }
        assert_eq!((one_sigma.len(), assumptions.len()), (4, 4));
        assert!(note.contains("26 mm") && note.contains("1.5 ± 0.2 m") && note.contains("5°"), "{note}");
    }

    #[test]
    fn each_assumption_moves_the_camera_by_its_own_sigma() {
        let assumed = assumed_camera(PHONE, &KnownOfCamera::default()).unwrap();
        let camera = &assumed.camera;
        let ahead = Point3::new(0.0, 3.0, 1.5);
        let [focal, pitch, roll, height] = &assumed.one_sigma[..] else { panic!("{}", assumed.one_sigma.len()) };
        assert!((focal.intrinsic()[(0, 0)] / camera.intrinsic()[(0, 0)] - 1.0 - 2.0 / 26.0).abs() < 1e-9);
        let tilted = pitch.camera_from_world(&ahead);
        assert!((tilted.y.atan2(tilted.z).to_degrees().abs() - 5.0).abs() < 1e-9, "{tilted}");
        let up = roll.camera_from_world(&(ahead + Vector3::z())) - roll.camera_from_world(&ahead);
        assert!((up.x.atan2(-up.y).to_degrees().abs() - 2.0).abs() < 1e-9, "{up}");
        assert!((height.camera_from_world(&ahead).y - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_stated_lens_and_height_are_surer_than_assumed_ones_and_a_video_less_sure() {
        let sigma = |known: KnownOfCamera, size: Size| {
            let assumed = assumed_camera(size, &known).unwrap();
            [0, 3].map(|index| assumed.assumptions[index].sigma / assumed.assumptions[index].value)
        };
        let plain = KnownOfCamera::default();
        let known = KnownOfCamera { focal_35mm: Some(26.0), height: Some(1.5), video: false };
        let [assumed, stated] = [sigma(plain, PHONE), sigma(known, PHONE)];
        assert!(stated[0] < 0.3 * assumed[0] && stated[1] < 0.6 * assumed[1], "{stated:?} {assumed:?}");
        assert!(sigma(KnownOfCamera { video: true, ..plain }, PHONE)[0] > 1.1 * assumed[0]);
    }

    #[test]
    fn a_video_of_16_to_9_is_as_wide_as_its_sensor_and_a_turned_picture_as_tall() {
        let focal = |width, height| {
            assumed_camera(Size::new(width, height), &KnownOfCamera::default()).unwrap().camera.intrinsic()[(0, 0)]
        };
        assert!((focal(1920, 1080) - focal(1920, 1440)).abs() < 1e-9);
        assert!((focal(3024, 4032) - focal(4032, 3024)).abs() < 1e-9);
        // A camera of 3:2 shows all of its picture: 36 mm of film are as wide.
        assert!((focal(3600, 2400) - 2600.0).abs() < 0.1);
    }

    #[test]
    fn a_lens_or_a_height_that_no_camera_has_is_refused_by_name() {
        let refused = |known| assumed_camera(PHONE, &known).unwrap_err().to_string();
        let plain = KnownOfCamera::default();
        assert!(refused(KnownOfCamera { focal_35mm: Some(0.0), ..plain }).contains("focal35mm"));
        assert!(refused(KnownOfCamera { focal_35mm: Some(f64::NAN), ..plain }).contains("focal35mm"));
        assert!(refused(KnownOfCamera { height: Some(-1.0), ..plain }).contains("heightAboveGround"));
        assert!(assumed_camera(Size::new(0, 100), &plain).is_err());
    }
}
