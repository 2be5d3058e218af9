//! The paper's second experiment (figure 5): the shorter path leads through a ball that becomes solid; a motion is rolled
//! back, and the robot finds the way around. Then an obstacle appears on its resting arm: the robot holds, then escapes.
//!
//! `cargo run --release --example 03_the_ball`

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let done = mobee::run::example("configs/behaviors/ball.toml", &["record.enabled=false"])?;
    println!("{}", serde_json::to_string_pretty(&mobee::run::summary(&done))?);
    assert!(mobee::run::in_order(&done.end), "the robot gets round the ball by itself");
    Ok(())
}
