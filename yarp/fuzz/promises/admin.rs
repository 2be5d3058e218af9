//! Administrative commands, as text or binary: every one is answered, and the answer can be sent.

use mobee_yarp::wire::admin::{self, Added, AdminReply, Peer, PortView, Removed};
use mobee_yarp::{Bottle, Carrier, Contact, Dialect, Text, Value};

/// Panics where a promise is broken.
pub fn hold(input: &[u8]) {
    let Some((choice, bytes)) = input.split_first() else { return };
    let peer =
        |name: &str| Peer { name: name.into(), carrier: Carrier::ALL[usize::from(*choice) % Carrier::ALL.len()] };
    let view = PortView {
        name: "/me".into(),
        address: "tcp://127.0.0.1:10002/".into(),
        is_input: choice & 1 != 0,
        is_output: choice & 2 != 0,
        is_rpc: choice & 4 != 0,
        inputs: vec![peer("/a"), peer("admin")],
        outputs: vec![peer("/b")],
        properties: vec![(Text::from("k"), Value::from(5))],
    };
    let command = match choice & 8 {
        0 => Bottle::parse(bytes, Dialect::V3).ok(),
        _ => Bottle::decode(bytes, Dialect::V3).ok(),
    };
    let Some(command) = command else { return };
    let reply = match admin::answer(&view, &command) {
        AdminReply::Reply(reply) => reply,
        AdminReply::Add { given, contact } => {
            let _ = Contact::parse(&contact.to_string());
            admin::added(&view.name, &given, Added::NoOutputs)
        }
        AdminReply::Remove(name) => admin::removed(&view.name, &name, Removed::None),
        AdminReply::Set(..) => admin::ok(),
    };
    let sent = reply.encode(Dialect::V3);
    assert_eq!(Bottle::decode(&sent, Dialect::V3).expect("what was encoded").to_text(), reply.to_text());
    assert!(!reply.to_text().contains(&b'\n') && !admin::describe(&view).is_empty());
}
