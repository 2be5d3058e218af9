//! Any text is read, and what was read prints to text that reads the same.

use mobee_yarp::text::{LineJoiner, is_complete};
use mobee_yarp::{Bottle, Dialect, Image, JointData, Stamp, payload};

/// Panics where a promise is broken.
pub fn hold(text: &[u8]) {
    for dialect in [Dialect::V3, Dialect::V4] {
        let Ok(bottle) = Bottle::parse(text, dialect) else { continue };
        let printed = bottle.to_text();
        // a vocab of signs, cut to four letters, may open what it does not close
        if !text.contains(&b'[') {
            assert_eq!(Bottle::parse(&printed, dialect).expect("what was printed").to_text(), printed);
        }
        let bytes = bottle.encode(dialect);
        let decoded = Bottle::decode(&bytes, dialect).expect("what was encoded");
        assert_eq!(decoded.to_text(), printed);
        // every other payload may come as text too
        let _ = payload::vector::from_bottle(&bottle);
        let _ = payload::pair::from_bottle(&bottle);
        let _ = JointData::from_bottle(&bottle);
        let _ = Stamp::from_bottle(&bottle);
        if let Ok(image) = Image::from_bottle(bottle) {
            let _ = image.pixels();
        }
    }
    let _ = std::str::from_utf8(text).map(Stamp::from_envelope);
    let _ = is_complete(text);
    let mut lines = LineJoiner::default();
    for line in text.split(|byte| *byte == b'\n') {
        let _ = lines.push(line, 1000);
    }
}
