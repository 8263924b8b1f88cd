//! The paper's own numbers, for data that is the paper's.

use gravisight::Clip;
use gravisight::internal::{self, Shot};

/// Largest difference between two descriptions of the same box, m (and rad).
const SAME_BOX: f64 = 1e-3;

/// Where a clip belongs in the paper's data sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PaperCamera {
    /// Synthetic data set: environment and camera.
    Synthetic { environment: usize, camera: usize },
    /// Real data set: camera.
    Real { camera: usize },
    /// Ball on a spring.
    Spring,
}

/// DtG of one of the paper's models: which, mean, standard deviation; cm.
pub type PaperScore = (&'static str, f64, f64);

/// Per camera of the first environment (tab. DtG_synthetic_cam_full).
const SD_M: [(f64, f64); 9] = [
    (19.0, 10.0),
    (19.0, 18.0),
    (28.0, 24.0),
    (13.0, 9.0),
    (26.0, 12.0),
    (19.0, 14.0),
    (27.0, 23.0),
    (23.0, 9.0),
    (21.0, 10.0),
];
const SD_L: [(f64, f64); 9] = [
    (11.0, 6.0),
    (20.0, 19.0),
    (28.0, 25.0),
    (11.0, 8.0),
    (10.0, 6.0),
    (19.0, 13.0),
    (28.0, 25.0),
    (15.0, 8.0),
    (16.0, 7.0),
];
/// Per environment, over all nine cameras (tab. DtG_synthetic_env).
const SD_L_ENVIRONMENTS: [(f64, f64); 3] = [(18.0, 16.0), (17.0, 16.0), (18.0, 13.0)];
/// Per camera (tab. DtG_real).
const RD: [(f64, f64); 2] = [(7.0, 4.0), (6.0, 4.0)];

impl PaperCamera {
    /// The place that the clip's id names (`…/env1/cam2/…`, `…/real/cam1/…`, `…/spring/…`). A synthetic one counts
    /// only if the clip's scene has the boxes of the paper's environment: `env1` is a name that anyone could give.
    pub fn of(clip: &Clip) -> Option<Self> {
        let parts: Vec<&str> = clip.id.split('/').collect();
        let number = |prefix: &str| parts.iter().find_map(|part| part.strip_prefix(prefix)?.parse::<usize>().ok());
        if parts.contains(&"spring") {
            return Some(Self::Spring);
        }
        let camera = number("cam")?;
        if parts.contains(&"real") {
            return Some(Self::Real { camera });
        }
        let environment = number("env")?;
        let known = Shot { site: internal::Site::Environment(environment), camera }.scene().ok()?.boxes;
        let boxes = &clip.scene.as_ref()?.boxes;
        let same = |index: usize| {
            let [ours, theirs] =
                [&boxes[index], &known[index]].map(|it| [&it.position[..], &it.half_size, &[it.yaw]].concat());
            let pairs = ours.into_iter().zip(theirs);
            pairs.into_iter().all(|(a, b)| (a - b).abs() < SAME_BOX)
        };
        let all = boxes.len() == known.len() && (0..known.len()).all(same);
        all.then_some(Self::Synthetic { environment, camera })
    }

    /// Whether both are of one environment (or of one data set, where it has but one).
    pub fn same_environment(self, other: Self) -> bool {
        match (self, other) {
            (Self::Synthetic { environment: a, .. }, Self::Synthetic { environment: b, .. }) => a == b,
            (a, b) => std::mem::discriminant(&a) == std::mem::discriminant(&b),
        }
    }

    /// What the paper's models scored for this camera.
    pub fn scores(self) -> Vec<PaperScore> {
        let of = |table: &[(f64, f64)], camera: usize, name| {
            table.get(camera.wrapping_sub(1)).map(|&(mean, deviation)| (name, mean, deviation))
        };
        match self {
            Self::Synthetic { environment: 1, camera } => {
                let sd_s = (camera == 1).then_some(("SD-S", 22.0, 19.0));
                [sd_s, of(&SD_M, camera, "SD-M"), of(&SD_L, camera, "SD-L")].into_iter().flatten().collect()
            }
            Self::Synthetic { .. } => Vec::new(),
            Self::Real { camera } => of(&RD, camera, "RD").into_iter().collect(),
            Self::Spring => vec![("numeric", 9.0, 15.0), ("analytic", 10.0, 16.0)],
        }
    }

    /// What they scored for this environment, over all nine cameras.
    pub fn environment_scores(self) -> Vec<PaperScore> {
        let Self::Synthetic { environment, .. } = self else { return Vec::new() };
        let sd_m = (environment == 1).then_some(("SD-M", 22.0, 16.0));
        let sd_l = SD_L_ENVIRONMENTS.get(environment.wrapping_sub(1));
        sd_m.into_iter().chain(sd_l.map(|&(mean, deviation)| ("SD-L", mean, deviation))).collect()
    }
}
