//! The reaching of reach.toml with robot and cameras in another process, behind YARP: nothing of the behavior changes, and the cup is
//! reached where only the eyes can know it.

use super::common::{HOLD, Run, network, real_name_server, sim, thin_map};

#[test]
fn the_cup_is_reached_with_robot_and_cameras_behind_yarp() {
    let network = network();
    let _server = real_name_server(&network);
    // a place that the run is not told
    let script = "script=[{when={at_s=0},edit={object=\"cup\",position_m=[-0.34,0.16,-0.10]}}]";
    let _robot = sim(&network, "configs/behaviors/reach.toml", "/icubSim", &[script.to_owned()]);
    let map = format!("robot.icub.agent.map=\"{}\"", thin_map(network.path()).display());
    let set = [map.as_str(), "robot.icub.agent.repeat=1", "record.enabled=false"];
    let mut run = Run::with(&network, "configs/behaviors/reach-yarp.toml", "icub", &set);
    let checked = run.wait();
    assert!(checked.contains(HOLD), "{checked}");
    let counters = run.summary()["counters"].clone();
    assert_eq!(counters["hard_contacts"], 0, "{counters}");
    let figures = counters["done"]["icub"]["figures"].as_array().expect("figures").clone();
    let figure = |name: &str| figures.iter().find(|f| f[0] == name).and_then(|f| f[1].as_f64()).unwrap_or(f64::NAN);
    assert_eq!(figure("reached"), 1.0, "{counters}");
    let off = (figure("hand_x_mm") + 340.0).hypot(figure("hand_y_mm") - 160.0);
    assert!(off < 20.0, "the hand is {off} mm beside the cup: {counters}");
}
