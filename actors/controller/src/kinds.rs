//! Kinds of controllers, registered by name where they are defined, so that a configuration file can name them.
//!
//! Every controller keeps a history, supervises and has a reflex; the kinds differ in how they drive a motion.

use crate::Drive;
use mobee_contract::{KindError, settings};
use schemars::{JsonSchema, Schema};
use serde::Deserialize;
use serde_json::Value;

/// The kind of a controller that names none.
pub const DEFAULT_KIND: &str = "rollback";

/// A kind of controller.
pub struct ControllerKind {
    /// Its name in configuration files.
    pub name: &'static str,
    /// One paragraph for its users.
    pub doc: &'static str,
    /// Its own settings, beside those that all controllers have, with their docs and defaults.
    pub schema: fn() -> Schema,
    /// How it drives motions, from its own settings.
    pub build: fn(&Value) -> Result<Drive, KindError>,
}
inventory::collect!(ControllerKind);

/// All registered kinds of controllers, by name.
pub fn controller_kinds() -> Vec<&'static ControllerKind> {
    let mut kinds: Vec<_> = inventory::iter::<ControllerKind>.into_iter().collect();
    kinds.sort_by_key(|k| k.name);
    kinds
}

inventory::submit! {
    ControllerKind {
        name: DEFAULT_KIND,
        doc: "The paper's controller. A motion is driven straight to its target, all motors in step. When anything comes nearer than the margin, \
              the reflex stops the robot and retraces its recorded path to where the motion began.",
        schema: || schemars::schema_for!(RollbackSettings),
        build: |value| settings::<RollbackSettings>(value).map(|_| Drive::Straight),
    }
}

/// Settings of the kind `rollback`: none of its own.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RollbackSettings {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_words_and_defaults_and_refuses_what_it_does_not_know() {
        let kinds = controller_kinds();
        assert!(kinds.iter().any(|k| k.name == DEFAULT_KIND));
        for kind in kinds {
            assert!(kind.doc.len() > 80, "{}", kind.name);
            assert!((kind.build)(&serde_json::json!({})).is_ok(), "{}: its own settings have defaults", kind.name);
            let e = (kind.build)(&serde_json::json!({ "nonsense": 1 })).unwrap_err();
            assert!(e.what.contains("nonsense"), "{}: {e}", kind.name);
        }
    }
}
