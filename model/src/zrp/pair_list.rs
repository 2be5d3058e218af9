//! The list of disabled pairs: `<pairs> <leaveOut a="upper_arm" b="forearm" reason="neighbors"/> </pairs>`.

use super::element::Element;
use crate::error::FileError;
use crate::{LeftOut, Node, suggestion};
use std::collections::BTreeMap;

/// Maximum number of disabled pairs.
const MAX_LEFT_OUT: usize = 100_000;

/// The list as written: the names in it may be defined later in the file.
#[derive(Default)]
pub(super) struct PairList(Vec<Element>);

impl PairList {
    /// The attributes of a `leaveOut`: the names of two links or joints, and the reason.
    const ATTRIBUTES: &[&str] = &["a", "b", "reason"];

    /// Adds a `leaveOut` element.
    pub(super) fn push(&mut self, e: Element, warnings: &mut super::element::Warnings) -> Result<(), FileError> {
        e.warn_unknown(&[Self::ATTRIBUTES], warnings);
        if self.0.len() >= MAX_LEFT_OUT {
            let message = format!("more than {MAX_LEFT_OUT} pairs are left out");
            return Err(e.error(message, "leave out each pair once"));
        }
        self.0.push(e);
        Ok(())
    }

    /// Resolves the names at the end of the file.
    ///
    /// # Errors
    /// At an unknown name of a link or joint, and at a pair of a link with itself.
    pub(super) fn resolve(self, nodes: &[Node]) -> Result<Vec<LeftOut>, FileError> {
        let known: BTreeMap<&str, usize> =
            nodes.iter().enumerate().filter_map(|(i, n)| Some((n.name.as_deref()?, i))).collect();
        let find = |e: &Element, attr: &str| {
            let name = e.get(attr).map(|a| a.value.trim()).filter(|n| !n.is_empty()).ok_or_else(|| {
                let help = "name both of them: a=\"upper_arm\" b=\"forearm\"";
                e.error_at(attr, format!("<{}> has no `{attr}`", e.written), help)
            })?;
            known.get(name).copied().ok_or_else(|| {
                let names: Vec<&str> = known.keys().copied().collect();
                let message = format!("there is no link or joint `{name}`");
                e.error_at(attr, message, suggestion(name, "link or joint with a name", &names))
            })
        };
        let pair = |e: &Element| {
            let a = find(e, "a")?;
            let b = find(e, "b")?;
            if a == b {
                let help = "shapes of one link are never tested against each other: remove the line";
                return Err(e.error_at("b", "a pair is of two links, and this names one twice", help));
            }
            let reason = e.get("reason").map(|r| r.value.trim().to_owned()).unwrap_or_default();
            Ok(LeftOut { nodes: (a.min(b), a.max(b)), reason })
        };
        self.0.iter().map(pair).collect()
    }
}
