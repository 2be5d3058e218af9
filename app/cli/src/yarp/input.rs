//! Standard input as lines.

use std::io::BufRead;
use tokio::sync::mpsc;

/// The lines of standard input, read by a separate thread so that nothing else waits for them.
pub(super) struct Lines(mpsc::Receiver<Vec<u8>>);

impl Lines {
    /// Starts reading.
    pub(super) fn new() -> Lines {
        let (send, lines) = mpsc::channel(1);
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().split(b'\n') {
                let Ok(mut line) = line else { return };
                if line.last() == Some(&b'\r') {
                    line.pop();
                }
                if send.blocking_send(line).is_err() {
                    return;
                }
            }
        });
        Lines(lines)
    }

    /// The next line; `None` at the end of the input.
    pub(super) async fn next(&mut self) -> Option<Vec<u8>> {
        self.0.recv().await
    }
}
