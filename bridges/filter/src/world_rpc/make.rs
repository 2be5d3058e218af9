//! New objects, named by geometry and number.

use super::{Change, Changed, Geometry, WorldRefusal, WorldReply, WorldRpc, WorldView};
use mobee_model::{Edit, Object, ObjectClass, Primitive};
use nalgebra::Isometry3;

/// Prefixes of the names of made objects: free to fall and fixed, of each geometry.
const SERIES: [[&str; 2]; 3] = [["sph", "ssph"], ["cyl", "scyl"], ["box", "sbox"]];

/// Number of names used of each series since the last `clr`.
#[derive(Clone, Debug, Default)]
pub(super) struct Counters([u32; 2 * SERIES.len()]);

/// True if this word, followed by a number, is the name of a made object.
pub fn is_series(word: &str) -> bool {
    SERIES.as_flattened().contains(&word)
}

impl WorldRpc {
    pub(super) fn make(
        &mut self,
        geometry: Geometry,
        fixed: bool,
        at: [f64; 3],
        view: &WorldView,
    ) -> Result<Changed, WorldRefusal> {
        let shape = geometry.shape()?;
        let kind = match geometry {
            Geometry::Sphere { .. } => 0,
            Geometry::Cylinder { .. } => 1,
            Geometry::Box { .. } => 2,
        };
        let series = 2 * kind + usize::from(fixed);
        let word = SERIES.as_flattened().get(series).copied().unwrap_or_default();
        // skips numbers whose name is in use, for example by an object of a file
        let used = self.counters.0.get(series).copied().unwrap_or_default();
        let free = (used.saturating_add(1)..=u32::MAX).find(|n| view.scene.object(&format!("{word}{n}")).is_none());
        let number = free.ok_or(WorldRefusal::NoNumberLeft)?;
        let name = format!("{word}{number}");
        let object = Object {
            name: name.clone(),
            class: ObjectClass::Obstacle,
            persistent: false,
            pose: Isometry3::translation(at[0], at[1], at[2]),
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        };
        let changed = self.change(Change::Made(name.clone()), vec![Edit::Add(object)], view, WorldReply::Made(name))?;
        // a refused object uses no number
        if let Some(counter) = self.counters.0.get_mut(series) {
            *counter = number;
        }
        Ok(changed)
    }
}
