//! Registry of kinds: everything that a configuration file can name, by its role (`agent`, `driver`, ...) and its own
//! name, registered where it is defined.
//!
//! ```text
//! inventory::submit! { Registered(&Kind::<dyn Agent> { name: "wave", .. }) }        in the file of the kind
//! kinds::<dyn Agent>()                                                            typed, to build one
//! registered()                                                                    all, to list names, descriptions and settings
//! ```

use crate::{Agent, Bridge, Context, Hardware, KindError};
use mobee_model::Robot;
use schemars::Schema;
use serde_json::Value;
use std::any::Any;
use std::path::PathBuf;
use std::sync::Arc;

/// Part of the system that comes in kinds. A new role needs only an implementation of this trait, beside the type
/// that it builds.
pub trait Role: 'static {
    /// Name of the role in configuration files and `mobee kinds`.
    const NAME: &'static str;
    /// Data available, in addition to the settings, when an instance is built.
    type Context;
    /// Type that is built.
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
    /// Folder that paths in its settings are relative to.
    type Context = PathBuf;
    type Built = Arc<dyn Bridge>;
}

/// One kind of a role.
pub struct Kind<R: Role + ?Sized> {
    /// Name in configuration files.
    pub name: &'static str,
    /// Description of one paragraph for users.
    pub doc: &'static str,
    /// Schema of its own settings, with descriptions and defaults.
    pub schema: fn() -> Schema,
    /// Settings that work for a robot without any other changes, written by `mobee new` and run by the composition
    /// tests; or the reason why there are none.
    pub example: fn(&Robot) -> Result<Value, &'static str>,
    /// Builds an instance from its settings.
    pub build: fn(&Value, &R::Context) -> Result<R::Built, KindError>,
}

/// Properties of a kind of any role.
pub trait AnyKind: Sync {
    /// Name of the role.
    fn role(&self) -> &'static str;
    /// Name of the kind.
    fn name(&self) -> &'static str;
    /// Description of one paragraph for users.
    fn doc(&self) -> &'static str;
    /// Schema of its own settings, with descriptions and defaults.
    fn schema(&self) -> Schema;
    /// The kind itself, to be downcast to the kind of a role.
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

/// Kind in the registry, submitted by `inventory::submit!`.
pub struct Registered(pub &'static dyn AnyKind);
inventory::collect!(Registered);

/// Kinds of all roles, sorted by role and name, since the linker's order is arbitrary.
pub fn registered() -> Vec<&'static dyn AnyKind> {
    let mut kinds: Vec<_> = inventory::iter::<Registered>.into_iter().map(|r| r.0).collect();
    kinds.sort_by_key(|k| (k.role(), k.name()));
    kinds
}

/// Kinds of one role, sorted by name.
pub fn kinds<R: Role + ?Sized>() -> Vec<&'static Kind<R>> {
    registered().into_iter().filter_map(|k| k.as_any().downcast_ref()).collect()
}
