use std::path::Path;

use super::Scenario;
use crate::{ScenarioError, VehicleId};

const BUILTIN: [(&str, &str); 4] = [
    (
        "obstacle-at-corner",
        include_str!("../../../assets/scenarios/obstacle-at-corner.toml"),
    ),
    (
        "obstacle-at-corner-mirrored",
        include_str!("../../../assets/scenarios/obstacle-at-corner-mirrored.toml"),
    ),
    (
        "open-corner",
        include_str!("../../../assets/scenarios/open-corner.toml"),
    ),
    (
        "mixed-traffic",
        include_str!("../../../assets/scenarios/mixed-traffic.toml"),
    ),
];

impl Scenario {
    /// Names of the built-in scenarios.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.into_iter().map(|(name, _)| name)
    }

    /// The built-in scenario of this name.
    ///
    /// # Errors
    /// When there is none.
    pub fn builtin(name: &str) -> Result<Self, ScenarioError> {
        let (_, text) = BUILTIN
            .iter()
            .find(|(known, _)| *known == name)
            .ok_or_else(|| ScenarioError::UnknownName {
                name: name.to_owned(),
                builtin: known_names(),
            })?;
        Self::parse(text, name)
    }

    /// Reads a scenario file.
    ///
    /// # Errors
    /// When it cannot be read, has unknown or missing fields, or values that make no sense.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ScenarioError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|reason| ScenarioError::Read {
            path: path.to_owned(),
            reason,
            builtin: known_names(),
        })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses the text of a scenario file; `origin` names it in errors.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn parse(text: &str, origin: &str) -> Result<Self, ScenarioError> {
        let parsed: Self = toml::from_str(text).map_err(|error| ScenarioError::Syntax {
            origin: origin.to_owned(),
            line: error.span().map_or(1, |span| line_of(text, span.start)),
            message: error.message().lines().collect::<Vec<_>>().join(", "),
        })?;
        let scenario = Self {
            origin: origin.to_owned(),
            ..parsed
        };
        scenario.check()?;
        Ok(scenario)
    }

    pub(crate) fn overlap(&self, seed: u64, one: VehicleId, other: VehicleId) -> ScenarioError {
        ScenarioError::Overlap {
            origin: self.origin.clone(),
            seed,
            one: one.0,
            other: other.0,
        }
    }
}

fn known_names() -> String {
    Scenario::builtin_names().collect::<Vec<_>>().join(", ")
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text
        .bytes()
        .take(offset)
        .filter(|&byte| byte == b'\n')
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Traffic;

    const CORNER: &str = BUILTIN[0].1;

    fn refusal(text: &str) -> String {
        let error = Scenario::parse(text, "my.toml").expect_err("refused");
        let message = error.to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn builtin_scenarios_start_without_overlaps_on_any_seed() {
        for name in Scenario::builtin_names() {
            let scenario = Scenario::builtin(name).expect(name);
            assert_eq!(scenario.name, name);
            for seed in 0..50 {
                let traffic = Traffic::new(&scenario, seed).expect(name);
                assert!(traffic.vehicles().len() >= 8);
            }
        }
    }

    #[test]
    fn an_unknown_field_is_named_with_its_line() {
        let line = CORNER
            .lines()
            .take_while(|line| !line.starts_with("lane_width_m"))
            .count();
        let message = refusal(&CORNER.replacen("lane_width_m", "lane_width", 1));
        let start = format!(
            "scenario my.toml, line {}: unknown field `lane_width`",
            line + 1
        );
        assert!(message.starts_with(&start), "{message}");
        assert!(message.contains("`lane_width_m`"), "{message}");

        let message =
            refusal(&CORNER.replacen("kind = \"arc\"", "kind = \"arc\"\nbank_rad = 0.1", 1));
        assert!(message.contains("unknown field `bank_rad`"), "{message}");
        let message = refusal(&CORNER.replacen("lane =", "colour = 1\nlane =", 1));
        assert!(message.contains("unknown field `colour`"), "{message}");
    }

    #[test]
    fn values_that_make_no_sense_are_refused() {
        let message = refusal(&CORNER.replacen("lane =", "lane = 3 #", 1));
        assert!(message.contains("lane is 3"), "{message}");
        let message = refusal(&CORNER.replacen("duration_s =", "duration_s = nan #", 1));
        assert!(message.contains("duration_s is NaN"), "{message}");
        let message = refusal(&CORNER.replacen("curvature_per_m =", "curvature_per_m = 0.5 #", 1));
        assert!(
            message.contains("tighter than the road is wide"),
            "{message}"
        );
    }

    #[test]
    fn an_unknown_name_and_a_missing_file_list_the_names() {
        for message in [
            Scenario::builtin("corner")
                .expect_err("refused")
                .to_string(),
            Scenario::load("/nowhere/corner.toml")
                .expect_err("refused")
                .to_string(),
        ] {
            assert!(message.contains("obstacle-at-corner, "), "{message}");
        }
    }
}
