//! Joints of a request, given by its code and its first arguments.

use crate::{Bottle, Value, Vocab};

/// Greatest number of joints of a board; longer lists are refused before any processing.
pub(super) const MOST_JOINTS: usize = 1024;

/// One joint, all or some, numbered from 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Joints {
    /// One joint.
    One(usize),
    /// All of the board, in order.
    All,
    /// Some, in the order given.
    Group(Vec<usize>),
}

impl Joints {
    /// Joints of a board with this number of axes; `None` if one does not exist, or if the group names one
    /// twice.
    pub fn on(&self, axes: usize) -> Option<Vec<usize>> {
        match self {
            Joints::One(j) => (*j < axes).then(|| vec![*j]),
            Joints::All => Some((0..axes).collect()),
            Joints::Group(group) => {
                let mut seen = vec![false; axes];
                for j in group {
                    let slot = seen.get_mut(*j)?;
                    if std::mem::replace(slot, true) {
                        return None;
                    }
                }
                Some(group.clone())
            }
        }
    }

    /// Writes the first arguments of these joints: nothing, `j`, or `n (J)`.
    pub(super) fn write(&self, to: &mut Vec<Value>) {
        match self {
            Joints::One(j) => to.push(int(*j)),
            Joints::All => {}
            Joints::Group(group) => {
                to.push(int(group.len()));
                to.push(Value::List(Bottle(group.iter().map(|j| int(*j)).collect())));
            }
        }
    }

    /// Parses `j`, nothing, or `n (J)`, and returns the rest.
    pub(super) fn read(shape: CodeSuffix, words: &[Value]) -> Option<(Joints, &[Value])> {
        match shape {
            CodeSuffix::All => Some((Joints::All, words)),
            CodeSuffix::One => {
                let (first, rest) = words.split_first()?;
                Some((Joints::One(index(first)?), rest))
            }
            CodeSuffix::Group => {
                let (count, rest) = words.split_first()?;
                let (list, rest) = rest.split_first()?;
                let list = &list.as_list()?.0;
                if list.len() > MOST_JOINTS || index(count)? != list.len() {
                    return None;
                }
                Some((Joints::Group(list.iter().map(index).collect::<Option<_>>()?), rest))
            }
        }
    }

    /// Number of their values; `None` if it depends on the board.
    pub(super) fn count(&self) -> Option<usize> {
        match self {
            Joints::One(_) => Some(1),
            Joints::All => None,
            Joints::Group(group) => Some(group.len()),
        }
    }

    pub(super) fn shape(&self) -> CodeSuffix {
        match self {
            Joints::One(_) => CodeSuffix::One,
            Joints::All => CodeSuffix::All,
            Joints::Group(_) => CodeSuffix::Group,
        }
    }
}

/// Meaning of the last letter of a code.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum CodeSuffix {
    One,
    All,
    Group,
}

impl CodeSuffix {
    /// Three-letter family of a code, and its shape: `pos`, `poss`, `posg`.
    pub(super) fn of(code: Vocab) -> Option<(Vocab, CodeSuffix)> {
        let [a, b, c, last] = code.0.to_le_bytes();
        let family = Vocab(u32::from_le_bytes([a, b, c, 0]));
        match last {
            _ if c == 0 => None,
            0 => Some((family, CodeSuffix::One)),
            b's' => Some((family, CodeSuffix::All)),
            b'g' => Some((family, CodeSuffix::Group)),
            _ => None,
        }
    }

    /// Code of a family for this shape.
    pub(super) fn code(self, family: Vocab) -> Vocab {
        let last = match self {
            CodeSuffix::One => 0,
            CodeSuffix::All => b's',
            CodeSuffix::Group => b'g',
        };
        Vocab(family.0 | u32::from(last) << 24)
    }

    /// Shape by position in a table of codes (one, all, group).
    pub(super) fn among(code: Vocab, codes: [Vocab; 3]) -> Option<CodeSuffix> {
        let shapes = [CodeSuffix::One, CodeSuffix::All, CodeSuffix::Group];
        codes.iter().zip(shapes).find(|(c, _)| **c == code).map(|(_, s)| s)
    }

    /// Code of this shape in such a table.
    pub(super) fn pick(self, [one, all, group]: [Vocab; 3]) -> Vocab {
        match self {
            CodeSuffix::One => one,
            CodeSuffix::All => all,
            CodeSuffix::Group => group,
        }
    }
}

/// A joint index or count. Floats are accepted if they are whole; a vocab is not, although it could be read
/// as a number.
pub(super) fn index(value: &Value) -> Option<usize> {
    if matches!(value, Value::Vocab(_)) {
        return None;
    }
    usize::try_from(value.as_i64()?).ok()
}

/// An index as an integer of the wire.
pub(super) fn int(n: usize) -> Value {
    Value::Int32(i32::try_from(n).unwrap_or(i32::MAX))
}

/// Numbers of a list.
pub(super) fn numbers(value: &Value) -> Option<Vec<f64>> {
    let list = &value.as_list()?.0;
    if list.len() > MOST_JOINTS {
        return None;
    }
    list.iter().map(Value::as_f64).collect()
}

/// Vocabs of a list.
pub(super) fn vocabs(value: &Value) -> Option<Vec<Vocab>> {
    let list = &value.as_list()?.0;
    if list.len() > MOST_JOINTS {
        return None;
    }
    list.iter().map(Value::as_vocab).collect()
}

/// A list of f64.
pub(super) fn floats(values: &[f64]) -> Value {
    Value::List(Bottle(values.iter().map(|v| Value::Float64(*v)).collect()))
}

/// A list of vocabs.
pub(super) fn vocab_list(values: &[Vocab]) -> Value {
    Value::List(Bottle(values.iter().map(|v| Value::Vocab(*v)).collect()))
}
