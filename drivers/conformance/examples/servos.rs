//! Six simulated STS3215 servos, ids 1 to 6, at a serial port: an SO-101 to try a driver with.
//!
//! ```sh
//! cargo run --release -p mobee-conformance --example servos -- /tmp/so101
//! ```
//! Lines on standard input: `block ID COUNT`, `free ID`, `hand ID COUNT` (moves a limp joint), `sag ID COUNTS`, `drop ID`, `back ID`, `brown ID`, `damage SHARE`, `lose SHARE`, `late MS`,
//! `unplug`, `plug`, `state`, `quit`.

#[cfg(unix)]
use mobee_conformance::servos::{ServoTerminal, SimulatedServo};

#[cfg(unix)]
fn main() -> std::io::Result<()> {
    use mobee_conformance::servos::ServoWorld;
    let link = std::env::args().nth(1).unwrap_or_else(|| "/tmp/so101".into());
    let mut terminal = ServoTerminal::start(link.as_ref(), ServoWorld::new(1..=6), 1_000_000)?;
    println!("{}", terminal.port().display());
    for line in std::io::stdin().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["quit"] => return Ok(()),
            ["unplug"] => terminal.unplug(),
            ["plug"] => terminal.plug_in()?,
            words => act(&terminal, words),
        }
    }
    // without a standard input it goes on until it is ended
    loop {
        std::thread::park();
    }
}

#[cfg(unix)]
fn act(terminal: &ServoTerminal, words: &[&str]) {
    let number = |at: usize| words.get(at).and_then(|word| word.parse::<f64>().ok());
    let change: Option<fn(&mut SimulatedServo, f64)> = match words.first().copied().unwrap_or_default() {
        "block" => Some(|servo, count| servo.block = Some(count)),
        "free" => Some(|servo, _| servo.block = None),
        "sag" => Some(|servo, counts| servo.sag = counts),
        "drop" => Some(|servo, _| servo.answers = false),
        "back" => Some(|servo, _| servo.answers = true),
        "brown" => Some(|servo, _| servo.brown_out()),
        "hand" => Some(|servo, count| servo.place(count)),
        _ => None,
    };
    terminal.with(|world| match (words.first().copied().unwrap_or_default(), change) {
        (_, Some(change)) => match number(1).and_then(|id| world.servo(id as u8)) {
            Some(servo) => change(servo, number(2).unwrap_or_default()),
            None => eprintln!("no such servo: {}", words.join(" ")),
        },
        ("damage", _) => world.damaged = number(1).unwrap_or_default(),
        ("lose", _) => world.lost = number(1).unwrap_or_default(),
        ("late", _) => world.late = std::time::Duration::from_secs_f64(number(1).unwrap_or_default().max(0.0) / 1e3),
        ("state", _) => {
            for servo in world.servos() {
                let (id, at, load) = (servo.id(), servo.position(), servo.load());
                let reported = servo.reported();
                println!("{id}: {at:.1} counts, reports {reported:.0}, load {load:.0}, torque {}", servo.has_torque());
            }
        }
        (word, _) => eprintln!("unknown word `{word}`"),
    });
}

#[cfg(not(unix))]
fn main() {
    eprintln!("pseudo-terminals need a Unix system");
}
