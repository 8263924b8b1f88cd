//! Depth from apparent size: the 3D position of the ball that a model that reads sizes detects.

use nalgebra::{Matrix3, Point2, Point3};

use super::search::SearchResult;
use super::volume_check::VolumeCheck;
use super::{Candidate, Localisation, LocaliseOptions, Localiser, device_name};
use gravisight_geometry::camera::{BallShift, Camera, Detection, symmetric};
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::volume::check_ball_radius;

/// Angle off the camera's axis beyond which few lenses are without distortion, degrees.
const WIDE: f64 = 40.0;

impl Localiser {
    /// The ball's radius, m; refuses `options` without one.
    pub(super) fn ball_radius(&self, options: &LocaliseOptions) -> Result<f64> {
        let Some(radius) = options.ball_radius else {
            let reason = format!(
                "is missing: model `{}` measures a ball's apparent size, and the depth follows from its real radius; give it in \
                 metres (`--ball-radius 0.0335` or `--ball tennis`, `ball: {{ radius: 0.0335 }}`, or a scene)",
                self.card.name
            );
            return Err(Error::value("ball", "radius", reason));
        };
        check_ball_radius(radius)?;
        Ok(radius)
    }

    /// The ball's position in `picture` by its apparent size.
    pub(super) async fn localise_by_size(
        &self,
        picture: &Picture,
        camera: &Camera,
        options: LocaliseOptions,
    ) -> Result<Localisation> {
        let radius = self.ball_radius(&options)?;
        let size = picture.size();
        let camera_of_picture = camera.for_picture(size)?;
        let check =
            options.volume.map(|volume| VolumeCheck { camera: &camera_of_picture, ball_radius: radius, volume });
        let (count, maps) = (options.candidates.max(1), options.maps);
        let SearchResult { mut detections, maps, refused } =
            self.search(picture, Some(&camera_of_picture), options.region, check.as_ref(), count, maps).await?;
        let all_refused = detections.is_empty();
        if let (true, Some((likeliest, _))) = (all_refused, refused.first()) {
            detections.push(Detection { confidence: 0.0, ..*likeliest });
        }
        let Some(best) = detections.first() else {
            return Err(Error::OutputNotFinite { device: device_name(&self.device) });
        };
        let centre = camera_of_picture.ball_from_outline(&best.outline, radius)?;
        let mut notes = picture.notes().to_vec();
        if size != camera.size() {
            notes.push(format!(
                "camera.json is for a {} picture; it was scaled to this picture's {size}",
                camera.size()
            ));
        }
        let not_found = match all_refused {
            true => Some(
                "no ball found: every detection is outside the volume in which the ball can be; the position is that of the likeliest one"
                    .into(),
            ),
            false => self.below_threshold(best.confidence),
        };
        let ball_found = not_found.is_none();
        notes.extend(not_found);
        if let Some((likeliest, reason)) = refused.first() {
            let Point2 { coords } = likeliest.outline.centre;
            notes.push(format!(
                "rejected detections, outside the volume in which the ball can be: {}; the likeliest, at ({:.0}, {:.0}) px with \
                 a confidence of {:.2}: {reason}",
                refused.len(),
                coords.x,
                coords.y,
                likeliest.confidence
            ));
        }
        let off_axis = centre.coords.xy().norm().atan2(centre.z).to_degrees();
        if off_axis > WIDE && camera.distortion().is_none() {
            notes.push(format!(
                "the ball is {off_axis:.0}° off the camera's axis, and camera.json models no lens distortion: if the lens has \
                 any, position and depth are wrong by as much as it distorts there"
            ));
        }
        notes.extend(camera.doubts(None, &[]));
        let candidate = |detection: &Detection| candidate(detection, &camera_of_picture, radius).ok();
        let candidates =
            if options.candidates > 0 { detections.iter().filter_map(candidate).collect() } else { vec![] };
        let image = camera_of_picture.image_from_camera(&centre)?;
        let depth_sigma = best.log_sigma * centre.z;
        let maps = maps.map(|mut maps| {
            let focal = camera_of_picture.intrinsic().fixed_view::<2, 2>(0, 0).determinant().abs().sqrt();
            maps.depth.iter_mut().for_each(|value| *value = (focal * radius) as f32 / *value);
            maps
        });
        Ok(Localisation {
            image: image.coords.into(),
            depth: centre.z,
            depth_sigma: Some(depth_sigma),
            radius_px: Some(best.outline.radius),
            covariance: Some(covariance(best, &camera_of_picture, &image, centre.z)?),
            camera: centre.coords.into(),
            world: camera_of_picture.world_from_camera(&centre).coords.into(),
            ball_found,
            confidence: best.confidence,
            confidence_kind: self.card.confidence_kind(),
            candidates,
            notes,
            maps,
        })
    }
}

impl Localisation {
    /// Adds what a camera's uncertainty makes of the position and of the candidates: `one_sigma` are `camera` displaced by one standard
    /// deviation each ([`Calibration::one_sigma`](gravisight_geometry::camera::Calibration::one_sigma)). `camera` is that of the picture,
    /// `radius` the ball's, m. Without a covariance, as of a model that knows depths by heart, it does nothing.
    ///
    /// # Errors
    /// [`Error::CameraMismatch`] for a displaced camera of another aspect ratio; [`Error::NoBall`] where one cannot see this ball.
    pub fn add_camera_sigma(&mut self, camera: &Camera, radius: f64, one_sigma: &[Camera]) -> Result<()> {
        let Some(covariance) = &mut self.covariance else { return Ok(()) };
        let mut sum = Matrix3::from_fn(|row, column| covariance[row][column]);
        let shifts = camera.ball_shifts(&self.camera.into(), radius, one_sigma)?;
        shifts.iter().for_each(|BallShift { world, .. }| sum += world * world.transpose());
        *covariance = symmetric(&sum);
        let along = |shifts: &[BallShift]| shifts.iter().map(|shift| shift.depth * shift.depth).sum::<f64>().sqrt();
        self.depth_sigma = self.depth_sigma.map(|sigma| sigma.hypot(along(&shifts)));
        for candidate in &mut self.candidates {
            let in_camera = camera.camera_from_world(&candidate.world.into());
            let shifts = camera.ball_shifts(&in_camera, radius, one_sigma)?;
            candidate.depth_sigma = candidate.depth_sigma.hypot(along(&shifts));
        }
        Ok(())
    }
}

fn candidate(detection: &Detection, camera: &Camera, radius: f64) -> Result<Candidate> {
    let centre = camera.ball_from_outline(&detection.outline, radius)?;
    Ok(Candidate {
        image: camera.image_from_camera(&centre)?.coords.into(),
        radius_px: detection.outline.radius,
        depth: centre.z,
        depth_sigma: detection.log_sigma * centre.z,
        world: camera.world_from_camera(&centre).coords.into(),
        confidence: detection.confidence,
    })
}

/// Covariance of the position in the world, m²: of the centre along each axis of the picture and of the depth.
fn covariance(detection: &Detection, camera: &Camera, image: &Point2<f64>, depth: f64) -> Result<[[f64; 3]; 3]> {
    let (_, jacobian): (Point3<f64>, Matrix3<f64>) = camera.world_from_image_with_jacobian(image, depth)?;
    let centre = detection.sigma_px().powi(2);
    let own = Matrix3::from_diagonal(&[centre, centre, (detection.log_sigma * depth).powi(2)].into());
    Ok(symmetric(&(jacobian * own * jacobian.transpose())))
}
