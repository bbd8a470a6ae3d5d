//! Shell completions and the manual page.

use clap::{Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};

use super::Cli;

pub(super) fn completions(shell: Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "pve-sim", &mut script);
    // clap_complete (up to 4.6.11) spells a hyphenated program name in two ways; bash would then complete no
    // option of a command.
    text(script).replace("pve__subcmd__sim", "pve__sim")
}

/// Returns the manual page, section 1, in roff: one page for all commands.
pub(super) fn manual_page() -> String {
    let page = Man::new(Cli::command());
    let mut roff = Vec::new();
    let written = page
        .render_title(&mut roff)
        .and_then(|()| page.render_name_section(&mut roff))
        .and_then(|()| page.render_synopsis_section(&mut roff))
        .and_then(|()| page.render_description_section(&mut roff))
        .and_then(|()| commands().to_writer(&mut roff))
        .and_then(|()| page.render_options_section(&mut roff))
        .and_then(|()| page.render_extra_section(&mut roff));
    debug_assert!(written.is_ok(), "a vector takes everything");
    text(roff)
}

/// Returns the COMMANDS section; the section that clap generates refers to one page per command.
fn commands() -> Roff {
    let mut command = Cli::command();
    command.build();
    let mut roff = Roff::new();
    roff.control("SH", ["COMMANDS"]);
    for command in command.get_subcommands_mut() {
        let usage = command.render_usage().to_string();
        roff.control("TP", []);
        roff.text([bold(usage.strip_prefix("Usage: ").unwrap_or(&usage))]);
        roff.text([roman(about(command))]);
    }
    roff
}

fn about(command: &Command) -> String {
    command.get_about().map(ToString::to_string).unwrap_or_default()
}

/// Returns the UTF-8 output of clap as text.
fn text(bytes: Vec<u8>) -> String {
    String::from_utf8_lossy(&bytes).into_owned()
}
