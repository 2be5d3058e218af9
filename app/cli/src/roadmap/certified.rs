//! Loads and saves maps with certified edges, for `validate` and `improve`.

use super::{PlaceArgs, info, load_for, may_write, robot, save};
use crate::robot_import::{Steps, millimeters};
use miette::{Report, miette};
use mobee_model::{Labels, Scene};
use mobee_planning::map_file::{MapFile, certify};
use std::path::PathBuf;

/// Arguments of commands that certify a map: map, robot, clearance and output.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct CertifiedArgs {
    /// The map.
    pub(super) map: PathBuf,
    #[command(flatten)]
    place: PlaceArgs,
    /// Clearance of edges between all shapes, millimeters: the reflex's margin and 2 mm.
    #[arg(long, value_name = "MM", default_value_t = 12.0, value_parser = millimeters(0.0, 500.0))]
    clearance: f64,
    /// Write the map into this file; default: into the map itself.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace that file if it exists.
    #[arg(long, requires = "out")]
    force: bool,
}

impl CertifiedArgs {
    /// Loads the scene, and the map for its robot.
    ///
    /// # Errors
    /// If the result may not be written, a file can't be read, or the map is of another robot.
    pub(super) fn load(&self) -> Result<(Scene, MapFile), Report> {
        if let Some(out) = &self.out {
            may_write(out, self.force)?;
        }
        let scene = self.place.scene()?;
        let map = load_for(&self.map, robot(&scene)?)?;
        Ok((scene, map))
    }

    /// Clearance of the edges, meters.
    pub(super) fn clearance(&self) -> f64 {
        self.clearance * 1e-3
    }

    /// Certifies every edge.
    ///
    /// # Errors
    /// If the scene has no robot for the map.
    pub(super) fn certify(&self, map: &mut MapFile, scene: &Scene, bar: &Steps) -> Result<(), Report> {
        bar.step("certifies edges");
        certify(map, scene, self.clearance(), &mut |share| bar.show(share)).map_err(|e| miette!("{e}"))
    }

    /// Writes the map; returns a summary of its free edges.
    ///
    /// # Errors
    /// If it can't be written.
    pub(super) fn save(&self, map: &MapFile, scene: &Scene) -> Result<String, Report> {
        let out = self.out.as_ref().unwrap_or(&self.map);
        save(out, map)?;
        let vertices = map.vertices.len();
        let edges = map.edges.len();
        let verdicts = info::verdicts(map);
        let pairs = info::pairs(map, Some(&Labels::new(scene.robots())));
        Ok(format!("{}: {vertices} vertices, {edges} directed edges: {verdicts}\n{pairs}", out.display()))
    }
}
