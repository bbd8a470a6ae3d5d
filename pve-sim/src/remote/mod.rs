//! `pve-sim set` and `pve-sim status`: requests to a running simulator's control interface.
//!
//! ```text
//! mod    requests, answers and failures
//! words  plant words of the command line, as JSON
//! table  device states as a readable table
//! ```

mod table;
mod words;

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

/// A failed request.
#[derive(Debug, thiserror::Error)]
pub enum RemoteError {
    /// The simulator refused the request, with this message.
    #[error("{0}")]
    Refused(String),
    /// The address cannot be reached.
    #[error("no simulator at {0}: {1}; {REMEDY}")]
    Unreachable(SocketAddr, std::io::Error),
    /// The address accepts connections but does not answer in time.
    #[error("no response from {0} within {1:?}; {REMEDY}")]
    Silent(SocketAddr, Duration),
    /// Another program answers at the address.
    #[error("{0} is not the control interface of pve-sim: {1}; {REMEDY}")]
    OtherServer(SocketAddr, String),
}

const REMEDY: &str = "start pve-sim, or give the address from its ready line as --http ADDR:PORT";

/// Changes plant words of a device in the simulator at `http`; applies all of them or none.
///
/// # Errors
/// [`RemoteError`]. If the simulator refused the change, nothing has changed.
pub fn set(http: SocketAddr, device: &str, words: &[PlantWord]) -> Result<(), RemoteError> {
    let change: Value = words.iter().map(|word| (word.name.clone(), word.json())).collect();
    Simulator::at(http, RESPONSE_TIMEOUT).change_plant(device, &change).map(drop)
}

/// Returns the state of the named device, or of all devices for `None`, in the simulator at `http`: as a readable
/// table, or as the JSON of the control interface.
///
/// # Errors
/// [`RemoteError`]
pub fn status(http: SocketAddr, device: Option<&str>, json: bool) -> Result<String, RemoteError> {
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

    fn devices(&self, name: Option<&str>) -> Result<String, RemoteError> {
        self.answer(self.agent.get(self.url(&name.map_or_else(String::new, in_path))).call())
    }

    fn change_plant(&self, name: &str, change: &Value) -> Result<String, RemoteError> {
        let request = self.agent.patch(self.url(&(in_path(name) + "/plant")));
        self.answer(request.content_type("application/json").send(change.to_string()))
    }

    fn url(&self, path: &str) -> String {
        format!("http://{}/api/v1/devices{path}", self.address)
    }

    /// Returns the body of a successful response.
    fn answer(&self, answer: Result<http::Response<Body>, ureq::Error>) -> Result<String, RemoteError> {
        let mut answer = answer.map_err(|error| self.failure(error))?;
        let body = answer.body_mut().read_to_string().map_err(|error| self.failure(error))?;
        if answer.status() == StatusCode::OK {
            return Ok(body);
        }
        let refusal: Option<Refusal> = serde_json::from_str(&body).ok();
        Err(refusal.map_or_else(|| self.other_server(answer.status()), |Refusal { error }| RemoteError::Refused(error)))
    }

    fn failure(&self, error: ureq::Error) -> RemoteError {
        match error {
            ureq::Error::Io(error) => RemoteError::Unreachable(self.address, error),
            ureq::Error::Timeout(_) => RemoteError::Silent(self.address, self.timeout),
            error => self.other_server(error),
        }
    }

    fn other_server(&self, reason: impl ToString) -> RemoteError {
        RemoteError::OtherServer(self.address, reason.to_string())
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
        assert!(matches!(error, RemoteError::Silent(at, _) if at == address), "{error}");
    }
}
