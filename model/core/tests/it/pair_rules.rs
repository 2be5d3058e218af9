//! Promises: the pairs that a query names may touch or have a clearance of their own, all others are tested as before;
//! an unknown name is refused with the known ones.

use mobee_model::{Edit, Object, ObjectClass, PairRule, Primitive, Scene, SceneError, Shape, parse_robot};
use nalgebra::Isometry3;
use std::sync::Arc;

/// A hand that moves along x, with a palm and a marker; its base is far away.
const HAND: &str = r#"<ZeroPositionKinematicTree robotName="r"><bodypart name="p">
<link name="base" z="1" radius="0.01">
<motor name="x" minPos="0" maxPos="500"><joint x="1" type="prismatic" minPos="0" maxPos="0.5">
<link name="palm" x="0.05"><sphere radius="0.05"/><link name="tip" x="0.01"><sphere radius="0.01"/><marker name="grasp"/></link></link>
</joint></motor></link></bodypart><pairs/></ZeroPositionKinematicTree>"#;

fn scene() -> Scene {
    let robot = Arc::new(parse_robot("r.xml", HAND).unwrap().value);
    let ball = |name: &str, x: f64| Object {
        name: name.into(),
        class: ObjectClass::Obstacle,
        persistent: false,
        pose: Isometry3::translation(x, 0.0, 1.0),
        shapes: vec![Primitive { shape: Shape::Sphere { radius: 0.03 }, pose: Isometry3::identity() }],
        color: None,
    };
    Scene::new(vec![(robot, Isometry3::identity())], vec![ball("cup", 0.3), ball("post", 0.5)]).unwrap()
}

fn rules(scene: &Scene, rules: &[PairRule]) -> Scene {
    scene.with_pair_rules(0, rules).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn the_object_to_be_picked_may_be_touched_by_what_is_named_and_by_nothing_else() {
    let scene = scene();
    let pick = |pair: &str| rules(&scene, &[PairRule::may_touch(pair).unwrap()]);
    // the palm is within the cup at 0.3 m, and 15 mm from the post at 0.405 m
    let (at_cup, at_post) = ([[300f64.to_radians()]], [[450f64.to_radians()]]);
    assert!(!scene.free(&at_cup, 0.0) && !scene.free(&at_post, 0.0));
    for pair in ["p:cup", "cup:p"] {
        let pick = pick(pair);
        assert!(pick.free(&at_cup, 0.005) && !pick.free(&at_post, 0.0), "{pair}");
        assert_eq!(pick.epoch(), scene.epoch());
        // the rule stays with an object that moves, and with nothing else
        let moved =
            pick.edit(&Edit::Move { name: "cup".into(), pose: Isometry3::translation(0.45, 0.0, 1.0) }).unwrap();
        assert!(moved.contacts(&at_post, 0.0).iter().all(|c| scene.shape_name(c.pair.1) == "post#0"));
    }
    assert!(!pick("tip:cup").free(&at_cup, 0.0), "the palm is not named");
    assert!(pick("grasp:cup").free(&at_cup, 0.0), "a marker stands for the body that carries it");
    // without rules it is the scene that it was
    let again = pick("p:cup").with_pair_rules(0, &[]).unwrap();
    assert_eq!(again.pairs(), scene.pairs());
}

#[test]
fn a_pair_can_have_a_lower_clearance_than_all_others() {
    let scene = scene();
    // tip and cup are 2 mm apart, palm and cup 12 mm
    let q = [[(0.3 - 0.06 - 0.03 - 0.002f64) * 1000.0].map(f64::to_radians)];
    let near = |m: f64| rules(&scene, &["palm:cup", "tip:cup"].map(|pair| PairRule::near(pair, m).unwrap()));
    assert!(!scene.free(&q, 0.012) && near(0.001).free(&q, 0.012) && !near(0.003).free(&q, 0.012));
    assert!(!near(0.5).free(&q, 0.012) && near(0.5).free(&q, 0.001), "it only lowers the clearance");
}

#[test]
fn a_name_that_does_not_exist_is_refused_with_the_known_ones() {
    let scene = scene();
    let refused = |rule: PairRule| match scene.with_pair_rules(0, &[rule]) {
        Err(SceneError::PairRule { what, help }) => format!("{what}: {help}"),
        other => panic!("{other:?}"),
    };
    let said = refused(PairRule::may_touch("palm:cip").unwrap());
    assert!(said.contains("`cip`") && said.contains("did you mean `cup`") && said.contains("grasp"), "{said}");
    assert!(refused(PairRule::may_touch("plam:cup").unwrap()).contains("palm"));
    assert!(refused(PairRule::near("palm:cup", f64::NAN).unwrap()).contains("from 0 on"));
    for pair in ["palm", "palm:", ":", "a:b:c"] {
        assert_eq!(PairRule::may_touch(pair), None, "{pair}");
    }
    // at run time an object may be absent
    let absent = scene.with_pair_rules_of_present(0, &[PairRule::may_touch("palm:bowl").unwrap()]);
    assert_eq!(absent.pairs(), scene.pairs());
    let palm = scene.object("cup").map(|(_, cup)| Object { name: "palm".into(), ..Object::clone(cup) }).unwrap();
    let both = scene.edit(&Edit::Add(palm)).unwrap();
    let said = both.with_pair_rules(0, &[PairRule::may_touch("palm:cup").unwrap()]).unwrap_err().to_string();
    assert!(said.contains("another name"), "{said}");
}
