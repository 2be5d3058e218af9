//! Prismatic joints: meters for programs, millimeters for the filter.

use super::*;

/// Programs use meters for prismatic joints, as with the robot's own board, in commands and in readings.
#[test]
fn programs_count_meters_where_a_joint_slides() {
    let mut b = Programs::sliding();
    let near = |rad: f64, ours: f64| (rad.to_degrees() - ours).abs() < 1e-9;
    // both motors have limits of 90 units and 50 units per second: degrees here, millimeters there
    assert_eq!(b.say(1, "[get] [type] 0"), format!("[is] [type] {} [tsta] 1 1.0 [ok]", JointKind::Revolute.code()));
    assert_eq!(b.say(1, "[get] [type] 1"), format!("[is] [type] {} [tsta] 2 1.0 [ok]", JointKind::Prismatic.code()));
    let numbers = |said: &str| -> Vec<f64> {
        let list = |v: &Value| v.as_list().and_then(Bottle::numbers);
        let values = bottle(said).0.into_iter().skip(2).take_while(|v| v.as_vocab() != Some(Vocab::new("tsta")));
        values.flat_map(|v| list(&v).unwrap_or_else(|| v.as_f64().into_iter().collect())).collect()
    };
    let alike = |read: Vec<f64>, want: &[f64]| {
        assert!(
            read.len() == want.len() && read.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-9),
            "{read:?} {want:?}"
        );
    };
    alike(numbers(&b.say(1, "[get] [llim] 0")), &[-90.0, 90.0]);
    alike(numbers(&b.say(1, "[get] [llim] 1")), &[-0.09, 0.09]);
    alike(numbers(&b.say(1, "[get] [vlim] 1")), &[0.0, 0.05]);
    alike(numbers(&b.say(1, "[get] [encs]")), &[0.1f64.to_degrees(), 0.2f64.to_degrees() / 1000.0]);
    alike(numbers(&b.say(1, "[get] [vels]")), &[5.0, 0.005]);

    // moves, at the client's own reference speed, which can be read back
    assert_eq!(b.say(1, "[set] [vels] (20.0 0.02)"), "[ok]");
    alike(numbers(&b.say(1, "[get] [vels]")), &[20.0, 0.02]);
    assert_eq!(b.say(1, "[set] [accs] (20.0 0.02)"), "[ok]");
    alike(numbers(&b.say(1, "[get] [acc] 1")), &[0.02]);
    let FilterDecision::Commit(commit) = b.step("[set] [posg] 2 (1 0) (0.08 10.0)") else { panic!("no commit") };
    let speeds = commit.speeds.unwrap();
    assert!(near(commit.target.q[0], 80.0) && near(commit.target.q[1], 10.0), "{:?}", commit.target.q);
    assert!(near(speeds[0], 20.0) && near(speeds[1], 20.0), "{speeds:?}");
    let FilterDecision::Commit(commit) = b.step("[set] [rel] 1 -0.005") else { panic!("no commit") };
    assert!(near(commit.target.q[0], 0.2f64.to_degrees() - 5.0));
    for beyond in ["[set] [pos] 1 0.091", "[set] [pos] 1 80.0", "[set] [poss] (10.0 10.0)", "[set] [rel] 1 0.08"] {
        assert_eq!(b.step(beyond), FilterDecision::Reply(BoardReply::Refused), "{beyond}");
    }

    // streams: setpoints out of range are refused, velocities are limited, in millimeters per second
    let Some(FilterDecision::Stream(s)) = b.stream(7, "[dpog] 2 (0 1)", &[5.0, 0.03]) else { panic!("no stream") };
    let Values::Position(q) = s.values else { panic!("no positions") };
    assert!(near(q[0], 5.0) && near(q[1], 30.0), "{q:?}");
    assert_eq!(b.stream(7, "[dpo] 1", &[30.0]), None, "thirty meters");
    let Some(FilterDecision::Stream(s)) = b.stream(8, "[vmog] 2 (0 1)", &[20.0, 0.02]) else { panic!("no stream") };
    let Values::Velocity(v) = s.values else { panic!("no velocities") };
    assert!(near(v[0], 20.0) && near(v[1], 20.0), "{v:?}");
    let Some(FilterDecision::Stream(s)) = b.stream(8, "[vmo] 1", &[20.0]) else { panic!("no stream") };
    let Values::Velocity(v) = s.values else { panic!("no velocities") };
    assert!(near(v[0], 50.0), "no faster than 50 mm/s: {v:?}");

    // published states, for a robot without boards; the states of a board are passed on unchanged
    let own = state(b.core.board(0), None);
    alike(own.position.values.clone(), &[0.1f64.to_degrees(), 0.2f64.to_degrees() / 1000.0]);
    let told = JointData { position: JointField::known(vec![1.0, 0.5]), ..own };
    alike(state(b.core.board(0), Some(told)).position.values, &[1.0, 0.5]);
    // and the references of a board are converted to the filter's units
    let read = references(&bottle("[is] [vels] (7.0 0.007) [tsta] 1 1.0 [ok]"), &units(b.core.board(0)));
    alike(read.unwrap(), &[7.0, 7.0]);
    assert_eq!(b.pass("[get] [encs]", "[is] [encs] (1.0 0.5) [tsta] 1 1.0 [ok]"), None);
    let corrected = b.pass("[get] [vels]", "[is] [vels] (1.0 0.5) [tsta] 1 1.0 [ok]").unwrap();
    alike(numbers(&corrected), &[20.0, 0.02]);
}
