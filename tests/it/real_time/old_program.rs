//! An ordinary C++ YARP program (`tests/yarp/reach.cpp`, on the real library) drives the simulated iCub through the port
//! filter: it reaches, runs into the ball, is refused while the reflex takes the arm back, and then goes on.

use crate::common::{HOLD, RealYarp, Run, network};

/// Right of the ball, left of it (the straight way leads through it), below it, left of it.
const POSES: [&str; 4] =
    ["(-20 75 0 60 10 -15 5)", "(-45 35 35 95 15 -25 -5)", "(0 55 10 60 20 -10 -5)", "(-45 35 35 95 15 -25 -5)"];

fn reach(carrier: &str) {
    let Some(real) = RealYarp::find() else { return };
    let network = network();
    let mut run = Run::start(&network, "configs/behaviors/filter.toml");
    run.wait_for_port("/MoBeE/icub/right_arm/rpc:i");
    let mut args = vec!["--remote", "/MoBeE/icub/right_arm", "--local", "/reach", "--carrier", carrier];
    POSES.iter().for_each(|p| args.extend(["--pose", p]));
    let said = real.program("reach", &network, &args);
    let lines: Vec<&str> = said.lines().filter(|l| !l.starts_with('[')).collect();
    let of = |word: &str| lines.iter().filter(|l| l.starts_with(word)).count();
    assert_eq!(lines.first(), Some(&"axes 16"), "{said}");
    assert_eq!(lines.last(), Some(&"bye"), "{said}");
    assert_eq!((of("moving"), of("reached"), of("failed"), of("again")), (4, 3, 1, 1), "{said}");
    assert!(lines.iter().any(|l| l.starts_with("failed 1")), "the way through the ball fails: {said}");
    let journal = run.end();
    assert!(journal.contains(HOLD), "{journal}");
    let outcomes = run.summary();
    assert_eq!(outcomes["counters"]["rolled_back"], 1, "{outcomes}");
    assert_eq!(outcomes["counters"]["hard_contacts"], 0, "{outcomes}");
}

#[test]
fn an_old_program_is_refused_at_the_ball_and_goes_on_tcp() {
    reach("tcp");
}

/// `udp` is the real client's default for its streams.
#[test]
fn an_old_program_is_refused_at_the_ball_and_goes_on_udp() {
    reach("udp");
}
