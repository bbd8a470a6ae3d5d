//! Clients that use the simulator as a serial-line adapter, over TCP and on a pseudo-terminal.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;

use rustix::process::Signal;

use super::simulator::*;

/// The refusal of an adapter.
const BELL: &str = "\x07";

/// Starts a bus of slcan and one of socketcand, with a silent device.
fn start(options: &[&str]) -> Simulator {
    let buses = ["--bus", "slcan://127.0.0.1:0", "--bus", "socketcand://127.0.0.1:0/pve0"];
    Simulator::start(&[&buses[..], &["--device", "pvea-canopen,blank"], options].concat())
}

/// Connects to the adapter.
fn adapter(simulator: &Simulator) -> TcpStream {
    let bus = simulator.ready.split_once("bus=slcan://127.0.0.1:").expect("a bus").1;
    connect(bus.split(' ').next().expect("a port").parse().expect("a port"))
}

/// Reads the next answer or frame.
fn line(client: &mut impl Read) -> String {
    let mut line = Vec::new();
    while !matches!(line.last(), Some(b'\r' | 0x07)) {
        let mut byte = [0];
        client.read_exact(&mut byte).unwrap_or_else(|error| panic!("{error} after {line:?}"));
        line.push(byte[0]);
    }
    String::from_utf8(line).expect("text")
}

fn command(client: &mut (impl Read + Write), command: &str, answer: &str) {
    client.write_all(format!("{command}\r").as_bytes()).expect(command);
    assert_eq!(line(client), answer, "{command}");
}

/// Returns a client with an open channel.
fn open(simulator: &Simulator) -> TcpStream {
    let mut client = adapter(simulator);
    command(&mut client, "O", "\r");
    client
}

#[test]
fn the_dialogue_with_an_adapter() {
    let simulator = start(&[]);
    let mut witness = simulator.join();
    let mut client = adapter(&simulator);
    let garbage = "T".repeat(10_000);
    for (text, answer) in [
        ("", "\r"),
        ("V", concat!("V10", env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), "\r")),
        ("N", "NPVE0\r"),
        // closed
        ("C", BELL),
        ("F", BELL),
        ("t1230", BELL),
        ("S9", BELL),
        ("M00000000", BELL),
        ("mFFFFFFFF", BELL),
        // a different bit rate than the bus
        ("S4", "\r"),
        ("O", BELL),
        ("L", BELL),
        ("t1230", BELL),
        ("S3", "\r"),
        ("O", BELL),
        // the same, by register
        ("s011C", "\r"),
        ("X1", "\r"),
        ("Z0", "\r"),
        // listen only
        ("L", "\r"),
        ("t1230", BELL),
        ("O", BELL),
        ("C", "\r"),
        ("S5", "\r"),
        ("O", "\r"),
        ("S5", BELL),
        ("s011C", BELL),
        ("Z1", BELL),
        ("L", BELL),
        ("F", "F00\r"),
        ("t18A20102", "z\r"),
        ("T18FF0AE00", "Z\r"),
        ("r1232", "z\r"),
        ("R000001231", "Z\r"),
        ("t1239", BELL),
        ("t8000", BELL),
        ("d1230", BELL),
        (&garbage, BELL),
        ("\nt7FF0\n", "z\r"),
        ("C", "\r"),
        ("t7FF0", BELL),
    ] {
        command(&mut client, text, answer);
    }
    // An accepted frame is still on its way.
    await_frame(&mut witness, "7FF#");
    let (trace, said) = simulator.end(Signal::TERM);
    let frames: Vec<&str> = trace.lines().filter_map(|line| line.split(' ').nth(2)).collect();
    assert_eq!(frames, ["18A#0102", "18FF0AE0#", "123#R2", "00000123#R1", "7FF#"], "{trace}");
    assert!(
        said.contains("a client set 125000 bit/s, but the bus runs at 250000 bit/s: the channel stays closed"),
        "{said}"
    );
    assert_eq!(said.matches("the channel stays closed").count(), 1, "told once: {said}");
}

#[test]
fn everybody_hears_the_others_and_nobody_himself() {
    let simulator = start(&[]);
    let (mut one, mut two) = (open(&simulator), open(&simulator));
    let mut three = simulator.join();
    command(&mut one, "t12320102", "z\r");
    assert_eq!(line(&mut two), "t12320102\r");
    assert_eq!(frame(&mut three), "123#0102");
    say(&mut three, "< send 18FF0AE0 1 ff >");
    assert_eq!([line(&mut one), line(&mut two)], ["T18FF0AE01FF\r", "T18FF0AE01FF\r"]);
    command(&mut two, "r1238", "z\r");
    assert_eq!(line(&mut one), "r1238\r");
    // A closed channel receives nothing; after the next opening, everything again.
    command(&mut one, "C", "\r");
    command(&mut two, "t2000", "z\r");
    assert_eq!(frame(&mut three), "200#");
    command(&mut one, "V", concat!("V10", env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"), "\r"));
    command(&mut one, "L", "\r");
    command(&mut two, "t2010", "z\r");
    assert_eq!(line(&mut one), "t2010\r");
}

#[test]
fn time_stamps_are_set_with_the_channel_closed() {
    let simulator = start(&[]);
    let mut sender = open(&simulator);
    let mut client = adapter(&simulator);
    for text in ["Z1", "O"] {
        command(&mut client, text, "\r");
    }
    for expected in ["t123209FF", "t1230"] {
        command(&mut sender, expected, "z\r");
        let line = line(&mut client);
        let stamp = line.trim_end().strip_prefix(expected).unwrap_or_else(|| panic!("{line:?}"));
        assert_eq!(stamp.len(), 4, "{line:?}");
        assert!(u32::from_str_radix(stamp, 16).expect("a number") < 60_000, "{line:?}");
    }
}

/// As a client that finds the channel open.
#[test]
fn lines_of_one_write_are_carried_out_in_order() {
    let simulator = start(&[]);
    let mut sender = open(&simulator);
    let mut client = open(&simulator);
    client.write_all(b"C\rZ1\rO\rZ0\rt1230\rC\rt1240\rZ0\rO\r").expect("room");
    for answer in ["\r", "\r", "\r", BELL, "z\r", "\r", BELL, "\r", "\r"] {
        assert_eq!(line(&mut client), answer);
    }
    assert_eq!(line(&mut sender), "t1230\r");
    command(&mut sender, "t2000", "z\r");
    assert_eq!(line(&mut client), "t2000\r");
}

/// As with any adapter: frames sent before the line broke are on the bus.
#[test]
fn what_was_sent_before_the_end_counts_and_is_answered() {
    let simulator = start(&[]);
    let mut witness = simulator.join();
    let mut hasty = adapter(&simulator);
    hasty.write_all(b"O\rt12311\rt123111\rt12").expect("room");
    hasty.shutdown(std::net::Shutdown::Write).expect("half a connection");
    let mut answers = String::new();
    hasty.read_to_string(&mut answers).expect("the end");
    assert_eq!(answers, "\r\x07z\r");
    assert_eq!(frame(&mut witness), "123#11");
}

#[test]
fn an_address_that_is_taken_is_exit_1() {
    let simulator = start(&[]);
    let taken = simulator.ready.split(' ').find_map(|word| word.strip_prefix("bus=")).expect("a bus");
    let text = refusal(&["--bus", taken], 1);
    assert!(text.contains(taken) && text.ends_with("--bus slcan://127.0.0.1:0 selects a free port"), "{text}");
}

#[cfg(unix)]
mod pty {
    use std::fs::{File, OpenOptions};
    use std::os::unix::fs::OpenOptionsExt;
    use std::path::Path;

    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fs::OFlags;
    use rustix::process::{Pid, kill_process};
    use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

    use super::*;

    /// The client's end of a terminal, with reads limited by [`PATIENCE`].
    struct Terminal(File);

    impl Terminal {
        fn open(path: &Path) -> Self {
            let no_control = OFlags::NOCTTY.bits().try_into().expect("a flag");
            Self(OpenOptions::new().read(true).write(true).custom_flags(no_control).open(path).expect("the terminal"))
        }

        /// Opens the terminal in its last state, and starts over.
        fn reset(path: &Path) -> Self {
            let mut terminal = Self::open(path);
            terminal.write_all(b"C\rV\r").expect("room");
            while !line(&mut terminal).starts_with('V') {}
            terminal
        }
    }

    impl Read for Terminal {
        fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
            let patience = Timespec::try_from(PATIENCE).expect("a time");
            let ready = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&patience))?;
            assert_eq!(ready, 1, "nothing comes");
            self.0.read(bytes)
        }
    }

    impl Write for Terminal {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// Starts a simulator with a terminal at this path, and a bus of socketcand.
    fn start_at(path: &Path, options: &[&str]) -> Simulator {
        let url = format!("slcan+pty:{}", path.display());
        let buses = ["--bus", &url, "--bus", "socketcand://127.0.0.1:0/pve0", "--device", "pvea-canopen,blank"];
        let simulator = Simulator::start(&[&buses[..], options].concat());
        assert!(simulator.ready.contains(&format!("bus={url} ")), "{}", simulator.ready);
        simulator
    }

    #[test]
    fn clients_open_and_close_it_again_and_again() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("pve0");
        let simulator = start_at(&path, &[]);
        let mut witness = simulator.join();
        for round in 0..20 {
            // no client has the terminal open: the frame is for the others only
            let earlier = format!("< send 100 1 {round:x} >< echo >");
            say(&mut witness, &earlier);
            expect(&mut witness, "< echo >");
            let mut client = Terminal::reset(&path);
            command(&mut client, "S5", "\r");
            command(&mut client, "O", "\r");
            command(&mut client, &format!("t2001{round:02X}"), "z\r");
            assert_eq!(frame(&mut witness), format!("200#{round:02X}"));
            say(&mut witness, &format!("< send 300 1 {round:x} >"));
            assert_eq!(line(&mut client), format!("t3001{round:02X}\r"));
            if round % 2 == 0 {
                command(&mut client, "C", "\r");
            }
            // its last frame counts, too
            client.write_all(b"O\rt4000\r").expect("room");
            drop(client);
            assert_eq!(frame(&mut witness), "400#");
        }
        simulator.end(Signal::TERM);
        assert!(path.symlink_metadata().is_err(), "the link is gone");
    }

    /// As tests do that open a bus each: at every instant from the end of the previous one on.
    #[test]
    fn a_client_that_comes_at_the_end_of_another_is_served() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("pve0");
        let _simulator = start_at(&path, &[]);
        for later in 0..100 {
            drop(Terminal::reset(&path));
            // Some 2 ms at the end. A busy machine would make a yield last for a time slice.
            (0..500 * later).for_each(|_| std::hint::spin_loop());
        }
    }

    /// A shell sets the terminal to echo, as `stty sane` does.
    #[test]
    fn an_echo_is_no_command() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("pve0");
        let simulator = start_at(&path, &[]);
        let mut witness = simulator.join();
        let mut client = Terminal::open(&path);
        command(&mut client, "O", "\r");
        let mut attributes = tcgetattr(&client.0).expect("attributes");
        attributes.local_modes |= LocalModes::ECHO;
        attributes.local_modes -= LocalModes::ECHOCTL;
        tcsetattr(&client.0, OptionalActions::Now, &attributes).expect("attributes");
        command(&mut client, "t1000", "z\r");
        assert_eq!(frame(&mut witness), "100#");
        for id in ["200", "300"] {
            say(&mut witness, &format!("< send {id} 0 >< echo >"));
            expect(&mut witness, "< echo >");
            while line(&mut client) != format!("t{id}0\r") {}
        }
        command(&mut client, "t4000", "z\r");
        assert_eq!(frame(&mut witness), "400#", "no echo of the frames before");
    }

    #[test]
    fn a_client_that_does_not_read_loses_its_terminal_and_holds_nobody_up() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("pve0");
        let simulator = start_at(&path, &["--bit-rate", "1M", "--device", "hat1000,bit-rate=1M", "--speed", "1000"]);
        let mut sleeper = Terminal::open(&path);
        command(&mut sleeper, "O", "\r");
        let mut witness = simulator.join();
        let before = fs::read_link(&path).expect("the link");
        std::thread::scope(|scope| {
            let at_every_instant = || while fs::read_link(&path).expect("the link is there") == before {};
            let watcher = scope.spawn(at_every_instant);
            while !watcher.is_finished() {
                say(&mut witness, &"< send 100 8 1 2 3 4 5 6 7 8 >".repeat(256));
                say(&mut witness, "< echo >");
                while message(&mut witness) != "< echo >" {}
            }
        });
        let mut rest = Vec::new();
        let _ = sleeper.0.read_to_end(&mut rest);
        let mut next = Terminal::reset(&path);
        command(&mut next, "O", "\r");
        say(&mut witness, "< send 200 0 >");
        while line(&mut next) != "t2000\r" {}
        let (_, said) = simulator.end(Signal::TERM);
        assert!(said.contains("disconnected a client that did not read its data"), "{said}");
    }

    #[test]
    fn it_replaces_nothing_but_a_link_that_was_left_behind() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("pve0");
        let url = format!("slcan+pty:{}", path.display());
        fs::write(&path, "mine").expect("a file");
        let text = refusal(&["--bus", &url], 1);
        assert!(text.contains(&url), "{text}");
        assert_eq!(fs::read_to_string(&path).expect("the file"), "mine");
        fs::remove_file(&path).expect("the file");

        let first = start_at(&path, &[]);
        let device = fs::read_link(&path).expect("the link");
        let text = refusal(&["--bus", &url], 1);
        let in_use = format!(
            "{url}: {} links to {}, which is in use; if no other pve-sim uses it, remove",
            path.display(),
            device.display()
        );
        assert!(text.contains(&in_use), "{text}");
        assert_eq!(fs::read_link(&path).expect("the link"), device);
        // A killed simulator leaves its link behind.
        kill_process(Pid::from_child(&first.process), Signal::KILL).expect("it still runs");
        drop(first);
        assert_eq!(fs::read_link(&path).expect("the link"), device);
        fs::remove_file(&path).expect("the link");
        std::os::unix::fs::symlink(device.with_file_name("123456789"), &path).expect("a link");
        let second = start_at(&path, &[]);
        command(&mut Terminal::open(&path), "N", "NPVE0\r");
        second.end(Signal::INT);
        assert!(path.symlink_metadata().is_err(), "the link is gone");

        let text = refusal(&["--bus", &format!("slcan+pty:{}/none/pve0", dir.path().display())], 1);
        assert!(text.contains("none/pve0: No such file"), "{text}");
    }
}
