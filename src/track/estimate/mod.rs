//! The trajectory estimator: from rays to flights between contacts whose place the scene knows and hits that it does not.

mod change_points;
mod config;
mod model;
mod normal;
mod observation;
mod rays;
mod result;
mod search;
mod solve;
mod trajectory;

use std::sync::Arc;

use self::model::Model;
use self::observation::Observation;
use self::search::Search;
use super::fit::{Fit, FitOptions, Observation as Label};
use crate::camera::Camera;
use crate::physics::Forecaster;

/// The flights that explain the labels best; none where nothing does.
pub fn estimated(
    forecaster: &Forecaster,
    camera: &Camera,
    labels: &[Label],
    options: &FitOptions,
    smooth: f64,
) -> Option<Fit> {
    let radius = forecaster.scene().ball.radius;
    let of = |label: &Label| Observation::of(label, camera, radius).ok();
    let observations: Vec<Observation> = labels.iter().map(of).collect::<Option<_>>()?;
    let [width, height] = camera.size().xy();
    let model = Model::new(forecaster, &observations, width * height, options.noise_px)?;
    let times = Arc::new(labels.iter().map(|label| label.time).collect::<Vec<f64>>());
    let start = options.noise_px.unwrap_or(smooth.clamp(0.3, 3.0)).max(0.1);
    let search = Search::new(&model, times, start, options.hits)?;
    let found = search.found();
    if let Ok(t) = std::env::var("TRUTH") {
        let v: Vec<f64> = t.split(',').map(|x| x.parse().unwrap()).collect();
        if let Some(it) = search.debug_from(&v) {
            println!("  TRUTH {:.1} noise {:.2} {:?} start {:.2?} v {:.1?} strains {:.1?}", it.cost, it.trajectory.noise, it.trajectory.segments.iter().map(|s| format!("{:?}@{:.3}", s.begin, s.time)).collect::<Vec<_>>(), it.trajectory.segments[0].position().as_slice(), it.trajectory.segments[0].velocity().as_slice(), model.strains(&it.trajectory));
        }
    }
    if std::env::var_os("DBG").is_some() {
        for it in &found {
            let strains = model.strains(&it.trajectory);
            println!("  {:.1} noise {:.2} {:?} start {:.2?} v {:.1?} strains {:.1?}", it.cost, it.trajectory.noise, it.trajectory.segments.iter().map(|s| format!("{:?}@{:.3}", s.begin, s.time)).collect::<Vec<_>>(), it.trajectory.segments[0].position().as_slice(), it.trajectory.segments[0].velocity().as_slice(), strains.iter().map(|s| s.0).collect::<Vec<_>>());
        }
    }
    model.result(&found, smooth)
}
