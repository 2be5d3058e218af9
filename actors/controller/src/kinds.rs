//! Kinds of controllers, registered by name where they are defined, so that a configuration file can name them.
//!
//! Every controller has a history, a supervise and a reflex; the kinds differ in how they drive a motion.

use crate::Drive;
use mobee_contract::{Kind, Registered, Role, settings};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::json;

/// Kind of a controller whose configuration names none.
pub const DEFAULT_KIND: &str = "rollback";

impl Role for Drive {
    const NAME: &'static str = "controller";
    type Context = ();
    type Built = Drive;
}

inventory::submit! {
    Registered(&Kind::<Drive> {
        name: DEFAULT_KIND,
        doc: "The paper's controller. A motion is driven straight to its target, all motors in step. When anything comes nearer than the margin, \
              the reflex stops the robot and retraces its recorded path to where the motion began, unless `reflex = false`: then \
              contacts are recorded and counted, but stop nothing.",
        schema: || schemars::schema_for!(RollbackSettings),
        example: |_| Ok(json!({})),
        build: |value, ()| settings(value).map(|own: RollbackSettings| if own.reflex { Drive::Straight } else { Drive::Blind }),
    })
}

/// Settings of the kind `rollback`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RollbackSettings {
    /// True if the reflex stops the robot and retreats when a pair gets closer than the margin. `false` is for
    /// simulations: to measure the effect of the reflex.
    #[serde(default = "yes")]
    pub reflex: bool,
}

fn yes() -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::kinds;

    #[test]
    fn every_kind_has_a_description_and_defaults_and_rejects_unknown_settings() {
        let kinds = kinds::<Drive>();
        assert!(kinds.iter().any(|k| k.name == DEFAULT_KIND));
        for kind in kinds {
            assert!(kind.doc.len() > 80, "{}", kind.name);
            assert!((kind.build)(&json!({}), &()).is_ok(), "{}: its own settings have defaults", kind.name);
            let e = (kind.build)(&json!({ "nonsense": 1 }), &()).unwrap_err();
            assert!(e.what.contains("nonsense"), "{}: {e}", kind.name);
        }
    }

    #[test]
    fn the_reflex_is_on_unless_the_settings_disable_it() {
        for kind in kinds::<Drive>() {
            for (value, reflex) in [(json!({}), true), (json!({ "reflex": false }), false)] {
                let drive = (kind.build)(&value, &()).expect("a drive");
                assert_eq!((drive.has_reflex(), drive.kind()), (reflex, kind.name));
            }
        }
    }
}
