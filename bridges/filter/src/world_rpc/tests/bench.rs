//! Test bench of the world's requests: the core and the scene of its edits, without a network; and arbitrary requests.

use mobee_contract::Pose;
use mobee_filter::world_rpc::*;
use mobee_model::{Edit, Object, ObjectClass, Scene, load_robot, parse_world};
use proptest::prelude::*;
use std::sync::Arc;

/// The core and the scene of its edits, without a network.
pub struct Bench {
    pub core: WorldRpc,
    pub scene: Scene,
    pub poses: Vec<Pose>,
}

impl Bench {
    pub fn new() -> Bench {
        let icub = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml");
        let robot = Arc::new(load_robot(icub).unwrap().value);
        let table =
            "<WorldList><object name='table' persistent='1'><box width='1' height='1' depth='1'/></object></WorldList>";
        let objects = parse_world("table", table).unwrap().value;
        let scene = Scene::new(vec![(robot, nalgebra::Isometry3::identity())], objects).unwrap();
        let poses = scene.home();
        Bench { core: WorldRpc::default(), scene, poses }
    }

    pub fn ask(&mut self, request: &WorldRequest) -> Result<Answered, WorldRefusal> {
        let answered = self.core.on(request, &WorldView { scene: &self.scene, poses: &self.poses });
        if let Ok(Answered::Changed(changed)) = &answered {
            self.edit(&changed.edits);
        }
        answered
    }

    pub fn loaded(&mut self, file: &str, objects: Vec<Object>) -> Result<WorldReply, WorldRefusal> {
        let changed = self.core.loaded(file, objects, &WorldView { scene: &self.scene, poses: &self.poses })?;
        self.edit(&changed.edits);
        Ok(changed.reply)
    }

    pub fn edit(&mut self, edits: &[Edit]) {
        for edit in edits {
            self.scene = self.scene.edit(edit).expect("an edit that was rehearsed");
        }
    }

    pub fn follow(&mut self) -> Vec<Edit> {
        let edits = self.core.follow(&WorldView { scene: &self.scene, poses: &self.poses });
        self.edit(&edits);
        edits
    }
}

/// Arbitrary well-formed request.
pub fn any_request() -> impl Strategy<Value = WorldRequest> {
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
