//! Results as JUnit XML: a test case for each row. A failure names the worst cell and the command that reproduces it.

use std::io::{self, Write};

use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};

use super::Sink;
use super::summary::{counts, failed, reaction};
use crate::campaign::manifest::Manifest;
use crate::campaign::results::Row;

/// The name of the test suite.
const SUITE: &str = "pve-sim campaign";

/// A JUnit file, written as a whole at the end. The memory it needs depends on the number of rows, not of cells.
pub(super) struct JUnit<W> {
    out: W,
    manifest: Manifest,
    suite: TestSuite,
}

impl<W: Write> JUnit<W> {
    pub(super) fn new(out: W, manifest: &Manifest) -> Self {
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
        Self { out, manifest: manifest.clone(), suite }
    }
}

impl<W: Write> Sink for JUnit<W> {
    fn row(&mut self, row: &Row) -> io::Result<()> {
        let status = match row.worst().filter(|_| failed(row) > 0) {
            None => TestCaseStatus::success(),
            Some(worst) => {
                let command = row.command(&self.manifest, worst);
                let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                status
                    .set_message(format!("{}; worst: {}", counts(row), reaction(worst, &self.manifest.limits)))
                    .set_type(worst.verdict.word())
                    .set_description(format!("reproduce: {command}\n{}", row.head.trace));
                status
            }
        };
        let mut case = TestCase::new(format!("{} (seed {})", row.head.fault, row.head.seed), status);
        case.set_classname(format!("{SUITE}.{}", self.manifest.plan));
        self.suite.add_test_case(case);
        Ok(())
    }

    fn end(&mut self) -> io::Result<()> {
        if let Some(missing) = &self.manifest.missing {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status.set_message(format!("missing: {missing}")).set_type("missing");
            self.suite.add_test_case(TestCase::new("all rows", status));
        }
        let mut report = Report::new(SUITE);
        report.add_test_suite(self.suite.clone());
        let text = report.to_string().map_err(io::Error::other)?;
        self.out.write_all(text.as_bytes())?;
        self.out.flush()
    }
}
