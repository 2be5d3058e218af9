//! Control measurement for tests in real time: bare threads that only sleep, on the same processors at the
//! same time.
//!
//! ```text
//! work       ──────────────── took 31 ms ────────────────┐
//! control    nap nap nap  nap nap nap (9 ms late) nap nap ┴─> 31 ms, of which the machine may account for 9 at each waking
//! ```
//! If a busy machine wakes all threads up late, the control measures this lateness, and the work is judged by
//! the rest.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Duration of one sleep of the control.
const NAP: Duration = Duration::from_millis(2);

/// Lateness of the wakings of a control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lateness {
    /// Median.
    pub usual: Duration,
    /// Maximum.
    pub most: Duration,
}

impl Lateness {
    fn of(mut all: Vec<Duration>) -> Lateness {
        all.sort();
        let usual = all.get(all.len() / 2).copied().unwrap_or_default();
        Lateness { usual, most: all.last().copied().unwrap_or_default() }
    }

    /// Time without the lateness of `wakings` wakings, each as late as the latest of the control.
    pub fn apart_from(&self, took: Duration, wakings: u32) -> Duration {
        took.saturating_sub(self.most.saturating_mul(wakings))
    }
}

/// Runs the work while a control runs, one thread per processor.
pub fn beside<T>(work: impl FnOnce() -> T) -> (T, Lateness) {
    let over = AtomicBool::new(false);
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..processors).map(|_| scope.spawn(|| nap_until(&over))).collect();
        let done = {
            let _over = Over(&over);
            work()
        };
        let late = threads.into_iter().filter_map(|thread| thread.join().ok()).flatten();
        (done, Lateness::of(late.collect()))
    })
}

/// Ends the control, even if the work panics.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Measures the excess of each nap.
#[expect(clippy::disallowed_methods, reason = "a control of real time lives in real time")]
fn nap_until(over: &AtomicBool) -> Vec<Duration> {
    let mut late = Vec::new();
    while !over.load(Ordering::Relaxed) {
        let then = std::time::Instant::now();
        std::thread::sleep(NAP);
        late.push(then.elapsed().saturating_sub(NAP));
    }
    late
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_control_reports_its_median_its_maximum_and_the_remaining_time() {
        let ms = Duration::from_millis;
        let late = Lateness::of(vec![ms(9), ms(0), ms(1)]);
        assert_eq!(late, Lateness { usual: ms(1), most: ms(9) });
        assert_eq!((late.apart_from(ms(31), 2), late.apart_from(ms(10), 2)), (ms(13), ms(0)));
        assert_eq!(Lateness::of(Vec::new()), Lateness::default());
    }

    #[test]
    fn a_control_ends_with_its_work_even_if_that_panics() {
        let (done, late) = beside(|| 7);
        assert!(done == 7 && late.usual <= late.most);
        let caught = std::panic::catch_unwind(|| beside(|| std::panic::resume_unwind(Box::new("planted"))));
        assert!(caught.is_err());
    }
}
