//! The options of `scenario`.

use std::path::PathBuf;

use clap::Args;

use super::{Request, UsageError};
use crate::batch::Options;
use crate::run::{DEFAULT_SEED, seed};
use hal_sim::scenario;

/// The arguments of `scenario`.
#[derive(Args, Debug)]
pub(super) struct ScenarioArgs {
    /// The scenario files, in the order of the report; docs/scenarios.md describes their format
    #[arg(value_name = "FILE.toml", required_unless_present = "schema")]
    files: Vec<PathBuf>,

    /// Write the results to FILE as JUnit XML, with a test case for each scenario
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,

    /// The seed of all random values: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed, default_value_t = DEFAULT_SEED)]
    seed: u64,

    /// Print the trace of each scenario, with the notes of its steps
    #[arg(long)]
    verbose: bool,

    /// Print the format of a scenario as a JSON schema, for editors
    #[arg(long, exclusive = true)]
    schema: bool,
}

impl TryFrom<ScenarioArgs> for Request {
    type Error = UsageError;

    fn try_from(args: ScenarioArgs) -> Result<Self, UsageError> {
        if args.schema {
            return Ok(Self::Print(scenario::schema()));
        }
        // `--junit` without its file would take a scenario as its file, and overwrite the scenario.
        if let Some(path) = args.junit.as_ref().filter(|path| path.extension().is_some_and(|end| end == "toml")) {
            return Err(UsageError(format!(
                "--junit {}: this is a scenario; use a file for the results, as in results.xml",
                path.display()
            )));
        }
        Ok(Self::Scenarios(Options { files: args.files, junit: args.junit, seed: args.seed, verbose: args.verbose }))
    }
}
