//! The use cases of the manuals: strict scenarios that the program carries.

/// A use case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UseCase {
    /// How it is called for on the command line.
    pub name: &'static str,
    /// Its file in the repository.
    pub file: &'static str,
    /// What the file holds.
    pub text: &'static str,
}

macro_rules! use_cases {
    ($($name:literal)*) => {
        /// Every use case there is, in order.
        pub const ALL: &[UseCase] = &[$(UseCase {
            name: $name,
            file: concat!("scenarios/use-case-", $name, ".toml"),
            text: include_str!(concat!("../../scenarios/use-case-", $name, ".toml")),
        },)*];
    };
}

use_cases! { "1" "2" "3" "4" "5" "6" "isobus" "hat" }

impl UseCase {
    /// Returns what it shows: its title without its name.
    #[must_use]
    pub fn title(&self) -> &'static str {
        let title = self.text.lines().find_map(|line| line.strip_prefix("title = \"")?.strip_suffix('"'));
        let title = title.unwrap_or_default();
        title.split_once(": ").map_or(title, |(_, shows)| shows)
    }
}
