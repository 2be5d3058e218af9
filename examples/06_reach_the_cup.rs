//! The paper's third experiment (section 3.3, figure 8): an iCub sees a cup, reaches for it over a roadmap of some 5,000 poses, and again
//! where it was moved to; once in each mode that certifies edges.
//!
//! The map is built when it is first asked for (some ten seconds), and kept in the user's cache.
//!
//! `cargo run --release --example 06_reach_the_cup`

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:10} {:>7} {:>9} {:>9} {:>12}", "validation", "reached", "replanned", "rollbacks", "to pre-grasp");
    for mode in ["lazy", "verified"] {
        let mode_set = format!("robot.icub.agent.validation=\"{mode}\"");
        let set = ["clock=\"virtual\"", "record.enabled=false", mode_set.as_str()];
        let done = mobee::run::example("configs/behaviors/reach.toml", &set)?;
        let told = done.end.counts.done.get("icub").cloned().unwrap_or_default();
        let figure = |name: &str| told.figures.iter().find(|(n, _)| n == name).map_or(0.0, |(_, n)| *n);
        println!(
            "{mode:10} {:7} {:9} {:9} {:10.1} s",
            figure("reached"),
            figure("replanned"),
            done.end.counts.rolled_back,
            figure("pre_grasp_s")
        );
        assert!(figure("reached") >= 3.0, "the cup is reached");
        assert_eq!(done.end.counts.hard_contacts, 0, "nothing is touched");
    }
    Ok(())
}
