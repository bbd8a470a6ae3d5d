//! The README and the guides as a visitor goes through them: their blocks run against the binary, and what they promise
//! is what comes.

use std::fs;
use std::process::Command;

use pve_sim::cli;

use crate::programs::{Program, output};
use crate::simulator::{PVE_SIM, Simulator, python, root};

/// The port that pages name; a test has one of its own.
const PORT: &str = "29536";

const README: &str = "README.md";
const BENCH: &str = "docs/guides/bench.md";
const TOOLS: &str = "docs/guides/tools.md";

/// The pages with command lines for users.
const PAGES: [&str; 7] =
    [README, BENCH, TOOLS, "docs/guides/ci.md", "docs/pve-sim.md", "docs/recordings.md", "docs/scenarios.md"];

/// The fenced blocks of a page, each with its language.
fn blocks(page: &str) -> Vec<(String, String)> {
    let text = fs::read_to_string(root().join(page)).expect(page);
    let mut blocks = Vec::new();
    let mut open: Option<(String, String)> = None;
    for line in text.lines() {
        match (line.strip_prefix("```"), open.take()) {
            (Some(_), Some(block)) => blocks.push(block),
            (Some(language), None) => open = Some((language.to_owned(), String::new())),
            (None, Some((language, block))) => open = Some((language, format!("{block}{line}\n"))),
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "{page}: a block has no end");
    blocks
}

fn block(page: &str, has: &str) -> String {
    let found = blocks(page).into_iter().find(|(_, block)| block.contains(has));
    found.unwrap_or_else(|| panic!("{page} has no block with {has:?}")).1
}

/// Runs a block of Python as a visitor does, who presses Enter once the spool is there; returns what it printed.
fn paste(script: &str, simulator: &Simulator, until: &str) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("pasted.py");
    fs::write(&path, script.replace(PORT, &simulator.address()[1])).expect("room");
    let mut client = Program::start(simulator.python(&path).env("PYTHONUNBUFFERED", "1"));
    client.until(until);
    client.enter()
}

#[test]
fn the_first_drive_works_twice_in_a_row() {
    let script = block(BENCH, "canopen.Network()");
    let file = fs::read_to_string(root().join("examples/drive.py")).expect("the example");
    assert_eq!(script, file, "the guide shows the example");
    let promised = block(BENCH, "status 0x0009");
    let last = promised.lines().last().expect("a line");
    assert_eq!(block(README, "status 0x"), format!("{last}\n"), "the README shows the end");
    let simulator = Simulator::start_wound::<&str>(&[]);
    for visit in 1..=2 {
        let printed = paste(&script, &simulator, last);
        let statuses: Vec<&str> = printed.lines().filter_map(|line| line.strip_prefix("status ")).collect();
        let states = |lines: &[&str]| lines.iter().map(|line| line[..6].to_owned()).collect::<Vec<_>>();
        // The first of a later visit is that of the fault that the end of the one before has left.
        let promised: Vec<&str> = promised.lines().filter_map(|line| line.strip_prefix("status ")).collect();
        assert_eq!(states(&statuses)[1..3], states(&promised)[1..3], "visit {visit}: {printed}");
        assert!(statuses.contains(&"0x000f, spool 8192"), "visit {visit}: {printed}");
        let mut different = statuses.clone();
        different.dedup();
        assert_eq!(different, statuses, "visit {visit}: a status is printed when it changes");
    }
    simulator.terminate();
}

/// Where no terminal is, nobody presses Enter. How far the spool comes until then is the machine's.
#[test]
fn the_first_drive_ends_by_itself_without_a_terminal() {
    let simulator = Simulator::start::<&str>(&[]);
    let script = block(BENCH, "canopen.Network()").replace(PORT, &simulator.address()[1]);
    let run = output(Command::new(python()).args(["-c", &script]));
    let printed = String::from_utf8(run.stdout).expect("text");
    assert!(run.status.success(), "{printed}{}", String::from_utf8_lossy(&run.stderr));
    assert!(printed.contains("Enter ends\n"), "{printed}");
    simulator.terminate();
}

/// What the README's command lines make is nobody's to commit.
#[test]
fn the_steps_of_the_readme_leave_the_clone_clean() {
    let ignored = fs::read_to_string(root().join(".gitignore")).expect("the list");
    let text: String = blocks(README).into_iter().map(|(_, block)| block).collect();
    let words: Vec<&str> = text.split_whitespace().collect();
    for (option, ending) in [("venv", "/"), ("--junit", "")] {
        let mut made = words.windows(2).filter(|pair| pair[0] == option).map(|pair| format!("/{}{ending}", pair[1]));
        let made = made.next().unwrap_or_else(|| panic!("{option} is not in the README"));
        assert!(ignored.lines().any(|line| line == made), "{made}");
    }
}

/// Each block of the README, by words in it, and what goes through it.
#[test]
fn every_block_of_the_readme_is_gone_through() {
    const FIRST_DRIVE: &str = "the_first_drive_works_twice_in_a_row";
    let known = [
        ("cargo run\n", "every test: it is Simulator::start"),
        ("./test ", "what runs this test"),
        ("pvea-canopen: boot-up", "the_trace_begins_as_the_readme_shows_it"),
        ("pip install python-can", "the_readme_installs_what_is_tested"),
        ("venv/bin/python examples/drive.py", FIRST_DRIVE),
        ("status 0x000f", FIRST_DRIVE),
        ("./python[can]", "./test: it builds, installs and tests the Python package"),
        ("@pytest.mark.pve_sim", "the_readme_shows_the_test_of_the_python_package"),
        ("scenario scenarios/", "the_scenarios_of_the_readme_pass"),
        ("campaign scenarios/", "the_campaign_of_the_readme_runs"),
    ];
    for (_, block) in blocks(README) {
        assert!(known.iter().any(|(words, _)| block.contains(words)), "nothing goes through this:\n{block}");
    }
    for (words, _) in known {
        block(README, words);
    }
}

#[test]
fn the_boom_of_the_guide_reaches_its_angle_twice_in_a_row() {
    let block = block(BENCH, "examples/boom.py");
    let [run, client] = block.lines().collect::<Vec<_>>()[..] else { panic!("{block}") };
    let options: Vec<&str> = run.strip_prefix("pve-sim ").expect("a command line").split(' ').collect();
    let words: Vec<&str> = client.split(' ').collect();
    let ["venv/bin/python", "examples/boom.py", "127.0.0.1", PORT, "pve0", degrees] = words[..] else {
        panic!("{client}")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("boom.log");
    let simulator = Simulator::start_wound(&[&options[..], &["--log", log.to_str().expect("text")]].concat());
    for _ in 1..=2 {
        let angles = simulator.serve("../../examples/boom.py", &[degrees]);
        let last = angles.lines().last().and_then(|line| line.split_once(' ')).expect("an angle").1;
        let (last, wanted): (f64, f64) = (last.parse().expect("a number"), degrees.parse().expect("a number"));
        assert!((last - wanted).abs() < 0.5, "{angles}");
    }
    simulator.terminate();
    let drawn = output(Command::new(python()).arg(root().join("examples/step_response.py")).arg(log).arg(degrees));
    let picture = String::from_utf8(drawn.stdout).expect("text");
    assert!(picture.starts_with("<svg") && picture.matches("<polyline").count() == 3, "{picture}");
}

#[test]
fn the_readme_shows_the_test_of_the_python_package() {
    // python/tests/test_readme.py runs it.
    assert_eq!(block(README, "@pytest.mark.pve_sim"), block("python/README.md", "@pytest.mark.pve_sim"));
}

#[test]
fn the_scenarios_of_the_readme_pass() {
    let block = block(README, "scenario scenarios/");
    let words: Vec<&str> = block.trim_end().strip_prefix("cargo run -- ").expect("a command line").split(' ').collect();
    let folder = tempfile::tempdir().expect("a folder");
    let results = folder.path().join("results.xml");
    let words = words.iter().map(|word| if *word == "results.xml" { results.as_os_str() } else { word.as_ref() });
    let run = output(Command::new(&*PVE_SIM).args(words).current_dir(root()));
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stdout));
    assert!(fs::read_to_string(results).expect("the results").contains("failures=\"0\""));
}

/// A seventh of it.
#[test]
fn the_campaign_of_the_readme_runs() {
    let block = block(README, "campaign scenarios/");
    let words = block.trim_end().strip_prefix("cargo run --release -- ").expect("a command line").split(' ');
    let folder = tempfile::tempdir().expect("a folder");
    let page = folder.path().join("campaign.html");
    let words = words.map(|word| if word == "campaign.html" { page.as_os_str() } else { word.as_ref() });
    let mut campaign = Command::new(&*PVE_SIM);
    campaign.args(words).args(["--shard", "1/7", "--results"]).arg(folder.path().join("results"));
    let run = output(campaign.current_dir(root()));
    let told = String::from_utf8_lossy(&run.stdout);
    assert!(told.ends_with(" failed\n"), "{told}{}", String::from_utf8_lossy(&run.stderr));
    assert!(fs::read_to_string(page).expect("the page").starts_with("<!doctype html>"));
}

/// The calls of curl in the guide, one after the other, each of which is answered.
#[test]
fn the_fault_of_the_guide_for_tools_happens() {
    const URL: &str = "http://127.0.0.1:8408";
    let simulator =
        Simulator::start(&["--speed", "step", "--device", "pvea-canopen@0x20,name=boom", "--http", "127.0.0.1:0"]);
    let script = block(TOOLS, "curl -sS -X PATCH").replace("curl -sS", "curl -sS --fail-with-body");
    let script = script.replace(URL, simulator.http());
    let run = output(Command::new("sh").args(["-ec", &script]));
    let answers = String::from_utf8(run.stdout).expect("text");
    assert!(run.status.success(), "{answers}");
    assert!(answers.contains("EMCY: supply too low") && answers.contains("\"dsm\":\"fault-hold\""), "{answers}");
    simulator.terminate();
}

#[test]
fn the_commands_for_the_board_are_there() {
    let aliases = fs::read_to_string(root().join(".cargo/config.toml")).expect("cargo's aliases");
    for line in block(BENCH, "cargo firmware").lines() {
        let alias = line.strip_prefix("cargo ").expect("a command of cargo");
        assert!(aliases.lines().any(|line| line.starts_with(&format!("{alias} = "))), "{line}");
    }
}

/// Frame by frame, meanings included; the times are those of the README's run.
#[test]
fn the_trace_begins_as_the_readme_shows_it() {
    let shown = block(README, "boot-up");
    let simulator = Simulator::start_wound(&["--color", "always"]);
    // Who has joined has seen the boot-up go by.
    simulator.serve("boot.py", &["11149437"]);
    let told = simulator.said();
    for line in shown.lines() {
        let (_, frame) = line.split_once(" ms  ").expect("a time");
        let plain: String =
            told.split("\u{1b}[").map(|part| part.split_once('m').map_or(part, |(_, text)| text)).collect();
        assert!(plain.contains(frame), "{frame}\n{plain}");
    }
    simulator.terminate();
}

/// What pip installs in the README are the clients that these tests run.
#[test]
fn the_readme_installs_what_is_tested() {
    let tested = fs::read_to_string(root().join("tests/clients/requirements.txt")).expect("the list");
    let block = block(README, "pip install");
    let line = block.lines().find(|line| line.contains("pip install")).expect("a line");
    let (_, packages) = line.split_once("pip install ").expect("packages");
    for package in packages.split(' ') {
        assert!(tested.lines().any(|line| line.starts_with(&format!("{package}=="))), "{package}");
    }
}

/// Every logger, and every other line of a shell that calls a client, starts and joins.
#[test]
fn the_logger_joins_as_the_pages_say() {
    let simulator = Simulator::start::<&str>(&[]);
    for page in [BENCH, "docs/pve-sim.md"] {
        let block = block(page, "can_logger ");
        let line = block.lines().find(|line| line.contains("can_logger ")).expect("a line");
        let arguments = line.split_once("can_logger ").expect("arguments").1.replace(PORT, &simulator.address()[1]);
        let logger = python().with_file_name("can_logger");
        Program::start(Command::new(logger).args(arguments.split(' '))).until("Can Logger (Started");
    }
    simulator.terminate();
}

/// What follows `pve-sim` or `cargo run --` on a page is a command line that is accepted.
#[test]
fn every_command_line_of_the_pages_is_accepted() {
    let mut seen = 0;
    for page in PAGES {
        let text = fs::read_to_string(root().join(page)).expect(page);
        let quoted = text.split('`').filter(|code| !code.contains('\n'));
        let shell = blocks(page).into_iter().filter(|(language, _)| language == "sh").map(|(_, block)| block);
        let shell: Vec<String> = shell.flat_map(|block| block.lines().map(str::to_owned).collect::<Vec<_>>()).collect();
        let lines = quoted.chain(shell.iter().map(String::as_str));
        for code in lines.filter(|code| !code.contains(['<', '[', '…'])) {
            let arguments = code.strip_prefix("cargo run -- ").or_else(|| code.strip_prefix("pve-sim "));
            // A word alone is the name of a command.
            let is_line =
                |line: &&str| !line.contains(char::is_uppercase) && (line.contains(' ') || line.starts_with('-'));
            let Some(arguments) = arguments.filter(is_line) else {
                continue;
            };
            let words: Vec<String> = std::iter::once("pve-sim")
                .chain(arguments.split_whitespace().take_while(|word| *word != "|"))
                .map(str::to_owned)
                .collect();
            match cli::parse(words) {
                Ok(_) => seen += 1,
                Err(error) => panic!("{page}: {code}: {error}"),
            }
        }
    }
    assert!(seen >= 20, "{seen}");
}
