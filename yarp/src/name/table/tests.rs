use super::*;
use proptest::prelude::*;

fn table() -> NameTable {
    NameTable::new(Contact::new("/root", "tcp", "127.0.0.1", 10000), 100)
}

fn say(table: &mut NameTable, line: &str) -> String {
    let words: Vec<String> = line.split_whitespace().map(String::from).collect();
    String::from_utf8(table.answer(&words, "127.0.0.1").answer.text()).unwrap()
}

fn number(table: &mut NameTable, line: &str) -> u16 {
    crate::name::text::extract(&say(table, line)).map_or(0, |c| c.port)
}

#[test]
fn a_name_retains_its_number_and_others_get_the_next() {
    let mut t = table();
    assert_eq!(number(&mut t, "register /a"), 10002);
    assert_eq!(number(&mut t, "register /b"), 10003);
    say(&mut t, "unregister /a");
    assert_eq!(number(&mut t, "register /c"), 10004);
    assert_eq!(number(&mut t, "register /a"), 10002);
    assert_eq!(number(&mut t, "register /a tcp 127.0.0.1 0"), 10002);
}

#[test]
fn a_port_with_a_type_leaves_the_number_to_us_by_minus_one() {
    assert_eq!(number(&mut table(), "register /a ... ... -1 yarp/vector"), 10002);
}

#[test]
fn taking_a_name_over_is_silent_but_counted() {
    let mut t = table();
    say(&mut t, "register /a tcp 127.0.0.1 5000");
    say(&mut t, "register /a tcp 127.0.0.1 5000");
    assert_eq!(t.counts(), NameCounts { registered: 2, ..NameCounts::default() });
    assert_eq!(number(&mut t, "register /a tcp 127.0.0.1 5001"), 5001);
    assert_eq!(t.counts().replaced, 1);
}

/// A registration that is refused since no number is left changes nothing.
#[test]
fn a_refused_registration_leaves_the_former_one() {
    let mut t = NameTable::new(Contact::new("/root", "tcp", "127.0.0.1", 65530), 100);
    let mut numbers = Vec::new();
    while let number @ 1.. = number(&mut t, &format!("register /{}", numbers.len())) {
        numbers.push(number);
    }
    assert_eq!(numbers, [65532, 65533, 65534]);
    say(&mut t, "register /a tcp 127.0.0.1 5000");
    say(&mut t, "set /a k b");
    say(&mut t, "subscribe /a /0 from");
    let before = say(&mut t, "subscribe /a");
    assert!(before.contains("/0"), "{before}");
    let refused = t.counts().refused;
    assert_eq!(number(&mut t, "register /a"), 0);
    assert_eq!(t.counts().refused, refused + 1);
    assert_eq!(t.query("/a").map(|c| c.port), Some(5000));
    assert_eq!(say(&mut t, "bot get /a k"), "b\r\n");
    assert_eq!(say(&mut t, "subscribe /a"), before);
    assert_eq!(number(&mut t, "register /1"), 65533, "its own number is released first");
}

#[test]
fn a_new_registration_forgets_the_properties() {
    let mut t = table();
    say(&mut t, "register /a");
    assert_eq!(say(&mut t, "set /a k b a b"), "port /a property k = a b b\r\n*** end of message\r\n");
    assert_eq!(say(&mut t, "bot get /a k"), "a b b\r\n");
    say(&mut t, "register /a");
    assert_eq!(say(&mut t, "get /a k"), "port /a property k =\r\n*** end of message\r\n");
}

#[test]
fn prefixes_are_whole_components() {
    let mut t = table();
    ["/p/a", "/p/b", "/pa"].iter().for_each(|n| drop(say(&mut t, &format!("register {n}"))));
    let names = |t: &NameTable, p| t.list(Some(p)).iter().map(|c| c.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&t, "/p"), ["/p/a", "/p/b"]);
    assert_eq!(names(&t, "/p/"), ["/p/a", "/p/b"]);
    assert_eq!(names(&t, "/pa"), ["/pa"]);
    assert_eq!(t.list(None).len(), 5);
}

#[test]
fn the_servers_own_name_can_not_be_taken() {
    let mut t = table();
    assert_eq!(say(&mut t, "register /root tcp 127.0.0.1 1"), "*** end of message\r\n");
    say(&mut t, "unregister /root");
    assert_eq!(t.query("/root").map(|c| c.port), Some(10000));
}

#[test]
fn subscriptions_are_due_when_both_ends_are_there() {
    let mut t = table();
    let mut links = |line: &str| {
        let words: Vec<String> = line.split(' ').map(String::from).collect();
        t.answer(&words, "127.0.0.1").links
    };
    assert_eq!(links("subscribe /a udp://b"), []);
    links("register /a");
    assert_eq!(links("announce /a"), []);
    links("register /b");
    let due = [PendingConnection { src: "/a".into(), dest: "udp://b".into() }];
    assert_eq!(links("announce /b"), due);
    assert_eq!(links("announce /b 0"), []);
    assert_eq!(links("subscribe /a udp://b"), due);
    links("unsubscribe /a /b");
    assert_eq!(links("announce /a"), []);
}

#[test]
fn a_transient_subscription_goes_with_its_end() {
    let mut t = table();
    say(&mut t, "register /a");
    say(&mut t, "subscribe /a /b from");
    assert_eq!(say(&mut t, "subscribe"), "subscriptions (subscription (src \"/a\") (dest \"/b\") (mode from))\r\n");
    say(&mut t, "unregister /a");
    assert_eq!(say(&mut t, "subscribe"), "subscriptions\r\n");
}

#[test]
fn unprintable_and_surplus_entries_are_refused() {
    let mut t = table();
    for line in ["register /a tcp 127.0.0.1 99999", "register /a tcp 127.0.0.1 -5", "register"] {
        assert_eq!(say(&mut t, line), "*** end of message\r\n", "{line}");
    }
    let words = ["register".to_string(), "/a b".into()];
    assert_eq!(t.answer(&words, "127.0.0.1").answer, NameReply::end());
    (0..200).for_each(|i| drop(say(&mut t, &format!("register /n/{i}"))));
    assert_eq!(t.ports().count(), 100);
    let long = "x".repeat(10_000);
    say(&mut t, &format!("set /n/1 k {long}"));
    assert_eq!(say(&mut t, "get /n/1 k"), "port /n/1 property k =\r\n*** end of message\r\n");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_words_are_answered_within_bounds(lines in prop::collection::vec(
        prop::collection::vec(prop_oneof![
            "register|query|unregister|list|set|get|check|route|announce|subscribe|unsubscribe|topic|untopic|bot|help|gc",
            "/[ab]", "\\.\\.\\.", "tcp|mcast|udp://a", "[0-9]{1,6}", ".{0,8}", "/net=.{0,5}",
        ], 0..6), 0..60)) {
        let mut t = table();
        for words in lines {
            let outcome = t.answer(&words, "127.0.0.1");
            let text = outcome.answer.text();
            prop_assert!(text.ends_with(b"\r\n"));
            prop_assert!(t.ports().count() <= 100);
            prop_assert!(t.query("/root").is_some());
        }
    }
}
