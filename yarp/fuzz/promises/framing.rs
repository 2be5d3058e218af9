//! The bytes of connections: hellos, messages of both families, acknowledgements and datagrams. What arrives in pieces
//! is read as what arrives at once, and no more than what arrived.

use mobee_yarp::wire::datagram::{self, Assembler};
use mobee_yarp::wire::line::{self, Scanner};
use mobee_yarp::wire::{Carrier, frame, handshake};

const MOST: usize = 2000;

/// Panics where a promise is broken.
pub fn hold(input: &[u8]) {
    let Some((choice, bytes)) = input.split_first() else { return };
    let cut = usize::from(*choice) % (bytes.len() + 1);

    if let Ok(Some((hello, used))) = handshake::parse(bytes) {
        assert!(used <= bytes.len() && !hello.bare().is_empty());
        let again = handshake::encode(hello.carrier, &hello.name);
        assert_eq!(handshake::parse(&again).expect("what was encoded").expect("a whole one").0, hello);
        let _ = handshake::parse_reply(hello.carrier, &handshake::reply(&hello, 7)).expect("what was encoded");
    }
    for carrier in Carrier::ALL {
        if let Ok(Some((_, used))) = handshake::parse_reply(carrier, bytes) {
            assert!(used <= bytes.len());
        }
    }

    match frame::parse(bytes, MOST) {
        Ok(Some(frame)) => {
            assert!(frame.payload <= frame.end && frame.end <= bytes.len());
            assert_eq!(frame::parse(&bytes[..frame.end], MOST), Ok(Some(frame.clone())));
            assert_eq!(frame::parse(&bytes[..frame.end - 1], MOST), Ok(None));
        }
        Ok(None) => assert_ne!(frame::length(bytes, MOST).map(|l| l.is_some_and(|l| l <= bytes.len())), Ok(true)),
        Err(_) => {}
    }
    if let Ok(Some(used)) = frame::parse_ack(bytes) {
        assert!(used <= bytes.len());
    }

    let whole = Scanner::default().parse(bytes, MOST);
    let mut scanner = Scanner::default();
    let pieces = match scanner.parse(&bytes[..cut], MOST) {
        Ok(None) => scanner.parse(bytes, MOST),
        early => early,
    };
    assert_eq!(pieces, whole);
    if let Ok(Some(line)) = &whole {
        assert!(line.end <= bytes.len());
    }
    if let Some(end) = line::reply_end(bytes) {
        assert!(end <= bytes.len());
    }

    // datagrams as they are, and with a check sum and a counter that fit
    let mut assembler = Assembler::default();
    let mut counter = 0_i32;
    for piece in bytes.chunks(cut.max(8)) {
        let _ = assembler.take(piece, MOST);
        let mut fitting = Vec::new();
        for piece in datagram::split(piece).take(1) {
            fitting = piece;
        }
        if let Some(place) = fitting.get_mut(4..8) {
            place.copy_from_slice(&counter.to_le_bytes());
        }
        match assembler.take(&fitting, MOST) {
            Some(message) => {
                assert!(message.len() <= MOST + 18 + 4 * 510);
                counter = 0;
            }
            None => counter += 1,
        }
    }
    if let Ok(Some(length)) = frame::length(bytes, MOST)
        && length == bytes.len()
    {
        let mut assembler = Assembler::default();
        let message = datagram::split(bytes).filter_map(|piece| assembler.take(&piece, MOST)).last();
        assert_eq!(message.as_deref(), Some(bytes));
    }
}
