//! The list of disabled pairs, and of pairs with a clearance of their own:
//! `<pairs> <leaveOut a="upper_arm" b="forearm" reason="neighbors"/> <near a="left_finger" b="right_finger" clearance="0.001"/> </pairs>`.

use super::element::Element;
use crate::{LeftOut, NearPair, Node, Robot};
use mobee_text::FileError;
use mobee_text::suggestion;
use std::collections::BTreeMap;

/// Maximum number of listed pairs.
const MAX_LISTED: usize = 100_000;
/// Maximum clearance of a pair, meters: detects values in millimeters.
const MAX_CLEARANCE_M: f64 = 1.0;

/// The list as written: the names in it may be defined later in the file.
#[derive(Default)]
pub(super) struct PairList(Vec<Element>);

/// The list with indices of nodes.
pub(super) struct ResolvedPairs {
    pub(super) left_out: Vec<LeftOut>,
    pub(super) near: Vec<NearPair>,
    /// The element of each of these.
    near_elements: Vec<Element>,
}

impl ResolvedPairs {
    /// Disables and brings near the pairs of a robot. Warns about lines with a clearance that has no effect.
    pub(super) fn apply(self, robot: &mut Robot, warnings: &mut super::element::Warnings) {
        robot.leave_out(self.left_out);
        for (near, e) in self.near.into_iter().zip(&self.near_elements) {
            let help = "remove the line";
            if robot.pairs.reflex.binary_search(&near.nodes).is_err() {
                let message = "this pair is not tested, so its clearance has no effect";
                warnings.add(|| e.warning_at("a", message, help));
            } else if robot.near.iter().any(|known| known.nodes == near.nodes) {
                let message = "this pair has a clearance already: the lower one applies";
                warnings.add(|| e.warning_at("a", message, help));
            }
            robot.bring_near([near]);
        }
    }
}

impl PairList {
    /// The attributes of both elements: the names of two links or joints, and the reason.
    const ATTRIBUTES: &[&str] = &["a", "b", "reason"];

    /// Adds a `leaveOut` or `near` element.
    pub(super) fn push(&mut self, e: Element, warnings: &mut super::element::Warnings) -> Result<(), FileError> {
        let more: &[&str] = if is_near(&e) { &["clearance"] } else { &[] };
        e.warn_unknown(&[Self::ATTRIBUTES, more], warnings);
        if self.0.len() >= MAX_LISTED {
            return Err(e.error(format!("more than {MAX_LISTED} pairs are listed"), "list each pair once"));
        }
        self.0.push(e);
        Ok(())
    }

    /// Resolves the names at the end of the file.
    ///
    /// # Errors
    /// At an unknown name of a link or joint, at a pair of a link with itself, and at a missing or unusable clearance.
    pub(super) fn resolve(self, nodes: &[Node]) -> Result<ResolvedPairs, FileError> {
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
        let mut resolved = ResolvedPairs { left_out: Vec::new(), near: Vec::new(), near_elements: Vec::new() };
        for e in self.0 {
            let a = find(&e, "a")?;
            let b = find(&e, "b")?;
            if a == b {
                let help = "shapes of one link are never tested against each other: remove the line";
                return Err(e.error_at("b", "a pair is of two links, and this names one twice", help));
            }
            let nodes = (a.min(b), a.max(b));
            let reason = e.get("reason").map(|r| r.value.trim().to_owned()).unwrap_or_default();
            if is_near(&e) {
                resolved.near.push(NearPair { nodes, clearance: clearance(&e)?, reason });
                resolved.near_elements.push(e);
            } else {
                resolved.left_out.push(LeftOut { nodes, reason });
            }
        }
        Ok(resolved)
    }
}

fn is_near(e: &Element) -> bool {
    e.name == "near"
}

/// The clearance of a `near` element, meters.
fn clearance(e: &Element) -> Result<f64, FileError> {
    let help = "give the pair's clearance in meters: clearance=\"0.003\"";
    match e.number("clearance")? {
        Some(clearance) if (0.0..=MAX_CLEARANCE_M).contains(&clearance) => Ok(clearance),
        Some(clearance) => {
            let message = format!("`clearance` is {clearance}, outside 0 to {MAX_CLEARANCE_M} m");
            Err(e.error_at("clearance", message, help))
        }
        None => Err(e.error("<near> has no `clearance`", help)),
    }
}
