//! Plain-text form of the name server protocol, shared by both ends (spec section 3.1).

use crate::Contact;

/// Start of every request line.
pub const REQUEST: &str = "NAME_SERVER ";
/// Last line of most replies.
pub const END: &str = "*** end of message";
/// Greatest length of a line that either end accepts, bytes.
pub const LONGEST_LINE: usize = 16 * 1024;

/// Registration line of a port, without its line end.
pub fn registration(contact: &Contact) -> String {
    let Contact { name, carrier, host, port } = contact;
    format!("registration name {name} ip {host} port {port} type {carrier}")
}

/// Port of a registration line; `None` for every other line.
pub fn extract(line: &str) -> Option<Contact> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.as_slice() {
        ["registration", _, name, _, host, _, port, _, carrier, ..] => {
            Some(Contact::new(name, carrier, host, port.parse().ok()?))
        }
        _ => None,
    }
}

/// True if a reply ends with this line: the terminator, or a vocab such as `[ok]`.
pub fn ends(line: &str) -> bool {
    line.starts_with('*') || line.starts_with('[')
}

/// True if a word is valid in the plain-text form, where arguments are not quoted.
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
