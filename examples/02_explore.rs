//! The paper's first experiment, smaller: an iCub explores a roadmap of eight poses, and all its figures are printed.
//!
//! `cargo run --release --example 02_explore`

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let set = ["robot.icub.agent.vertices=8", "robot.icub.agent.neighbors=4", "record.enabled=false"];
    let done = mobee::run::example("configs/behaviors/explore.toml", &set)?;
    println!("{}", serde_json::to_string_pretty(&mobee::run::summary(&done))?);
    assert!(mobee::run::in_order(&done.end), "the exploration ends by itself");
    Ok(())
}
