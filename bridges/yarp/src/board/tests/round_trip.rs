//! Requests survive writing and parsing.

use super::*;

/// Message of a client for a board request; `None` for requests with more than one form.
fn written(request: &BoardRequest) -> Option<Bottle> {
    let (group, vocabs) = (|joints: &[usize]| Joints::Group(joints.to_vec()), |mode: &ClientMode| vocab(*mode));
    let asked = match request.clone() {
        BoardRequest::Move { joints, values, relative } => Set::Move { joints: group(&joints), values, relative },
        BoardRequest::Velocity { values, .. } => Set::Velocity(values),
        BoardRequest::Stop(joints) => Set::Stop(group(&joints)),
        BoardRequest::Speed { joints, values } => Set::Speed(group(&joints), values),
        BoardRequest::Acceleration { joints, values } => Set::Acceleration(group(&joints), values),
        BoardRequest::Mode { joints, modes } => Set::Mode(group(&joints), modes.iter().map(vocabs).collect()),
        _ => return None,
    };
    Some(Ask::Set(asked).bottle())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// A request written as a client writes it is parsed to the same request, joint by joint.
    #[test]
    fn what_is_written_is_read_again(
        joints in Just(vec![0_usize, 1, 2, 3]).prop_shuffle(),
        n in 1..4_usize,
        values in prop::collection::vec(-1e3..1e3_f64, 4),
        which in 0..6,
    ) {
        let (some, first) = (joints[..n].to_vec(), values[..n].to_vec());
        let request = match which {
            0 => BoardRequest::Move { joints: some, values: first, relative: n == 2 },
            1 => BoardRequest::Velocity { joints: vec![0, 1, 2, 3], values },
            2 => BoardRequest::Stop(some),
            3 => BoardRequest::Speed { joints: some, values: first },
            4 => BoardRequest::Acceleration { joints: some, values: first },
            _ => BoardRequest::Mode { modes: vec![ClientMode::PositionDirect; n], joints: some },
        };
        prop_assert_eq!(parse(&written(&request).unwrap(), &turning(4)), request);
    }
}
