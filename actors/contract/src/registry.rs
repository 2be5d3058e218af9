//! The registry of kinds: whatever a configuration file can name, by its role (`agent`, `driver`, ...) and its own name, registered
//! where it is defined.
//!
//! ```text
//! inventory::submit! { Registered(&Kind::<dyn Agent> { name: "wave", .. }) }        in the file of the kind
//! kinds::<dyn Agent>()                                                            whoever builds one, typed
//! registered()                                                                    whoever lists all: names, docs, settings
//! ```

use crate::{Agent, Bridge, Context, Hardware, KindError};
use mobee_model::Robot;
use schemars::Schema;
use serde_json::Value;
use std::any::Any;
use std::path::PathBuf;
use std::sync::Arc;

/// A part of the system that comes in kinds. A new role needs an implementation of this, beside what it builds, and nothing here.
pub trait Role: 'static {
    /// What configuration files and `mobee kinds` call it.
    const NAME: &'static str;
    /// What is known, beside its settings, when one is built.
    type Context;
    /// What is built.
    type Built;
}

impl Role for dyn Agent {
    const NAME: &'static str = "agent";
    type Context = Context;
    type Built = Box<dyn Agent>;
}

impl Role for dyn Hardware {
    const NAME: &'static str = "driver";
    type Context = Context;
    type Built = Arc<dyn Hardware>;
}

impl Role for dyn Bridge {
    const NAME: &'static str = "bridge";
    /// The folder that paths in its settings are relative to.
    type Context = PathBuf;
    type Built = Arc<dyn Bridge>;
}

/// One kind of a role.
pub struct Kind<R: Role + ?Sized> {
    /// Its name in configuration files.
    pub name: &'static str,
    /// One paragraph for its users.
    pub doc: &'static str,
    /// Its own settings with their docs and defaults.
    pub schema: fn() -> Schema,
    /// Settings that work for a robot as it is, without anything else: what `mobee new` writes, and what the composition tests run; or
    /// why there are none.
    pub example: fn(&Robot) -> Result<Value, &'static str>,
    /// Builds one from its settings.
    pub build: fn(&Value, &R::Context) -> Result<R::Built, KindError>,
}

/// What can be said of a kind without knowing its role.
pub trait AnyKind: Sync {
    /// The name of its role.
    fn role(&self) -> &'static str;
    /// Its name.
    fn name(&self) -> &'static str;
    /// One paragraph for its users.
    fn doc(&self) -> &'static str;
    /// Its own settings with their docs and defaults.
    fn schema(&self) -> Schema;
    /// The kind itself, for who knows the role.
    fn as_any(&self) -> &dyn Any;
}

impl<R: Role + ?Sized> AnyKind for Kind<R> {
    fn role(&self) -> &'static str {
        R::NAME
    }

    fn name(&self) -> &'static str {
        self.name
    }

    fn doc(&self) -> &'static str {
        self.doc
    }

    fn schema(&self) -> Schema {
        (self.schema)()
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

/// A kind in the registry: `inventory::submit!` takes it.
pub struct Registered(pub &'static dyn AnyKind);
inventory::collect!(Registered);

/// All kinds of all roles, by role and name: the linker's order is nobody's.
pub fn registered() -> Vec<&'static dyn AnyKind> {
    let mut kinds: Vec<_> = inventory::iter::<Registered>.into_iter().map(|r| r.0).collect();
    kinds.sort_by_key(|k| (k.role(), k.name()));
    kinds
}

/// The kinds of one role, by name.
pub fn kinds<R: Role + ?Sized>() -> Vec<&'static Kind<R>> {
    registered().into_iter().filter_map(|k| k.as_any().downcast_ref()).collect()
}
