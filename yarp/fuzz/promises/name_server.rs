//! The name server's table, asked line by line, and the client's reading of its answers.

use mobee_yarp::name::{NameTable, text};
use mobee_yarp::{Bottle, Contact, Dialect, Value};

const MOST: usize = 20;

/// Panics where a promise is broken.
pub fn hold(input: &[u8]) {
    let mut table = NameTable::new(Contact::new("/root", "tcp", "127.0.0.1", 10000), MOST);
    for line in input.split(|byte| *byte == b'\n') {
        let Ok(request) = Bottle::parse(line, Dialect::V3) else { continue };
        let word = |value: &Value| value.as_text().map_or_else(|| value.to_string(), |text| text.into_owned());
        let words: Vec<String> = request.iter().map(word).collect();
        let outcome = table.answer(&words, "127.0.0.1");
        let answer = outcome.answer.text();
        assert!(answer.ends_with(b"\r\n"));
        let _ = outcome.answer.binary(Dialect::V3);
        for line in String::from_utf8_lossy(&answer).lines() {
            let _ = text::extract(line);
        }
        assert!(table.ports().count() <= MOST + 2);
        assert!(table.ports().any(|port| port.name == "/root" && port.port == 10000));
    }
    let line = String::from_utf8_lossy(input);
    let _ = text::extract(&line).map(|contact| text::extract(&text::registration(&contact)));
    let contact = Contact::parse(&line);
    let _ = Contact::parse(&contact.to_string());
}
