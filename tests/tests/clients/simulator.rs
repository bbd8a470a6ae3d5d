//! The `pve-sim` process that users run, and the scripts that are run against it.

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

use crate::programs::{LIFE, PATIENCE, output_within};

/// The binary beside this test's own, built afresh: a test of a stale one would say nothing.
pub(crate) static PVE_SIM: LazyLock<PathBuf> = LazyLock::new(|| {
    let profile = profile();
    let mut build = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    build.args(["build", "--quiet", "--package", "pve-sim", "--bin", "pve-sim"]).current_dir(root());
    if profile.file_name() == Some(OsStr::new("release")) {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo runs").success(), "pve-sim does not build");
    profile.join("pve-sim")
});

/// Where this test's profile is built: `target/<profile>`.
fn profile() -> PathBuf {
    let test = env::current_exe().expect("the test knows its own path");
    test.parent().and_then(Path::parent).expect("tests lie in target/<profile>/deps").to_owned()
}

/// The interpreter that has the clients.
pub(crate) fn python() -> PathBuf {
    let venv = || profile().with_file_name("venv").join("bin/python");
    env::var_os("CLIENTS_PYTHON").map_or_else(venv, PathBuf::from)
}

/// The folder that has playwright-core.
pub(crate) fn modules() -> PathBuf {
    profile().with_file_name("node").join("node_modules")
}

pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A running `pve-sim` on a port of its own.
pub(crate) struct Simulator {
    process: Child,
    address: [String; 3],
    /// Its first line on stdout.
    ready: String,
    http: Option<String>,
    /// Its clients wind its clock.
    is_wound: bool,
    output: Arc<Mutex<String>>,
    ended: Receiver<()>,
}

/// Starts a simulator with these arguments.
pub(crate) type Start = fn(&[&str]) -> Simulator;
/// One that runs in real time.
pub(crate) const FREE: Start = |arguments| Simulator::start(arguments);
/// One whose clients wind its clock.
pub(crate) const WOUND: Start = |arguments| Simulator::start_wound(arguments);

impl Simulator {
    pub(crate) fn start<S: AsRef<OsStr>>(arguments: &[S]) -> Self {
        Self::spawn(Command::new(&*PVE_SIM), arguments)
    }

    /// One whose time passes while a script runs, and stands still when the machine holds that up (`wound.py`): for
    /// devices that wait for their clients. One script after the other.
    pub(crate) fn start_wound<S: AsRef<OsStr>>(arguments: &[S]) -> Self {
        let clock = ["--speed", "step", "--http", "127.0.0.1:0"].map(OsStr::new);
        let arguments = clock.into_iter().chain(arguments.iter().map(AsRef::as_ref));
        let mut simulator = Self::start(&arguments.collect::<Vec<_>>());
        simulator.is_wound = true;
        simulator
    }

    /// One that has fewer file descriptors than impolite clients take.
    pub(crate) fn start_with_few_descriptors() -> Self {
        let mut shell = Command::new("sh");
        shell.args(["-c", "ulimit -n 64 && exec \"$0\" \"$@\""]).arg(&*PVE_SIM);
        Self::spawn::<&str>(shell, &[])
    }

    fn spawn<S: AsRef<OsStr>>(mut command: Command, arguments: &[S]) -> Self {
        let has_http = arguments.iter().any(|argument| argument.as_ref() == "--http");
        let mut process = command
            .args(["run", "--bus", "socketcand://127.0.0.1:0/pve0"])
            .args((!has_http).then_some("--no-http"))
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
        let mut simulator = Self {
            process,
            address: Default::default(),
            ready: String::new(),
            http: None,
            is_wound: false,
            output,
            ended,
        };
        let line = first_line.recv_timeout(PATIENCE).expect("pve-sim says that it is ready");
        simulator.address = address(&line).unwrap_or_else(|| {
            panic!("the first line is no ready line: {line:?}\n{}", simulator.said());
        });
        simulator.ready.clone_from(&line);
        simulator.http = line.split_once(" http=").map(|(_, url)| url.trim_end_matches('/').to_owned());
        simulator
    }

    /// Its process.
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    /// Host, port and name of the bus.
    pub(crate) fn address(&self) -> &[String; 3] {
        &self.address
    }

    /// The URL of the control interface.
    pub(crate) fn http(&self) -> &str {
        self.http.as_deref().expect("it was started with --http")
    }

    /// The rest of the first bus whose URL begins so.
    pub(crate) fn bus(&self, scheme: &str) -> &str {
        let found = self.ready.split(' ').find_map(|word| word.strip_prefix("bus=")?.strip_prefix(scheme));
        found.unwrap_or_else(|| panic!("no bus={scheme} in {}", self.ready))
    }

    /// Runs a script that joins with these arguments of `can.Bus`, in JSON.
    pub(crate) fn serve_over(&self, bus: &str, script: &str, arguments: &[&str]) -> String {
        self.run(LIFE, Some(bus), script, arguments)
    }

    /// Runs a script against it, and shows all there is to see when it fails; returns what the script printed.
    pub(crate) fn serve(&self, script: &str, arguments: &[&str]) -> String {
        self.run(LIFE, None, script, arguments)
    }

    /// The same with a script that works for so long.
    pub(crate) fn serve_for(&self, work: Duration, script: &str, arguments: &[&str]) -> String {
        self.run(work + LIFE, None, script, arguments)
    }

    fn run(&self, life: Duration, bus: Option<&str>, script: &str, arguments: &[&str]) -> String {
        let mut command = self.python(&root().join("tests/clients").join(script));
        command.args(&self.address).args(arguments).envs(bus.map(|bus| ("CAN_BUS", bus)));
        let run = output_within(life, &mut command);
        assert!(
            run.status.success(),
            "{script} {arguments:?}: {}\n--- client\n{}{}\n--- pve-sim\n{}",
            run.status,
            String::from_utf8_lossy(&run.stdout),
            String::from_utf8_lossy(&run.stderr),
            self.said(),
        );
        String::from_utf8_lossy(&run.stdout).into_owned()
    }

    /// A script with the clients, which winds the clock if somebody has to.
    pub(crate) fn python(&self, script: &Path) -> Command {
        let python = python();
        assert!(python.exists(), "{}: not there; ./test makes the environment", python.display());
        let mut command = Command::new(python);
        if self.is_wound {
            command.arg(root().join("tests/clients/wound.py")).env("CLOCK", self.http());
        }
        command.arg(script).env("PVE_SIM", &*PVE_SIM);
        command
    }

    /// Ends it as a user does, and sees it end well.
    pub(crate) fn terminate(self) {
        self.finish();
    }

    /// Ends it as a user does, and sees it end well; returns its whole trace, and what it wrote to stderr.
    pub(crate) fn finish(mut self) -> String {
        let pid = Pid::from_child(&self.process);
        kill_process(pid, Signal::TERM).expect("it still runs");
        self.ended.recv_timeout(PATIENCE).expect("SIGTERM ends it");
        let status = self.process.wait().expect("it is our child");
        assert!(status.success(), "SIGTERM: {status}\n{}", self.said());
        self.said()
    }

    /// Its trace, and what it wrote to stderr.
    pub(crate) fn said(&self) -> String {
        self.output.lock().unwrap().clone()
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
