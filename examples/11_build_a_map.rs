//! A map of pre-grasp poses over a table, from nothing: two hundred poses of the iCub's torso and right arm, joined to
//! their neighbors, every edge certified, and a path planned.
//!
//! ```sh
//! cargo run --release --example 11_build_a_map
//! ```

use mobee::compose::maps::read_settings;
use mobee_model::{Scene, load_robot, load_world};
use mobee_planning::map_file::{StoredVerdict, certify};
use mobee_planning::roadmap::{Roadmap, Vertex};
use mobee_planning::table_map::{Growth, PoseSearch};
use nalgebra::Isometry3;
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/roadmaps/table.toml");
    let (settings, _) = read_settings(&file, &["vertices=200".to_owned()])?;
    let robot = Arc::new(load_robot(&settings.robot)?.value);
    let world = settings.world.as_ref().map(load_world).transpose()?.map(|w| w.value).unwrap_or_default();
    let scene = Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], world)?;

    // growth says where, the search finds a pose there, or none
    let plan = Arc::new(settings.plan(&robot).map_err(|e| e.what)?);
    let mut search = PoseSearch::new(&scene, Arc::clone(&plan))?;
    let mut growth = Growth::new(&plan, &robot.home());
    while let Some(wish) = growth.next() {
        let trial = search.search(&growth, &wish);
        let found = trial.q.as_ref().and_then(|q| search.accept(&growth, &wish, q));
        growth.tell(trial.evaluations, found);
    }
    println!("{} poses by {} searches of {} samples", growth.found().len(), growth.trials(), growth.evaluations());

    let mut map = Roadmap::new(plan.motors.clone(), &robot);
    for found in growth.found() {
        map.add(Vertex { name: None, q: found.whole.clone(), at: found.at });
    }
    map.join_nearest(plan.neighbors);

    // what is blocked is not planned over
    let mut file = map.file(&robot);
    certify(&mut file, &scene, plan.clearance, &mut |_| ())?;
    let all = file.edges.len();
    file.edges.retain(|e| e.verdict == Some(StoredVerdict::Free));
    println!("{} of {all} directed edges are free all along", file.edges.len());

    let map = Roadmap::of_file(&file, &robot).map_err(|e| e.what)?;
    let last = map.len() as u32 - 1;
    match map.plan(0, last) {
        Some(path) => println!("a path from the first pose to the last: {path:?}"),
        None => println!("no path leads from the first pose to the last"),
    }
    Ok(())
}
