//! Boards that go and come back, a name server that is restarted, another program under our names (F11, F13).

#![allow(clippy::disallowed_methods, reason = "real sockets live in real time")]

use crate::net::{Act, Rig};
use mobee_contract::{Command, DriverFault, Hardware};
use mobee_driver_yarp::{YarpDriverSettings, YarpHardware};

#[test]
fn boards_that_come_back_are_stopped_first_and_nothing_is_resumed() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.under_way(&mut driver);
    robot.net.act(Act::BoardsDown);
    robot.wait("the loss", |now| matches!(driver.sample(now), Err(DriverFault::Lost)).then_some(()));
    assert_eq!(driver.command(robot.now(), &Command::Stop { motors: vec![] }), Err(DriverFault::Lost));
    assert!(matches!(robot.hardware.connect(), Err(DriverFault::Lost)), "later connections don't wait");
    robot.net.act(Act::BoardsUp);
    let mut driver = robot.wait("the boards", |_| robot.hardware.connect().ok());
    let rest = robot.rests();
    assert!(rest[0] < 44.0 && rest[2] < 49.0, "they were stopped: {rest:?}");
    let sample = robot.reading(&mut driver, "a reading at rest", |s| s.done.iter().all(|d| *d));
    assert!((sample.q[0].to_degrees() - rest[0]).abs() < 0.2, "no jump");
    let rests = robot.rests();
    assert!(rests.iter().zip(&rest).all(|(now, then)| (now - then).abs() < 0.2), "{rests:?}, and before {rest:?}");
    // and it can be used again
    robot.under_way(&mut driver);
}

#[test]
fn a_name_server_that_is_restarted_learns_all_names_again_while_the_robot_moves_on() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.under_way(&mut driver);
    robot.net.act(Act::ServerDown);
    // what is connected needs no name server
    robot.reading(&mut driver, "the target", |s| s.done.iter().all(|d| *d) && s.q[0].to_degrees() > 44.5);
    robot.net.act(Act::ServerUp);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let network = robot.net.network();
    let names = ["/two/trunk/rpc:i", "/two/arm/stateExt:o", "/MoBeE/two/driver/trunk/state:i"];
    robot.wait("the names", |_| {
        let known = |n: &&str| runtime.block_on(network.query(n)).ok().flatten().is_some();
        names.iter().all(known).then_some(())
    });
    robot.reading(&mut driver, "a reading afterwards", |_| true);
}

#[test]
fn two_programs_under_one_name_are_not_both_let_to_write() {
    let robot = Rig::new();
    let mut driver = robot.hardware.connect().unwrap();
    robot.reading(&mut driver, "a reading", |_| true);
    let settings = mobee_driver_yarp::YarpDriverSettings { connect_s: 1.0, ..robot.net.settings() };
    let second = YarpHardware::on(&robot.net.network(), &settings, &robot.net.robot).unwrap();
    let Err(DriverFault::Hardware(why)) = second.connect().map(|_| ()) else { panic!("two writers") };
    assert!(why.contains("/MoBeE/two/driver/") && why.contains("another program"), "{why}");
    robot.reading(&mut driver, "a reading of the first", |_| true);
    // a thief of the name that registers without asking silences the first
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let network = robot.net.network();
    runtime.block_on(network.unregister("/MoBeE/two/driver/trunk/state:i")).unwrap();
    runtime.block_on(network.register("/MoBeE/two/driver/trunk/state:i", "127.0.0.1", 9)).unwrap();
    let why = robot.wait("the thief to be noticed", |now| match driver.sample(now) {
        Err(DriverFault::Hardware(why)) => Some(why),
        _ => None,
    });
    assert!(why.contains("another program"), "{why}");
    let stop = driver.command(robot.now(), &Command::Stop { motors: vec![] });
    assert!(matches!(stop, Err(DriverFault::Hardware(_))), "{stop:?}");
    runtime.block_on(network.unregister("/MoBeE/two/driver/trunk/state:i")).unwrap();
    robot.wait("the name to be ours again", |_| robot.hardware.connect().ok());
}

#[test]
fn questions_of_others_are_passed_on_and_nothing_else_is() {
    use mobee_contract::NativeMessage;
    use mobee_yarp::{Bottle, Dialect};
    let robot = Rig::new();
    robot.hardware.connect().unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let ask = |part: &str, words: &str| {
        let words = Bottle::parse(words, Dialect::V3).unwrap().encode(Dialect::V3);
        let answer = robot.hardware.passthrough(part, NativeMessage(words)).unwrap();
        runtime.block_on(answer).map(|answer| answer.0)
    };
    let axes = Bottle::decode(&ask("arm", "[get] [axes]").unwrap(), Dialect::V3).unwrap();
    assert!(axes.to_string().starts_with("[is] [axes] 3 [tsta]"), "{axes}");
    assert!(matches!(ask("arm", "[set] [vel] 0 20.0"), Err(DriverFault::Refused(_))));
    assert!(matches!(ask("arm", "[set] [accs] (20.0 20.0 20.0)"), Err(DriverFault::Refused(_))));
    assert!(matches!(ask("arm", "[set] [pos] 0 10.0"), Err(DriverFault::Refused(_))));
    assert!(matches!(ask("leg", "[get] [axes]"), Err(DriverFault::Refused(_))));
}

#[test]
fn a_driver_that_ends_leaves_no_names_behind() {
    let robot = Rig::new();
    let driver = robot.hardware.connect().unwrap();
    let (network, net) = (robot.net.network(), robot.net);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let names = || runtime.block_on(network.list("/MoBeE")).unwrap();
    assert!(!names().is_empty());
    drop(driver);
    drop(robot.hardware);
    assert_eq!(names(), []);
    drop(net);
}

/// Until a run has all that it needs another program may move its robot.
#[test]
fn a_robot_that_is_only_looked_at_is_sent_nothing() {
    let robot = Rig::new();
    let sent = || robot.net.ways.iter().map(|way| way.told.lock().unwrap().len()).sum::<usize>();
    let on =
        |settings: &YarpDriverSettings| YarpHardware::on(&robot.net.network(), settings, &robot.net.robot).unwrap();
    let settings = YarpDriverSettings { connect_s: 1.0, ..robot.net.settings() };
    let other = on(&YarpDriverSettings { name: Some("/other".into()), ..settings.clone() });
    let mut driver = other.look().unwrap().unwrap();
    robot.reading(&mut driver, "a reading", |_| true);
    let stop = driver.command(robot.now(), &Command::Stop { motors: vec![] });
    assert!(matches!(stop, Err(DriverFault::Refused(_))), "{stop:?}");
    drop((driver, other));
    // one of its boards is not there
    let absent = YarpDriverSettings::of([("trunk", "/two/trunk"), ("arm", "/two/nowhere")]);
    let absent = on(&YarpDriverSettings { connect_s: 1.0, max_speed_deg_per_s: 100.0, ..absent });
    let Err(why) = absent.look().unwrap() else { panic!("a board that is not there") };
    assert!(why.to_string().contains("/two/nowhere"), "{why}");
    drop(absent);
    assert_eq!(sent(), 0, "{:?}", robot.net.ways[0].told.lock().unwrap());
    // what drives it is not disturbed by a second program under the same names, neither as that looks nor as it connects
    let mut driver = robot.hardware.connect().unwrap();
    robot.under_way(&mut driver);
    let begun = tokio::time::Instant::now();
    for connects in [false, true] {
        let (network, settings, model) = (robot.net.network(), settings.clone(), robot.net.robot.clone());
        let second = std::thread::spawn(move || {
            let second = YarpHardware::on(&network, &settings, &model).unwrap();
            if connects { second.connect().map(drop) } else { second.look().unwrap().map(drop) }
        });
        robot.keep(&mut driver, "the second to be refused", |_| second.is_finished().then_some(()));
        let Err(DriverFault::Hardware(why)) = second.join().unwrap() else { panic!("two writers") };
        assert!(why.contains("another program"), "{why}");
    }
    robot.reading(&mut driver, "the target", |s| s.done.iter().all(|d| *d) && s.q[0].to_degrees() > 44.5);
    assert!(robot.net.ways.iter().all(|way| way.stopped(begun).is_none()));
}
