use std::path::PathBuf;

/// Why a scenario cannot be used; each in one line that says where, what and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error(
        "cannot read scenario {}: {reason}; check the path, or name a built-in scenario: {builtin}",
        path.display()
    )]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        reason: std::io::Error,
        /// Names of the built-in scenarios.
        builtin: String,
    },
    /// There is no built-in scenario of this name.
    #[error(
        "there is no built-in scenario '{name}'; choose one of {builtin}, or give the path of a .toml file"
    )]
    UnknownName {
        /// The name asked for.
        name: String,
        /// Names of the built-in scenarios.
        builtin: String,
    },
    /// The text is no TOML, or has a field that is unknown, missing or of the wrong type.
    #[error("scenario {origin}, line {line}: {message}; correct this line")]
    Syntax {
        /// File or built-in name.
        origin: String,
        /// Line, from 1.
        line: usize,
        /// What the parser says, in one line.
        message: String,
    },
    /// A value makes no sense.
    #[error("scenario {origin}: {what}; {remedy}")]
    Value {
        /// File or built-in name.
        origin: String,
        /// Which value is wrong.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// Two vehicles start in the same place.
    #[error(
        "scenario {origin}, seed {seed}: vehicles {one} and {other} (counted from 1 in the file, obstacles last) overlap at the start; move one of them or reduce s_spread_m"
    )]
    Overlap {
        /// File or built-in name.
        origin: String,
        /// The seed that placed them.
        seed: u64,
        /// The one.
        one: u32,
        /// The other.
        other: u32,
    },
}
