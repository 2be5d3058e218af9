//! Controllers of kind `fields` on a robot of three motors: round what is near, back from what can't be passed, and all invariants.

use crate::common::{Ran, Trial, ball};
use mobee_contract::{Cause, Event, Outcome};
use mobee_controller::{Drive, FieldsSettings};
use mobee_model::ObjectClass;
use mobee_runtime::system::Reason;

fn fields(reflex: bool) -> Drive {
    Drive::Fields(FieldsSettings { reflex, field_mm: 30.0, ..FieldsSettings::default() })
}

fn causes(ran: &Ran) -> Vec<Cause> {
    let events = ran.events();
    let cause = |e: &Event| if let Event::Outcome { cause, .. } = e { cause.clone() } else { None };
    events.iter().filter_map(|(_, e)| cause(e)).collect()
}

#[test]
fn with_nothing_near_every_target_is_reached() {
    for reflex in [true, false] {
        // at a limit, too, whose spring would else keep the robot off
        let poses = vec![[30.0, 20.0, 10.0], [170.0, 0.0, -88.0], [0.0, 0.0, 0.0]];
        let ran = Trial { poses, drive: fields(reflex), ..Trial::default() }.run();
        assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
        assert_eq!(ran.outcomes(), [Outcome::Committed; 3], "{}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
    }
}

/// The straight way brushes a ball: the reflex ends it, and the fields lead round.
#[test]
fn the_fields_lead_round_what_the_straight_way_brushes() {
    let way = |drive: Drive| {
        let objects = vec![ball("ball", [-0.4096, 0.3166, 0.2], ObjectClass::Obstacle)];
        let poses = vec![[30.0, 95.0, 0.0], [150.0, 95.0, 0.0]];
        let ran = Trial { objects, poses, speed: 0.1, drive, ..Trial::default() }.run();
        assert_eq!(ran.violations(), [], "{}", ran.lines());
        ran
    };
    let straight = way(Drive::Straight);
    assert_eq!(straight.outcomes(), [Outcome::Committed, Outcome::RolledBack], "{}", straight.lines());
    for reflex in [true, false] {
        let forced = way(fields(reflex));
        assert_eq!(forced.outcomes(), [Outcome::Committed; 2], "{}", forced.lines());
        assert_eq!(forced.end.counts.contacts, 0, "{}", forced.lines());
    }
}

/// A ball right in the way: the forces balance before it, the target counts as missed, and the robot goes back.
#[test]
fn where_there_is_no_way_round_the_motion_is_rolled_back_without_a_contact() {
    for reflex in [true, false] {
        let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
        let poses = vec![[30.0, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
        let ran = Trial { objects, poses, speed: 0.1, drive: fields(reflex), ..Trial::default() }.run();
        assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
        assert_eq!(ran.outcomes(), [Outcome::Committed, Outcome::RolledBack, Outcome::Committed], "{}", ran.lines());
        assert_eq!(causes(&ran), [Cause::TargetMissed], "{}", ran.lines());
        assert_eq!(ran.end.counts.contacts, 0, "{}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
    }
}

/// Without fields to speak of the same ball is run into: with a reflex the robot is taken back, without one nothing is.
#[test]
fn contacts_are_told_and_stop_only_what_has_a_reflex() {
    let way = |reflex: bool| {
        let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
        let poses = vec![[30.0, 0.0, 0.0], [150.0, 0.0, 0.0]];
        let drive = Drive::Fields(FieldsSettings { reflex, max_field_force: 0.0, ..FieldsSettings::default() });
        let ran = Trial { objects, poses, speed: 0.1, drive, ..Trial::default() }.run();
        assert!(ran.end.counts.contacts > 0, "{}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
        ran
    };
    let stopped = way(true);
    assert_eq!(stopped.outcomes(), [Outcome::Committed, Outcome::RolledBack], "{}", stopped.lines());
    assert!(matches!(causes(&stopped).as_slice(), [Cause::Contact(_)]), "{}", stopped.lines());
    let through = way(false);
    assert_eq!(through.outcomes(), [Outcome::Committed; 2], "{}", through.lines());
    assert!(through.end.counts.hard_contacts > 0, "{}", through.lines());
}
