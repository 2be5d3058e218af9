//! References of speed and acceleration: told, then read back before the move that goes by them.
//!
//! Nobody of ours writes references but the hand, one order after the other. What another program on the robot's network
//! writes in between is seen when they are read back, or as the speed of the motor (`pace.rs`).

use super::super::found::Restored;
use super::{Hand, SLOWEST};
use mobee_contract::DriverFault;
use mobee_yarp::Value;
use mobee_yarp::board::{Ask, Get, Joints, Quantity, Set};

/// How often references are told before the move is given up.
const ATTEMPTS: usize = 3;
/// A reference that is read back as this much more is another one.
const ROUNDING: f64 = 1.01;

impl Hand {
    /// Sets references, and sees that they are in force.
    pub(super) async fn refer(
        &self,
        joints: &[usize],
        speed: Option<&[f64]>,
        acc: Option<&[f64]>,
    ) -> Result<(), String> {
        let told = |v: &[f64]| v.iter().map(|v| v.max(SLOWEST)).collect::<Vec<f64>>();
        let (speed, acc) = (speed.map(told), acc.map(told));
        for _ in 0..ATTEMPTS {
            if self.tell_references(joints, speed.as_deref(), acc.as_deref()).await? {
                return Ok(());
            }
        }
        let port = self.board.port();
        let why = format!(
            "another program sets the reference speeds of {port} while MoBeE does, and the move was not made: end that program"
        );
        if let Some(known) = self.cell.lock().boards.get_mut(self.index) {
            known.alarm = Some(DriverFault::Hardware(why.clone()));
        }
        Err(why)
    }

    /// Reads references back under which joints were timed.
    pub(super) async fn confirm(&self) {
        if !self.cell.lock().boards.get(self.index).is_some_and(|known| known.gauge.asks()) {
            return;
        }
        let Ok(read) = self.references(Quantity::ReferenceSpeed).await else { return };
        let mut inner = self.cell.lock();
        if inner.boards.get_mut(self.index).is_some_and(|known| known.gauge.answered(&read)) {
            inner.news = inner.unfair(&self.layout);
        }
    }

    /// Tells the references once; whether the board then has none that is greater. A board without accelerations to set, or that
    /// does not tell what it has, is no reason not to move.
    async fn tell_references(
        &self,
        joints: &[usize],
        speed: Option<&[f64]>,
        acc: Option<&[f64]>,
    ) -> Result<bool, String> {
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
        let mut good = self.has(Quantity::ReferenceSpeed, joints, speed).await?;
        if taken {
            good &= self.has(Quantity::ReferenceAcceleration, joints, acc).await?;
        }
        Ok(good)
    }

    async fn has(&self, what: Quantity, joints: &[usize], told: Option<&[f64]>) -> Result<bool, String> {
        let Some(told) = told else { return Ok(true) };
        let asked = Ask::Get(Get::Values(what, Joints::Group(joints.to_vec())));
        let answer = self.say(&asked).await.map_err(|e| e.to_string())?;
        let Some(read) = answer.get(2).and_then(Value::as_list).and_then(mobee_yarp::Bottle::numbers) else {
            return Ok(true);
        };
        Ok(read.len() != told.len() || read.iter().zip(told).all(|(read, told)| read.abs() <= told * ROUNDING))
    }
}
