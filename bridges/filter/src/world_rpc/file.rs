//! `save` and `load`: worlds in files of one folder, never outside it.

use super::{WorldRefusal, WorldView};
use mobee_model::{Edit, Object, Scene, write_world};
use std::collections::BTreeSet;

/// A file to be written or read. Names are bare: letters, digits, `_`, `-` and `.`, not beginning with a dot,
/// at most 100 characters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Errand {
    /// Write the text to the file, completely or not at all.
    Save {
        /// Bare name of the file.
        file: String,
        /// Text to write.
        text: String,
    },
    /// Read the file as a world and pass it to [`super::WorldRpc::loaded`].
    Load {
        /// Bare name of the file.
        file: String,
    },
}

pub(super) fn save(name: &str, view: &WorldView) -> Result<Errand, WorldRefusal> {
    let file = bare(name)?;
    Ok(Errand::Save { file, text: write_world(view.scene.objects().map(|(_, o)| o.as_ref())) })
}

pub(super) fn load(name: &str) -> Result<Errand, WorldRefusal> {
    bare(name).map(|file| Errand::Load { file })
}

/// Checks that a name can't leave its folder, and adds `.xml` if it is missing.
fn bare(name: &str) -> Result<String, WorldRefusal> {
    let fine = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    let good = !name.is_empty() && name.len() <= 100 && !name.starts_with('.') && name.chars().all(fine);
    if !good {
        return Err(WorldRefusal::FileName);
    }
    Ok(if name.ends_with(".xml") { name.to_owned() } else { format!("{name}.xml") })
}

/// Edits that make a world of these objects. All others are removed, except for persistent ones. Those are
/// moved if the file contains them.
pub(super) fn replace(objects: Vec<Object>, scene: &Scene) -> Vec<Edit> {
    let stays: BTreeSet<&str> = scene.objects().filter(|(_, o)| o.persistent).map(|(_, o)| o.name.as_str()).collect();
    let mut edits = vec![Edit::Clear];
    for object in objects {
        if stays.contains(object.name.as_str()) {
            edits.push(Edit::Move { name: object.name.clone(), pose: object.pose });
            edits.push(Edit::Class { name: object.name, class: object.class });
        } else {
            edits.push(Edit::Add(object));
        }
    }
    edits
}
