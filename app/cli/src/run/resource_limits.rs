//! System resources that a run needs, checked before it begins: a shortage during the run would end it.

use super::CtlAt;
use mobee_compose::config::{Config, ConfigError};
use mobee_driver_yarp::YARP;
use std::net::TcpListener;

/// Files and sockets that a run opens (runtimes of threads, journal, recording, control port), with a reserve.
const MIN_OPEN_FILES: u64 = 64;
/// The same with YARP ports; each connection to one of them needs another.
const MIN_OPEN_FILES_YARP: u64 = 256;

/// Checks that the run can have the files and the address that it needs.
///
/// # Errors
/// The missing resource, and its remedy.
pub(super) fn check(config: &Config, ctl: CtlAt) -> Result<(), ConfigError> {
    let yarp = config.yarp_ports().next().is_some() || config.robot.iter().any(|r| r.driver_kind() == YARP);
    let needed = if yarp { MIN_OPEN_FILES_YARP } else { MIN_OPEN_FILES };
    if let Some(limit) = max_open_files(&std::fs::read_to_string("/proc/self/limits").unwrap_or_default())
        && limit < needed
    {
        let what = format!("at most {limit} files can be open here, and this run may need {needed}");
        return Err(ConfigError::plain(what, format!("raise the limit: ulimit -n {}", 4 * MIN_OPEN_FILES_YARP)));
    }
    check_network_access(config)?;
    if let CtlAt::Address(address) = ctl {
        let open = config.yarp_ports().any(|(_, ports)| ports.allow_open_network);
        if !address.ip().is_loopback() && !open {
            return Err(ConfigError::plain(
                format!("--ctl {address} lets other computers reach the control port"),
                "use `ssh HOST mobee ctl ...` instead, or set allow_open_network = true in the table [yarp] if that \
                 network is yours alone",
            ));
        }
        TcpListener::bind(address).map_err(|e| {
            let what = format!("the control port can't listen on {address}: {e}");
            ConfigError::plain(what, "give another address with --ctl, or --ctl off")
        })?;
    }
    Ok(())
}

/// Checks that no port of the run is open to everybody on the network.
///
/// # Errors
/// If one is open: the reason, and the settings that guard it.
pub(crate) fn check_network_access(config: &Config) -> Result<(), ConfigError> {
    if config.yarp_ports().any(|(_, ports)| ports.is_unguarded()) {
        return Err(ConfigError::plain(
            "with yarp.allow_open_network everybody on the network could move the robots: there is no key in YARP's auth.conf",
            "write a key into auth.conf on all computers of the network ([AUTH], key = ...), or set without_auth = true in the \
             table [yarp] if nobody else can reach it",
        ));
    }
    Ok(())
}

/// The soft limit of open files in Linux' table of limits; `None` if it is missing or unlimited.
fn max_open_files(limits: &str) -> Option<u64> {
    limits.lines().find_map(|line| line.strip_prefix("Max open files")?.split_whitespace().next()?.parse().ok())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_table_of_limits_is_read() {
        let table = "Limit                     Soft Limit           Hard Limit           Units     \n\
                     Max processes             unlimited            unlimited            processes \n\
                     Max open files            1024                 524288               files     \n";
        assert_eq!(super::max_open_files(table), Some(1024));
        assert_eq!(super::max_open_files("Max open files            unlimited            unlimited  files"), None);
        assert_eq!(super::max_open_files(""), None);
    }
}
