use proptest::prelude::*;

use super::*;
use crate::{Bottle, Dialect, Text, Value, Vocab};

fn dialect() -> impl Strategy<Value = Dialect> {
    prop_oneof![Just(Dialect::V3), Just(Dialect::V4)]
}

fn scalar() -> impl Strategy<Value = Value> {
    prop_oneof![
        any::<i8>().prop_map(Value::Int8),
        any::<i16>().prop_map(Value::Int16),
        any::<i32>().prop_map(Value::Int32),
        any::<i64>().prop_map(Value::Int64),
        (-1e30f32..1e30).prop_map(Value::Float32),
        (-1e300..1e300).prop_map(Value::Float64),
        any::<u32>().prop_map(|x| Value::Vocab(Vocab(x))),
        any::<Vec<u8>>().prop_map(|x| Value::String(Text(x))),
        "[a-z ()\"\\\\]{0,6}".prop_map(Value::from),
        any::<Vec<u8>>().prop_map(Value::Blob),
    ]
}

fn bottle() -> impl Strategy<Value = Bottle> {
    let alike = prop_oneof![
        prop::collection::vec(-1e9..1e9f64, 0..6).prop_map(Bottle::of),
        prop::collection::vec(any::<i32>(), 0..6).prop_map(Bottle::of),
        prop::collection::vec("[a-z]{0,3}", 0..6).prop_map(Bottle::of),
    ];
    let value =
        scalar().prop_recursive(5, 40, 6, move |inner| {
            let list = prop::collection::vec(inner, 0..6).prop_map(Bottle);
            prop_oneof![
                list.clone().prop_map(Value::List),
                alike.clone().prop_map(Value::List),
                list.prop_map(Value::Dict),
            ]
        });
    prop::collection::vec(value, 0..8).prop_map(Bottle)
}

/// Allocated memory of a bottle, bytes.
fn weight(bottle: &Bottle) -> usize {
    let inner = bottle.iter().map(|value| match value {
        Value::String(text) => text.0.capacity(),
        Value::Blob(bytes) => bytes.capacity(),
        Value::List(list) | Value::Dict(list) => weight(list),
        _ => 0,
    });
    bottle.0.capacity() * size_of::<Value>() + inner.sum::<usize>()
}

proptest! {
    #[test]
    fn any_bottle_comes_back(bottle in bottle(), dialect in dialect()) {
        let bytes = bottle.encode(dialect);
        prop_assert_eq!(&Bottle::decode(&bytes, dialect).unwrap(), &bottle);
        let more = [bytes.as_slice(), &[1, 2, 3]].concat();
        prop_assert_eq!(Bottle::decode_prefix(&more, dialect), Ok(Some((bottle, bytes.len()))));
        let trailing = matches!(Bottle::decode(&more, dialect), Err(DecodeError::Trailing { extra: 3, .. }));
        prop_assert!(trailing);
        let half = bytes.len() / 2;
        prop_assert_eq!(Bottle::decode_prefix(&bytes[..half], dialect), Ok(None));
    }

    #[test]
    fn the_text_of_any_bottle_prints_as_it_was_read(bottle in bottle(), dialect in dialect()) {
        // a vocab may hold characters by its number that can't be written as text
        fn sayable(bottle: &Bottle) -> bool {
            bottle.iter().all(|value| match value {
                Value::Vocab(vocab) => *vocab == Vocab(0) || vocab.letters().iter().all(u8::is_ascii_alphabetic),
                Value::List(list) | Value::Dict(list) => sayable(list),
                _ => true,
            })
        }
        prop_assume!(sayable(&bottle));
        let text = bottle.to_text();
        prop_assert!(crate::text::is_complete(&text));
        prop_assert_eq!(Bottle::parse(&text, dialect).unwrap().to_text(), text);
    }

    #[test]
    fn any_bytes_are_decoded_or_refused_in_little_memory(bytes: Vec<u8>, dialect in dialect()) {
        if let Ok(Some((bottle, length))) = Bottle::decode_prefix(&bytes, dialect) {
            prop_assert!(length <= bytes.len());
            prop_assert!(weight(&bottle) <= 40 * bytes.len());
        }
    }

    #[test]
    fn spoiled_bytes_are_decoded_or_refused_in_little_memory(
        bottle in bottle(),
        dialect in dialect(),
        spoil in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = bottle.encode(dialect);
        for (at, byte) in spoil {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(bottle) = Bottle::decode(&bytes, dialect) {
            prop_assert!(weight(&bottle) <= 40 * bytes.len());
            // encoding a decoded bottle gives the same bottle
            let again = Bottle::decode(&bottle.encode(dialect), dialect).unwrap();
            prop_assert_eq!(format!("{again:?}"), format!("{bottle:?}"));
        }
    }
}

#[test]
fn stated_lengths_are_not_believed() {
    let words = |words: &[i32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let decode = |bytes: &[i32]| Bottle::decode(&words(bytes), Dialect::V3);
    assert!(matches!(decode(&[256, i32::MAX]), Err(DecodeError::Length { at: 4, .. })));
    assert!(matches!(decode(&[256, -1]), Err(DecodeError::Length { length: -1, .. })));
    assert!(matches!(decode(&[266, 1 << 20, 0]), Err(DecodeError::Short { .. })));
    assert!(matches!(decode(&[260, 1, i32::MAX]), Err(DecodeError::Length { at: 8, .. })));
    assert!(matches!(decode(&[260, 1, 1 << 20]), Err(DecodeError::Short { .. })));
    // a prefix that can't become a bottle is refused at once, without waiting for more bytes
    assert!(Bottle::decode_prefix(&words(&[260, 1, i32::MAX]), Dialect::V3).is_err());
    // the limit counts the values of all lists
    let limits = DecodeLimits { max_elements: 3, ..DecodeLimits::DEFAULT };
    let two = Bottle::of([Bottle::of([1]), Bottle::of([2])]).encode(Dialect::V3);
    assert!(matches!(Bottle::decode_within(&two, Dialect::V3, limits), Err(DecodeError::Length { limit: 0, .. })));
}

#[test]
fn lists_in_lists_are_bounded() {
    let nested = |word: i32, depth: usize| {
        let mut bytes = Vec::new();
        for _ in 0..depth {
            if word == tag::DICT {
                bytes.extend(tag::DICT.to_le_bytes());
            }
            bytes.extend([256i32, 1].into_iter().flat_map(i32::to_le_bytes));
        }
        bytes.extend([1i32, 5].into_iter().flat_map(i32::to_le_bytes));
        [256i32.to_le_bytes().as_slice(), &1i32.to_le_bytes(), &bytes].concat()
    };
    for word in [tag::LIST, tag::DICT] {
        assert!(Bottle::decode(&nested(word, 64), Dialect::V3).is_ok());
        let deep = Bottle::decode(&nested(word, 65), Dialect::V3);
        assert!(matches!(deep, Err(DecodeError::TooDeep { limit: 64, .. })), "{deep:?}");
        // the depth limit applies before the stack overflows
        assert!(Bottle::decode(&nested(word, 100_000), Dialect::V3).is_err());
    }
}

#[test]
fn the_other_dialect_is_named_in_the_error() {
    let bytes = Bottle::new().with(1).with(0.5).encode(Dialect::V4);
    let error = Bottle::decode(&bytes, Dialect::V3).unwrap_err();
    assert_eq!(error, DecodeError::UnknownTag { tag: 20, at: 16 });
    assert!(error.to_string().contains("set the dialect"));
}
