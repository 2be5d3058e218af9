//! One STS3215 servo: its registers, and a joint of first order.

use std::time::Duration;

/// Position error at full torque and default gain, counts.
const FULL_LOAD_COUNTS: f64 = 150.0;
/// The servo follows its own trajectory with this delay, s.
const LAG_S: f64 = 0.03;
/// Greatest speed, counts/s.
const TOP_SPEED: f64 = 3400.0;
/// Counts/s^2 of one unit of the acceleration register.
const ACCELERATION_UNIT: f64 = 100.0;
/// Acceleration without a ramp, counts/s^2.
const NO_RAMP: f64 = 50_000.0;
/// Longest step of the integration.
const STEP: Duration = Duration::from_millis(4);
/// The first register that is not stored.
const FIRST_RAM: usize = 40;
/// Offset between the magnet's angle and the reported position, 2 bytes, sign in bit 11.
const OFFSET: usize = 31;
/// While this is 1, writes to stored registers are lost when the supply is.
const LOCK: usize = 55;
/// Counts of a turn: reported positions wrap.
const TURN: f64 = 4096.0;
const OVERLOADED: u8 = 0x20;

/// Registers that are not zero when a servo leaves the factory, or has just been switched on.
const DEFAULTS: [(usize, u8); 22] = [
    (0, 3),
    (1, 10),
    (3, 9),
    (4, 3),
    (8, 1),
    (11, 0xFF),
    (12, 0x0F),
    (13, 70),
    (14, 80),
    (15, 40),
    (16, 0xE8),
    (17, 3),
    (21, 32),
    (22, 32),
    (28, 0xF4),
    (29, 1),
    (34, 20),
    (35, 200),
    (36, 80),
    (48, 0xE8),
    (49, 3),
    (55, 1),
];

/// A servo.
#[derive(Clone, Debug)]
pub struct SimulatedServo {
    registers: [u8; 128],
    /// The registers that survive a loss of the supply.
    stored: [u8; FIRST_RAM],
    id: u8,
    /// Angle of the magnet, counts: what it reports is this less the offset.
    position: f64,
    speed: f64,
    /// The servo's own trajectory, counts and counts/s.
    target: f64,
    target_speed: f64,
    now: Duration,
    pressed: f64,
    overloaded: bool,
    /// Nothing passes this count, from either side.
    pub block: Option<f64>,
    /// By how many counts gravity pulls the servo below its goal.
    pub sag: f64,
    /// By how many counts positions flicker.
    pub noise: f64,
    /// True if it answers and takes commands.
    pub answers: bool,
    /// True if it falls silent, unchanged, at the next write to a stored register.
    pub mute_when_written: bool,
    /// True if it stores an offset, and counts on without it.
    pub ignores_offset: bool,
    /// Error bits beside those of an overload.
    pub alarm: u8,
    /// Writes to registers that a servo stores.
    pub stored_writes: u64,
}

impl SimulatedServo {
    /// A servo at its middle, without torque.
    pub fn new(id: u8) -> SimulatedServo {
        let mut servo = SimulatedServo {
            registers: [0; 128],
            stored: [0; FIRST_RAM],
            id,
            position: 2048.0,
            speed: 0.0,
            target: 2048.0,
            target_speed: 0.0,
            now: Duration::ZERO,
            pressed: 0.0,
            overloaded: false,
            block: None,
            sag: 0.0,
            noise: 0.0,
            answers: true,
            mute_when_written: false,
            ignores_offset: false,
            alarm: 0,
            stored_writes: 0,
        };
        for (at, value) in DEFAULTS {
            servo.set(at, value);
        }
        servo.set(5, id);
        servo.preserve();
        servo.reset();
        servo
    }

    /// Its id.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// Angle of the magnet, counts: the reported position if the offset is 0.
    pub fn position(&self) -> f64 {
        self.position
    }

    /// The position that it reports, counts: the magnet's angle less the stored offset, within one turn.
    pub fn reported(&self) -> f64 {
        let offset = if self.ignores_offset { 0 } else { signed(self.word(OFFSET), 11) };
        (self.position - f64::from(offset)).rem_euclid(TURN)
    }

    /// The goal register.
    pub fn goal(&self) -> i32 {
        signed(self.word(42), 15)
    }

    /// True if it has torque.
    pub fn has_torque(&self) -> bool {
        self.get(40) == 1
    }

    /// Its error bits.
    pub fn status(&self) -> u8 {
        self.alarm | if self.overloaded { OVERLOADED } else { 0 }
    }

    /// Puts its magnet elsewhere, as a hand does with a limp arm.
    pub fn place(&mut self, count: f64) {
        (self.position, self.target, self.speed, self.target_speed) = (count, count, 0.0, 0.0);
        self.set_word(42, sign_magnitude(self.reported(), 15));
    }

    /// Stores a value, as a tool does that calibrates it.
    pub fn store(&mut self, at: usize, value: u16) {
        self.set_word(at, value);
        self.preserve();
    }

    /// Makes the values of the stored registers survive a loss of the supply.
    fn preserve(&mut self) {
        self.stored.copy_from_slice(self.registers.get(..FIRST_RAM).unwrap_or(&[0; FIRST_RAM]));
    }

    /// Its supply breaks down for a moment: it starts again without torque.
    pub fn brown_out(&mut self) {
        let stored = self.stored.into_iter().chain(std::iter::repeat(0));
        self.registers.iter_mut().zip(stored).for_each(|(register, value)| *register = value);
        for (at, value) in DEFAULTS.into_iter().filter(|(at, _)| *at >= FIRST_RAM) {
            self.set(at, value);
        }
        self.reset();
    }

    fn reset(&mut self) {
        (self.target, self.target_speed, self.speed) = (self.position, 0.0, 0.0);
        (self.pressed, self.overloaded) = (0.0, false);
        self.set_word(42, sign_magnitude(self.reported(), 15));
        self.publish(0.0);
    }

    /// Registers, as many as there are.
    pub fn read(&self, at: usize, count: usize) -> Vec<u8> {
        self.registers.iter().skip(at).take(count).copied().collect()
    }

    /// Writes registers; those that it measures can't be written.
    pub fn write(&mut self, at: usize, data: &[u8]) {
        let stores = at < FIRST_RAM && !data.is_empty();
        if stores && self.mute_when_written {
            self.answers = false;
            return;
        }
        self.stored_writes += u64::from(stores);
        for (i, value) in data.iter().enumerate() {
            if at + i < 56 {
                self.set(at + i, *value);
            }
        }
        if stores && self.get(LOCK) == 0 {
            self.preserve();
        }
    }

    /// Lets time pass. `flicker` is between -1 and 1.
    pub fn advance(&mut self, now: Duration, flicker: f64) {
        while self.now < now {
            let step = STEP.min(now.saturating_sub(self.now));
            self.now += step;
            self.step(step.as_secs_f64());
        }
        self.publish(flicker * self.noise);
    }

    fn publish(&mut self, flicker: f64) {
        let load = self.load();
        self.set_word(56, sign_magnitude((self.reported() + flicker).round(), 15));
        self.set_word(58, sign_magnitude(self.speed, 15));
        self.set_word(60, sign_magnitude(load, 10));
        self.set(62, 74);
        self.set(63, 31 + (2.0 * self.pressed).min(59.0) as u8);
        self.set(65, self.status());
        self.set(66, u8::from(self.speed.abs() > 5.0));
        self.set_word(69, sign_magnitude(0.2 * load.abs(), 15));
    }

    /// Load in thousandths of full torque: proportional to the error, as the servo's controller is.
    pub fn load(&self) -> f64 {
        if !self.has_torque() {
            return 0.0;
        }
        let limit = f64::from(self.word(48));
        let most = if self.overloaded { limit.min(10.0 * f64::from(self.get(34))) } else { limit.min(1000.0) };
        (1000.0 * (self.target - self.position) * self.gain() / FULL_LOAD_COUNTS).clamp(-most, most)
    }

    fn gain(&self) -> f64 {
        (f64::from(self.get(21)) / 32.0).max(0.01)
    }

    fn step(&mut self, dt: f64) {
        if !self.has_torque() {
            (self.target, self.target_speed, self.speed) = (self.position, 0.0, 0.0);
            self.overloaded = false;
            return;
        }
        self.lead(dt);
        let (strength, weakness) = if self.overloaded { (0.2, 3.0) } else { (1.0, 1.0) };
        let want = self.target - weakness * self.sag / self.gain();
        let mut new = self.position + (want - self.position) * (dt / LAG_S).min(1.0) * strength;
        if let Some(block) = self.block
            && (self.position - block) * (new - block) <= 0.0
        {
            new = block + if self.position >= block { 0.01 } else { -0.01 };
        }
        (self.speed, self.position) = ((new - self.position) / dt, new);
        self.protect(dt);
    }

    /// The servo's own trajectory to its goal.
    fn lead(&mut self, dt: f64) {
        let limits = (f64::from(self.word(9)), f64::from(self.word(11)));
        let goal = f64::from(self.goal());
        let goal = if limits.1 > limits.0 { goal.clamp(limits.0, limits.1) } else { goal };
        // goals are in the reported frame
        let goal = goal + self.position - self.reported();
        let speed = f64::from(signed(self.word(46), 15)).abs();
        let speed = if speed > 0.0 { speed } else { TOP_SPEED };
        let ramp = f64::from(self.get(41)) * ACCELERATION_UNIT;
        let ramp = if ramp > 0.0 { ramp } else { NO_RAMP };
        let left = goal - self.target;
        let wanted = speed.min((2.0 * ramp * left.abs()).sqrt()).copysign(left);
        self.target_speed += (wanted - self.target_speed).clamp(-ramp * dt, ramp * dt);
        if left.abs() <= (self.target_speed.abs() * dt).max(1.0) {
            (self.target, self.target_speed) = (goal, 0.0);
        } else {
            self.target += self.target_speed * dt;
        }
    }

    /// After some time of overload the torque is lowered, until the goal is near again.
    fn protect(&mut self, dt: f64) {
        let is_pressed = self.load().abs() >= 10.0 * f64::from(self.get(36));
        self.pressed = if is_pressed { self.pressed + dt } else { (self.pressed - dt).max(0.0) };
        if self.pressed > 0.01 * f64::from(self.get(35)) {
            self.overloaded = true;
        } else if self.overloaded && (self.target - self.position).abs() < 10.0 {
            self.overloaded = false;
        }
    }

    fn get(&self, at: usize) -> u8 {
        self.registers.get(at).copied().unwrap_or_default()
    }

    fn set(&mut self, at: usize, value: u8) {
        if let Some(register) = self.registers.get_mut(at) {
            *register = value;
        }
    }

    fn word(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.get(at), self.get(at + 1)])
    }

    fn set_word(&mut self, at: usize, value: u16) {
        let [low, high] = value.to_le_bytes();
        self.set(at, low);
        self.set(at + 1, high);
    }
}

fn signed(raw: u16, bit: u16) -> i32 {
    let magnitude = i32::from(raw & ((1 << bit) - 1));
    if raw >> bit & 1 == 1 { -magnitude } else { magnitude }
}

fn sign_magnitude(value: f64, bit: u16) -> u16 {
    let most = (1u16 << bit) - 1;
    let magnitude = (value.abs().round() as u16).min(most);
    // there is no negative zero
    if value < 0.0 && magnitude > 0 { magnitude | 1 << bit } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(goal: u16) -> SimulatedServo {
        let mut servo = SimulatedServo::new(1);
        let [low, high] = goal.to_le_bytes();
        servo.write(41, &[254, low, high]);
        servo.write(40, &[1]);
        servo
    }

    #[test]
    fn a_servo_without_torque_stays_and_one_with_it_goes_to_its_goal() {
        let mut limp = SimulatedServo::new(1);
        limp.write(42, &[0, 10]);
        limp.advance(Duration::from_secs(1), 0.0);
        assert_eq!(limp.position(), 2048.0);
        let mut servo = driven(2560);
        servo.advance(Duration::from_secs(1), 0.0);
        assert!((servo.position() - 2560.0).abs() < 1.0, "{}", servo.position());
        servo.sag = 20.0;
        servo.advance(Duration::from_secs(2), 0.0);
        assert!((servo.position() - 2540.0).abs() < 1.0 && servo.load() > 100.0);
    }

    /// Two seconds of overload lower the torque to a fifth; a goal near the position restores it.
    #[test]
    fn an_overload_lowers_the_torque_until_it_is_relieved() {
        let mut servo = driven(3000);
        servo.block = Some(2200.0);
        servo.advance(Duration::from_millis(1900), 0.0);
        assert_eq!((servo.status(), servo.load()), (0, 1000.0));
        servo.advance(Duration::from_millis(2600), 0.0);
        assert_eq!((servo.status(), servo.load()), (OVERLOADED, 200.0));
        let [low, high] = 2195u16.to_le_bytes();
        servo.write(42, &[low, high]);
        servo.advance(Duration::from_secs(6), 0.0);
        assert_eq!(servo.status(), 0);
    }

    #[test]
    fn a_brown_out_takes_torque_and_goal_and_no_stored_value() {
        let mut servo = driven(2560);
        servo.advance(Duration::from_secs(1), 0.0);
        servo.brown_out();
        assert!(!servo.has_torque() && servo.goal() == 2560 && servo.read(3, 2) == [9, 3]);
        assert_eq!(servo.stored_writes, 0);
    }

    /// Reported positions and goals are those of the magnet less the offset; unlocked, the offset survives a loss of the supply.
    #[test]
    fn an_offset_shifts_positions_and_goals_and_is_stored_where_it_is_unlocked() {
        for (lock, reported) in [(1, 2048.0), (0, 1948.0)] {
            let mut servo = SimulatedServo::new(1);
            servo.write(LOCK, &[lock]);
            servo.write(OFFSET, &100u16.to_le_bytes());
            servo.advance(Duration::from_millis(1), 0.0);
            assert_eq!((servo.reported(), servo.read(56, 2)), (1948.0, 1948u16.to_le_bytes().to_vec()));
            let [low, high] = 2000u16.to_le_bytes();
            servo.write(41, &[254, low, high]);
            servo.write(40, &[1]);
            servo.advance(Duration::from_secs(1), 0.0);
            assert!((servo.position() - 2100.0).abs() < 1.0, "{}", servo.position());
            servo.place(2048.0);
            servo.brown_out();
            assert_eq!(servo.reported(), reported);
        }
    }
}
