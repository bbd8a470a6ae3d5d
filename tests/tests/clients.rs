//! Unmodified python-canopen, over python-can's socketcand interface, against the `pve-sim` process that users run.
//!
//! `./test` makes the virtual environment `.venv` with the clients; the scripts are in `tests/clients/`.

use std::env;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, LazyLock, Mutex};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

/// How long the simulator may take to start or to end.
const PATIENCE: Duration = Duration::from_secs(30);

/// The binary beside this test's own, built afresh: a test of a stale one would say nothing.
static PVE_SIM: LazyLock<PathBuf> = LazyLock::new(|| {
    let test = env::current_exe().expect("the test knows its own path");
    let profile = test.parent().and_then(Path::parent).expect("tests lie in target/<profile>/deps");
    let mut build = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--quiet", "--package", "hal-sim", "--bin", "pve-sim"]).current_dir(root());
    if profile.file_name() == Some(OsStr::new("release")) {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo runs").success(), "pve-sim does not build");
    profile.join("pve-sim")
});

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A running `pve-sim` on a port of its own.
struct Simulator {
    process: Child,
    address: [String; 3],
    output: Arc<Mutex<String>>,
    ended: Receiver<()>,
}

impl Simulator {
    fn start<S: AsRef<OsStr>>(arguments: &[S]) -> Self {
        let mut process = Command::new(&*PVE_SIM)
            .args(["run", "--bus", "socketcand://127.0.0.1:0/pve0", "--no-http"])
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("pve-sim starts");
        let output = Arc::new(Mutex::new(String::new()));
        let stderr = process.stderr.take().expect("stderr is piped");
        collect(stderr, &output);

        let mut lines = BufReader::new(process.stdout.take().expect("stdout is piped")).lines();
        let (ready, first_line) = channel();
        let (end, ended) = channel();
        let trace = Arc::clone(&output);
        thread::spawn(move || {
            let _ = ready.send(lines.next().and_then(Result::ok).unwrap_or_default());
            for line in lines.map_while(Result::ok) {
                append(&trace, &line);
            }
            let _ = end.send(());
        });
        let mut simulator = Self { process, address: Default::default(), output, ended };
        let line = first_line.recv_timeout(PATIENCE).expect("pve-sim says that it is ready");
        simulator.address = address(&line).unwrap_or_else(|| {
            panic!("the first line is no ready line: {line:?}\n{}", simulator.output.lock().unwrap());
        });
        simulator
    }

    /// Runs a script against it, and shows all there is to see when it fails.
    fn serve(&self, script: &str, arguments: &[&str]) {
        let python = env::var_os("CLIENTS_PYTHON").map_or_else(|| root().join(".venv/bin/python"), PathBuf::from);
        let run = Command::new(&python)
            .arg(root().join("tests/clients").join(script))
            .args(&self.address)
            .args(arguments)
            .stdin(Stdio::null())
            .output()
            .unwrap_or_else(|error| panic!("{}: {error}; ./test makes the environment", python.display()));
        assert!(
            run.status.success(),
            "{script} {arguments:?}: {}\n--- client\n{}{}\n--- pve-sim\n{}",
            run.status,
            String::from_utf8_lossy(&run.stdout),
            String::from_utf8_lossy(&run.stderr),
            self.output.lock().unwrap(),
        );
    }

    /// Ends it as a user does, and sees it end well.
    fn terminate(mut self) {
        let pid = Pid::from_child(&self.process);
        kill_process(pid, Signal::TERM).expect("it still runs");
        self.ended.recv_timeout(PATIENCE).expect("SIGTERM ends it");
        let status = self.process.wait().expect("it is our child");
        assert!(status.success(), "SIGTERM: {status}\n{}", self.output.lock().unwrap());
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Host, port and bus name of `pve-sim ready bus=socketcand://HOST:PORT/NAME`.
fn address(ready: &str) -> Option<[String; 3]> {
    let bus =
        ready.strip_prefix("pve-sim ready ")?.split(' ').find_map(|part| part.strip_prefix("bus=socketcand://"))?;
    let (endpoint, name) = bus.split_once('/')?;
    let (host, port) = endpoint.rsplit_once(':')?;
    Some([host, port, name].map(String::from))
}

fn append(output: &Mutex<String>, line: &str) {
    let mut output = output.lock().unwrap();
    output.push_str(line);
    output.push('\n');
}

fn collect(source: impl Read + Send + 'static, output: &Arc<Mutex<String>>) {
    let output = Arc::clone(output);
    thread::spawn(move || {
        for line in BufReader::new(source).lines().map_while(Result::ok) {
            append(&output, &line);
        }
    });
}

const NO_ARGUMENTS: [&str; 0] = [];

#[test]
fn boots_goes_active_and_moves_the_spool() {
    let simulator = Simulator::start(&NO_ARGUMENTS);
    simulator.serve("boot.py", &["11149437"]);
    simulator.terminate();
}

#[test]
fn falls_into_fault_hold_without_set_points_and_comes_back() {
    let simulator = Simulator::start(&NO_ARGUMENTS);
    simulator.serve("fault.py", &[]);
    simulator.terminate();
}

#[test]
fn what_was_stored_outlives_the_process() {
    let state = tempfile::tempdir().expect("a directory for the state");
    for phase in ["store", "found", "restored"] {
        let simulator = Simulator::start(&[OsStr::new("--state"), state.path().as_os_str()]);
        simulator.serve("store.py", &[phase]);
        simulator.terminate();
    }
}

#[test]
fn takes_another_node_id_by_lss() {
    let simulator = Simulator::start(&NO_ARGUMENTS);
    simulator.serve("lss.py", &[]);
    simulator.terminate();
}

#[test]
fn a_blank_valve_is_found_by_fast_scan() {
    let simulator = Simulator::start(&["--device", "pvea-canopen,blank"]);
    simulator.serve("scan.py", &[]);
    simulator.terminate();
}
