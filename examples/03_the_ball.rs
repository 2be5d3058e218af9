//! The paper's second experiment (figure 5): the short way leads through a ball that turns solid; the robot is rolled back
//! once and finds the way round. Then an obstacle is put onto its resting arm: it holds, and escapes.
//!
//! `cargo run --release --example 03_the_ball`

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let done = mobee::run::example("configs/behaviors/ball.toml", &["record.enabled=false"])?;
    println!("{}", serde_json::to_string_pretty(&mobee::run::summary(&done))?);
    assert!(mobee::run::in_order(&done.end), "the robot gets round the ball by itself");
    Ok(())
}
