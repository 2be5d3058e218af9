//! Locator files: what was learned, as JSON with a version.

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

/// What it is a file of.
const NOUN: &str = "locator";
/// The version that is written, and the only one that is read.
pub const LOCATOR_VERSION: u32 = 1;

/// What kind of locator it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LocatorKind {
    /// By the drawings of the head.
    Triangulate,
    /// By a network as published.
    Network,
    /// By several networks that are told more.
    Ensemble,
    /// By a model of the head that was fitted.
    Calibrated,
}

impl LocatorKind {
    /// All of them.
    pub const ALL: [LocatorKind; 4] =
        [LocatorKind::Triangulate, LocatorKind::Network, LocatorKind::Ensemble, LocatorKind::Calibrated];

    /// Its name in files and commands.
    pub fn name(self) -> &'static str {
        match self {
            LocatorKind::Triangulate => "triangulate",
            LocatorKind::Network => "network",
            LocatorKind::Ensemble => "ensemble",
            LocatorKind::Calibrated => "calibrated",
        }
    }
}

/// What was learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LearnedPlaces {
    /// In which frame, and how far off.
    Triangulate(Box<Triangulated>),
    /// Weights.
    Network(PublishedNetwork),
    /// More weights.
    Ensemble(Box<Ensemble>),
    /// How far the head is from its drawings.
    Calibrated(Box<Calibrated>),
}

/// A locator, learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocatorFile {
    /// What this file is.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// The SHA-256 of the table that it was learned from, in hexadecimal.
    pub data: String,
    /// The seed of all randomness.
    pub seed: u64,
    /// What was learned.
    pub learned: LearnedPlaces,
}

impl LocatorFile {
    /// Learns from views of known places; `data` is the digest of the table that they are from, and `tell` hears how far it is.
    ///
    /// # Errors
    /// Views that teach nothing, or with which learning does not converge.
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
        let format = learned_file::format_name(NOUN);
        let file = LocatorFile { format, version: LOCATOR_VERSION, data, seed, learned };
        let help = "learning did not converge: views or places are far outside of what a head can see";
        if file.is_whole() { Ok(file) } else { Err(Untaught(help.into())) }
    }

    /// Whether it has all its numbers, and these can be.
    fn is_whole(&self) -> bool {
        match &self.learned {
            LearnedPlaces::Triangulate(t) => t.is_whole(),
            LearnedPlaces::Network(n) => n.is_whole(),
            LearnedPlaces::Ensemble(e) => e.is_whole(),
            LearnedPlaces::Calibrated(c) => c.is_whole(),
        }
    }

    /// From JSON.
    ///
    /// # Errors
    /// Text that is no such file or not whole, another version, numbers that can't be: nothing of it is taken then.
    pub fn parse(text: &str) -> Result<LocatorFile, LearnedFault> {
        learned_file::parse(text, NOUN, LOCATOR_VERSION, |file: &LocatorFile| {
            let what = || format!("`learned.{}` has missing, too many or impossible numbers", file.kind().name());
            (!file.is_whole()).then(what)
        })
    }

    /// As JSON.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() + "\n"
    }

    /// What kind of locator it is.
    pub fn kind(&self) -> LocatorKind {
        match &self.learned {
            LearnedPlaces::Triangulate(_) => LocatorKind::Triangulate,
            LearnedPlaces::Network(_) => LocatorKind::Network,
            LearnedPlaces::Ensemble(_) => LocatorKind::Ensemble,
            LearnedPlaces::Calibrated(_) => LocatorKind::Calibrated,
        }
    }

    /// Ready to be asked.
    pub fn ready(&self) -> ReadyLocator {
        match &self.learned {
            LearnedPlaces::Triangulate(t) => ReadyLocator::Triangulate(t.clone()),
            LearnedPlaces::Network(n) => ReadyLocator::Network(n.clone()),
            LearnedPlaces::Ensemble(e) => ReadyLocator::Ensemble(e.clone()),
            LearnedPlaces::Calibrated(c) => ReadyLocator::Calibrated(Box::new(c.ready())),
        }
    }
}

/// A locator and what it computes beforehand.
#[derive(Clone, Debug)]
pub enum ReadyLocator {
    /// By the drawings.
    Triangulate(Box<Triangulated>),
    /// By the published network.
    Network(PublishedNetwork),
    /// By several networks.
    Ensemble(Box<Ensemble>),
    /// By the fitted model.
    Calibrated(Box<Ready>),
}

impl ReadyLocator {
    /// Where what was seen is, as far as one view tells; `None` if it tells nothing.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        match self {
            ReadyLocator::Triangulate(t) => t.locate(view),
            ReadyLocator::Network(n) => n.locate(view),
            ReadyLocator::Ensemble(e) => e.locate(view),
            ReadyLocator::Calibrated(c) => c.locate(view),
        }
    }

    /// What several views of one object are off in common, square meters.
    pub fn common(&self) -> Matrix3<f64> {
        match self {
            ReadyLocator::Triangulate(t) => t.common,
            ReadyLocator::Network(n) => n.common,
            ReadyLocator::Ensemble(e) => e.common,
            ReadyLocator::Calibrated(c) => c.common(),
        }
    }

    /// The rays to what both eyes saw, in the frame of the places; a published network knows of none.
    pub(super) fn rays(&self, view: &StereoView) -> Option<[Ray; 2]> {
        let model = match self {
            ReadyLocator::Triangulate(t) => &t.model,
            ReadyLocator::Network(_) => return None,
            ReadyLocator::Ensemble(e) => &e.model,
            ReadyLocator::Calibrated(c) => c.model(),
        };
        Some(model.look(&view.encoders, &[0.0; 9]).rays(&view.pixels()))
    }

    /// The cameras as the file knows them, left and right.
    pub fn lenses(&self) -> [Lens; 2] {
        match self {
            ReadyLocator::Triangulate(t) => t.model.lenses,
            ReadyLocator::Network(_) => Lens::icub(),
            ReadyLocator::Ensemble(e) => e.model.lenses,
            ReadyLocator::Calibrated(c) => c.lenses(),
        }
    }

    /// Where an object is of which there are several views.
    pub fn fuse(&self, views: &[StereoView]) -> Option<Estimate> {
        if let ReadyLocator::Calibrated(c) = self {
            return c.fuse(views);
        }
        let each: Vec<Estimate> = views.iter().filter_map(|v| self.locate(v)).collect();
        fuse(&each, &self.common())
    }
}
