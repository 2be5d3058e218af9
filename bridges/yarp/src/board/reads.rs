//! Queries that may reach the board: those that are known to change nothing.

use mobee_yarp::{Bottle, Vocab};

const GET: Vocab = Vocab::new("get");

/// Second word of each query. Motion and state, then motors, amplifiers, temperatures, torque, current, PWM,
/// PID, faults, remote calibrator and variables.
const READS: &[Vocab] = &[
    Vocab::new("prot"),
    Vocab::new("axes"),
    Vocab::new("name"),
    Vocab::new("type"),
    Vocab::new("llim"),
    Vocab::new("vlim"),
    Vocab::new("enc"),
    Vocab::new("encs"),
    Vocab::new("esp"),
    Vocab::new("esps"),
    Vocab::new("eac"),
    Vocab::new("eacs"),
    Vocab::new("pos"),
    Vocab::new("poss"),
    Vocab::new("posg"),
    Vocab::new("don"),
    Vocab::new("dons"),
    Vocab::new("dong"),
    Vocab::new("vel"),
    Vocab::new("vels"),
    Vocab::new("velg"),
    Vocab::new("acc"),
    Vocab::new("accs"),
    Vocab::new("accg"),
    Vocab::new("vmo"),
    Vocab::new("vmos"),
    Vocab::new("vmog"),
    Vocab::new("dpo"),
    Vocab::new("dpos"),
    Vocab::new("dpog"),
    Vocab::new("icmd"),
    Vocab::new("intm"),
    Vocab::new("mtnm"),
    Vocab::new("mnum"),
    Vocab::new("mnc"),
    Vocab::new("mncs"),
    Vocab::new("msp"),
    Vocab::new("msps"),
    Vocab::new("mac"),
    Vocab::new("macs"),
    Vocab::new("mcpr"),
    Vocab::new("asta"),
    Vocab::new("asts"),
    Vocab::new("acu"),
    Vocab::new("acus"),
    Vocab::new("maxc"),
    Vocab::new("acno"),
    Vocab::new("acpk"),
    Vocab::new("pwm"),
    Vocab::new("pwml"),
    Vocab::new("avsu"),
    Vocab::new("tmp"),
    Vocab::new("tmps"),
    Vocab::new("tmpl"),
    Vocab::new("gbxr"),
    Vocab::new("torq"),
    Vocab::new("icur"),
    Vocab::new("ipwm"),
    Vocab::new("pid"),
    Vocab::new("ijfl"),
    Vocab::new("reca"),
    Vocab::new("ivar"),
];

/// True if a request is one of these queries.
pub(super) fn allowed(request: &Bottle) -> bool {
    let word = |i: usize| request.0.get(i).and_then(|v| v.as_vocab());
    word(0) == Some(GET) && word(1).is_some_and(|code| READS.contains(&code))
}
