//! Results as JUnit XML: a test case for each row. A failure names the worst cell and the command that reproduces it.

use std::io::{self, Write};

use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};

use super::summary::{counts, failed, reaction};
use crate::campaign::manifest::Manifest;
use crate::campaign::results::Row;

/// The name of the test suite.
const SUITE: &str = "pve-sim campaign";

/// Writes the file as a whole at the end. The memory it needs depends on the number of rows, not of cells.
pub(super) fn write(out: &mut dyn Write, manifest: &Manifest, rows: &mut dyn Iterator<Item = Row>) -> io::Result<()> {
    let mut suite = TestSuite::new(SUITE);
    let Manifest { version, commit, plan, plan_hash, machine, .. } = manifest;
    let commit = commit.as_deref().unwrap_or("unknown");
    for (name, value) in [
        ("version", version.as_str()),
        ("commit", commit),
        ("plan", plan),
        ("plan_hash", plan_hash),
        ("machine", machine),
    ] {
        suite.add_property(Property::new(name, value));
    }
    for row in rows {
        let mut case = TestCase::new(format!("{} (seed {})", row.fault, row.seed), status(&row, manifest));
        case.set_classname(format!("{SUITE}.{plan}"));
        suite.add_test_case(case);
    }
    if let Some(missing) = &manifest.missing {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
        status.set_message(format!("missing: {missing}")).set_type("missing");
        suite.add_test_case(TestCase::new("all rows", status));
    }
    let mut report = Report::new(SUITE);
    report.add_test_suite(suite);
    out.write_all(report.to_string().map_err(io::Error::other)?.as_bytes())
}

fn status(row: &Row, manifest: &Manifest) -> TestCaseStatus {
    if failed(row) == 0 {
        return TestCaseStatus::success();
    }
    let worst = row.worst();
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    status
        .set_message(format!("{}; worst: {}", counts(row), reaction(worst, &manifest.limits)))
        .set_type(worst.verdict.word())
        .set_description(format!("reproduce: {}\n{}", row.command(manifest, worst), row.trace));
    status
}
