//! Edits of a scene: each creates a new snapshot with a higher epoch, or fails.
//!
//! All that is derived from the robots is shared with the old snapshot, and the pairs, too, if an object is only moved:
//! a few microseconds, for example while a hand carries an object.

use super::pair_rules::RuleChange;
use super::{Object, ObjectClass, Scene};
use crate::engine::Engine;
use crate::shape::{Primitive, Shape};
use nalgebra::Isometry3;
use std::sync::Arc;

/// A change to the objects of a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Adds an object.
    Add(Object),
    /// Removes an object permanently.
    Remove {
        /// Its name.
        name: String,
    },
    /// Moves an object.
    Move {
        /// Its name.
        name: String,
        /// The new `world_from_object`.
        pose: Isometry3<f64>,
    },
    /// Changes the role of an object.
    Class {
        /// Its name.
        name: String,
        /// The new role.
        class: ObjectClass,
    },
    /// Removes all objects except the persistent ones.
    Clear,
}

/// Reason why a scene could not be created or edited. Nothing has changed then.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// Two robots or objects have the same name.
    #[error("there are two {kind}s named `{name}`; give each its own name")]
    Duplicate {
        /// `robot` or `object`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// No object of that name.
    #[error("there is no object named `{name}`; the scene has {known}")]
    Unknown {
        /// The name.
        name: String,
        /// The existing names.
        known: String,
    },
    /// A persistent object can't be removed.
    #[error("object `{name}` is persistent and stays; clear `persistent` in its file to make it removable")]
    Persistent {
        /// Its name.
        name: String,
    },
    /// A number is not finite, or a size is not above zero.
    #[error("{what} has a {quantity} that is not finite{positive}; correct that number")]
    NotFinite {
        /// Owner of the number.
        what: String,
        /// Kind of the number.
        quantity: &'static str,
        /// For sizes: the additional requirement.
        positive: &'static str,
    },
    /// A rule for pairs names something that does not exist, or two things.
    #[error("{what}; {help}")]
    PairRule {
        /// The problem.
        what: String,
        /// The remedy, with the known names.
        help: String,
    },
    /// There are too many of something.
    #[error("{what}: at most {most} are possible; split or simplify it")]
    TooMany {
        /// The objects that are counted.
        what: String,
        /// The maximum.
        most: u32,
    },
}

impl<E: Engine> Scene<E> {
    /// The scene after an edit: a new snapshot with the epoch one higher. The old one stays valid.
    ///
    /// # Errors
    /// If the object does not exist (or, for `Add`, exists already), is persistent (for `Remove`), or has a number that
    /// is not finite.
    pub fn edit(&self, edit: &Edit) -> Result<Self, SceneError> {
        self.with(|scene| match edit {
            Edit::Add(object) => scene.add(object.clone()),
            Edit::Remove { name } => {
                let at = scene.find(name)?;
                if scene.objects.get(at).is_some_and(|(_, o)| o.persistent) {
                    return Err(SceneError::Persistent { name: name.clone() });
                }
                scene.objects.remove(at);
                Ok(())
            }
            Edit::Move { name, pose } => scene.replace(name, |o| o.pose = *pose),
            Edit::Class { name, class } => scene.replace(name, |o| o.class = *class),
            Edit::Clear => {
                scene.objects.retain(|(_, o)| o.persistent);
                Ok(())
            }
        })
    }

    /// The same robots among other objects, in place of all present ones: a new snapshot with the epoch one higher. Much
    /// cheaper than [`Scene::new`], since what is derived from the robots is shared. Ids of objects continue.
    ///
    /// # Errors
    /// As [`Scene::new`] for objects.
    pub fn with_objects(&self, objects: Vec<Object>) -> Result<Self, SceneError> {
        self.with(|scene| {
            scene.objects.clear();
            objects.into_iter().try_for_each(|object| scene.add(object))
        })
    }

    /// A copy with a change applied, prepared again; the epoch is one higher.
    ///
    /// # Errors
    /// The error of the change. Nothing has changed then.
    pub(super) fn with(&self, change: impl FnOnce(&mut Self) -> Result<(), SceneError>) -> Result<Self, SceneError> {
        let mut next = self.clone();
        change(&mut next)?;
        next.epoch += 1;
        // Only what depends on changed objects is prepared again.
        let is_changed = |id: u32| {
            let object = |scene: &Self| {
                let at = scene.objects.binary_search_by_key(&id, |(id, _)| *id).ok();
                at.map(|at| Arc::as_ptr(&scene.objects[at].1))
            };
            object(self) != object(&next)
        };
        next.world =
            Arc::new(self.world.among(&next.bodies, &next.objects, (&next.rules, RuleChange::None), is_changed));
        Ok(next)
    }

    /// Adds an object under a new id.
    pub(super) fn add(&mut self, object: Object) -> Result<(), SceneError> {
        check(&object)?;
        if self.object(&object.name).is_some() {
            return Err(SceneError::Duplicate { kind: "object", name: object.name });
        }
        // Ids are not reused, so that a reported contact can't come to refer to another object.
        let id = self.next_object;
        let what = || "objects in the life of a scene".to_string();
        self.next_object = id.checked_add(1).ok_or_else(|| SceneError::TooMany { what: what(), most: u32::MAX })?;
        self.objects.push((id, Arc::new(object)));
        Ok(())
    }

    /// The index of the object of that name; the error lists the existing names.
    fn find(&self, name: &str) -> Result<usize, SceneError> {
        self.objects.iter().position(|(_, o)| o.name == name).ok_or_else(|| {
            let names: Vec<_> = self.objects.iter().map(|(_, o)| format!("`{}`", o.name)).collect();
            let known = if names.is_empty() { "no objects".to_string() } else { names.join(", ") };
            SceneError::Unknown { name: name.to_string(), known }
        })
    }

    /// Changes an object and checks it again. Its id is preserved, so that contacts with it continue.
    fn replace(&mut self, name: &str, change: impl FnOnce(&mut Object)) -> Result<(), SceneError> {
        let at = self.find(name)?;
        if let Some((_, slot)) = self.objects.get_mut(at) {
            let mut object = Object::clone(slot);
            change(&mut object);
            check(&object)?;
            *slot = Arc::new(object);
        }
        Ok(())
    }
}

/// Checks that an object can be collided with: finite, with sizes above zero, and not too many shapes.
fn check(object: &Object) -> Result<(), SceneError> {
    let what = format!("object `{}`", object.name);
    check_pose(&object.pose, &what)?;
    check_count(object.shapes.len(), || format!("shapes of {what}"))?;
    object.shapes.iter().try_for_each(|p| check_primitive(p, &what))
}

/// Checks that a shape is finite and has sizes above zero; `what` names its owner for the error.
pub(super) fn check_primitive(primitive: &Primitive, what: &str) -> Result<(), SceneError> {
    check_pose(&primitive.pose, what)?;
    // A capsule without length is a ball, which is allowed.
    let sizes = match primitive.shape {
        Shape::Sphere { radius } => [radius; 3],
        Shape::Cylinder { radius, height } => [radius, height, height],
        Shape::Capsule { radius, height } => [radius, if height == 0.0 { 1.0 } else { height }, 1.0],
        Shape::Box { size } => size.into(),
    };
    if sizes.iter().all(|s| s.is_finite() && *s > 0.0) {
        Ok(())
    } else {
        Err(SceneError::NotFinite { what: what.to_string(), quantity: "size", positive: " and above zero" })
    }
}

/// Checks that all numbers of a pose are finite.
pub(super) fn check_pose(pose: &Isometry3<f64>, what: &str) -> Result<(), SceneError> {
    let finite = pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite());
    if finite { Ok(()) } else { Err(SceneError::NotFinite { what: what.to_string(), quantity: "pose", positive: "" }) }
}

/// Checks that a count fits the ids of shapes, which have 16 bits per number.
pub(super) fn check_count(count: usize, what: impl FnOnce() -> String) -> Result<(), SceneError> {
    if u16::try_from(count).is_ok() {
        Ok(())
    } else {
        Err(SceneError::TooMany { what: what(), most: u32::from(u16::MAX) })
    }
}
