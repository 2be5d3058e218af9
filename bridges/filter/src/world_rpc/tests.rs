#[allow(dead_code, reason = "the tests of bridges use the rest")]
mod bench;

use super::*;
use bench::{Bench, any_request};
use mobee_model::ObjectClass;
use proptest::prelude::*;

impl Bench {
    fn say(&mut self, request: WorldRequest) -> Result<WorldReply, WorldRefusal> {
        match self.ask(&request)? {
            Answered::Reply(reply) | Answered::Changed(Changed { reply, .. }) => Ok(reply),
            Answered::Errand(errand) => panic!("a file: {errand:?}"),
        }
    }

    fn of(&mut self, name: &str, ask: ObjectRequest) -> Result<ObjectReply, WorldRefusal> {
        match self.say(WorldRequest::Object { name: name.into(), ask })? {
            WorldReply::Found { name: found, outcome } if found == name => outcome,
            other => panic!("{other:?}"),
        }
    }
}

fn ball(radius: f64) -> WorldRequest {
    WorldRequest::Make { geometry: Geometry::Sphere { radius }, fixed: false, at: [1.0, 2.0, 3.0] }
}

#[test]
fn objects_are_made_changed_and_taken_back() {
    let mut b = Bench::new();
    assert_eq!(b.say(ball(0.1)), Ok(WorldReply::Made("sph1".into())));
    assert_eq!(b.say(ball(0.0)), Err(WorldRefusal::NotPositive(Size::SphereRadius)));
    let size = [0.1, -1.0, 0.1];
    let flat = WorldRequest::Make { geometry: Geometry::Box { size }, fixed: true, at: [0.0; 3] };
    assert_eq!(b.say(flat), Err(WorldRefusal::NotPositive(Size::BoxHeight)));
    assert_eq!(b.of("sph1", ObjectRequest::Put([4.0, 5.0, 6.0])), Ok(ObjectReply::Put));
    let Ok(ObjectReply::Pose(pose)) = b.of("sph1", ObjectRequest::Get) else { panic!("no pose") };
    assert_eq!(pose, nalgebra::Isometry3::translation(4.0, 5.0, 6.0));
    assert_eq!(b.of("sph1", ObjectRequest::TurnTo([1.0; 9])), Err(WorldRefusal::Rotation), "no rotation");
    assert!(matches!(b.of("sph1", ObjectRequest::Put([f64::NAN; 3])), Err(WorldRefusal::Scene(_))));
    assert_eq!(b.of("cyl1", ObjectRequest::Get), Err(WorldRefusal::NoObject("cyl1".into())));
    assert_eq!(b.of("table", ObjectRequest::Remove), Err(WorldRefusal::Persistent));
    let ghost = ObjectRequest::Class(ObjectClass::Ghost);
    assert_eq!(b.of("sph1", ghost), Ok(ObjectReply::Class(ObjectClass::Ghost)));
    assert_eq!(b.of("sph1", ObjectRequest::Remove), Ok(ObjectReply::Removed));
    let undone = [Change::Changed("sph1".into()), Change::Changed("sph1".into()), Change::Changed("sph1".into())];
    for change in undone.into_iter().chain([Change::Made("sph1".into())]) {
        assert_eq!(b.say(WorldRequest::Undo), Ok(WorldReply::Undone(change)));
    }
    assert_eq!(b.say(WorldRequest::Undo), Err(WorldRefusal::NothingToUndo));
    assert_eq!(b.say(WorldRequest::List), Ok(WorldReply::Names(vec!["table".into()])));
}

/// A refused request changes nothing: neither the steps that can be undone nor the grabbed objects.
#[test]
fn a_refused_request_changes_nothing() {
    let mut b = Bench::new();
    assert_eq!(b.say(ball(0.1)), Ok(WorldReply::Made("sph1".into())));
    let object = |b: &Bench, name: &str| Object::clone(b.scene.object(name).unwrap().1);
    let sph1 = object(&b, "sph1");
    assert_eq!(b.of("sph1", ObjectRequest::Remove), Ok(ObjectReply::Removed));
    b.edit(&[Edit::Add(sph1)]);
    for _ in 0..2 {
        assert!(matches!(b.say(WorldRequest::Undo), Err(WorldRefusal::NotUndone(_))), "its name is in use");
    }
    b.edit(&[Edit::Remove { name: "sph1".into() }]);
    assert_eq!(b.say(WorldRequest::Undo), Ok(WorldReply::Undone(Change::Changed("sph1".into()))));
    let robot = b.scene.robots()[0].clone();
    let marker = robot.markers[0].name.clone();
    let grab = ObjectRequest::Grab { robot: robot.name.clone(), marker };
    assert_eq!(b.of("sph1", grab), Ok(ObjectReply::Grabbed));
    // An overfull world, as a configuration can make it.
    let table = object(&b, "table");
    let more = (0..MOST_OBJECTS).map(|k| Object { name: format!("t{k}"), persistent: true, ..table.clone() });
    let objects = more.chain([table.clone(), object(&b, "sph1")]).collect();
    b.scene = Scene::new(vec![(robot, nalgebra::Isometry3::identity())], objects).unwrap();
    let full = WorldRefusal::Full { most: MOST_OBJECTS };
    assert_eq!(b.of("sph1", ObjectRequest::Remove), Err(full.clone()));
    assert!(b.core.holds_anything());
    assert_eq!(b.say(WorldRequest::Clear), Err(full));
    assert!(b.core.holds_anything());
}

#[test]
fn a_missing_object_is_reported_before_other_errors() {
    let mut b = Bench::new();
    let wrong =
        |object: Option<&str>| WorldRequest::Malformed { object: object.map(Into::into), why: WorldRefusal::Position };
    assert_eq!(b.say(wrong(None)), Err(WorldRefusal::Position));
    assert_eq!(b.say(wrong(Some("sph1"))), Err(WorldRefusal::NoObject("sph1".into())));
    let found = WorldReply::Found { name: "table".into(), outcome: Err(WorldRefusal::Position) };
    assert_eq!(b.say(wrong(Some("table"))), Ok(found));
    assert!(wrong(None).is_change(), "it counts as what it was meant to be");
    assert!(!WorldRequest::Malformed { object: None, why: WorldRefusal::Unknown }.is_change());
}

#[test]
fn names_of_files_lead_nowhere_else() {
    let mut b = Bench::new();
    for name in ["../x", "/etc/passwd", "a/b", "..", ".hidden", "", "a\\b", "x\0y"] {
        for request in [WorldRequest::Save(name.into()), WorldRequest::Load(name.into())] {
            assert_eq!(b.ask(&request).err(), Some(WorldRefusal::FileName), "{name:?}");
        }
    }
    let Ok(Answered::Errand(Errand::Load { file })) = b.ask(&WorldRequest::Load("a-b".into())) else {
        panic!("no file")
    };
    assert_eq!(file, "a-b.xml");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// For all requests in any order: no panic, and only edits that the scene accepts.
    #[test]
    fn no_request_harms(requests in prop::collection::vec(any_request(), 1..20)) {
        let mut b = Bench::new();
        for request in requests {
            let questions = !request.is_change();
            let answered = b.ask(&request);
            prop_assert!(!(questions && matches!(answered, Ok(Answered::Changed(_)))), "{:?}", request);
            b.follow();
        }
    }
}
