//! The registers of an STS3215 that the driver uses, and what they mean. Pure.
//!
//! Source: Feetech, "ST3215 memory table"; little endian, signed values as sign and magnitude.

/// Model number, 2 bytes.
pub const MODEL: u8 = 3;
/// Model number of an STS3215.
pub const STS3215: u16 = 777;
/// Bytes of the block that is read once at the connection: all of the EEPROM that matters.
pub const IDENTITY_BYTES: u8 = 40;
/// Lower and upper position limit, 2 bytes each.
pub const LIMITS: u8 = 9;
/// Offset between magnet and position, 2 bytes, sign in bit 11.
pub const OFFSET: u8 = 31;
/// Operating mode: 0 is position.
pub const OPERATING_MODE: u8 = 33;
/// Torque: 1 on, 0 off.
pub const TORQUE: u8 = 40;
/// Acceleration, goal position, goal time and goal speed follow each other from here.
pub const ACCELERATION: u8 = 41;
/// Goal position, 2 bytes.
pub const GOAL: u8 = 42;
/// First and last byte of the state: torque to current.
pub const STATE: (u8, u8) = (40, 70);
/// Lock of the stored registers: at 0 their values survive a loss of the supply.
pub const LOCK: u8 = 55;
/// The acceleration that the driver sets: the fastest ramp, since it streams its own trajectory.
pub const FASTEST_RAMP: u8 = 254;
/// Counts in a turn.
pub const TURN_COUNTS: i32 = 4096;

/// The first register of EEPROM is 0, the first of RAM this one: only a calibration writes below it.
pub const FIRST_RAM: u8 = 40;

/// Decodes a value with the sign in this bit.
pub fn signed(raw: u16, bit: u32) -> i32 {
    let magnitude = i32::from(raw & ((1 << bit) - 1));
    if raw >> bit & 1 == 1 { -magnitude } else { magnitude }
}

/// Encodes a value with the sign in this bit; a greater magnitude than it can have is cut.
pub fn sign_magnitude(value: i32, bit: u32) -> u16 {
    let most = (1u32 << bit) - 1;
    let magnitude = value.unsigned_abs().min(most) as u16;
    if value < 0 { magnitude | 1 << bit } else { magnitude }
}

/// Two bytes at this place.
pub fn word(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]))
}

/// The state of one servo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServoState {
    /// True if it has torque.
    pub torque: bool,
    /// Its ramp.
    pub acceleration: u8,
    /// The goal that it follows, counts.
    pub goal: i32,
    /// Position, counts.
    pub position: i32,
    /// Speed, counts/s.
    pub speed: i32,
    /// Load, thousandths of the greatest torque.
    pub load: i32,
    /// Voltage, tenths of a volt.
    pub voltage: u8,
    /// Temperature, degrees Celsius.
    pub temperature: u8,
    /// Error bits.
    pub status: u8,
    /// Current, units of 6.5 mA.
    pub current: i32,
}

impl ServoState {
    /// Decodes the registers from [`STATE`] on.
    pub fn decode(bytes: &[u8]) -> Option<ServoState> {
        let at = |register: u8| usize::from(register - STATE.0);
        let byte = |register: u8| bytes.get(at(register)).copied();
        Some(ServoState {
            torque: byte(TORQUE)? == 1,
            acceleration: byte(ACCELERATION)?,
            goal: signed(word(bytes, at(GOAL))?, 15),
            position: signed(word(bytes, at(56))?, 15),
            speed: signed(word(bytes, at(58))?, 15),
            load: signed(word(bytes, at(60))?, 10),
            voltage: byte(62)?,
            temperature: byte(63)?,
            status: byte(65)?,
            current: signed(word(bytes, at(69))?, 15),
        })
    }
}

/// The status bit of a servo that has lowered its torque.
pub const OVERLOADED: u8 = 0x20;
/// The error bits of an STS3215, each with a name and a remedy.
pub const STATUS_BITS: [(u8, &str, &str); 5] = [
    (0x01, "has a voltage out of its range", "check the power supply: 5 to 7.4 V, or 12 V for 12 V servos, and 5 A"),
    (0x02, "has a fault of its position sensor", "switch the arm off and on; if it stays, replace the servo"),
    (0x04, "is too hot", "let the arm rest, its weight supported, until the servo is below 60 degrees Celsius"),
    (0x08, "draws too much current", "free the joint, then switch the arm off and on"),
    (OVERLOADED, "is overloaded and has lowered its torque", "support the arm, free the joint, then recover"),
];

/// The names of these error bits, and what to do about the first.
pub fn status_text(status: u8) -> Option<(String, &'static str)> {
    let set: Vec<_> = STATUS_BITS.iter().filter(|(bit, ..)| status & bit != 0).collect();
    let names: Vec<&str> = set.iter().map(|(_, name, _)| *name).collect();
    match set.first() {
        Some((.., remedy)) => Some((names.join(" and "), remedy)),
        None if status != 0 => {
            Some((format!("reports unknown error bits 0x{status:02x}"), "switch the arm off and on"))
        }
        None => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn signs_survive(value in -2047i32..=2047) {
            prop_assert_eq!(signed(sign_magnitude(value, 11), 11), value);
            prop_assert_eq!(signed(sign_magnitude(value, 15), 15), value);
        }

        /// A state is decoded from exactly as many bytes as are read, and never from fewer.
        #[test]
        fn a_state_needs_all_its_bytes(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let whole = usize::from(STATE.1 - STATE.0) + 1;
            prop_assert_eq!(ServoState::decode(&bytes).is_some(), bytes.len() >= whole);
        }
    }

    #[test]
    fn error_bits_have_names_and_remedies() {
        assert_eq!(status_text(0), None);
        let (text, remedy) = status_text(0x24).unwrap();
        assert_eq!(text, "is too hot and is overloaded and has lowered its torque");
        assert!(remedy.contains("rest"));
        assert!(status_text(0x40).unwrap().0.contains("0x40"));
    }
}
