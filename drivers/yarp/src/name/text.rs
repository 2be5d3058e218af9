//! The plain-text form of the name server protocol, the same for both ends (spec section 3.1).

use crate::Contact;

/// What every request line begins with.
pub const REQUEST: &str = "NAME_SERVER ";
/// The last line of most replies.
pub const END: &str = "*** end of message";
/// The longest line that either end accepts, in bytes.
pub const LONGEST_LINE: usize = 16 * 1024;

/// The registration line of a port, without its line end.
pub fn registration(contact: &Contact) -> String {
    let Contact { name, carrier, host, port } = contact;
    format!("registration name {name} ip {host} port {port} type {carrier}")
}

/// The port that a registration line tells of; `None` for every other line.
pub fn extract(line: &str) -> Option<Contact> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.as_slice() {
        ["registration", _, name, _, host, _, port, _, carrier, ..] => {
            Some(Contact::new(name, carrier, host, port.parse().ok()?))
        }
        _ => None,
    }
}

/// Whether a reply ends with this line: the terminator, or a vocab such as `[ok]`.
pub fn ends(line: &str) -> bool {
    line.starts_with('*') || line.starts_with('[')
}

/// Whether a word can be said in the plain-text form, where arguments are not quoted.
pub fn sayable(word: &str) -> bool {
    !word.is_empty() && word.len() <= 1000 && !word.contains(|c: char| c.is_whitespace() || c.is_control() || c == '"')
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_registration_is_read_back() {
        let contact = Contact::new("/reader", "tcp", "127.0.0.1", 10003);
        assert_eq!(extract(&registration(&contact)), Some(contact));
    }

    #[test]
    fn other_lines_are_no_registration() {
        for line in
            ["", END, "[ok]", "registration name /x ip h port 1 type", "registration name /x ip h port no type tcp"]
        {
            assert_eq!(extract(line), None, "{line}");
        }
    }

    proptest! {
        #[test]
        fn any_line_is_read_without_panic(line in ".{0,200}") {
            let _ = (extract(&line), ends(&line), sayable(&line));
        }
    }
}
