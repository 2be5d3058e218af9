//! Reference speeds and accelerations: sent, then read back before the move that uses them.
//!
//! Within this program only this worker writes references, one order after the other. A value that another
//! program on the robot's network writes in between is detected by reading back, or by the speed of the motor
//! (`pace.rs`).

use super::super::found::Restored;
use super::{Hand, SLOWEST};
use mobee_contract::DriverFault;
use mobee_yarp::Value;
use mobee_yarp::board::{Ask, Get, Joints, Quantity, Set};

/// Number of times that references are sent before the move is aborted.
const ATTEMPTS: usize = 3;
/// Ratio beyond which a reference read back differs from the one sent.
const ROUNDING: f64 = 1.01;

/// References that a board uses.
enum InForce {
    /// Those sent.
    Ours,
    /// The speeds sent, and the accelerations it was found with, because the board does not change them.
    Found,
    /// Greater ones, set by another program.
    Others,
}

impl Hand {
    /// Sets references and verifies that they are in force.
    pub(super) async fn refer(
        &self,
        joints: &[usize],
        speed: Option<&[f64]>,
        acc: Option<&[f64]>,
    ) -> Result<(), String> {
        let commanded = |v: &[f64]| v.iter().map(|v| v.max(SLOWEST)).collect::<Vec<f64>>();
        let has_own_accelerations = self.cell.lock().boards.get(self.index).is_some_and(|known| known.own_acceleration);
        let speed = speed.map(commanded);
        let acc = acc.filter(|_| !has_own_accelerations).map(commanded);
        let mut has_own_accelerations = true;
        for _ in 0..ATTEMPTS {
            match self.send_references(joints, speed.as_deref(), acc.as_deref()).await? {
                InForce::Ours => return Ok(()),
                InForce::Found => {}
                InForce::Others => has_own_accelerations = false,
            }
        }
        let port = self.board.port();
        if has_own_accelerations {
            let mut inner = self.cell.lock();
            if let Some(known) = inner.boards.get_mut(self.index) {
                known.own_acceleration = true;
            }
            inner.news = Some(format!(
                "{port} accepts reference accelerations and keeps its own, which are greater: its moves go by these, and accelerations are no longer sent"
            ));
            return Ok(());
        }
        let why = format!(
            "another program sets the reference speeds of {port} while MoBeE does, and the move was not made: end that program"
        );
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.alarm = Some(DriverFault::Hardware(why.clone()));
        }
        Err(why)
    }

    /// Reads back the references under which joints were timed.
    pub(super) async fn confirm(&self) {
        if !self.cell.lock().boards.get(self.index).is_some_and(|known| known.gauge.needs_references()) {
            return;
        }
        let Ok(read) = self.references(Quantity::ReferenceSpeed).await else { return };
        let mut inner = self.cell.lock();
        if inner.boards.get_mut(self.index).is_some_and(|known| known.gauge.answered(&read)) {
            inner.news = inner.unfair(&self.layout);
        }
    }

    /// Sends the references once and returns which ones are in force afterwards. A board that has no
    /// accelerations to set, or does not report its references, may still move.
    async fn send_references(
        &self,
        joints: &[usize],
        speed: Option<&[f64]>,
        acc: Option<&[f64]>,
    ) -> Result<InForce, String> {
        let group = || Joints::Group(joints.to_vec());
        if let Some(speed) = speed {
            self.changes(Restored::Speed, joints);
            self.set(Set::Speed(group(), speed.to_vec())).await?;
        }
        let mut taken = false;
        if let Some(acc) = acc {
            match self.set(Set::Acceleration(group(), acc.to_vec())).await {
                Ok(()) => {
                    self.changes(Restored::Acceleration, joints);
                    taken = true;
                }
                Err(why) => tracing::debug!(board = self.board.port(), why, "no accelerations"),
            }
        }
        if !self.greater(Quantity::ReferenceSpeed, joints, speed).await?.is_empty() {
            return Ok(InForce::Others);
        }
        if !taken {
            return Ok(InForce::Ours);
        }
        let greater = self.greater(Quantity::ReferenceAcceleration, joints, acc).await?;
        let inner = self.cell.lock();
        let found = inner.boards.get(self.index).map_or(&[][..], |known| known.owed.findings());
        let as_found = |(j, read): &(usize, f64)| {
            let found = found.get(*j).and_then(|found| found.acceleration);
            found.is_some_and(|found| (found.abs() - read).abs() <= (ROUNDING - 1.0) * read)
        };
        Ok(match greater.is_empty() {
            true => InForce::Ours,
            false if greater.iter().all(as_found) => InForce::Found,
            false => InForce::Others,
        })
    }

    /// Joints for which the board reads back a greater reference than `commanded`, each with that reference.
    async fn greater(
        &self,
        what: Quantity,
        joints: &[usize],
        commanded: Option<&[f64]>,
    ) -> Result<Vec<(usize, f64)>, String> {
        let Some(commanded) = commanded else { return Ok(Vec::new()) };
        let request = Ask::Get(Get::Values(what, Joints::Group(joints.to_vec())));
        let answer = self.send(&request).await.map_err(|e| e.to_string())?;
        let Some(read) = answer.get(2).and_then(Value::as_list).and_then(mobee_yarp::Bottle::numbers) else {
            return Ok(Vec::new());
        };
        if read.len() != commanded.len() {
            return Ok(Vec::new());
        }
        let all = joints.iter().zip(read.iter().zip(commanded));
        let greater = all.filter(|(_, (read, commanded))| read.abs() > **commanded * ROUNDING);
        Ok(greater.map(|(j, (read, _))| (*j, read.abs())).collect())
    }
}
