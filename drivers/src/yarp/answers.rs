//! How long a board takes to answer, from what it answered of late.

use mobee_contract::AnswerTime;
use std::collections::VecDeque;
use std::time::Duration;

/// For how long an answer counts, s.
const WINDOW: f64 = 5.0;
/// Most answers that are kept.
const MOST: usize = 128;

/// The round trips of one board. Times in seconds.
#[derive(Clone, Debug, Default)]
pub struct Answers(VecDeque<(f64, f64)>);

impl Answers {
    /// An answer came now, and took so long.
    pub fn note(&mut self, now: f64, took: f64) {
        if self.0.len() >= MOST {
            self.0.pop_front();
        }
        self.0.push_back((now, took));
    }

    /// When the newest came.
    pub fn newest(&self) -> Option<f64> {
        self.0.back().map(|(at, _)| *at)
    }

    /// What the answers of late took; `None` if there were none.
    pub fn summary(&self, now: f64) -> Option<AnswerTime> {
        let of_late = self.0.iter().filter(|(at, _)| *at >= now - WINDOW);
        let mut took: Vec<f64> = of_late.map(|(_, took)| *took).collect();
        took.sort_by(f64::total_cmp);
        let share = |tenths: usize| took.get((took.len() * tenths / 10).min(took.len().checked_sub(1)?)).copied();
        let secs = |s: f64| Duration::try_from_secs_f64(s).unwrap_or_default();
        Some(AnswerTime { median: secs(share(5)?), most: secs(share(9)?), greatest: secs(*took.last()?) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_late_answer_is_told_and_does_not_count_as_a_slow_board() {
        let mut answers = Answers::default();
        assert_eq!(answers.summary(0.0), None);
        for i in 0..40 {
            answers.note(0.1 * f64::from(i), if i == 20 { 0.5 } else { 0.001 * f64::from(i % 4) });
        }
        let summary = answers.summary(4.0).unwrap();
        assert_eq!(summary.greatest, Duration::from_millis(500));
        assert!(summary.median <= summary.most && summary.most < Duration::from_millis(5), "{summary:?}");
        for i in 40..80 {
            answers.note(0.1 * f64::from(i), 0.2);
        }
        let slow = answers.summary(8.0).unwrap();
        assert_eq!((slow.median, slow.most), (Duration::from_millis(200), Duration::from_millis(200)));
        assert_eq!(answers.summary(20.0), None, "what was long ago says nothing of now");
    }
}
