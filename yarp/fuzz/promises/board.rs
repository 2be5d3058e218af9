//! What clients say to a control board, as text or binary: requests and streamed commands.

use mobee_yarp::board::{Ask, Shadow, ShadowAxis, Streamed};
use mobee_yarp::payload::pair;
use mobee_yarp::{Bottle, Dialect, Stamp};

/// Panics where a promise is broken.
pub fn hold(input: &[u8]) {
    let Some((choice, bytes)) = input.split_first() else { return };
    let request = match choice & 1 {
        0 => Bottle::parse(bytes, Dialect::V3).ok(),
        _ => Bottle::decode(bytes, Dialect::V3).ok(),
    };
    let Some(request) = request else { return };
    let axes = usize::from(choice >> 1) % 17;
    if let Some(ask) = Ask::parse(&request) {
        let _ = ask.fits(axes);
        // what was understood is said again so that it is understood the same
        let again = Ask::parse(&ask.bottle()).expect("what was said");
        assert_eq!(format!("{again:?}"), format!("{ask:?}"));
    }
    let shadow = Shadow { axes: vec![ShadowAxis::at_rest("joint", -90.0, 90.0, 30.0, 0.0); axes] };
    if let Some(reply) = shadow.answer(&request, Stamp { count: 1, time: 2.0 }) {
        assert!(Bottle::decode(&reply.encode(Dialect::V3), Dialect::V3).is_ok());
    }
    if let Ok((head, body)) = pair::from_bottle(&request) {
        let _ = Streamed::parse(&head, &body, axes);
    }
}
