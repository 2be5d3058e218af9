//! `mk`: new objects, named by kind and number.

use super::{Answered, WorldRpc, WorldView};
use crate::words::{self, line, string};
use mobee_model::{Edit, Object, ObjectClass, Primitive, Shape};
use mobee_yarp::Value;
use nalgebra::{Isometry3, Vector3};

const KINDS: [&str; 6] = ["sph", "ssph", "cyl", "scyl", "box", "sbox"];

/// How many of each kind were named since the last `clr`.
#[derive(Default)]
pub(super) struct Counters([u32; KINDS.len()]);

pub(super) fn is_geometry(word: &str) -> bool {
    KINDS.contains(&word)
}

impl WorldRpc {
    pub(super) fn make(&mut self, arguments: &[Value], view: &WorldView) -> Answered {
        let word = words::name(arguments.first()).unwrap_or_default();
        let Some(kind) = KINDS.iter().position(|k| *k == word) else {
            let sentence = "MK ERROR: Unknown geometry... use '(s)sph', '(s)cyl', or '(s)box'";
            return Answered::says(line(sentence));
        };
        let (shape, at) = match shape(kind / 2, arguments.get(1..).unwrap_or_default()) {
            Ok(found) => found,
            Err(sentence) => return Answered::says(line(sentence)),
        };
        // a number whose name is in use, by a file's object for one, is passed over
        let used = self.counters.0.get(kind).copied().unwrap_or_default();
        let free = (used.saturating_add(1)..=u32::MAX).find(|n| view.scene.object(&format!("{word}{n}")).is_none());
        let Some(number) = free else { return Answered::says(line("MK ERROR: no number is left")) };
        let name = format!("{word}{number}");
        let object = Object {
            name: name.clone(),
            class: ObjectClass::Obstacle,
            persistent: false,
            pose: Isometry3::translation(at[0], at[1], at[2]),
            shapes: vec![Primitive { shape, pose: Isometry3::identity() }],
            color: None,
        };
        let answered = self.change(format!("mk {name}"), vec![Edit::Add(object)], view, vec![string(&name)]);
        if let Some(counter) = self.counters.0.get_mut(kind).filter(|_| !answered.edits.is_empty()) {
            *counter = number;
        }
        answered
    }
}

/// Shape (sphere, cylinder, box) and position from `sizes px py pz`, or the original's sentence for what is wrong with a size.
fn shape(kind: usize, arguments: &[Value]) -> Result<(Shape, [f64; 3]), String> {
    let (sizes, names): (usize, &[&str]) = match kind {
        0 => (1, &["Sphere radius must be greater than 0."]),
        1 => (2, &["Cylinder radius must be greater than 0.", "Cylinder height must be greater than 0."]),
        _ => (3, &["Box must have width > 0.", "Box must have height > 0.", "Box must have depth > 0."]),
    };
    for (i, sentence) in names.iter().enumerate() {
        // what is missing or no number counts as 0, as in the original
        if words::number(arguments.get(i)).unwrap_or_default() <= 0.0 {
            return Err((*sentence).into());
        }
    }
    let wrong = || format!("MK ERROR: give {sizes} size(s) and a position x y z, all numbers, in metres");
    let numbers = words::numbers(arguments).filter(|n| n.len() == sizes + 3).ok_or_else(wrong)?;
    match *numbers.as_slice() {
        [radius, x, y, z] => Ok((Shape::Sphere { radius }, [x, y, z])),
        [radius, height, x, y, z] => Ok((Shape::Cylinder { radius, height }, [x, y, z])),
        [w, h, d, x, y, z] => Ok((Shape::Box { size: Vector3::new(w, h, d) }, [x, y, z])),
        _ => Err(wrong()),
    }
}
