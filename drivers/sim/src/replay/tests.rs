use super::*;
use mobee_model::{Robot, load_robot};
use proptest::prelude::*;

fn robot() -> Robot {
    load_robot(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/katana.xml")).unwrap().value
}

fn heading(robot: &Robot) -> String {
    let m = &robot.motors[1];
    format!("t_s,{}.{}", robot.parts[m.part].name, m.name)
}

#[test]
fn a_robot_follows_its_table_and_ignores_commands() {
    let robot = robot();
    let home = robot.home()[1].to_degrees();
    let text = format!("{}\n0.5,{home}\n1.5,{}\n", heading(&robot), home + 1.0);
    let table = PoseTable::parse(&text, &robot).unwrap();
    let hardware = ReplayHardware::new(table, SimSettings::ideal().axes(&robot), 100.0);
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    let mut seen = Vec::new();
    while now < Time::from_secs(2.0) {
        driver.command(now, &Command::Stop { motors: Vec::new() }).unwrap();
        seen.extend(driver.sample(now).unwrap());
        assert_eq!(driver.sample(now).unwrap(), None, "a reading is given once");
        now = driver.next_sample(now);
    }
    assert_eq!(seen.len(), 200);
    let at = |i: usize| seen[i].q[1].to_degrees() - home;
    assert!(at(0).abs() < 1e-9 && (at(100) - 0.5).abs() < 1e-9 && (at(199) - 1.0).abs() < 1e-9);
    assert!(seen[10].done[1] && !seen[100].done[1] && seen[199].done[1]);
    assert!(seen.iter().all(|s| s.q[0] == robot.home()[0]), "motors without a column stay");
}

/// Any rate gives a period from one millisecond to one second.
#[test]
fn any_rate_is_played() {
    let robot = robot();
    for (rate, ms) in [(f64::NAN, 1000), (f64::NEG_INFINITY, 1000), (0.0, 1000), (100.0, 10), (f64::INFINITY, 1)] {
        let table = PoseTable::parse(&format!("{}\n0,0\n", heading(&robot)), &robot).unwrap();
        let hardware = ReplayHardware::new(table, SimSettings::ideal().axes(&robot), rate);
        assert_eq!(hardware.known().period, Some(Duration::from_millis(ms)), "{rate}");
    }
}

#[test]
fn wrong_tables_are_refused_with_their_line() {
    let robot = robot();
    let head = heading(&robot);
    let wrong = |text: String, line: usize, what: &str| {
        let (at, said, _) = PoseTable::parse(&text, &robot).unwrap_err();
        assert!(at == line && said.contains(what), "{text}: {at}: {said}");
    };
    wrong(String::new(), 1, "no heading");
    wrong("t,x\n".into(), 1, "t_s");
    wrong("t_s,arm.nose\n0,1\n".into(), 1, "no motor `arm.nose`");
    wrong(head.clone(), 2, "no pose");
    wrong(format!("{head}\n0,0\n0,0\n"), 3, "does not rise");
    wrong(format!("{head}\n0,NaN\n"), 2, "not a number");
    wrong(format!("{head}\n0\n"), 2, "1 values");
    wrong(format!("{head}\n0,0,0\n"), 2, "3 values");
    wrong(format!("{head}\n0,1e9\n"), 2, "outside the limits");
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(text in "(t_s)?[,.a-z0-9\\n-]{0,60}", at in 0.0..100.0f64) {
        if let Ok(table) = PoseTable::parse(&text, &robot()) {
            prop_assert_eq!(table.at(Time::from_secs(at)).len(), robot().motors.len());
        }
    }
}
