//! The completion scripts in their shells, and the manual page in man.

use std::io::{Write as _, stderr};
use std::process::{Command, Stdio};

use super::options::documented;
use super::simulator::output;

/// Returns the output of `pve-sim`.
fn printed(arguments: &[&str]) -> String {
    let output = output(arguments);
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]), "{arguments:?}");
    String::from_utf8(output.stdout).expect("text")
}

/// Runs a program with this stdin; returns stdout and stderr. `None` if the program is not installed.
fn told_by(program: &mut Command, stdin: &str) -> Option<(String, String)> {
    let mut child = program.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().ok()?;
    child.stdin.take().expect("a pipe").write_all(stdin.as_bytes()).expect("it reads");
    let output = child.wait_with_output().expect("it ends");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    assert!(output.status.success(), "{program:?}: {}", text(output.stderr));
    Some((text(output.stdout), text(output.stderr)))
}

#[test]
fn a_completion_script_names_every_option_and_command() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = printed(&["completions", shell]);
        for option in documented("| option |") {
            // fish has only the name, after -l.
            assert!(script.contains(option.trim_start_matches('-')), "{shell}: {option}");
        }
        for command in
            ["run", "use-case", "decode", "replay", "set", "status", "eds", "dbc", "completions", "man", "help"]
        {
            assert!(script.contains(command), "{shell}: {command}");
        }
    }
}

#[test]
fn bash_completes_options_and_files() {
    let script = printed(&["completions", "bash"]);
    let complete = |words: &str, word: &str, previous: &str| {
        let ask = format!(
            "{script}\nfunction=$(complete -p pve-sim | sed 's/.* -F \\([^ ]*\\) .*/\\1/')\n\
             COMP_WORDS=({words}) COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))\n\
             $function pve-sim '{word}' '{previous}' && printf '%s\\n' \"${{COMPREPLY[@]}}\""
        );
        // Its stderr has complaints of compopt, which needs an interactive shell.
        told_by(Command::new("bash").arg("/dev/stdin"), &ask).expect("bash").0
    };
    let (_, complaints) = told_by(Command::new("bash").arg("-n"), &script).expect("bash");
    assert_eq!(complaints, "");
    assert_eq!(complete("pve-sim --sp", "--sp", "pve-sim"), "--speed\n");
    assert_eq!(complete("pve-sim run --log-", "--log-", "run"), "--log-overwrite\n");
    assert_eq!(complete("pve-sim completions po", "po", "completions"), "powershell\n");
    let toml = format!("{}/Cargo.to", env!("CARGO_MANIFEST_DIR"));
    assert_eq!(complete(&format!("pve-sim --log {toml}"), &toml, "--log"), format!("{toml}ml\n"));
}

#[test]
fn the_manual_page_has_every_option_and_no_fault() {
    let page = printed(&["man"]);
    let plain = page.replace("\\-", "-");
    for option in documented("| option |") {
        assert!(plain.contains(&format!("\\fB{option}\\fR")), "{option}");
    }
    for command in ["run [OPTIONS]", "use-case [", "set [", "status [", "eds <", "dbc <", "completions <", "man"] {
        assert!(plain.contains(&format!("\\fBpve-sim {command}")), "{command}");
    }
    let format = ["--warnings", "--encoding=UTF-8", "--local-file", "-"];
    // A locale that is not installed would be a warning.
    let mut man = Command::new("man");
    man.args(format).env("MANWIDTH", "80").env("LC_ALL", "C");
    let Some((text, warnings)) = told_by(&mut man, &page) else {
        // The harness hides what the macros print.
        writeln!(stderr(), "skipped: the manual page in man: man is not installed").expect("stderr is open");
        return;
    };
    assert_eq!(warnings, "");
    assert!(text.contains("A simulator for Danfoss PVE valves"), "{text}");
}
