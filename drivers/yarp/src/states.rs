//! Reader of the states of one board.

use super::YarpDriverSettings;
use super::cell::{BoardFacts, SharedBoards, Trouble, describe};
use super::clock::Arrivals;
use super::layout::Layout;
use super::motion::MeasuredSpeeds;
use super::remote::Remote;
use mobee_contract::DriverFault;
use mobee_yarp::Vocab;
use mobee_yarp::board::{LinkState, RemoteState};
use std::sync::Arc;

/// Number of states that suffice to measure the encoders of a board at rest.
const MEASURED: u64 = 15;

/// Receives the states of one board.
pub async fn states(
    cell: Arc<SharedBoards>,
    layout: Arc<Layout>,
    index: usize,
    board: Arc<dyn Remote>,
    settings: YarpDriverSettings,
) {
    let mut state = board.state();
    let mut link = board.link();
    let mut facts = board.facts();
    let mut arrivals = Arrivals::default();
    loop {
        tokio::select! {
            biased;
            _ = link.changed() => {
                if let LinkState::Up(_) = *link.borrow_and_update() {
                    arrivals.reset();
                }
            }
            _ = facts.changed() => {
                let facts = facts.borrow_and_update().clone();
                if let Some(known) = cell.lock().boards.get_mut(index) {
                    known.facts = facts;
                }
                cell.describe(&layout, &settings);
            }
            _ = state.changed() => {
                let Some(newest) = state.borrow_and_update().clone() else { continue };
                let ahead = cell.lock().boards.get(index).and_then(|known| known.ahead);
                let at = arrivals.state_at(cell.secs(newest.arrived), newest.stamp, ahead);
                let lost = board.lost();
                if let Some(at) = at {
                    take(&cell, (&layout, &settings), index, &newest, (at, lost));
                }
            }
        }
    }
}

fn take(
    cell: &SharedBoards,
    (layout, settings): (&Layout, &YarpDriverSettings),
    index: usize,
    state: &Arc<RemoteState>,
    (at, lost): (f64, u64),
) {
    let mut inner = cell.lock();
    let Some(known) = inner.boards.get_mut(index) else { return };
    let units = layout.patches.get(index).map(|patch| patch.units.clone()).unwrap_or_default();
    for (j, (slot, q)) in known.q.iter_mut().zip(&state.joints.position.values).enumerate() {
        *slot = units.kind(j).from_wire(*q);
    }
    let words = |slots: &mut Vec<Vocab>, field: &mobee_yarp::JointField<i32>| {
        for (slot, word) in slots.iter_mut().zip(field.valid().unwrap_or_default()) {
            *slot = Vocab(u32::from_le_bytes(word.to_le_bytes()));
        }
    };
    words(&mut known.modes, &state.joints.control_modes);
    words(&mut known.interactions, &state.joints.interaction_modes);
    known.received = Some(state.clone());
    known.lost.0 = lost;
    known.read_at = at;
    known.fresh = true;
    let q = std::mem::take(&mut known.q);
    known.motions.read(at, &q);
    known.gauge.read(at, &q);
    known.q = q;
    let undescribed = inner.board.is_none();
    let Some(known) = inner.boards.get_mut(index) else { return };
    known.look_at_the_pace(at, layout, index);
    inner.join(layout);
    drop(inner);
    if undescribed {
        cell.describe(layout, settings);
    }
    cell.ring();
}

impl BoardFacts {
    /// Checks the speeds of the joints. Raises the alarm once, because the receiver must still be able to
    /// read what the board does.
    fn look_at_the_pace(&mut self, now: f64, layout: &Layout, index: usize) {
        let too_fast = match self.motions.speeds(now) {
            MeasuredSpeeds::At(speeds) => {
                let speeds: Vec<f64> = speeds.iter().map(|speed| speed.abs()).collect();
                self.pace.exceeded(&speeds, now)
            }
            MeasuredSpeeds::Rest | MeasuredSpeeds::Unknown => None,
        };
        if let Some(what) = &too_fast {
            self.gauge.outran(what.joint, what.speed / what.most.max(1e-3));
        }
        if let Some(what) = too_fast.as_ref().filter(|_| !self.outruns) {
            self.alarm = Some(DriverFault::TooFast(what.in_words(layout, index)));
        }
        self.outruns = too_fast.is_some();
    }
}

impl SharedBoards {
    /// Describes the robot's board, once the facts of all its boards have arrived and enough states to
    /// measure the encoders.
    fn describe(&self, layout: &Layout, settings: &YarpDriverSettings) {
        let mut inner = self.lock();
        let measured = inner.boards.iter().all(|known| known.motions.states() >= MEASURED);
        if inner.board.is_some() || !measured {
            return;
        }
        match describe(layout, &inner.boards, settings) {
            Ok(board) => inner.board = board,
            Err(why) => inner.misfit = Some(Trouble::Forbidden(why)),
        }
        drop(inner);
        self.ring();
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::Patch;
    use super::*;

    /// A board that is too fast and ignores stops remains readable: the alarm replaces a single reading, not
    /// all of them.
    #[test]
    fn a_joint_that_is_too_fast_alarms_once_until_it_is_not() {
        let patch = Patch { part: "arm".into(), port: "/arm".into(), motors: 0..1, units: Default::default() };
        let names = ["elbow".to_owned()].into();
        let limits = vec![(-9.0, 9.0)];
        let motions = Vec::new();
        let layout = Layout { patches: vec![patch], home: vec![0.0], names, limits, speeds: Vec::new(), motions };
        let cell = SharedBoards::new(&layout);
        let mut inner = cell.lock();
        let known = &mut inner.boards[0];
        known.pace.set_limit(&[0], &[10.0], 0.0);
        let mut alarms = Vec::new();
        for k in 0..150 {
            // at 40 deg/s for a second, at rest for one, and at 40 deg/s again
            let at = 0.02 * f64::from(k);
            let q = 40.0 * (at.min(1.0) + (at - 2.0).max(0.0));
            known.motions.read(at, &[q]);
            known.look_at_the_pace(at, &layout, 0);
            alarms.extend(known.alarm.take().map(|_| k));
        }
        assert!(matches!(alarms.as_slice(), [0..10, 101..112]), "{alarms:?}");
    }
}
