//! Outcomes as JUnit XML: a test case for each scenario, named after its file.

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use hal_sim::scenario::Outcome;

const SUITE: &str = "pve-sim scenario";

/// Returns the JUnit report, one test case per file, without wall-clock times: equal runs give equal reports.
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

/// Returns the status of a scenario. All failures are combined into one, because a JUnit test case has room for only
/// one.
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
