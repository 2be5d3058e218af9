use super::*;
use std::net::Ipv4Addr;
use tempfile::TempDir;

/// Configuration folder with these files.
fn home(files: &[(&str, &str)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, text)| std::fs::write(dir.path().join(name), text).unwrap());
    dir
}

fn load(dir: &TempDir, vars: &[(&str, &str)]) -> Result<Network, NetworkConfigError> {
    let home = dir.path().display().to_string();
    network(&Env::new(|name| {
        let given = vars.iter().find(|(n, _)| *n == name).map(|(_, v)| v.to_string());
        given.or_else(|| (name == "YARP_CONFIG_HOME").then(|| home.clone()))
    }))
}

#[test]
fn both_forms_of_the_address_file_are_read() {
    for text in [
        "127.0.0.1 10000 yarp\n",
        "\n127.0.0.1\t10000",
        "[name]\nhost 127.0.0.1\nport 10000\nmode yarp\n",
        "[name]\n# where it is\nhost = \"127.0.0.1\"\nport=10000\n",
    ] {
        assert_eq!(load(&home(&[("yarp.conf", text)]), &[]).unwrap().server(), ("127.0.0.1", 10000), "{text}");
    }
}

#[test]
fn the_folder_is_found_in_the_order_of_the_specification() {
    let vars = |list: &'static [(&str, &str)]| {
        Env::new(move |n| list.iter().find(|(k, _)| *k == n).map(|(_, v)| v.to_string())).config_home()
    };
    let all: &[_] = &[("YARP_CONFIG_HOME", "/a"), ("XDG_CONFIG_HOME", "/b"), ("HOME", "/c")];
    assert_eq!(vars(all).unwrap(), Path::new("/a"));
    assert_eq!(vars(&all[1..]).unwrap(), Path::new("/b/yarp"));
    assert_eq!(vars(&all[2..]).unwrap(), Path::new("/c/.config/yarp"));
    assert!(matches!(vars(&[]), Err(NetworkConfigError::NoHome)));
}

#[test]
fn a_namespace_has_a_file_of_its_own() {
    let dir = home(&[("yarp.conf", "127.0.0.1 10000"), ("_lab_2.conf", "127.0.0.1 10200")]);
    let found = load(&dir, &[("YARP_NAMESPACE", "/lab/2")]).unwrap();
    assert_eq!((found.server().1, found.namespace()), (10200, "/lab/2"));
    std::fs::write(dir.path().join("yarp_namespace.conf"), "/lab/2\n").unwrap();
    assert_eq!(load(&dir, &[]).unwrap().server().1, 10200);
}

#[test]
fn variables_and_the_key_are_applied() {
    let dir = home(&[("yarp.conf", "h 7"), ("auth.conf", "[AUTH]\nkey \"abc\"\n")]);
    let network = load(&dir, &[("YARP_PORT_PREFIX", "/lab"), ("YARP_IP", "127.0.0.2")]).unwrap();
    assert_eq!((network.full_name("/x"), network.full_name("anon")), ("/lab/x".into(), "anon".into()));
    assert_eq!(network.bind(), Ipv4Addr::new(127, 0, 0, 2));
    assert_eq!(network.auth(), Some(&Key::new("abc")));
    assert_eq!(load(&home(&[("yarp.conf", "h 7")]), &[]).unwrap().auth(), None);
}

#[test]
fn errors_name_the_place_and_the_remedy() {
    let says = |text: &str, vars: &[(&str, &str)]| load(&home(&[("yarp.conf", text)]), vars).unwrap_err().to_string();
    assert!(load(&home(&[]), &[]).unwrap_err().to_string().contains("mobee yarp server"));
    assert!(says("", &[]).contains("line 1: the file is empty"));
    assert!(says("\n127.0.0.1\n", &[]).contains("line 2: `HOST PORT yarp` was expected"));
    assert!(says("127.0.0.1 99999", &[]).contains("`99999` is no port number"));
    assert!(says("[name]\nhost h\nport x\n", &[]).contains("line 3: `x` is no port number"));
    assert!(says("[other]\nhost h\n", &[]).contains("lacks `host`"));
    assert!(says("127.0.0.1 11311 ros", &[]).contains("mode `ros`"));
    assert!(says("h 7", &[("YARP_IP", "10.")]).contains("YARP_IP=\"10.\""));
}
