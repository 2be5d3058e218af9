//! `mobee yarp ...`, as a user types it: one static binary that serves names, reads, writes, asks and connects.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, ExitStatus, Output, Stdio};

/// The program, in a network whose name server is at this number.
struct Tools {
    dir: tempfile::TempDir,
    server: Option<String>,
}

impl Tools {
    fn new() -> Tools {
        Tools { dir: tempfile::tempdir().unwrap(), server: None }
    }

    fn command(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mobee"));
        command.arg("yarp").args(args.split_whitespace()).env("YARP_CONFIG_HOME", self.dir.path());
        for variable in ["YARP_NAMESPACE", "YARP_PORT_PREFIX", "YARP_PORT_RANGE", "YARP_IP"] {
            command.env_remove(variable);
        }
        if let Some(server) = &self.server {
            command.args(["--server", server]);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs a command to its end, with this input.
    fn run(&self, args: &str, input: &str) -> Output {
        let mut child = self.command(args).spawn().unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    }

    /// Runs a command that is successful, and gives what it prints.
    fn ok(&self, args: &str) -> String {
        let out = self.run(args, "");
        assert!(out.status.success(), "{args}: {}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    }

    /// Runs a command that is not, and gives its complaint.
    fn fails(&self, args: &str) -> String {
        let out = self.run(args, "");
        assert_eq!(out.status.code(), Some(1), "{args}: {}", String::from_utf8_lossy(&out.stdout));
        String::from_utf8(out.stderr).unwrap()
    }

    /// Starts a command, and waits until it says on either output that it is ready.
    fn start(&self, args: &str, ready: &str) -> Running {
        let mut child = self.command(args).spawn().unwrap();
        let out = BufReader::new(Box::new(child.stdout.take().unwrap()) as Box<dyn Read + Send>);
        let log = BufReader::new(Box::new(child.stderr.take().unwrap()) as Box<dyn Read + Send>);
        let mut running = Running { child, out, log };
        let from = if ready.contains("Port") { &mut running.log } else { &mut running.out };
        let said = line(from);
        assert!(said.contains(ready), "{args}: {said}");
        if self.server.is_none() {
            // the line of a name server ends with its number
            running.out = BufReader::new(Box::new(std::io::Cursor::new(said.into_bytes())));
        }
        running
    }
}

/// A tool that runs; killed when dropped.
struct Running {
    child: Child,
    out: BufReader<Box<dyn Read + Send>>,
    log: BufReader<Box<dyn Read + Send>>,
}

impl Running {
    fn interrupt(&mut self) -> ExitStatus {
        let sent = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        self.child.wait().unwrap()
    }

    fn types(&mut self, text: &str) {
        self.child.stdin.as_mut().unwrap().write_all(text.as_bytes()).unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn line(from: &mut impl BufRead) -> String {
    let mut text = String::new();
    from.read_line(&mut text).unwrap();
    text.trim_end().to_string()
}

/// A name server on a number of its own, and the tools for its network.
fn network() -> (Running, Tools) {
    let mut tools = Tools::new();
    let mut server = tools.start("server --server 127.0.0.1:0", "Name server /root is available at ip 127.0.0.1 port ");
    let number = line(&mut server.out).rsplit(' ').next().unwrap().to_string();
    tools.server = Some(format!("127.0.0.1:{number}"));
    (server, tools)
}

#[test]
fn names_are_served_listed_and_cleaned() {
    let (mut server, tools) = network();
    assert!(tools.ok("where").contains("Name server /root is available at ip 127.0.0.1 port "));
    assert_eq!(
        tools.ok("name register /dead tcp 127.0.0.1 1"),
        "registration name /dead ip 127.0.0.1 port 1 type tcp\n"
    );
    assert_eq!(tools.ok("list /dead"), "registration name /dead ip 127.0.0.1 port 1 type tcp\n");
    assert!(tools.ok("list").contains("registration name /root"));
    assert!(tools.fails("exists /dead").is_empty());
    assert!(tools.fails("ping /dead").contains("`mobee yarp clean` forgets it"));
    let cleaned = tools.ok("clean");
    assert!(cleaned.contains("Testing /dead at tcp://127.0.0.1:1/\n* No response, removing port /dead\n"), "{cleaned}");
    assert!(cleaned.ends_with("Name server says: garbage collection done.\n"), "{cleaned}");
    assert_eq!(tools.ok("list /dead"), "");
    assert!(tools.fails("name query /dead").contains("/dead not known."));
    assert!(server.interrupt().success());
}

#[test]
fn lines_are_written_read_connected_and_disconnected() {
    let (_server, tools) = network();
    for carrier in ["tcp", "fast_tcp", "text", "text_ack"] {
        let mut reader = tools.start("read /r", "Port /r active");
        let mut writer = tools.start("write /w", "Port /w active");
        assert!(tools.fails("exists /w /r").contains("No connection from /w to /r found"));
        assert_eq!(
            tools.ok(&format!("connect /w /r {carrier}")),
            format!("Success: Added connection from /w to {carrier}://r\n")
        );
        tools.ok("exists /w /r");
        assert!(tools.ok("ping /w").contains(&format!("from \"/w\" to \"/r\" using {carrier}\n")));
        writer.types("hello \"two words\" 3 2.5 [set] (1 2)\n0 \"a line\"\n");
        assert_eq!(line(&mut reader.out), "hello \"two words\" 3 2.5 [set] (1 2)");
        assert_eq!(line(&mut reader.out), "a line");
        assert_eq!(tools.ok("disconnect /w /r"), "Success: Removed connection from /w to /r\n");
        assert!(tools.fails("disconnect /w /r").contains("no such connection"));
        // the end of the input ends the writer, Ctrl-C the reader; both unregister
        drop(writer.child.stdin.take());
        assert!(writer.child.wait().unwrap().success());
        assert!(reader.interrupt().success());
        assert_eq!(tools.ok("list /r") + &tools.ok("list /w"), "");
    }
}

#[test]
fn the_end_of_a_verbatim_file_ends_the_reader() {
    let (_server, tools) = network();
    let mut reader = tools.start("read /r trim 5", "Port /r active");
    assert!(tools.run("write /w /r verbatim", "a long (line\n\n").status.success());
    assert_eq!((line(&mut reader.out), line(&mut reader.out)), ("a lon".into(), String::new()));
    assert!(reader.child.wait().unwrap().success());
}

#[test]
fn requests_are_answered() {
    let (_server, tools) = network();
    let asked = tools.run("rpc /root", "bot query /nope\nbot query /root\n");
    let said = String::from_utf8(asked.stdout).unwrap();
    assert!(
        said.starts_with("Response: port (error -2 \"port not known\")\nResponse: port (name \"/root\")"),
        "{said}"
    );
    let asked = tools.run("rpc /root --admin --carrier text_ack", "[ver]\n");
    assert_eq!(String::from_utf8(asked.stdout).unwrap(), "Response: [ver] 1 2 3\n");
}

#[test]
fn persistent_connections_are_made_when_both_are_there() {
    let (_server, tools) = network();
    tools.ok("connect --persist /w fast_tcp://r");
    assert_eq!(tools.ok("connect"), "Persistent connection /w -> fast_tcp://r\n");
    let mut reader = tools.start("read /r", "Port /r active");
    let sent = tools.run("write /w --wait-connect", "hello\n");
    assert!(sent.status.success());
    assert_eq!(line(&mut reader.out), "hello");
    tools.ok("disconnect --persist /w /r");
    assert_eq!(tools.ok("connect"), "No persistent connections.\n");
    tools.ok("exists --wait 20 /r");
}

#[test]
fn complaints_name_the_remedy() {
    let nowhere = Tools::new();
    assert!(nowhere.fails("list").contains("start one with `mobee yarp server"));
    assert!(nowhere.fails("list --server here").contains("`here` is not an address: give HOST:PORT"));
    assert!(nowhere.fails("list --server 127.0.0.1:1").contains("is it running? (`mobee yarp server`)"));
    assert!(nowhere.fails("server --ip 0.0.0.0 --socket 0").contains("YARP has no encryption"));
    let (_server, tools) = network();
    assert!(tools.fails("connect /a /b").contains("could not find source port /a"));
    assert!(tools.fails("ping /a").contains("could not find port /a"));
    assert!(tools.fails("rpc /a").contains("/a"));
    assert!(tools.fails("read noslash").contains("noslash"));
    let _reader = tools.start("read /r", "Port /r active");
    assert!(tools.fails("read /r").contains("open already"));
    assert_eq!(tools.run("connect /r /r carrier_pigeon", "").status.code(), Some(2));
}

#[test]
fn the_address_file_is_written_once_and_then_respected() {
    let tools = Tools::new();
    let file = tools.dir.path().join("yarp.conf");
    let mut server = tools.start("server --socket 0", "Name server /root is available");
    let number = line(&mut server.out).rsplit(' ').next().unwrap().to_string();
    assert_eq!(std::fs::read_to_string(&file).unwrap(), format!("127.0.0.1 {number} yarp\n"));
    assert!(tools.ok("list").contains(&format!("port {number} ")));
    drop(server);
    std::fs::write(&file, "127.0.0.1 1 yarp\n").unwrap();
    assert!(tools.fails("server --socket 0").contains("--write changes the file"));
    let _server = tools.start("server --socket 0 --write", "Name server /root is available");
    assert_ne!(std::fs::read_to_string(&file).unwrap(), "127.0.0.1 1 yarp\n");
}

#[test]
fn messages_are_sampled_at_a_rate_and_merged_as_they_come() {
    let (_server, tools) = network();
    let mut first = tools.start("write /w1", "Port /w1 active");
    let mut second = tools.start("write /w2", "Port /w2 active");
    let _sample = tools.start("sample --input /w1 --output /s --rate 100 --carrier fast_tcp", "Port /s active");
    let mut sampled = tools.start("read /r /s", "Port /r active");
    tools.ok("wait /s /r");
    tools.ok("wait /w1 /s");
    first.types("5 \"a b\" 2\n");
    for _ in 0..5 {
        assert_eq!(line(&mut sampled.out), "5 \"a b\" 2", "said once, and passed on again and again");
    }
    let merge = "merge --input /w1 /w2 --output /m --worker /parts/i --carrier tcp";
    let _merge = tools.start(merge, "Port /m active");
    let mut merged = tools.start("read /all envelope /m", "Port /all active");
    tools.ok("wait /m /all");
    for port in ["/w1 /parts/i0", "/w2 /parts/i1"] {
        tools.ok(&format!("wait {port}"));
    }
    second.types("x (1 2)\n");
    let alone = line(&mut merged.out);
    assert!(alone.ends_with(" x (1 2)"), "the other has said nothing yet: {alone}");
    first.types("7\n");
    let both = line(&mut merged.out);
    let words: Vec<&str> = both.split(' ').collect();
    assert_eq!((words[0], &words[2..]), ("2", &["7", "x", "(1", "2)"][..]), "{both}");
    assert!(words[1].parse::<f64>().unwrap() > 1.6e9, "the time of day: {both}");
    assert!(tools.fails("merge /nobody").contains("/nobody"));
    assert!(tools.fails("sample --output /t --rate 0").contains("--rate takes seconds above 0"));
}

#[test]
fn the_configuration_is_shown_and_changed() {
    let tools = Tools::new();
    let file = tools.dir.path().join("yarp.conf");
    assert_eq!(tools.ok("conf"), format!("{}\n", file.display()));
    tools.ok("conf 192.168.0.7 10000");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "192.168.0.7 10000 yarp\n");
    assert!(tools.fails("conf ro\"bot 10000").contains("is no host"));
    assert_eq!(tools.run("conf 192.168.0.7", "").status.code(), Some(2));
    assert_eq!(tools.run("conf 192.168.0.7 0", "").status.code(), Some(2));
    tools.ok("conf --clean");
    tools.ok("conf --clean");
    assert!(!file.exists());
    assert_eq!(tools.ok("namespace"), "YARP namespace: /root\n");
    assert_eq!(tools.ok("namespace /lab"), "YARP namespace: /lab\n");
    assert!(tools.ok("conf").ends_with("/_lab.conf\n"));
    assert!(tools.fails("namespace lab").contains("begins with /"));
    assert_eq!(tools.ok("namespace /root"), "YARP namespace: /root\n");
    assert!(tools.ok("version").contains("MoBeE"));
}

#[test]
fn a_name_server_is_detected_and_its_ports_are_administered() {
    let (_server, tools) = network();
    let address = tools.server.clone().unwrap();
    let file = tools.dir.path().join("yarp.conf");
    let found = tools.ok("detect");
    assert!(found.starts_with("Name server /root is available at ip 127.0.0.1 port "), "{found}");
    assert!(!file.exists());
    tools.ok("detect --write");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), format!("{} yarp\n", address.replace(':', " ")));
    let asked = tools.run("admin /root", "[ver]\n");
    assert_eq!(String::from_utf8(asked.stdout).unwrap(), "Response: [ver] 1 2 3\n");
    // other programs may know carriers that are not spoken here
    let said = tools.fails("connect /a /b tcp+recv.portmonitor+type.lua");
    assert!(said.contains("could not find source port /a"), "{said}");
    assert_eq!(tools.run("connect /a /b pigeon+x", "").status.code(), Some(2));
}
