//! The use cases of the manuals, as built-in strict scenarios.

/// A use case of a manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UseCase {
    /// The name on the command line.
    pub name: &'static str,
    /// The file in the repository.
    pub file: &'static str,
    /// The text of the file.
    pub text: &'static str,
}

macro_rules! use_cases {
    ($($name:literal)*) => {
        /// All use cases, in order.
        pub const ALL: &[UseCase] = &[$(UseCase {
            name: $name,
            file: concat!("scenarios/use-case-", $name, ".toml"),
            text: include_str!(concat!("../../scenarios/use-case-", $name, ".toml")),
        },)*];
    };
}

use_cases! { "1" "2" "3" "4" "5" "6" "isobus" "hat" }

impl UseCase {
    /// Returns the title without the name.
    #[must_use]
    pub fn title(&self) -> &'static str {
        let title = self.text.lines().find_map(|line| line.strip_prefix("title = \"")?.strip_suffix('"'));
        let title = title.unwrap_or_default();
        title.split_once(": ").map_or(title, |(_, shows)| shows)
    }
}
