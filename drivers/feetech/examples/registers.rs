//! Reads and writes registers of servos, a command per line of the standard input; numbers are decimal, bytes hexadecimal.
//!
//! ```sh
//! cargo run --release -p mobee-feetech --example registers -- /dev/ttyACM0
//! ```
//! `ping ID`, `read ID ADDRESS COUNT`, `write ID ADDRESS BYTES`, `sync_read ADDRESS COUNT ID...`, `sync_write ADDRESS ID=BYTES...`. Each answer
//! is a line: `ok`, then for each servo its id and its bytes. **A write moves or reconfigures a real arm, unchecked.**

use mobee_feetech::bus::{ServoBus, open_port};
use std::error::Error;
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let port = std::env::args().nth(1).ok_or("give the serial port")?;
    let mut bus = ServoBus::new(open_port(&port, 1_000_000)?, Duration::from_millis(100));
    for line in std::io::stdin().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match act(&mut bus, &words) {
            Ok(answer) => println!("ok{answer}"),
            Err(e) => println!("error {e}"),
        }
    }
    Ok(())
}

fn act(bus: &mut ServoBus, words: &[&str]) -> Result<String, Box<dyn Error>> {
    let number = |text: &str| text.parse::<u8>();
    Ok(match words {
        ["ping", id] => format!(" {id}={:02x}", bus.ping(number(id)?)?),
        ["read", id, address, count] => {
            let answer = bus.read(number(id)?, number(address)?, number(count)?)?;
            format!(" {}={}", answer.id, hex(&answer.data))
        }
        ["write", id, address, data] => {
            bus.write(number(id)?, number(address)?, bytes(data)?)?;
            String::new()
        }
        ["sync_read", address, count, ids @ ..] => {
            let ids = ids.iter().map(|id| number(id)).collect::<Result<Vec<u8>, _>>()?;
            let answers = bus.sync_read(number(address)?, number(count)?, &ids)?;
            answers.iter().map(|a| format!(" {}={}", a.id, hex(&a.data))).collect()
        }
        ["sync_write", address, servos @ ..] => {
            let one = |servo: &&str| -> Result<(u8, Vec<u8>), Box<dyn Error>> {
                let (id, data) = servo.split_once('=').ok_or("give ID=BYTES")?;
                Ok((number(id)?, bytes(data)?))
            };
            bus.sync_write(number(address)?, servos.iter().map(one).collect::<Result<_, _>>()?)?;
            String::new()
        }
        _ => return Err("ping, read, write, sync_read or sync_write".into()),
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(text: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let byte = |at: usize| -> Result<u8, Box<dyn Error>> {
        Ok(u8::from_str_radix(text.get(at..at + 2).ok_or("bytes are two digits each")?, 16)?)
    };
    (0..text.len()).step_by(2).map(byte).collect()
}
