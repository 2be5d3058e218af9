use super::arming::Arming;
use super::*;
use mobee_contract::Move;

const MS: Duration = Duration::from_millis(10);

fn joint(inverted: bool) -> ServoJoint {
    let range = (1000, 3000);
    ServoJoint { name: "pan".into(), id: 1, range, middle: 2000.0, inverted, offset: 0.0, homing_offset: None }
}

/// An arm of one joint, whose servo is where the test puts it.
struct Bench {
    core: ArmCore,
    now: Time,
    position: f64,
    status: u8,
    torque: bool,
    load: i32,
    /// The goal that the servo stores, if it is not the one that was written.
    other_goal: Option<i32>,
}

impl Bench {
    fn new(inverted: bool) -> Bench {
        let joint = joint(inverted);
        let (min, max) = joint.limits();
        let axis = Axis {
            name: "pan".into(),
            min,
            max,
            max_speed: 1.0,
            max_acceleration: 7.0,
            contact_effort: 1.7,
            ..Axis::default()
        };
        let numbers = CoreNumbers { period: MS, lead: 0.05, hold_error: 0.1, torque: 2.9 };
        let core = ArmCore::new(vec![joint], vec![axis], numbers);
        let (now, other_goal) = (Time::from_secs(1.0), None);
        let mut bench = Bench { core, now, position: 2000.0, status: 0, torque: false, load: 0, other_goal };
        bench.read(2000);
        let arming = bench.core.arming().unwrap();
        assert_eq!(arming, [Arming { id: 1, goal: 2000, torque_off: true }]);
        bench.core.armed(bench.now, &arming);
        bench.torque = true;
        bench
    }

    fn read(&mut self, goal: i32) {
        self.now = self.now + Duration::from_millis(1);
        let state = ServoState {
            torque: self.torque,
            goal: self.other_goal.unwrap_or(goal),
            position: self.position.round() as i32,
            load: self.load,
            status: self.status,
            ..ServoState::default()
        };
        self.core.take_states(self.now, vec![state]);
    }

    /// One period: the goal. A free servo follows at once.
    fn step(&mut self, free: bool) -> i32 {
        self.now = self.now + Duration::from_millis(9);
        let goal = self.core.tick(self.now).expect("goals")[0].1;
        if free {
            self.position = f64::from(goal);
        }
        self.read(goal);
        goal
    }

    fn lease(&mut self) {
        self.core.lease(self.now, self.now + Duration::from_millis(100));
    }

    fn go(&mut self, q: f64) {
        self.lease();
        let go = Move { motors: vec![0], q: vec![q], relative: false, speed: Some(vec![1.0]), acceleration: None };
        self.core.command(self.now, &Command::Move(go)).unwrap();
    }

    fn sample(&mut self) -> Sample {
        self.core.take_sample().expect("a sample")
    }
}

#[test]
fn a_move_ends_at_its_target_and_is_done_once_the_readings_rest() {
    for inverted in [false, true] {
        let mut bench = Bench::new(inverted);
        bench.go(0.3);
        let mut steps = 0;
        loop {
            bench.lease();
            bench.step(true);
            steps += 1;
            assert!(steps < 300, "never done");
            if bench.sample_done() {
                break;
            }
        }
        let q = bench.core.joints()[0].angle(bench.position);
        assert!((q - 0.3).abs() < 0.001, "{q}");
    }
}

impl Bench {
    fn sample_done(&mut self) -> bool {
        self.core.take_sample().is_some_and(|s| s.done[0])
    }
}

/// However long it is pushed, a goal is never farther ahead of a blocked servo than the lead, and a stop leaves it there.
#[test]
fn a_blocked_servo_is_led_by_no_more_than_the_lead() {
    let mut bench = Bench::new(false);
    bench.go(0.5);
    let mut most = 0;
    for _ in 0..500 {
        bench.lease();
        most = most.max(bench.step(false) - 2000);
    }
    assert!(bench.sample().external[0] < -1.7, "a blocked joint reports a contact");
    let lead = 0.05 / crate::joint::RAD_PER_COUNT;
    assert!(f64::from(most) <= lead + 1.0 && f64::from(most) > 0.8 * lead, "{most} of {lead:.1} counts");
    bench.core.command(bench.now, &Command::Stop { motors: vec![] }).unwrap();
    let held = bench.step(false);
    assert!((held - 2000 - most).abs() <= 1);
    for _ in 0..50 {
        assert_eq!(bench.step(false), held);
    }
    assert!(bench.sample_done());
    // nor does a second motion into it push harder
    bench.go(0.5);
    for _ in 0..500 {
        bench.lease();
        most = most.max(bench.step(false) - 2000);
    }
    assert!(f64::from(most) <= lead + 1.0, "{most} of {lead:.1} counts");
}

/// At the end of the lease the goal brakes along a ramp, and the next lease resumes nothing.
#[test]
fn the_end_of_the_lease_brakes_along_a_ramp() {
    let mut bench = Bench::new(false);
    bench.go(0.6);
    let mut last = 2000;
    for _ in 0..25 {
        bench.lease();
        last = bench.step(true);
    }
    bench.core.lease(bench.now, bench.now + Duration::from_millis(1));
    let (speed, mut steps) = (last, 0);
    let rest = loop {
        let goal = bench.step(true);
        steps += 1;
        if goal == last || steps > 100 {
            break goal;
        }
        last = goal;
    };
    let way = f64::from(rest - speed) * crate::joint::RAD_PER_COUNT;
    assert!(way > 0.0 && way <= 1.0 / 14.0 + 0.02, "it went on for {way:.3} rad");
    bench.lease();
    for _ in 0..50 {
        assert_eq!(bench.step(true), rest);
    }
}

/// A servo that sags keeps its goal, whatever is stopped how often.
#[test]
fn a_stop_of_a_servo_that_sags_changes_nothing() {
    let mut bench = Bench::new(false);
    bench.position = 1970.0;
    for _ in 0..100 {
        bench.core.command(bench.now, &Command::Stop { motors: vec![] }).unwrap();
        assert_eq!(bench.step(false), 2000);
    }
    // and the sag takes nothing off the lead
    bench.go(0.2);
    for _ in 0..100 {
        bench.lease();
        bench.now = bench.now + Duration::from_millis(9);
        let goal = bench.core.tick(bench.now).unwrap()[0].1;
        bench.position = f64::from(goal) - 30.0;
        bench.read(goal);
    }
    assert!((bench.position - 1970.0 - 0.2 / crate::joint::RAD_PER_COUNT).abs() < 2.0, "{}", bench.position);
}

#[test]
fn faults_have_names_end_with_their_cause_and_brake() {
    let mut bench = Bench::new(false);
    bench.go(0.5);
    bench.status = 0x04;
    bench.step(true);
    assert!(bench.core.fault().unwrap().contains("pan (id 1) is too hot"));
    for _ in 0..40 {
        bench.lease();
        bench.step(true);
    }
    let rest = bench.step(true);
    assert!(rest < 2200, "it did not brake: {rest}");
    bench.status = 0;
    for _ in 0..40 {
        bench.step(true);
    }
    assert_eq!(bench.core.fault(), None);
}

/// An overloaded servo holds where it is, and its goal does not follow it down.
#[test]
fn an_overloaded_servo_holds_where_it_is() {
    let mut bench = Bench::new(false);
    bench.status = 0x20;
    bench.position = 1900.0;
    bench.step(false);
    for sunk in 1..30 {
        bench.position = 1900.0 - f64::from(sunk);
        assert_eq!(bench.step(false), 1900);
    }
    assert!(bench.core.fault().unwrap().contains("overloaded"));
}

#[test]
fn a_servo_without_torque_is_a_fault_until_it_is_armed() {
    let mut bench = Bench::new(false);
    bench.torque = false;
    bench.step(true);
    assert!(bench.core.fault().unwrap().contains("lost its torque"));
    assert_eq!(bench.core.stage(), ConnectionStage::Looking);
    for _ in 0..100 {
        bench.now = bench.now + MS;
        bench.read(2000);
    }
    assert!(bench.core.fault().is_some() && bench.core.tick(bench.now).is_none());
    let arming = bench.core.arming().unwrap();
    bench.core.armed(bench.now, &arming);
    bench.torque = true;
    for _ in 0..40 {
        bench.step(true);
    }
    assert_eq!(bench.core.fault(), None);
}

/// One goal that got lost is no other program; goals that come again and again are.
#[test]
fn goals_of_another_program_are_noticed() {
    let mut bench = Bench::new(false);
    for round in 0..12 {
        bench.other_goal = (round % 12 == 0).then_some(1500);
        bench.step(false);
        assert_eq!(bench.core.fault(), None);
    }
    for round in 0..12 {
        bench.other_goal = (round % 3 == 0).then_some(1500);
        bench.step(false);
    }
    assert!(bench.core.fault().unwrap().contains("another program"));
}

/// Load is the torque with which something pushes the joint, in the joint's own direction.
#[test]
fn load_is_torque_from_outside() {
    for (inverted, expected) in [(false, -1.45), (true, 1.45)] {
        let mut bench = Bench::new(inverted);
        bench.load = 500;
        bench.step(true);
        assert!((bench.sample().external[0] - expected).abs() < 1e-9);
    }
}

#[test]
fn a_joint_outside_its_limits_gets_no_torque() {
    let mut bench = Bench::new(false);
    bench.core.look_again();
    bench.position = 900.0;
    bench.read(2000);
    assert!(bench.core.arming().unwrap_err().contains("outside its limits"));
}

/// A servo that holds a load keeps its goal when a driver connects; at its position it would sag again.
#[test]
fn a_servo_that_holds_keeps_its_goal() {
    let mut bench = Bench::new(false);
    bench.core.look_again();
    (bench.position, bench.other_goal) = (1970.0, Some(2000));
    bench.read(2000);
    assert_eq!(bench.core.arming().unwrap(), [Arming { id: 1, goal: 2000, torque_off: false }]);
}
