//! Restart strategies of OTP as a pure state machine: the children to stop and start after a death.

use mobee_contract::Time;
use std::collections::VecDeque;
use std::time::Duration;

/// Siblings that are restarted with a child that died.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strategy {
    /// None.
    OneForOne,
    /// All.
    OneForAll,
    /// Those started after it, because they may depend on it.
    RestForOne,
}

/// Condition for restarting a child that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// Always.
    Permanent,
    /// After a failure only: a panic, an error or a kill.
    Transient,
    /// Never.
    Temporary,
}

/// Number of restarts within a period after which a group gives up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Intensity {
    /// Greatest number of restarts.
    pub restarts: u32,
    /// Length of the period.
    pub period: Duration,
}

/// Event in the life of a child or of its group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// The group is to be started.
    Begin,
    /// The child has started.
    Started(usize),
    /// The child was stopped on request.
    Stopped(usize),
    /// The child ended by itself, or could not be started.
    Died {
        /// Index of the child.
        child: usize,
        /// True after a failure, false after an orderly end.
        failed: bool,
    },
    /// The group is to be stopped.
    End,
}

/// Step to execute, one after the other. The steps of a later input replace those not yet executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RestartStep {
    /// Stop this child and wait for its end.
    Stop(usize),
    /// Start this child.
    Start(usize),
    /// The restarts are used up: fail, so that the parent is notified.
    GiveUp,
}

/// A group of children, numbered in the order of their start.
#[derive(Clone, Debug)]
pub struct RestartPlan {
    strategy: Strategy,
    intensity: Intensity,
    policies: Vec<Restart>,
    up: Vec<bool>,
    wanted: Vec<bool>,
    restarts: VecDeque<Time>,
    ended: bool,
}

impl RestartPlan {
    /// Creates the plan of a group in which no child is started yet.
    pub fn new(strategy: Strategy, intensity: Intensity, policies: Vec<Restart>) -> RestartPlan {
        let n = policies.len();
        RestartPlan {
            strategy,
            intensity,
            policies,
            up: vec![false; n],
            wanted: vec![true; n],
            restarts: VecDeque::new(),
            ended: false,
        }
    }

    /// Takes an input, and returns the steps to execute.
    pub fn on(&mut self, input: Input, now: Time) -> Vec<RestartStep> {
        match input {
            Input::Begin => self.start_missing(),
            Input::Started(child) => {
                set(&mut self.up, child, true);
                Vec::new()
            }
            Input::Stopped(child) => {
                set(&mut self.up, child, false);
                if self.policies.get(child) == Some(&Restart::Temporary) {
                    set(&mut self.wanted, child, false);
                }
                Vec::new()
            }
            Input::End => {
                self.ended = true;
                self.stop(0..self.up.len())
            }
            Input::Died { child, failed } => self.died(child, failed, now),
        }
    }

    /// True if the child is running.
    pub fn is_up(&self, child: usize) -> bool {
        self.up.get(child).copied().unwrap_or(false)
    }

    /// Number of restarts within the period up to `now`.
    pub fn restarts(&self, now: Time) -> u32 {
        let recent = self.restarts.iter().filter(|t| now.since(**t) < self.intensity.period).count();
        u32::try_from(recent).unwrap_or(u32::MAX)
    }

    fn died(&mut self, child: usize, failed: bool, now: Time) -> Vec<RestartStep> {
        set(&mut self.up, child, false);
        let again = match self.policies.get(child) {
            Some(Restart::Permanent) => true,
            Some(Restart::Transient) => failed,
            Some(Restart::Temporary) | None => false,
        };
        set(&mut self.wanted, child, again);
        if self.ended || !again {
            return Vec::new();
        }
        let period = self.intensity.period;
        self.restarts.retain(|t| now.since(*t) < period);
        self.restarts.push_back(now);
        if self.restarts(now) > self.intensity.restarts {
            self.ended = true;
            let mut steps = self.stop(0..self.up.len());
            steps.push(RestartStep::GiveUp);
            return steps;
        }
        let mut steps = match self.strategy {
            Strategy::OneForOne => Vec::new(),
            Strategy::OneForAll => self.stop(0..self.up.len()),
            Strategy::RestForOne => self.stop(child..self.up.len()),
        };
        // As in OTP, a temporary child that is stopped with the others is not restarted.
        let back = |i: usize| !self.is_up(i) || self.policies.get(i) != Some(&Restart::Temporary);
        let missing = |i: usize| !self.is_up(i) || steps.contains(&RestartStep::Stop(i));
        let starts: Vec<RestartStep> = (0..self.up.len())
            .filter(|i| self.wanted.get(*i) == Some(&true) && missing(*i) && back(*i))
            .map(RestartStep::Start)
            .collect();
        steps.extend(starts);
        steps
    }

    /// Stops the running children of `range` in reverse order.
    fn stop(&self, range: std::ops::Range<usize>) -> Vec<RestartStep> {
        range.rev().filter(|i| self.is_up(*i)).map(RestartStep::Stop).collect()
    }

    fn start_missing(&self) -> Vec<RestartStep> {
        (0..self.up.len()).filter(|i| !self.is_up(*i)).map(RestartStep::Start).collect()
    }
}

fn set(flags: &mut [bool], i: usize, value: bool) {
    if let Some(flag) = flags.get_mut(i) {
        *flag = value;
    }
}
