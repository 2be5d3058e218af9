//! Queries to a board when it is first reached.

use super::SharedRemote;
use crate::board::{Ask, Get, JointKind, reply, server};
use crate::{Bottle, Value};
use std::sync::Arc;

/// Major and minor version of our protocol; a board's patch level is ignored.
const VERSION: (i64, i64) = (1, 9);
/// Greatest plausible number of axes.
const MOST_AXES: usize = 256;

/// Facts that a board reports of one axis. Degrees, or meters for prismatic joints.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisFacts {
    /// Name of the axis; `JOINT3` if the board gives none.
    pub name: String,
    /// Kind of the joint.
    pub kind: JointKind,
    /// Position limits, if the board reports them.
    pub limits: Option<(f64, f64)>,
    /// Greatest speed, deg/s, if the board reports it.
    pub max_speed: Option<f64>,
}

/// Queries the facts of a board.
///
/// # Errors
/// No answer, another version, or an invalid answer, as a message.
pub(super) async fn query(shared: &SharedRemote) -> Result<Arc<[AxisFacts]>, String> {
    let version = get(shared, Get::Version).await?;
    let number = |i: usize| version.0.get(i).and_then(Value::as_i64);
    match (number(1), number(2)) {
        (Some(major), Some(minor)) if (major, minor) == VERSION && version.0.len() == 5 => {}
        _ => return Err(format!("the board speaks another protocol: it says {version}, not [prot] 1 9 0 [ok]")),
    }
    let axes = get(shared, Get::Axes).await?.0.get(2).and_then(Value::as_i64);
    let Some(axes) = axes.and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=MOST_AXES).contains(n)) else {
        return Err(format!("the board says that it has {axes:?} axes"));
    };
    let mut all = Vec::with_capacity(axes);
    for j in 0..axes {
        let name = get(shared, Get::Name(j)).await?;
        let kind = get(shared, Get::Kind(j)).await?;
        let limits = range(&get(shared, Get::Limits(j)).await?);
        let speeds = range(&get(shared, Get::SpeedLimits(j)).await?);
        let code = kind.0.get(2).and_then(Value::as_i64).and_then(|c| i32::try_from(c).ok());
        all.push(AxisFacts {
            name: name.0.get(2).and_then(|n| n.as_text()).map_or_else(|| format!("JOINT{j}"), |n| n.into_owned()),
            kind: code.map_or(JointKind::Unknown, JointKind::from_code),
            limits,
            max_speed: speeds.map(|(_, max)| max).filter(|v| *v > 0.0),
        });
    }
    Ok(all.into())
}

/// Answer to a query, which may be a `[fail]`.
async fn get(shared: &SharedRemote, what: Get) -> Result<Bottle, String> {
    let answer = shared.ask(&Ask::Get(what).bottle()).await.map_err(|e| e.to_string())?;
    if server::ends_well(&answer) || reply::is_fail(&answer) {
        return Ok(answer);
    }
    Err(format!("the board answers {answer}"))
}

fn range(answer: &Bottle) -> Option<(f64, f64)> {
    let number = |i: usize| answer.0.get(i).and_then(Value::as_f64).filter(|v| v.is_finite());
    let (min, max) = (number(2)?, number(3)?);
    (min < max).then_some((min, max))
}
