//! Any bytes are decoded or refused; what was decoded is encoded so that it decodes to the same.

use mobee_yarp::payload::{Image, JointData, Stamp, pair, vector};
use mobee_yarp::{Bottle, Dialect};

/// Panics where a promise is broken.
pub fn hold(bytes: &[u8]) {
    for dialect in [Dialect::V3, Dialect::V4] {
        let Ok(Some((bottle, length))) = Bottle::decode_prefix(bytes, dialect) else { continue };
        let message = &bytes[..length];
        assert!(Bottle::decode(message, dialect).is_ok());
        let again = Bottle::decode(&bottle.encode(dialect), dialect).expect("what was encoded");
        assert_eq!(again.to_text(), bottle.to_text());
        if let Ok(numbers) = vector::decode(message, dialect) {
            let _ = vector::encode(&numbers, dialect);
        }
        let _ = vector::decode_i32(message, dialect);
        if let Ok((head, body)) = pair::decode(message, dialect) {
            let again = pair::encode(&head, &body, dialect);
            assert_eq!(pair::decode(&again, dialect).expect("what was encoded").0.to_text(), head.to_text());
        }
        if let Ok(image) = Image::decode(message, dialect) {
            assert_eq!(Image::decode(&image.encode(), dialect).expect("what was encoded"), image);
            let _ = image.pixels();
        }
        if let Ok(data) = JointData::decode(message, dialect) {
            let _ = data.to_bottle(dialect);
        }
        let _ = Stamp::decode(message, dialect).map(Stamp::envelope);
    }
}
