//! Outcomes as JUnit XML: a test case for each scenario, by the name of its file.

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use hal_sim::scenario::Outcome;

/// The name of the test suite.
const SUITE: &str = "pve-sim scenario";

/// Returns the report of scenarios, by file. It has no times of the wall clock: two runs are the same.
pub(super) fn report(files: &[String], outcomes: &[Outcome]) -> String {
    let mut suite = TestSuite::new(SUITE);
    for (file, outcome) in files.iter().zip(outcomes) {
        let mut case = TestCase::new(file.as_str(), status(file, outcome));
        case.set_classname(SUITE);
        suite.add_test_case(case);
    }
    let mut report = Report::new(SUITE);
    report.add_test_suite(suite);
    report.to_string().unwrap_or_default()
}

/// Returns every failure of a scenario in one: a test case has one.
fn status(file: &str, outcome: &Outcome) -> TestCaseStatus {
    if outcome.is_success() {
        return TestCaseStatus::success();
    }
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    status
        .set_message(outcome.headlines(file).collect::<Vec<_>>().join("; "))
        .set_type("expectation")
        .set_description(outcome.failures(file));
    status
}
