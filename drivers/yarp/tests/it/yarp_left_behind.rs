//! Nothing is left behind in a board: references and modes are as they were found, however a motion or a run ends.

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::net::Rig;
use mobee_contract::{Command, ControlMode, Driver, Hardware, Move};
use mobee_driver_yarp::YarpHardware;
use mobee_yarp::board::Device;
use mobee_yarp::{Bottle, Dialect, Message};
use std::time::Duration;

/// What another program set, and what it reads later: references and modes of all joints.
struct Other<'a>(&'a Rig);

impl Other<'_> {
    fn say(&self, board: usize, words: &str) -> String {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let asked = Bottle::parse(words, Dialect::V3).unwrap();
        let (payload, from) = (asked.into(), "/other".into());
        let request = Message { payload, envelope: None, from, connection: 0, wants_reply: true };
        let answer = runtime.block_on(self.0.net.boards[board].rpc(request));
        answer.bottle(Dialect::V3).unwrap().to_string()
    }

    /// References of its own, a joint in set-points, another in velocities, a third that gives way.
    fn prepare(&self) {
        for (board, words) in [
            (0, "[set] [vels] (13.0 17.0)"),
            (0, "[set] [accs] (70.0 80.0)"),
            (1, "[set] [vels] (3.0 5.0 7.0)"),
            (1, "[set] [icmd] [cmds] ([posd] [vel] [pos])"),
            (1, "[set] [intm] [mods] ([comp] [stif] [stif])"),
        ] {
            let answer = self.say(board, words);
            assert!(answer.contains("[ok]"), "{words}: {answer}");
        }
    }

    fn reads(&self) -> String {
        self.0.net.boards.iter().map(|board| format!("{:?}\n", board.joint_settings())).collect()
    }
}

fn go(rig: &Rig, driver: &mut Box<dyn Driver>, secs: f64) {
    rig.reading(driver, "a reading", |_| true);
    let q = rig.net.truth();
    // out of the middle and back, 4 degrees of the yaw, the shoulder and the wrist
    let to = |m: usize| if q[m] > 0.0 { q[m] - 4.0 } else { q[m] + 4.0 };
    let there = Move {
        motors: vec![0, 2, 3],
        q: [to(0), to(2), to(3)].map(f64::to_radians).to_vec(),
        relative: false,
        speed: Some(vec![(4.0 / secs).to_radians(); 3]),
        acceleration: Some(vec![2.0; 3]),
    };
    driver.command(rig.now(), &Command::Move(there)).unwrap();
}

/// The motors of the arm are driven by set-points, or by velocities, and nobody ends it in order.
fn stream(rig: &Rig, driver: &mut Box<dyn Driver>, mode: ControlMode) {
    let motors = vec![2, 3];
    rig.reading(driver, "a reading", |_| true);
    driver.command(rig.now(), &Command::Mode { motors: motors.clone(), mode }).unwrap();
    for _ in 0..10 {
        let q: Vec<f64> = rig.net.truth()[2..4].iter().map(|q| (0.9 * q).to_radians()).collect();
        let command = match mode {
            ControlMode::Velocity => Command::Velocity { motors: motors.clone(), speed: vec![0.05, -0.05] },
            _ => Command::Direct { motors: motors.clone(), q },
        };
        driver.command(rig.now(), &command).unwrap();
        rig.reading(driver, "a reading of the stream", |_| true);
    }
}

#[test]
fn a_board_is_as_it_was_found_however_a_motion_ends() {
    let rounds = std::env::var("ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1);
    let mut robot = Rig::new();
    Other(&robot).prepare();
    let found = robot.wait("the modes", |_| {
        let reads = Other(&robot).reads();
        (reads.contains("[posd]") && reads.contains("[vel]")).then_some(reads)
    });
    let again = |robot: &Rig| YarpHardware::on(&robot.net.network(), &robot.net.settings(), &robot.net.robot).unwrap();
    let mut ends = 0;
    for _ in 0..rounds {
        let mut driver = robot.hardware.connect().unwrap();
        for end in ["arrives", "stops", "lease", "set-points", "velocities"] {
            match end {
                "arrives" => {
                    go(&robot, &mut driver, 0.5);
                    robot.reading(&mut driver, "the end of the move", |s| s.done.iter().all(|done| *done));
                }
                "stops" => {
                    go(&robot, &mut driver, 5.0);
                    // all of it: a joint that was made stiff and not yet switched from set-points is given back with the lease only
                    let before = robot.net.truth();
                    let goes = |m: usize| (robot.net.truth()[m] - before[m]).abs() > 0.2;
                    robot.reading(&mut driver, "the move", |_| [0, 2, 3].into_iter().all(goes));
                    driver.command(robot.now(), &Command::Stop { motors: Vec::new() }).unwrap();
                }
                "lease" => {
                    go(&robot, &mut driver, 5.0);
                    driver.lease(robot.now(), robot.now() + Duration::from_millis(100));
                }
                "set-points" => stream(&robot, &mut driver, ControlMode::PositionDirect),
                _ => stream(&robot, &mut driver, ControlMode::Velocity),
            }
            if end != "arrives" && end != "stops" {
                driver.lease(robot.now(), robot.now());
            }
            ends += 1;
            robot.wait(&format!("what was found, after `{end}`:\n{found}"), |now| {
                if end == "arrives" || end == "stops" {
                    driver.lease(now, now + Duration::from_millis(500));
                }
                (Other(&robot).reads() == found).then_some(())
            });
        }
        // the end of a run, with the robot on its way
        go(&robot, &mut driver, 5.0);
        let told = driver.found();
        robot.reading(&mut driver, "the move", |s| !s.done[0]);
        drop(driver);
        let fresh = again(&robot);
        drop(std::mem::replace(&mut robot.hardware, fresh));
        assert_eq!(Other(&robot).reads(), found, "after the end of a run");
        // a crash, which writes nothing more, and what resumes its run
        let mut driver = robot.hardware.connect().unwrap();
        go(&robot, &mut driver, 5.0);
        robot.reading(&mut driver, "the move", |s| !s.done[0]);
        drop(driver);
        robot.hardware.let_go();
        let fresh = again(&robot);
        drop(std::mem::replace(&mut robot.hardware, fresh));
        assert_ne!(Other(&robot).reads(), found, "after a crash");
        robot.hardware.was_found(&told);
        let driver = robot.hardware.connect().unwrap();
        assert_eq!(driver.found(), told);
        robot.wait("what was found before the crash", |_| (Other(&robot).reads() == found).then_some(()));
        ends += 2;
    }
    eprintln!("{ends} ends: nothing is left");
}
