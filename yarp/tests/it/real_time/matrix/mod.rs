//! Our ports and the real YARP's, over every carrier, by the real name server and by ours: writing and reading, requests,
//! connecting by a third program, persistent connections, looking at ports; the last rows with `auth.conf`. Prints the matrix; a cell that fails fails
//! the test. Skipped, and said so, where the real YARP is not installed (`tests/yarp/install.sh` installs it).

mod ours;
mod program;
mod real;

use mobee_yarp::auth::Key;
use mobee_yarp::{Carrier, NameServer, Network, ServerOptions};
use program::{Program, Tools};
use std::fmt::Display;
use std::net::{Ipv4Addr, TcpListener};
use std::time::Duration;
use tokio::time::timeout;

/// How long anything may take; a failing cell ends by it, a good one long before.
const LIMIT: Duration = Duration::from_secs(20);
/// The columns.
const COLUMNS: [&str; 6] = ["list", "connect", "write/read", "ping", "persistent", "rpc"];

/// What came of a cell: `None` where the carrier has no such thing.
type Cell = Option<Result<(), String>>;

/// One row of the matrix.
struct Row {
    title: String,
    cells: [Cell; 6],
}

/// What goes wrong, with what was tried.
fn at<E: Display>(what: &'static str) -> impl Fn(E) -> String {
    move |e| format!("{what}: {e}")
}

/// Within the limit, or not at all.
async fn within<T>(what: &str, work: impl Future<Output = T>) -> Result<T, String> {
    timeout(LIMIT, work).await.map_err(|_| format!("{what}: not within {LIMIT:?}"))
}

/// Asks again and again until the answer is yes.
async fn until<F: Future<Output = bool>>(what: &str, mut asked: impl FnMut() -> F) -> Result<(), String> {
    within(what, async {
        while !asked().await {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    })
    .await
}

/// Runs one name server with all carriers and both kinds of port.
async fn rows(tools: &Tools, network: &Network, server: &str) -> Vec<Row> {
    let mut rows = Vec::new();
    for carrier in Carrier::ALL {
        for kind in ["our port", "real port"] {
            let base = format!("/m/{}/{carrier}", kind.split(' ').next().unwrap_or_default());
            let cells = match kind {
                "our port" => ours::row(tools, network, &base, carrier).await,
                _ => real::row(tools, network, &base, carrier).await,
            };
            rows.push(Row { title: format!("{server:<10} {kind:<10} {carrier:<9}"), cells });
        }
    }
    rows
}

/// A number for a name server with room above it, outside of the range that systems give by themselves.
fn free_number() -> u16 {
    let first = 11_000 + (std::process::id() % 80) as u16 * 200;
    let free = |n: &u16| (0..100).all(|i| TcpListener::bind((Ipv4Addr::LOCALHOST, n + i)).is_ok());
    (first..30_000).step_by(100).find(free).expect("100 free port numbers")
}

#[tokio::test]
async fn our_ports_and_the_real_ones_understand_each_other() {
    let Some(tools) = Tools::find() else {
        println!("SKIPPED: the real YARP is not installed; tests/yarp/install.sh installs it");
        return;
    };
    let mut matrix = Vec::new();
    {
        let tools = tools.network(free_number());
        let mut server = tools.start("yarpserver", &["--socket", &tools.number().to_string(), "--read"]);
        let network = Network::at(tools.address()).with_timeout(LIMIT);
        let answers = async || network.query("/root").await.is_ok();
        until("the real name server", answers).await.unwrap_or_else(|e| panic!("{e}\n{}", server.said()));
        matrix.extend(rows(&tools, &network, "real names").await);
    }
    {
        let tools = tools.network(free_number());
        let server = NameServer::bind(tools.address(), ServerOptions::default()).await.unwrap();
        let network = server.network().with_timeout(LIMIT);
        matrix.extend(rows(&tools, &network, "our names").await);
        server.close().await;
    }
    {
        let tools = tools.network(free_number()).with_key("secret");
        let options = ServerOptions { auth: Some(Key::new("secret")), ..ServerOptions::default() };
        let server = NameServer::bind(tools.address(), options).await.unwrap();
        let network = server.network().with_timeout(LIMIT);
        matrix.extend(rows(&tools, &network, "auth.conf").await);
        server.close().await;
    }
    let width = COLUMNS.map(|c| c.len().max(5));
    let line = |cells: [&str; 6]| cells.iter().zip(width).map(|(c, w)| format!(" {c:<w$}")).collect::<String>();
    println!("{:<31}{}", "", line(COLUMNS));
    for row in &matrix {
        let cells = row.cells.each_ref().map(|c| match c {
            None => "-",
            Some(Ok(())) => "ok",
            Some(Err(_)) => "FAIL",
        });
        println!("{}{}", row.title, line(cells));
    }
    let cells = matrix.iter().flat_map(|row| row.cells.iter().zip(COLUMNS).map(move |(c, name)| (&row.title, name, c)));
    let failed: Vec<String> =
        cells.clone().filter_map(|(t, name, c)| Some(format!("{t} {name}: {}", c.as_ref()?.as_ref().err()?))).collect();
    println!("{} cells, {} failed", cells.filter(|(_, _, c)| c.is_some()).count(), failed.len());
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// The first of the four cells that build on each other which has no result is the one that failed.
fn blame(cells: &mut [Cell; 6], ended: Result<(), String>) {
    if let (Err(e), Some(cell)) = (ended, cells.iter_mut().take(4).find(|c| c.is_none())) {
        *cell = Some(Err(e));
    }
}

/// Waits for a program's line, so that a failing cell can say what came instead.
async fn line(program: &mut Program, what: &'static str, wanted: impl Fn(&str) -> bool) -> Result<String, String> {
    match timeout(LIMIT, program.line(wanted)).await {
        Ok(Some(line)) => Ok(line),
        Ok(None) => Err(format!("{what}: the program ended; it said {}", program.said())),
        Err(_) => Err(format!("{what}: not within {LIMIT:?}; it said {}", program.said())),
    }
}
