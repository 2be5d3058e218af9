//! Recent answer times of a board.

use mobee_contract::AnswerTime;
use std::collections::VecDeque;
use std::time::Duration;

/// Age beyond which an answer is ignored, s.
const WINDOW_S: f64 = 5.0;
/// Least and greatest weight of an answer, s. The greatest is the interval of answers when nothing else is
/// requested.
const COUNTS: (f64, f64) = (1e-3, 0.1);
/// Largest number of answers stored.
const MAX_ANSWERS: usize = 128;

/// Round-trip times of one board. Times in seconds.
#[derive(Clone, Debug, Default)]
pub struct Answers(VecDeque<(f64, f64)>);

impl Answers {
    /// Adds an answer that arrived at `now`, `took` seconds after its request.
    pub fn note(&mut self, now: f64, took: f64) {
        if self.0.len() >= MAX_ANSWERS {
            self.0.pop_front();
        }
        self.0.push_back((now, took));
    }

    /// Arrival time of the newest answer.
    pub fn newest(&self) -> Option<f64> {
        self.0.back().map(|(at, _)| *at)
    }

    /// Statistics of the recent answers, each weighted by the time since the one before, because a board that
    /// has become slow answers less often. `None` without recent answers.
    pub fn summary(&self, now: f64) -> Option<AnswerTime> {
        let mut before = f64::NEG_INFINITY;
        let counted = self.0.iter().map(|(at, took)| {
            let counts = (at - before).clamp(COUNTS.0, COUNTS.1);
            before = *at;
            (*at, *took, counts)
        });
        let of_late = counted.filter(|(at, ..)| *at >= now - WINDOW_S);
        let mut took: Vec<(f64, f64)> = of_late.map(|(_, took, counts)| (took, counts)).collect();
        took.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f64 = took.iter().map(|(_, counts)| counts).sum();
        let within = |share: f64| {
            let mut sum = 0.0;
            let of_share = took.iter().find(|(_, counts)| {
                sum += counts;
                sum > share * all
            });
            of_share.or(took.last()).map(|(took, _)| Duration::try_from_secs_f64(*took).unwrap_or_default())
        };
        Some(AnswerTime { median: within(0.5)?, most: within(0.9)?, greatest: within(1.0)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_late_answer_is_reported_and_does_not_count_as_a_slow_board() {
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
    #[test]
    fn a_board_that_becomes_slow_is_slow_however_often_it_answered_before() {
        let mut answers = Answers::default();
        (0..110).for_each(|i| answers.note(0.01 * f64::from(i), 0.001));
        assert_eq!(answers.summary(1.1).unwrap().most, Duration::from_millis(1));
        (1..=10).for_each(|i| answers.note(1.1 + 0.1 * f64::from(i), 0.1));
        let slow = answers.summary(2.1).unwrap();
        assert_eq!(slow.most, Duration::from_millis(100), "half of the time: {slow:?}");
    }
}
