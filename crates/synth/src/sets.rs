//! The paper's data sets: their environments, cameras and splits, and the names of their clips.

use super::scenes::Paper;
use gravisight_geometry::error::{Error, Result};
use gravisight_physics::Scene;

/// A data set of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Set {
    /// One environment, one camera.
    SdS,
    /// One environment; training cameras 1 to 6, test cameras 1 to 9.
    SdM,
    /// Three environments, cameras as SD-M.
    SdL,
    /// A ball on a spring.
    Spring,
    /// The rendered room that stands in for the paper's real data set, which cannot be had: two cameras, labels as if clicked.
    Rd,
}

/// Which part of a set; parts have no start in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// To learn from.
    Train,
    /// To choose with.
    Val,
    /// To report.
    Test,
}

impl Split {
    /// As in clip ids.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }
}

/// Where a ball moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Site {
    /// One of the paper's environments, by its number.
    Environment(usize),
    /// Around the fixed ball that the spring pulls it to.
    Spring,
    /// The room of the rendered RD.
    Room,
}

/// One place and one camera of a set: a studio in which clips are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shot {
    /// Where.
    pub site: Site,
    /// The paper's number of the camera; the spring has one of its own.
    pub camera: usize,
}

impl Set {
    /// Its shots.
    pub fn shots(self, split: Split) -> Vec<Shot> {
        let cameras = match (self, split) {
            (Self::SdS | Self::Spring, _) => 1..=1,
            (Self::Rd, _) => 1..=2,
            (_, Split::Train) => 1..=6,
            _ => 1..=9,
        };
        let sites = match self {
            Self::Spring => vec![Site::Spring],
            Self::SdS | Self::SdM => vec![Site::Environment(1)],
            Self::SdL => [1, 2, 3].map(Site::Environment).to_vec(),
            Self::Rd => vec![Site::Room],
        };
        sites.into_iter().flat_map(|site| cameras.clone().map(move |camera| Shot { site, camera })).collect()
    }
}

impl Shot {
    /// What the physics needs to know of its environment, or of the spring set.
    ///
    /// # Errors
    /// [`Error::Data`] for an environment that the paper does not have.
    pub fn scene(&self) -> Result<Scene> {
        Paper::get()?.scene(self.site)
    }

    /// How many clips of it the paper has in `split`.
    ///
    /// # Errors
    /// [`Error::Data`] for a camera that the paper does not have.
    pub fn clips(&self, split: Split) -> Result<usize> {
        let paper = Paper::get()?;
        let of_room = || paper.room.clips.get(split.name())?.get(self.camera.checked_sub(1)?).copied();
        match self.site {
            Site::Environment(_) | Site::Spring => Ok(100),
            Site::Room => of_room().ok_or_else(|| {
                let reason = format!("there is no camera {}", self.camera);
                Error::Data { what: "--set".into(), reason }
            }),
        }
    }

    /// A clip's id: `train/env1/cam1/0007`, `train/spring/0007`, `train/room/cam1/0007`.
    pub fn id(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.site {
            Site::Environment(environment) => format!("{split}/env{environment}/cam{}/{number:04}", self.camera),
            Site::Spring => format!("{split}/spring/{number:04}"),
            Site::Room => format!("{split}/room/cam{}/{number:04}", self.camera),
        }
    }

    /// The folder of a clip's pictures, inside the set's.
    pub fn folder(&self, split: Split, number: usize) -> String {
        let split = split.name();
        match self.site {
            Site::Environment(environment) => format!("frames/{split}_e{environment}_c{}_{number:04}", self.camera),
            Site::Spring => format!("frames/{split}_spring_{number:04}"),
            Site::Room => format!("frames/{split}_room_c{}_{number:04}", self.camera),
        }
    }
}
