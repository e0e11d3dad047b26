//! Every assumption of the promise, and every choice of the controller, by name.

mod reference;
mod safety;

use serde::{Deserialize, Serialize};

pub use reference::ReferenceSettings;
pub use safety::SafetySettings;

/// Which controller acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The barriers of docs/safety.md.
    #[default]
    Safe,
    /// The paper's text as it is written: barriers on position, a slack without bound, its noise
    /// term. It keeps no distance (docs/safety.md shows why).
    Paper,
    /// No filter: the reference within U, and every action counts as safe.
    Off,
}

/// Who solves the QP. Both give the same input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Solver {
    /// The projection onto the rows, which are intervals; Clarabel where a user's barrier couples
    /// steering and acceleration.
    #[default]
    ClosedForm,
    /// Clarabel, always.
    Clarabel,
}

/// The paper's three QPs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Formulation {
    /// Without noise and without slack (Appendix C).
    NoiseFree,
    /// Without noise, with slack (Appendix C, Theorem 4).
    Relaxed,
    /// With noise and slack (Section IV-B, Theorem 2).
    #[default]
    Noisy,
}

/// The QP.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QpSettings {
    /// Which of the paper's three.
    pub formulation: Formulation,
    /// M: price of a unit of slack.
    pub slack_price: f64,
    /// Z: largest slack, in units of h; beyond it the backup brakes.
    pub slack_max: f64,
}

impl Default for QpSettings {
    fn default() -> Self {
        Self {
            formulation: Formulation::Noisy,
            slack_price: 1e4,
            slack_max: 1.0,
        }
    }
}

/// All settings of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlSettings {
    /// Which controller acts.
    pub mode: Mode,
    /// Who solves the QP.
    pub solver: Solver,
    /// The QP.
    pub qp: QpSettings,
    /// The assumptions and the safe set.
    pub safety: SafetySettings,
    /// The reference.
    pub reference: ReferenceSettings,
}

/// A setting that the controller cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A number out of its range.
    #[error("control setting `{name}` is {value}; it must be {must}")]
    OutOfRange {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        must: &'static str,
    },
    /// A barrier of the user's with a number that is not finite.
    #[error("a barrier h = p'x + q has a number that is not finite; give five finite numbers")]
    Barrier,
    /// A barrier of the user's on the position alone.
    #[error(
        "a barrier h = p'x + q with p_psi = p_v = 0 leaves the input out of its row; give it a part in heading or speed"
    )]
    BarrierWithoutInput,
}

impl ControlSettings {
    /// The settings as the formulation uses them: without noise, its bounds are zero.
    pub(crate) fn effective(mut self) -> Self {
        if self.qp.formulation != Formulation::Noisy {
            self.safety.noise_position_m = 0.0;
            self.safety.noise_speed_mps = 0.0;
            self.safety.noise_slip_rad = 0.0;
            self.safety.noise_curvature_per_m = 0.0;
        }
        self
    }

    /// Refuses settings under which the guarantees have no meaning.
    ///
    /// # Errors
    /// Names the first setting that is out of its range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let s = &self.safety;
        let r = &self.reference;
        let positive = [
            ("brake_mps2", s.brake_mps2),
            ("accel_max_mps2", s.accel_max_mps2),
            ("tan_delta_max", s.tan_delta_max),
            ("lateral_accel_max_mps2", s.lateral_accel_max_mps2),
            ("leader_brake_mps2", s.leader_brake_mps2),
            ("follower_brake_mps2", s.follower_brake_mps2),
            ("headway_safe_m", s.headway_safe_m),
            ("gentle_brake_mps2", s.gentle_brake_mps2),
            ("counter_curvature_min_per_m", s.counter_curvature_min_per_m),
            ("sight_range_m", s.sight_range_m),
            ("knowledge_age_max_s", s.knowledge_age_max_s),
            ("qp.slack_price", self.qp.slack_price),
            ("reference.accel_mps2", r.accel_mps2),
            ("reference.brake_mps2", r.brake_mps2),
            ("reference.brake_max_mps2", r.brake_max_mps2),
            ("reference.jerk_mps3", r.jerk_mps3),
            ("reference.lane_change_s", r.lane_change_s),
            ("reference.lane_change_min_m", r.lane_change_min_m),
            ("reference.lateral_accel_mps2", r.lateral_accel_mps2),
            ("reference.leaving_speed_mps", r.leaving_speed_mps),
            ("reference.speed_share", r.speed_share),
        ];
        let not_negative = [
            ("follower_accel_mps2", s.follower_accel_mps2),
            ("reaction_cav_s", s.reaction_cav_s),
            ("reaction_human_s", s.reaction_human_s),
            ("noise_position_m", s.noise_position_m),
            ("noise_position_share", s.noise_position_share),
            ("noise_speed_mps", s.noise_speed_mps),
            ("noise_slip_rad", s.noise_slip_rad),
            ("noise_curvature_per_m", s.noise_curvature_per_m),
            ("perception_delay_s", s.perception_delay_s),
            ("sight_error_m", s.sight_error_m),
            ("shortest_vehicle_m", s.shortest_vehicle_m),
            ("widest_vehicle_m", s.widest_vehicle_m),
            (
                "longest_vehicle_m - shortest_vehicle_m",
                s.longest_vehicle_m - s.shortest_vehicle_m,
            ),
            ("qp.slack_max", self.qp.slack_max),
            ("collision_margin_m", s.collision_margin_m),
            ("leaving_speed_mps", s.leaving_speed_mps),
            ("error_sigmas", s.error_sigmas),
            ("lane_entry_m", s.lane_entry_m),
            ("sight_memory_s", s.sight_memory_s),
            ("announcement_s", s.announcement_s),
            ("reference.time_gap_s", r.time_gap_s),
            ("reference.standstill_gap_m", r.standstill_gap_m),
        ];
        check(&positive, "a number above 0", |x| x > 0.0)?;
        check(&not_negative, "a number at or above 0", |x| x >= 0.0)?;
        check(&[("eta", s.eta)], "in (0, 1]", |x| x > 0.0 && x <= 1.0)?;
        check(
            &[("noise_speed_mps", s.noise_speed_mps)],
            "less than what a step of braking takes off",
            |x| x < s.brake_mps2 * covista_world::STEP_S,
        )?;
        check(
            &[("noise_curvature_per_m", s.noise_curvature_per_m)],
            "less than counter_curvature_min_per_m",
            |x| x < s.counter_curvature_min_per_m,
        )?;
        check(
            &[("follower_brake_mps2", s.follower_brake_mps2)],
            "at most brake_mps2",
            |x| x <= s.brake_mps2,
        )?;
        check(
            &[("gentle_brake_mps2", s.gentle_brake_mps2)],
            "at most brake_mps2",
            |x| x <= s.brake_mps2,
        )
    }
}

fn check(
    fields: &[(&'static str, f64)],
    must: &'static str,
    holds: impl Fn(f64) -> bool,
) -> Result<(), SettingsError> {
    fields
        .iter()
        .find(|(_, value)| !(value.is_finite() && holds(*value)))
        .map_or(Ok(()), |&(name, value)| {
            Err(SettingsError::OutOfRange { name, value, must })
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_valid() {
        assert_eq!(ControlSettings::default().validate(), Ok(()));
    }

    #[test]
    fn a_bad_setting_is_named() {
        let mut settings = ControlSettings::default();
        settings.safety.eta = 0.0;
        let message = settings.validate().expect_err("refused").to_string();
        assert_eq!(message, "control setting `eta` is 0; it must be in (0, 1]");
        settings.safety.eta = 0.2;
        settings.safety.noise_speed_mps = 0.09;
        assert!(settings.validate().is_err());
    }

    type Change = fn(&mut SafetySettings);

    #[test]
    fn settings_that_contradict_each_other_are_named() {
        let refused = |change: Change| {
            let mut settings = ControlSettings::default();
            change(&mut settings.safety);
            settings.validate().expect_err("refused").to_string()
        };
        let cases: [(Change, &str); 7] = [
            (|s| s.noise_speed_mps = 0.08, "`noise_speed_mps` is 0.08"),
            (
                |s| s.noise_curvature_per_m = 0.003,
                "`noise_curvature_per_m` is 0.003",
            ),
            (
                |s| s.follower_brake_mps2 = 8.5,
                "`follower_brake_mps2` is 8.5",
            ),
            (|s| s.gentle_brake_mps2 = 8.5, "`gentle_brake_mps2` is 8.5"),
            (|s| s.eta = 1.1, "`eta` is 1.1"),
            (|s| s.brake_mps2 = f64::NAN, "`brake_mps2` is NaN"),
            (|s| s.error_sigmas = -1.0, "`error_sigmas` is -1"),
        ];
        for (change, part) in cases {
            let message = refused(change);
            assert!(message.contains(part), "{message}");
        }
        let mut settings = ControlSettings::default();
        settings.safety.eta = 1.0;
        settings.safety.follower_brake_mps2 = 8.0;
        settings.safety.gentle_brake_mps2 = 8.0;
        assert_eq!(settings.validate(), Ok(()));
    }
}
