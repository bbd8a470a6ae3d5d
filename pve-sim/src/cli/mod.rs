//! The command line of `pve-sim`: parsing, and error messages in one line.

mod options;
mod recordings;
mod remote;
mod scenario;
mod shell;

pub use self::remote::{SetArgs, StatusArgs};
pub use options::RunArgs;

use std::ffi::OsString;

use clap::error::{ContextKind, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;

use self::recordings::{DecodeArgs, ReplayArgs};
use crate::batch::Options;
use crate::campaign::{CampaignOptions, CellOptions};
use crate::run::RunOptions;
use crate::use_case::{self, UseCase};
use hal_sim::Kind;
use hal_sim::decode::DecodeOptions;
use hal_sim::describe;
use hal_sim::replay::ReplayOptions;
use hal_sim::text::in_one_line;
use scenario::ScenarioArgs;

/// A request of the user.
#[derive(Debug)]
pub enum Request {
    /// Run devices on a bus.
    Run(RunOptions),
    /// Run the devices of a campaign's scenario on a bus, and judge a cell.
    JudgedRun(RunOptions, CellOptions),
    /// Play these use cases.
    UseCases(Vec<UseCase>),
    /// Run these scenarios.
    Scenarios(Options),
    /// Run a campaign or a part of it, search for pairs of faults, or join results.
    Campaign(Box<CampaignOptions>),
    /// Explain a recording.
    Decode(DecodeOptions),
    /// Replay a recording.
    Replay(ReplayOptions),
    /// Change the plant of a device in a running simulator.
    Set(SetArgs),
    /// Show the devices in a running simulator.
    Status(StatusArgs),
    /// Print a text on stdout: the help, the version, the description of a kind, or a script for a shell.
    Print(String),
}

const AFTER_HELP: &str = "\
Examples:
  pve-sim
  pve-sim --device pvea-canopen@0x20 --device pveo-canopen@0x21,name=boom --bit-rate 250k
  pve-sim --device pvea-isobus@0x83 --device pvea-canopen@0x20
  pve-sim --device pvea-canopen --device hat1000,bit-rate=250k --link pvea-canopen=hat1000
  pve-sim --device pvea-canopen,blank --state memory --log frames.log
  pve-sim use-case isobus
  pve-sim scenario scenarios/*.toml --junit results.xml
  pve-sim campaign scenarios/campaigns/valve-careful.toml --html campaign.html
  pve-sim decode frames.log
  pve-sim replay frames.log --device pvea-canopen@0x20
  pve-sim set boom supply_mv=8000 spool=stuck
  pve-sim status boom
  pve-sim eds pvea-canopen > pvea.eds
  pve-sim dbc pvea-isobus > pvea.dbc

Exit codes:
  0  success; run also exits with 0 on SIGINT, SIGTERM, SIGHUP, or when
     stdout is closed, after all devices have stored their memory
  1  run: a port in use, a missing interface, a state file of
     another kind of device, a file that cannot be opened, written or replaced
     scenario: a failed expectation; use-case, replay: a difference
     campaign: a broken limit, a fault that was not injected, a missing row
     decode, replay: a line that cannot be parsed
     set, status: a refusal, or a simulator that cannot be reached
  2  a usage error, or a scenario or plan that cannot be read";

/// Wrong usage: one line with the error and the accepted form.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// A simulator for Danfoss PVE valves and HYDAC HAT sensors on CAN.
///
/// Without a command, the options of `run` apply.
#[derive(Debug, Parser)]
#[command(
    name = "pve-sim",
    version,
    args_conflicts_with_subcommands = true,
    max_term_width = 120,
    after_long_help = AFTER_HELP
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    run: RunArgs,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Runs devices on a bus (the default command)
    Run(Box<RunArgs>),
    /// Plays a use case (of the manuals, an ISOBUS valve or an angle sensor) in virtual time, and explains each
    /// frame; exit 1 if a frame differs
    UseCase {
        /// The use case, or all; without it, the titles are listed
        #[arg(value_name = "1-6|isobus|hat|all", value_parser = use_cases)]
        which: Option<UseCases>,
    },
    /// Runs scenario files in virtual time: devices, actions and expectations; exit 1 if a scenario fails; exit 2,
    /// without running any, if a file cannot be read
    Scenario(ScenarioArgs),
    /// Injects each fault of a plan at each instant of a scenario, in virtual time, and judges the reaction of the
    /// controller; exit 1 if a limit is broken; exit 2, without running anything, if the plan cannot be read
    Campaign(Box<CampaignOptions>),
    /// Explains each line of a recording, as the trace does; exit 1 if a line cannot be parsed
    Decode(DecodeArgs),
    /// Replays a recording against simulated devices in virtual time: compares their frames with the recording, and
    /// sends them all other frames; exit 1 on differences
    Replay(ReplayArgs),
    /// Changes the plant of a device in a running simulator, as its console does; exit 1 if the simulator refuses the
    /// change or cannot be reached
    Set(SetArgs),
    /// Prints the states of the devices in a running simulator; exit 1 if the device does not exist or the
    /// simulator cannot be reached
    Status(StatusArgs),
    /// Prints the EDS of a CANopen kind, generated from its object dictionary
    Eds {
        /// The kind of device
        #[arg(value_name = "pvea-canopen|pveo-canopen|hat1000|hat3000", value_parser = eds)]
        sheet: String,
    },
    /// Prints the DBC of an ISOBUS kind, with its messages at each address
    Dbc {
        /// The kind of device
        #[arg(value_name = "pvea-isobus|pveo-isobus", value_parser = dbc)]
        database: String,
    },
    /// Prints the completion script for a shell
    Completions {
        /// The shell
        #[arg(value_name = "bash|zsh|fish|powershell|elvish", hide_possible_values = true)]
        shell: Shell,
    },
    /// Prints the manual page, in roff
    Man,
}

fn eds(word: &str) -> Result<String, String> {
    description(word, "EDS", describe::eds, "dbc")
}

fn dbc(word: &str) -> Result<String, String> {
    description(word, "DBC", describe::dbc, "eds")
}

/// Returns the EDS or DBC of the named device kind. Each kind has one of the two formats; the `other` command prints the
/// other one.
fn description(word: &str, format: &str, describe: fn(Kind) -> Option<String>, other: &str) -> Result<String, String> {
    let article = if format == "EDS" { "an" } else { "a" };
    let kind = Kind::from_name(word).ok_or_else(|| format!("not a kind with {article} {format}"))?;
    describe(kind).ok_or_else(|| format!("this kind has no {format}; use pve-sim {other} {word}"))
}

/// Returns the names and titles of the use cases, one per line.
fn titles() -> String {
    let lines = use_case::ALL.iter().map(|case| format!("{:<8}{}\n", case.name, case.title()));
    lines.chain(["all     all use cases, in this order\n".to_owned()]).collect()
}

/// The use cases named on the command line.
#[derive(Clone, Debug)]
struct UseCases(Vec<UseCase>);

fn use_cases(word: &str) -> Result<UseCases, String> {
    let is_meant = |case: &&UseCase| word == "all" || word == case.name;
    let cases: Vec<UseCase> = use_case::ALL.iter().filter(is_meant).copied().collect();
    if cases.is_empty() {
        let known: Vec<&str> = use_case::ALL.iter().map(|case| case.name).collect();
        return Err(format!("unknown use case; accepted: {}, all", known.join(", ")));
    }
    Ok(UseCases(cases))
}

/// Parses the arguments, the program name first. Removes a trailing CR from each argument, as left by a script with
/// Windows line endings.
///
/// # Errors
/// [`UsageError`] for invalid arguments.
pub fn parse(args: impl IntoIterator<Item = impl Into<OsString>>) -> Result<Request, UsageError> {
    let args = args.into_iter().map(|arg| without_cr(arg.into()));
    read(args).map_err(|UsageError(reason)| UsageError(in_one_line(&reason)))
}

fn read(args: impl Iterator<Item = OsString>) -> Result<Request, UsageError> {
    let args: Vec<OsString> = args.collect();
    let cli = match Cli::try_parse_from(&args) {
        Ok(cli) => cli,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return Ok(Request::Print(error.to_string()));
        }
        Err(error) => return Err(UsageError(one_line(&error, &args))),
    };
    Ok(match cli.command {
        None => run_request(cli.run)?,
        Some(Command::Run(run)) => run_request(*run)?,
        Some(Command::UseCase { which: Some(which) }) => Request::UseCases(which.0),
        Some(Command::UseCase { which: None }) => Request::Print(titles()),
        Some(Command::Scenario(args)) => args.try_into()?,
        Some(Command::Campaign(options)) => Request::Campaign(options),
        Some(Command::Decode(args)) => Request::Decode(args.try_into()?),
        Some(Command::Replay(args)) => Request::Replay(args.try_into()?),
        Some(Command::Set(args)) => Request::Set(args.check()?),
        Some(Command::Status(args)) => Request::Status(args),
        Some(Command::Eds { sheet: text } | Command::Dbc { database: text }) => Request::Print(text),
        Some(Command::Completions { shell }) => Request::Print(shell::completions(shell)),
        Some(Command::Man) => Request::Print(shell::manual_page()),
    })
}

fn run_request(run: RunArgs) -> Result<Request, UsageError> {
    let (cell, seed) = (run.cell.plan.clone().zip(run.cell.cell), run.cell.plan_seed);
    let options = RunOptions::try_from(run)?;
    Ok(match cell {
        Some((plan, which)) => Request::JudgedRun(options, CellOptions { plan, seed, which }),
        None => Request::Run(options),
    })
}

fn without_cr(argument: OsString) -> OsString {
    match argument.to_str().and_then(|text| text.strip_suffix('\r')) {
        Some(text) => text.into(),
        None => argument,
    }
}

/// Returns clap's error about these arguments in one line: without the usage, with the tip, and with the accepted values
/// that clap omits.
fn one_line(error: &clap::Error, args: &[OsString]) -> String {
    let text = error.to_string();
    let first: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
    let what = first.join(" ");
    let what = what.strip_prefix("error: ").unwrap_or(&what);
    let tip = text.lines().find_map(|line| line.trim().strip_prefix("tip: "));
    let tip = tip.map_or_else(String::new, |tip| format!("; {tip}"));
    let accepted = match error.kind() {
        ErrorKind::UnknownArgument => {
            let given = error.get(ContextKind::InvalidArg).map(ToString::to_string).unwrap_or_default();
            if given.starts_with('-') { names(option_names(args)) } else { String::new() }
        }
        ErrorKind::InvalidSubcommand => names(command_names()),
        ErrorKind::ArgumentConflict if error.get(ContextKind::InvalidSubcommand).is_some() => {
            "; give the options after the command".to_owned()
        }
        _ => String::new(),
    };
    format!("{what}{tip}{accepted}")
}

fn names(names: Vec<String>) -> String {
    format!("; accepted: {}", names.join(", "))
}

/// Returns the options in the help of the command that these arguments give; of `run` if they give none.
fn option_names(args: &[OsString]) -> Vec<String> {
    let mut cli = Cli::command();
    cli.build();
    let mut command = &cli;
    for word in args.iter().skip(1) {
        let Some(subcommand) = command.find_subcommand(word) else { break };
        command = subcommand;
    }
    let shown = command.get_arguments().filter(|arg| !arg.is_hide_set());
    shown.filter_map(|arg| arg.get_long()).map(|long| format!("--{long}")).collect()
}

fn command_names() -> Vec<String> {
    let mut command = Cli::command();
    command.build();
    command.get_subcommands().map(|command| command.get_name().to_owned()).collect()
}

#[cfg(test)]
mod tests;
