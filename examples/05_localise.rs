//! A robot that sees (section 3.2 of the paper): an iCub looks about while somebody moves a cup. Nobody tells the model: the cup is found in
//! the pictures of both eyes, placed by these and the pose of the head, and moved in the model through the world gate.
//!
//! `cargo run --release --example 05_localise`

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // after 20 s the cup is put here
    let truth = [-0.42, -0.12, -0.10];
    let done = mobee::run::example("configs/behaviors/look.toml", &["record.enabled=false", "for_s=30"])?;
    let (_, cup) = done.end.scene.object("cup").ok_or("there is no cup")?;
    let off = (cup.pose.translation.vector - nalgebra::Vector3::from(truth)).norm();
    println!("the model has the cup {:.1} mm from where it is", off * 1e3);
    assert!(off < 0.02, "what is seen is where the model has it");
    Ok(())
}
