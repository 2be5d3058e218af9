//! Map files: written and read without a change, merged in any order, rejected with the place of
//! the error.

use super::world::{arm, ball, scene};
use mobee_contract::EdgeState;
use mobee_model::ObjectClass;
use mobee_planning::map_file::*;
use mobee_planning::roadmap::{Roadmap, Vertex};
use proptest::prelude::*;

/// Creates a map of the small arm from a few positions on a grid, so that two maps share some.
fn maps() -> impl Strategy<Value = MapFile> {
    let pose = || (-8_i32..8, -8_i32..8).prop_map(|(a, b)| vec![f64::from(a) / 7.0, f64::from(b) / 7.0]);
    let deed = (any::<prop::sample::Index>(), any::<bool>(), any::<bool>());
    let run = prop::option::of("[ab]");
    (prop::collection::vec(pose(), 2..12), 1_usize..4, prop::collection::vec(deed, 0..8), run, any::<bool>()).prop_map(
        |(mut poses, k, deeds, run, certified)| {
            poses.sort_by(|a, b| a.partial_cmp(b).unwrap());
            poses.dedup();
            let robot = arm(2);
            let mut map = Roadmap::new(vec![0, 1], &robot);
            for q in poses {
                map.add(Vertex { name: None, at: [q[0], q[1], 0.1], q });
            }
            map.join_nearest(k);
            for (which, reached, _) in &deeds {
                let edges: Vec<(u32, u32)> = map.edges().iter().map(|(a, b, _)| (*a, *b)).collect();
                let Some((a, b)) = edges.get(which.index(edges.len().max(1))).copied() else { continue };
                if *reached { map.succeeded(a, b) } else { map.failed(a, b, Some("a wall".into())) }
            }
            let mut file = map.file(&robot);
            run.iter().for_each(|run| file.label(run));
            if certified {
                file.certified = Some(Certified { world_sha256: "w".into(), clearance_m: 0.012 });
                for (edge, (_, _, free)) in file.edges.iter_mut().zip(&deeds) {
                    let blocked = StoredVerdict::Blocked { at: 1.0 / 3.0, between: None, object: Some("ball".into()) };
                    edge.verdict = Some(if *free { StoredVerdict::Free } else { blocked });
                }
            }
            file
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_file_is_read_as_it_was_written(map in maps()) {
        let read = MapFile::parse(&map.text()).unwrap();
        prop_assert_eq!(MapFile::parse(&read.text()).unwrap(), read.clone());
        prop_assert_eq!(read.text(), map.text());
        prop_assert_eq!((read.vertices.len(), &read.tried), (map.vertices.len(), &map.tried));
        let robot = arm(2);
        let again = Roadmap::of_file(&read, &robot).unwrap().file(&robot);
        prop_assert_eq!((again.vertices, again.tried), (read.vertices, read.tried));
    }

    #[test]
    fn merging_knows_no_order(a in maps(), b in maps(), c in maps()) {
        let merge = |maps: &[&MapFile]| merge(&maps.iter().map(|m| (*m).clone()).collect::<Vec<_>>()).unwrap();
        let (ab, other_way) = (merge(&[&a, &b]), merge(&[&b, &a]));
        prop_assert_eq!(&ab, &other_way);
        let all = merge(&[&a, &b, &c]);
        prop_assert_eq!(&merge(&[&ab, &c]), &all);
        prop_assert_eq!(&merge(&[&a, &merge(&[&b, &c])]), &all);
        prop_assert_eq!(&merge(&[&all, &all]), &all);
        prop_assert_eq!(&merge(&[&all, &b]), &all);
        // Nothing is lost, and the result is a valid map.
        prop_assert_eq!(&MapFile::parse(&all.text()).unwrap(), &all);
        for map in [&a, &b, &c] {
            for edge in &map.edges {
                let q = |id: u32| &map.vertices[id as usize].q_rad;
                let number = |q: &[f64]| all.vertices.iter().position(|v| {
                    v.q_rad.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-8)
                });
                let (from, to) = (number(q(edge.from)).unwrap() as u32, number(q(edge.to)).unwrap() as u32);
                let found = all.edges.iter().find(|e| (e.from, e.to) == (from, to)).unwrap();
                prop_assert!(edge.state != EdgeState::Removed || found.state == EdgeState::Removed);
                prop_assert!(!edge.driven || found.state != EdgeState::Optimistic);
            }
        }
    }

    #[test]
    fn a_damaged_file_is_refused_or_read_whole(map in maps(), cut in any::<prop::sample::Index>(), with in any::<u8>()) {
        let text = map.text();
        let mut bytes = text.clone().into_bytes();
        let at = cut.index(bytes.len());
        bytes[at] = with;
        for damaged in [String::from_utf8_lossy(&bytes).into_owned(), text[..at].to_owned()] {
            match MapFile::parse(&damaged) {
                Ok(read) => prop_assert_eq!(read.vertices.len(), map.vertices.len()),
                Err(e) => prop_assert!(e.span.end <= damaged.len() && !e.help.is_empty() && damaged.is_char_boundary(e.span.start)),
            }
        }
    }
}

fn small() -> MapFile {
    let robot = arm(2);
    let mut map = Roadmap::new(vec![0, 1], &robot);
    for (i, q) in [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]].into_iter().enumerate() {
        map.add(Vertex { name: Some(format!("v{i}")), q: q.to_vec(), at: [0.0; 3] });
    }
    map.join_nearest(1);
    map.file(&robot)
}

/// Errors, each with the text that the message must point at, and words of it.
#[test]
fn whatever_is_wrong_is_refused_at_its_place() {
    let text = small().text();
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{from} in {text}");
        text.replacen(from, to, 1)
    };
    let cases = [
        (with("\"version\": 2", "\"version\": 3"), "3", "reads versions up to 2"),
        (with("\"version\": 2,\n", ""), "{", "found none"),
        (with("\"to\":1", "\"to\":9"), "9", "there is no vertex 9"),
        (with("\"to\":1", "\"to\":0"), "0", "two different vertices"),
        (with("\"id\":1", "\"id\":7"), "7", "numbered in order"),
        (with("[0.5,0.5]", "[0.5]"), "[0.5]", "1 positions"),
        (with("[0.5,0.5]", "[0.5,NaN]"), "", "no JSON"),
        (with("[0.5,0.5]", "[0.5,1e999]"), "", "no JSON"),
        (with("[0.5,0.5]", "[0.5,null]"), "null", "null"),
        (with("\"optimistic\"", "\"fine\""), "\"fine\"", "fine"),
        (with("\"robot\":", "\"robto\":"), "", "robto"),
        (text[..text.len() / 2].to_owned(), "", "ends in the middle"),
        (String::new(), "", "ends in the middle"),
    ];
    for (bad, at, words) in cases {
        let e = MapFile::parse(&bad).expect_err(words);
        assert!(e.what.contains(words), "{e:?}");
        assert!(bad[e.span.clone()].starts_with(at) && !e.help.is_empty(), "{e:?}: {}", &bad[e.span.clone()]);
    }
}

#[test]
fn a_map_of_another_robot_or_a_changed_one_is_refused_with_the_reason() {
    let map = small();
    assert_eq!(map.check(&arm(2)), Ok(()));
    let other = map.check(&arm(3)).unwrap_err();
    assert_eq!(other.path, "robot_sha256");
    let mut changed = (*arm(2)).clone();
    changed.motors[1].max -= 0.1;
    let changed = map.check(&changed).unwrap_err();
    assert!(changed.what.contains("has changed since") && changed.help.contains("build the map anew"), "{changed:?}");
    // A map written by an earlier version has no digest.
    let old = r#"{"version":1,"robot":"arm","motors":["joint0","joint1"],
        "vertices":[{"id":0,"q_rad":[0,0],"at_m":[0,0,0]},{"id":1,"q_rad":[1,0],"at_m":[0,0,0]}],
        "edges":[{"from":0,"to":1,"state":"removed","driven":true,"cause":"a wall"}]}"#;
    let old = Roadmap::of_file(&MapFile::parse(old).unwrap(), &arm(2)).unwrap();
    assert_eq!(old.edge(0, 1).unwrap().cause.as_deref(), Some("a wall"));
}

#[test]
fn digests_tell_what_matters_from_what_does_not() {
    let robot = arm(2);
    let digest = robot_digest(&robot);
    let mut other = (*robot).clone();
    other.markers[0].tracer += 1;
    other.nodes.iter_mut().for_each(|n| n.fields.clear());
    assert_eq!(robot_digest(&other), digest, "trails and fields move nothing and block nothing");
    let mut other = (*robot).clone();
    let node = other.nodes.iter_mut().find(|n| !n.solids.is_empty()).unwrap();
    node.solids[0].pose.translation.vector.x += 1e-6;
    assert_ne!(robot_digest(&other), digest);

    let world = |objects| world_digest(&scene(&robot, objects));
    let [a, b] = [ball("a", 0.6, 0.0, 0.05, ObjectClass::Obstacle), ball("b", 0.0, 0.6, 0.05, ObjectClass::Obstacle)];
    assert_eq!(world(vec![a.clone(), b.clone()]), world(vec![b.clone(), a.clone()]));
    assert_ne!(world(vec![a.clone(), b.clone()]), world(vec![a.clone()]));
    let ghost = ball("g", 0.0, 0.6, 0.05, ObjectClass::Ghost);
    assert_eq!(world(vec![a.clone(), ghost]), world(vec![a]));
}

#[test]
fn edges_are_certified_with_what_blocks_them() {
    let robot = arm(2);
    let wall = scene(&robot, vec![ball("ball", 0.6, 0.0, 0.05, ObjectClass::Obstacle)]);
    let mut map = Roadmap::new(vec![0, 1], &robot);
    for q in [[-0.6, 0.0], [0.6, 0.0], [0.7, 0.0]] {
        map.add(Vertex { name: None, q: q.to_vec(), at: [0.0; 3] });
    }
    for (a, b) in [(0, 1), (1, 2)] {
        map.join(a, b);
    }
    let mut file = map.file(&robot);
    certify(&mut file, &wall, 0.01, &mut |_| ()).unwrap();
    let verdict = |from, to| file.edges.iter().find(|e| (e.from, e.to) == (from, to)).unwrap().verdict.clone().unwrap();
    assert_eq!((verdict(1, 2), verdict(2, 1)), (StoredVerdict::Free, StoredVerdict::Free));
    for (from, to) in [(0, 1), (1, 0)] {
        let StoredVerdict::Blocked { at, object, .. } = verdict(from, to) else { panic!("{:?}", verdict(from, to)) };
        assert_eq!(object.as_deref(), Some("ball"));
        assert!((0.05..0.5).contains(&at), "the ball is met before the middle, from either side: {at}");
    }
    let read = MapFile::parse(&file.text()).unwrap();
    assert_eq!(read, file);
    assert_eq!(read.certified.unwrap().world_sha256, world_digest(&wall));
}

#[test]
fn maps_that_do_not_belong_together_are_not_merged() {
    let map = small();
    let mut other = map.clone();
    other.world_sha256 = Some("else".into());
    let refused = merge(&[map.clone(), other]).unwrap_err();
    assert_eq!(refused.to_string(), "the maps have different worlds: not said and else");
    let mut renamed = map.clone();
    renamed.vertices[0].name = Some("v1".into());
    assert!(merge(&[map.clone(), renamed]).is_err());
    assert!(merge(&[]).is_err() && merge(&[map]).is_ok());
}
