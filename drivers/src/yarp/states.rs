//! The states of one board as they come.

use super::YarpDriverSettings;
use super::cell::{SharedBoards, Trouble, describe};
use super::clock::Arrivals;
use super::layout::Layout;
use super::motion::MeasuredSpeeds;
use super::remote::Remote;
use mobee_yarp::Vocab;
use mobee_yarp::board::{LinkState, RemoteState};
use std::sync::Arc;

/// Takes the states of one board as they come.
pub async fn states(
    cell: Arc<SharedBoards>,
    layout: Arc<Layout>,
    index: usize,
    board: Arc<dyn Remote>,
    settings: YarpDriverSettings,
) {
    let (mut state, mut link, mut facts) = (board.state(), board.link(), board.facts());
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
                    take(&cell, &layout, index, &newest, at, lost);
                }
            }
        }
    }
}

fn take(cell: &SharedBoards, layout: &Layout, index: usize, state: &Arc<RemoteState>, at: f64, lost: u64) {
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
    known.told = Some(state.clone());
    known.lost.0 = lost;
    known.read_at = at;
    known.fresh = true;
    let q = std::mem::take(&mut known.q);
    known.motions.read(at, &q);
    known.gauge.read(at, &q);
    known.q = q;
    if let MeasuredSpeeds::At(speeds) = known.motions.speeds(at)
        && let Some(what) = known.pace.exceeded(&speeds, at)
    {
        known.gauge.outran(what.joint, what.speed / what.most.max(1e-3));
        known.alarm.get_or_insert_with(|| what.in_words(layout, index));
    }
    inner.join(layout);
    drop(inner);
    cell.ring();
}

impl SharedBoards {
    /// Describes the robot's board, once the facts of all its boards are known.
    fn describe(&self, layout: &Layout, settings: &YarpDriverSettings) {
        let mut inner = self.lock();
        if inner.board.is_some() {
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
