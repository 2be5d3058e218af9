//! `mobee calibrate`: makes the calibration of an arm of servos, in LeRobot's format. A person moves each joint of the limp arm by hand.

use miette::Report;
use std::path::PathBuf;
use std::process::ExitCode;

#[cfg(feature = "feetech")]
mod session;

/// The arguments of `mobee calibrate`.
#[derive(clap::Args)]
pub struct CalibrateArgs {
    /// The serial port of the arm, such as /dev/ttyACM0.
    #[arg(long, value_name = "PORT")]
    pub port: String,
    /// The calibration to write.
    #[arg(long, value_name = "FILE.json")]
    pub out: PathBuf,
    /// The arm.
    #[arg(long, value_name = "ARM", default_value = "so101")]
    pub arm: String,
    /// Baud rate of its bus.
    #[arg(long, value_name = "BAUD", default_value_t = 1_000_000)]
    pub baud: u32,
    /// Also home the arm: store new offsets, by which every joint counts 2047 at its middle, and the limits of the ranges in the servos.
    /// Without it nothing is written to the servos.
    #[arg(long)]
    pub write_offsets: bool,
    /// Store them without a question.
    #[arg(long, requires = "write_offsets")]
    pub yes: bool,
    /// Replace the file if it exists.
    #[arg(long)]
    pub force: bool,
}

/// Makes a calibration.
///
/// # Errors
/// If the arm is unknown, can't be reached or has torque, a joint was not moved through its range, or the file can't be written. Nothing
/// is written then.
pub fn command(args: &CalibrateArgs) -> Result<ExitCode, Report> {
    let arm = crate::arms::known(&args.arm)?;
    crate::roadmap::may_write(&args.out, args.force)?;
    #[cfg(feature = "feetech")]
    return session::run(args, arm);
    #[cfg(not(feature = "feetech"))]
    Err({
        let _ = arm;
        crate::arms::lacks_driver().into()
    })
}
