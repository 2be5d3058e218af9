use super::*;
use mobee_model::{ObjectClass, load_robot, parse_world};
use proptest::prelude::*;

/// The core and the scene of its edits, without a network.
pub(crate) struct Bench {
    core: WorldRpc,
    pub(crate) scene: Scene,
    pub(crate) poses: Vec<Pose>,
}

impl Bench {
    pub(crate) fn new() -> Bench {
        let icub = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml");
        let robot = Arc::new(load_robot(icub).unwrap().value);
        let table =
            "<WorldList><object name='table' persistent='1'><box width='1' height='1' depth='1'/></object></WorldList>";
        let objects = parse_world("table", table).unwrap().value;
        let scene = Scene::new(vec![(robot, nalgebra::Isometry3::identity())], objects).unwrap();
        let poses = scene.home();
        Bench { core: WorldRpc::default(), scene, poses }
    }

    pub(crate) fn ask(&mut self, request: &WorldRequest) -> Result<Answered, WorldRefusal> {
        let answered = self.core.on(request, &WorldView { scene: &self.scene, poses: &self.poses });
        if let Ok(Answered::Changed(changed)) = &answered {
            self.edit(&changed.edits);
        }
        answered
    }

    pub(crate) fn loaded(&mut self, file: &str, objects: Vec<Object>) -> Result<WorldReply, WorldRefusal> {
        let changed = self.core.loaded(file, objects, &WorldView { scene: &self.scene, poses: &self.poses })?;
        self.edit(&changed.edits);
        Ok(changed.reply)
    }

    fn edit(&mut self, edits: &[Edit]) {
        for edit in edits {
            self.scene = self.scene.edit(edit).expect("an edit that was rehearsed");
        }
    }

    pub(crate) fn follow(&mut self) -> Vec<Edit> {
        let edits = self.core.follow(&WorldView { scene: &self.scene, poses: &self.poses });
        self.edit(&edits);
        edits
    }

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

/// Arbitrary well-formed request.
pub(crate) fn any_request() -> impl Strategy<Value = WorldRequest> {
    let name = || prop::sample::select(vec!["sph1", "ssph2", "cyl1", "table", "nobody"]).prop_map(String::from);
    let number = || prop_oneof![8 => -2.0..2.0_f64, 1 => -1e300..1e300_f64];
    let size = || prop_oneof![8 => 1e-6..2.0_f64, 1 => 1e-300..1e300_f64];
    let numbers = move || [number(), number(), number()];
    let geometry = prop_oneof![
        size().prop_map(|radius| Geometry::Sphere { radius }),
        (size(), size()).prop_map(|(radius, height)| Geometry::Cylinder { radius, height }),
        [size(), size(), size()].prop_map(|size| Geometry::Box { size }),
    ];
    let class = prop::sample::select(vec![ObjectClass::Obstacle, ObjectClass::Target, ObjectClass::Ghost]);
    let robot = prop::sample::select(vec!["icub", "icubSim", "nobody"]).prop_map(String::from);
    let ask = prop_oneof![
        Just(ObjectRequest::Get),
        numbers().prop_map(ObjectRequest::Put),
        numbers().prop_map(ObjectRequest::Turn),
        prop::array::uniform9(number()).prop_map(ObjectRequest::TurnTo),
        prop::array::uniform6(number()).prop_map(ObjectRequest::FromSimulator),
        class.prop_map(ObjectRequest::Class),
        Just(ObjectRequest::Remove),
        (robot, "[a-zA-Z]{1,9}").prop_map(|(robot, marker)| ObjectRequest::Grab { robot, marker }),
    ];
    let plain = prop::sample::select(vec![
        WorldRequest::Help,
        WorldRequest::List,
        WorldRequest::Clear,
        WorldRequest::Synchronize,
        WorldRequest::Undo,
    ]);
    prop_oneof![
        2 => plain,
        3 => (geometry, any::<bool>(), numbers())
            .prop_map(|(geometry, fixed, at)| WorldRequest::Make { geometry, fixed, at }),
        5 => (name(), ask).prop_map(|(name, ask)| WorldRequest::Object { name, ask }),
        1 => "[a-z.]{0,9}".prop_map(WorldRequest::Save),
        1 => "[a-z.]{0,9}".prop_map(WorldRequest::Load),
    ]
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
