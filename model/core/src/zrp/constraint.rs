//! Half-spaces over the motors of a part: `sum(a_i * q_i) + b > 0`, with q in degrees of encoder.
//!
//! ```text
//! <constraint a="1 -1" q="0 2" b="30"/>          q0 - q2 + 30 > 0: motor 2 is at most 30 degrees ahead of motor 0
//! ```

use super::element::Element;
use crate::HalfSpace;
use mobee_text::FileError;
use std::ops::Range;

/// A half-space over motor indices of its part. Resolved at the end of the file, since motors may follow later.
pub(super) struct Member {
    /// Pairs of (motor index within the part, coefficient).
    terms: Vec<(usize, f64)>,
    /// The constant, degrees of encoder.
    b: f64,
    /// The element, for errors that are detected only at the end of the file.
    element: Element,
}

impl Member {
    /// The attributes of a `constraint`: coefficients, motor indices, constant.
    pub(super) const ATTRIBUTES: &[&str] = &["a", "q", "b"];

    /// Reads a `constraint` element.
    pub(super) fn read(e: Element) -> Result<Self, FileError> {
        let a = e.numbers("a")?;
        let q = e.numbers("q")?;
        let b = e.number_or_zero("b")?;
        if a.is_empty() || a.len() != q.len() {
            let message = format!("`a` has {} numbers and `q` has {}", a.len(), q.len());
            return Err(e.error_at("q", message, "give one motor index in q for each coefficient in a, at least one"));
        }
        if let Some(bad) = q.iter().find(|i| i.fract() != 0.0 || **i < 0.0) {
            let message = format!("`q` holds {bad}, which is no motor index");
            return Err(e.error_at("q", message, "motor indices of the part are counted from 0"));
        }
        let terms = q.into_iter().map(|i| i as usize).zip(a).collect();
        Ok(Self { terms, b, element: e })
    }

    /// Converts the indices to those of the robot's motors; `motors` are the part's.
    pub(super) fn resolve(&self, part: &str, motors: Range<usize>) -> Result<HalfSpace, FileError> {
        if let Some((bad, _)) = self.terms.iter().find(|(q, _)| *q >= motors.len()) {
            let help = match motors.len() {
                0 => "the part has no motors".to_owned(),
                n => format!("its motors have the indices 0 to {}", n - 1),
            };
            return Err(self.element.error_at("q", format!("part `{part}` has no motor with index {bad}"), help));
        }
        Ok(HalfSpace { terms: self.terms.iter().map(|(q, a)| (motors.start + q, *a)).collect(), b: self.b })
    }
}
