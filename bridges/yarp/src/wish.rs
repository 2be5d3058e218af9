//! Messages of a part's `cmd:i`, as in the original.
//!
//! ```text
//! qatt (n0 n1 ...)                    attractor; shares of each joint's range
//! qfor (f0 f1 ...)                    a force per joint
//! opsp MARKER (Fx Fy Fz Tx Ty Tz)     a force and a torque at a marker, world frame; missing values are 0
//! ```

use super::words;
use mobee_filter::force_field::Wish;
use mobee_yarp::{Bottle, Value};

/// Parses a message; `None` if it is not one of these, or if one of its numbers is malformed.
pub(crate) fn parse(message: &Bottle) -> Option<Wish> {
    let list = |value: Option<&Value>| match value {
        Some(Value::List(list)) => words::numbers(&list.0),
        _ => None,
    };
    match words::name(message.0.first())?.as_str() {
        "qatt" => list(message.0.get(1)).map(Wish::Attractor),
        "qfor" => list(message.0.get(1)).map(Wish::Force),
        "opsp" => {
            let wrench = list(message.0.get(2))?;
            let at = |i: usize| wrench.get(i).copied().unwrap_or_default();
            let marker = words::name(message.0.get(1))?;
            Some(Wish::Wrench { marker, force: [at(0), at(1), at(2)], torque: [at(3), at(4), at(5)] })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::words::string;
    use super::*;

    #[test]
    fn messages_are_read_and_nonsense_is_not() {
        let list = |v: &[f64]| Value::List(Bottle(v.iter().map(|x| Value::Float64(*x)).collect()));
        let att = Bottle(vec![string("qatt"), list(&[0.1, 0.2])]);
        assert_eq!(parse(&att), Some(Wish::Attractor(vec![0.1, 0.2])));
        let wrench = Bottle(vec![string("opsp"), string("hand"), list(&[1.0])]);
        let expected = Wish::Wrench { marker: "hand".into(), force: [1.0, 0.0, 0.0], torque: [0.0; 3] };
        assert_eq!(parse(&wrench), Some(expected));
        for nonsense in [
            Bottle(vec![]),
            Bottle(vec![string("qatt"), Value::Int32(1)]),
            Bottle(vec![string("qfor"), list(&[f64::NAN])]),
            Bottle(vec![string("opsp"), list(&[1.0])]),
            Bottle(vec![list(&[1.0])]),
        ] {
            assert_eq!(parse(&nonsense), None);
        }
    }
}
