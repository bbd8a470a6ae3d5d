//! `pve-sim set` and `pve-sim status`: requests to a running simulator's control interface.
//!
//! ```text
//! mod    requests, answers and failures
//! words  plant words of the command line, as JSON
//! table  device states as a readable table
//! ```

mod table;
mod words;

use std::fmt::Display;
use std::net::SocketAddr;
use std::time::Duration;

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::Deserialize;
use serde_json::Value;
use ureq::http::StatusCode;
use ureq::{Agent, Body, http};

pub use words::PlantWord;

/// The time limit of a response. The simulator answers these requests immediately at any speed.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(30);

const REMEDY: &str = "start pve-sim, or give the address from its ready line as --http ADDR:PORT";

/// Changes plant words of a device in the simulator at `http`; applies all of them or none.
///
/// # Errors
/// The reason. If the simulator refused the change, nothing has changed.
pub fn set(http: SocketAddr, device: &str, words: &[PlantWord]) -> Result<(), String> {
    let change: Value = words.iter().map(|word| (word.name.clone(), word.json())).collect();
    Simulator::at(http, RESPONSE_TIMEOUT).change_plant(device, &change).map(drop)
}

/// Returns the state of the named device, or of all devices for `None`, in the simulator at `http`: as a readable
/// table, or as the JSON of the control interface.
///
/// # Errors
/// The reason.
pub fn status(http: SocketAddr, device: Option<&str>, json: bool) -> Result<String, String> {
    let simulator = Simulator::at(http, RESPONSE_TIMEOUT);
    let body = simulator.devices(device)?;
    if json { Ok(body + "\n") } else { table::of(&body).map_err(|error| simulator.other_server(error)) }
}

struct Simulator {
    address: SocketAddr,
    timeout: Duration,
    agent: Agent,
}

impl Simulator {
    fn at(address: SocketAddr, timeout: Duration) -> Self {
        // A proxy from the environment cannot reach this machine's loopback addresses.
        let config = Agent::config_builder().proxy(None).max_redirects(0).http_status_as_error(false);
        Self { address, timeout, agent: config.timeout_global(Some(timeout)).build().into() }
    }

    fn devices(&self, name: Option<&str>) -> Result<String, String> {
        self.answer(self.agent.get(self.url(&name.map_or_else(String::new, in_path))).call())
    }

    fn change_plant(&self, name: &str, change: &Value) -> Result<String, String> {
        let request = self.agent.patch(self.url(&(in_path(name) + "/plant")));
        self.answer(request.content_type("application/json").send(change.to_string()))
    }

    fn url(&self, path: &str) -> String {
        format!("http://{}/api/v1/devices{path}", self.address)
    }

    /// Returns the body of a successful response.
    fn answer(&self, answer: Result<http::Response<Body>, ureq::Error>) -> Result<String, String> {
        let mut answer = answer.map_err(|error| self.failure(error))?;
        let body = answer.body_mut().read_to_string().map_err(|error| self.failure(error))?;
        if answer.status() == StatusCode::OK {
            return Ok(body);
        }
        let refusal: Option<Refusal> = serde_json::from_str(&body).ok();
        Err(refusal.map_or_else(|| self.other_server(answer.status()), |Refusal { error }| error))
    }

    fn failure(&self, error: ureq::Error) -> String {
        match error {
            ureq::Error::Io(error) => format!("no simulator at {}: {error}; {REMEDY}", self.address),
            ureq::Error::Timeout(_) => format!("no response from {} within {:?}; {REMEDY}", self.address, self.timeout),
            error => self.other_server(error),
        }
    }

    /// Returns the message for an address at which another program answers.
    fn other_server(&self, reason: impl Display) -> String {
        format!("{} is not the control interface of pve-sim: {reason}; {REMEDY}", self.address)
    }
}

#[derive(Deserialize)]
struct Refusal {
    error: String,
}

/// Returns the path segment that names a device, percent-encoded.
fn in_path(name: &str) -> String {
    format!("/{}", utf8_percent_encode(name, NON_ALPHANUMERIC))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_silent_server_is_told_after_a_while() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address");
        let error = Simulator::at(address, Duration::from_millis(1)).devices(None).expect_err("nobody answers");
        assert!(error.starts_with(&format!("no response from {address} within 1ms; ")), "{error}");
    }
}
