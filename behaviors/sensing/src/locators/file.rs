//! Locator files: a trained model, as JSON with a version.

use super::beginning::{Beginning, Untaught};
use super::calibrated::{Calibrated, Ready};
use super::ensemble::Ensemble;
use super::lens::Lens;
use super::network::PublishedNetwork;
use super::pairing::Ray;
use super::tracker::fuse;
use super::triangulated::Triangulated;
use super::view::{Estimate, KnownView, StereoView};
use crate::learned_file::{self, LearnedFault};
use nalgebra::Matrix3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Noun for this kind of file in messages.
const FILE_NOUN: &str = "locator";
/// Version that is written, and the only one that is read.
pub const LOCATOR_VERSION: u32 = 1;

/// Kind of a locator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LocatorKind {
    /// Triangulation by nominal kinematics.
    Triangulate,
    /// The network published with the paper.
    Network,
    /// Several networks with more inputs.
    Ensemble,
    /// A fitted kinematic model.
    Calibrated,
}

impl LocatorKind {
    /// All kinds.
    pub const ALL: [LocatorKind; 4] =
        [LocatorKind::Triangulate, LocatorKind::Network, LocatorKind::Ensemble, LocatorKind::Calibrated];

    /// Name in files and commands.
    pub fn name(self) -> &'static str {
        match self {
            LocatorKind::Triangulate => "triangulate",
            LocatorKind::Network => "network",
            LocatorKind::Ensemble => "ensemble",
            LocatorKind::Calibrated => "calibrated",
        }
    }
}

/// Trained model of a locator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LearnedPlaces {
    /// Frame of the positions, and noise.
    Triangulate(Box<Triangulated>),
    /// Weights of the published network.
    Network(PublishedNetwork),
    /// Weights of several networks.
    Ensemble(Box<Ensemble>),
    /// Deviations of the head from its nominal kinematics.
    Calibrated(Box<Calibrated>),
}

/// A trained locator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocatorFile {
    /// Name of the file format.
    pub format: String,
    /// Version of the file format.
    pub version: u32,
    /// SHA-256 of the table that it was trained on, in hexadecimal.
    pub data: String,
    /// Seed of all randomness.
    pub seed: u64,
    /// The model.
    pub learned: LearnedPlaces,
}

impl LocatorFile {
    /// Trains on views of known positions. `data`: digest of the table that they are from; `tell`
    /// is called with the completed share.
    ///
    /// # Errors
    /// Unsuitable views, or a training that does not converge.
    pub fn train(
        kind: LocatorKind,
        known: &[KnownView],
        data: String,
        from: &Beginning,
        tell: &mut dyn FnMut(f64),
    ) -> Result<LocatorFile, Untaught> {
        let seed = from.seed;
        let learned = match kind {
            LocatorKind::Triangulate => LearnedPlaces::Triangulate(Box::new(Triangulated::train(known, from)?)),
            LocatorKind::Network => LearnedPlaces::Network(PublishedNetwork::train(known, seed, tell)?),
            LocatorKind::Ensemble => LearnedPlaces::Ensemble(Box::new(Ensemble::train(known, from, tell)?)),
            LocatorKind::Calibrated => LearnedPlaces::Calibrated(Box::new(Calibrated::train(known, from, tell)?)),
        };
        let format = learned_file::format_name(FILE_NOUN);
        let file = LocatorFile { format, version: LOCATOR_VERSION, data, seed, learned };
        let help = "learning did not converge: views or places are far outside of what a head can see";
        if file.is_whole() { Ok(file) } else { Err(Untaught(help.into())) }
    }

    /// Returns whether all numbers are present and valid.
    fn is_whole(&self) -> bool {
        match &self.learned {
            LearnedPlaces::Triangulate(t) => t.is_whole(),
            LearnedPlaces::Network(n) => n.is_whole(),
            LearnedPlaces::Ensemble(e) => e.is_whole(),
            LearnedPlaces::Calibrated(c) => c.is_whole(),
        }
    }

    /// Reads a locator from JSON.
    ///
    /// # Errors
    /// Text of another format, an incomplete file, another version, or values out of range.
    pub fn parse(text: &str) -> Result<LocatorFile, LearnedFault> {
        learned_file::parse(text, FILE_NOUN, LOCATOR_VERSION, |file: &LocatorFile| {
            let what = || format!("`learned.{}` has missing, too many or impossible numbers", file.kind().name());
            (!file.is_whole()).then(what)
        })
    }

    /// Writes the locator as JSON.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }

    /// Kind of the locator.
    pub fn kind(&self) -> LocatorKind {
        match &self.learned {
            LearnedPlaces::Triangulate(_) => LocatorKind::Triangulate,
            LearnedPlaces::Network(_) => LocatorKind::Network,
            LearnedPlaces::Ensemble(_) => LocatorKind::Ensemble,
            LearnedPlaces::Calibrated(_) => LocatorKind::Calibrated,
        }
    }

    /// Returns the locator with its precomputed values.
    pub fn ready(&self) -> ReadyLocator {
        match &self.learned {
            LearnedPlaces::Triangulate(t) => ReadyLocator::Triangulate(t.clone()),
            LearnedPlaces::Network(n) => ReadyLocator::Network(n.clone()),
            LearnedPlaces::Ensemble(e) => ReadyLocator::Ensemble(e.clone()),
            LearnedPlaces::Calibrated(c) => ReadyLocator::Calibrated(Box::new(c.ready())),
        }
    }
}

/// A locator with precomputed values.
#[derive(Clone, Debug)]
pub enum ReadyLocator {
    /// Triangulation by nominal kinematics.
    Triangulate(Box<Triangulated>),
    /// The published network.
    Network(PublishedNetwork),
    /// Several networks.
    Ensemble(Box<Ensemble>),
    /// The fitted model.
    Calibrated(Box<Ready>),
}

impl ReadyLocator {
    /// Estimates the position of an object from one view; `None` if the view does not determine it.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        match self {
            ReadyLocator::Triangulate(t) => t.locate(view),
            ReadyLocator::Network(n) => n.locate(view),
            ReadyLocator::Ensemble(e) => e.locate(view),
            ReadyLocator::Calibrated(c) => c.locate(view),
        }
    }

    /// Returns the covariance of the error that all views of one object share, m^2.
    pub fn common(&self) -> Matrix3<f64> {
        match self {
            ReadyLocator::Triangulate(t) => t.common,
            ReadyLocator::Network(n) => n.common,
            ReadyLocator::Ensemble(e) => e.common,
            ReadyLocator::Calibrated(c) => c.common(),
        }
    }

    /// Returns the rays to the detections of both eyes, in the frame of the positions; `None` for a
    /// published network, which has no kinematics.
    pub(super) fn rays(&self, view: &StereoView) -> Option<[Ray; 2]> {
        let model = match self {
            ReadyLocator::Triangulate(t) => &t.model,
            ReadyLocator::Network(_) => return None,
            ReadyLocator::Ensemble(e) => &e.model,
            ReadyLocator::Calibrated(c) => c.model(),
        };
        Some(model.look(&view.encoders, &[0.0; 9]).rays(&view.pixels()))
    }

    /// Returns the left and right camera of the file.
    pub fn lenses(&self) -> [Lens; 2] {
        match self {
            ReadyLocator::Triangulate(t) => t.model.lenses,
            ReadyLocator::Network(_) => Lens::icub(),
            ReadyLocator::Ensemble(e) => e.model.lenses,
            ReadyLocator::Calibrated(c) => c.lenses(),
        }
    }

    /// Estimates the position of an object from several views.
    pub fn fuse(&self, views: &[StereoView]) -> Option<Estimate> {
        if let ReadyLocator::Calibrated(c) = self {
            return c.fuse(views);
        }
        let each: Vec<Estimate> = views.iter().filter_map(|v| self.locate(v)).collect();
        fuse(&each, &self.common())
    }
}
