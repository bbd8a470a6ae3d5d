//! Requests and their answers, counted.

/// Returns how many of the requests have no answer among the frames sent: `asked` counts the requests of each kind, of
/// which `requests` has the text and the answer.
///
/// # Panics
/// When there are more answers than requests.
#[must_use]
#[track_caller]
pub fn unanswered(requests: &[(&str, &str)], asked: &[usize], sent: &[String]) -> usize {
    let missing = |((request, answer), asked): (&(&str, &str), &usize)| {
        let answered = sent.iter().filter(|frame| frame == answer).count();
        asked
            .checked_sub(answered)
            .unwrap_or_else(|| panic!("{request}: asked {asked} times, answered {answered} times"))
    };
    requests.iter().zip(asked).map(missing).sum()
}
