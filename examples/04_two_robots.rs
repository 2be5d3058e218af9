//! Two robots that teach each other: a Katana takes a block to known places, an iCub looks at it, and from what both of its eyes saw every
//! kind of locator learns where such a block is. The best one then tells the iCub's sensor in a run of its own.
//!
//! `cargo run --release --example 04_two_robots`

use mobee::run::example_in;
use mobee_contract::Event;
use mobee_journal::journal;

const BEHAVIOR: &str = "configs/behaviors/collect.toml";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let dir = tempfile::tempdir()?;
    let (run, again) = (dir.path().join("run"), dir.path().join("again"));
    let at = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let (table, locator) = (at("block.csv"), at("block.locator.json"));
    let (folder, quiet) = (run.to_string_lossy(), "record.enabled=false");
    example_in(&run, BEHAVIOR, &[quiet, "for_s=400"])?;
    print!("{}", mobee::locator::example(&["collect", &folder, "--out", &table])?);
    print!("{}", mobee::locator::example(&["best", "--data", &table, "--out", &locator])?);
    // now it is asked where the block is, which the other robot holds and nobody tells
    let kind = if mobee::locator::example(&["show", &locator])?.starts_with("calibrated") {
        "calibrated"
    } else {
        "triangulate"
    };
    let sensor = format!("sensor.eyes.locator={{ kind = \"{kind}\", file = \"{locator}\" }}");
    example_in(&again, BEHAVIOR, &[quiet, "for_s=60", "seed=2", &sensor])?;
    let mut located = 0;
    for line in journal::read(&again)? {
        located += usize::from(matches!(line?.event, Event::Located { .. }));
    }
    println!("the {kind} locator placed the block {located} times in another run");
    assert!(located > 20, "it places what it sees");
    Ok(())
}
