//! Sweeps the base of an SO-101 by 10 degrees to each side and prints readings, faults and cycle times.
//!
//! ```sh
//! cargo run --release -p mobee-feetech --example sweep -- /dev/ttyACM0 30
//! ```
//! Every servo gets torque where it is. The range of each is taken to be 1100 to 3000 counts: lay the arm near its middle.

use mobee_contract::{Command, Driver, Hardware, Move, Time};
use mobee_feetech::{BusMotorSettings, FeetechHardware, FeetechSettings};
use std::path::Path;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let port = std::env::args().nth(1).ok_or("give the serial port")?;
    let seconds: u64 = std::env::args().nth(2).map_or(Ok(10), |text| text.parse())?;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/so101.xml");
    let robot = mobee_model::load_robot(&file)?.value;
    let motor = |(i, motor): (usize, &mobee_model::Motor)| BusMotorSettings {
        joint: motor.name.clone(),
        id: Some(i as u8 + 1),
        range: Some([1100, 3000]),
        offset_deg: if motor.name == "gripper" { 45.0 } else { 0.0 },
        ..BusMotorSettings::default()
    };
    let motors = robot.motors.iter().enumerate().map(motor).collect();
    let hardware = FeetechHardware::new(&FeetechSettings { motors, ..FeetechSettings::at(port) }, &robot)?;
    let mut driver = hardware.connect()?;
    sweep(&hardware, driver.as_mut(), Duration::from_secs(seconds));
    println!("{:?}", hardware.cycles());
    Ok(())
}

#[allow(clippy::disallowed_methods, reason = "a serial line lives in real time")]
fn sweep(hardware: &FeetechHardware, driver: &mut dyn Driver, time: Duration) {
    let begun = Instant::now();
    let (mut middle, mut side, mut fault) = (None, 1.0, String::new());
    while begun.elapsed() < time {
        let now = Time(begun.elapsed().as_nanos() as u64);
        driver.lease(now, now + Duration::from_millis(200));
        match driver.sample(now) {
            Ok(Some(sample)) if sample.done.iter().all(|d| *d) => {
                let here = sample.q.first().copied().unwrap_or_default();
                let q: f64 = *middle.get_or_insert(here) + 10f64.to_radians() * side;
                side = -side;
                let deg: Vec<String> = sample.q.iter().map(|q| format!("{:.1}", q.to_degrees())).collect();
                println!("{now}: {} deg, {:?}", deg.join(" "), hardware.cycles());
                let speed = Some(vec![30f64.to_radians()]);
                let go = Move { motors: vec![0], q: vec![q], relative: false, speed, acceleration: None };
                if let Err(e) = driver.command(now, &Command::Move(go)) {
                    println!("{e}");
                }
            }
            Ok(_) => {}
            Err(e) if fault != e.to_string() => {
                fault = e.to_string();
                println!("{now}: {fault}");
            }
            Err(_) => {}
        }
        if let Some(news) = driver.news() {
            println!("{news}");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}
