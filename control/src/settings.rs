use serde::{Deserialize, Serialize};

/// Every assumption of the promise, and every choice of the controller, by name.
///
/// "If h(x_0) >= 0 on the road as it is, leaders brake at most `leader_brake_mps2`, noise,
/// perception error and message age stay within their bounds, and nobody cuts in or is revealed
/// inside the set, a CAV's headway never falls below `headway_safe_m`; and inside the collision
/// set it never hits the vehicle ahead."
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SafetySettings {
    /// b_e: hardest braking of the ego vehicle in U.
    pub brake_mps2: f64,
    /// Largest acceleration in U.
    pub accel_max_mps2: f64,
    /// |tan(delta)| in U.
    pub tan_delta_max: f64,
    /// Largest lateral acceleration v^2 tan(delta) / L.
    pub lateral_accel_max_mps2: f64,
    /// b_l: hardest braking assumed of a vehicle ahead.
    pub leader_brake_mps2: f64,
    /// b_min: braking that a follower really has.
    pub follower_brake_mps2: f64,
    /// a_b: acceleration of a follower until it reacts.
    pub follower_accel_mps2: f64,
    /// rho of a CAV.
    pub reaction_cav_s: f64,
    /// rho of a human driver.
    pub reaction_human_s: f64,
    /// W_p: bound on the position noise of one step.
    pub noise_position_m: f64,
    /// W_v: bound on the speed noise of one step.
    pub noise_speed_mps: f64,
    /// P_safe between the bodies' centres.
    pub headway_safe_m: f64,
    /// Bumper distance of the collision level.
    pub collision_margin_m: f64,
    /// eta in (0, 1]: h may fall to (1 - eta) h in a step.
    pub eta: f64,
    /// Largest braking while the distance level is broken and the collision level holds.
    pub gentle_brake_mps2: f64,
    /// Below this speed a vehicle that leaves its lane round a stopped one keeps only the
    /// collision level towards it.
    pub leaving_speed_mps: f64,
    /// k_min: counter-curvature that the curve speed leaves at least.
    pub counter_curvature_min_per_m: f64,
    /// How many standard deviations an estimate may be wrong.
    pub error_sigmas: f64,
    /// How far a body must reach over a line to be in the lane.
    pub lane_entry_m: f64,
    /// Range within which the own line of sight confirms a lane as free.
    pub sight_range_m: f64,
    /// How long a stretch that was seen free counts as free.
    pub sight_memory_s: f64,
    /// Time between the announcement of a lane change and its start.
    pub announcement_s: f64,
    /// Longest time from first line of sight to a vehicle to a track of it.
    pub perception_delay_s: f64,
    /// Age of the oldest measurement that a track may rest on.
    pub knowledge_age_max_s: f64,
}

impl Default for SafetySettings {
    fn default() -> Self {
        Self {
            brake_mps2: 8.0,
            accel_max_mps2: 3.0,
            tan_delta_max: 0.6,
            lateral_accel_max_mps2: 4.0,
            leader_brake_mps2: 8.0,
            follower_brake_mps2: 4.0,
            follower_accel_mps2: 1.0,
            reaction_cav_s: 0.1,
            reaction_human_s: 0.75,
            noise_position_m: 1e-3,
            noise_speed_mps: 5e-3,
            headway_safe_m: 18.5,
            collision_margin_m: 2.0,
            eta: 0.2,
            gentle_brake_mps2: 3.0,
            leaving_speed_mps: 5.0,
            counter_curvature_min_per_m: 0.003,
            error_sigmas: 3.0,
            lane_entry_m: 0.2,
            sight_range_m: 65.0,
            sight_memory_s: 1.0,
            announcement_s: 0.3,
            perception_delay_s: 1.5,
            knowledge_age_max_s: 1.0,
        }
    }
}

/// How the reference drives: comfort, not safety.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceSettings {
    /// Acceleration from standstill.
    pub accel_mps2: f64,
    /// Braking behind a leader.
    pub brake_mps2: f64,
    /// Hardest braking of the reference.
    pub brake_max_mps2: f64,
    /// Jerk of the reference.
    pub jerk_mps3: f64,
    /// Time gap to the leader beyond the safe headway.
    pub time_gap_s: f64,
    /// Gap beyond the safe headway at standstill.
    pub standstill_gap_m: f64,
    /// Duration of a lane change.
    pub lane_change_s: f64,
    /// Shortest length of a lane change.
    pub lane_change_min_m: f64,
    /// Lateral acceleration that a lane change and the road may take together.
    pub lateral_accel_mps2: f64,
    /// Speed round a stopped vehicle that is left from near standstill.
    pub leaving_speed_mps: f64,
    /// Share of the safe speed for curve and sight that is driven.
    pub speed_share: f64,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            accel_mps2: 1.8,
            brake_mps2: 2.0,
            brake_max_mps2: 4.0,
            jerk_mps3: 6.0,
            time_gap_s: 0.8,
            standstill_gap_m: 1.0,
            lane_change_s: 4.0,
            lane_change_min_m: 12.0,
            lateral_accel_mps2: 3.4,
            leaving_speed_mps: 3.5,
            speed_share: 0.96,
        }
    }
}

/// All settings of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControlSettings {
    /// The assumptions and the safe set.
    pub safety: SafetySettings,
    /// The reference.
    pub reference: ReferenceSettings,
}

/// A setting that the controller cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("control setting `{name}` is {value}; it must be {must}")]
pub struct SettingsError {
    name: &'static str,
    value: f64,
    must: &'static str,
}

impl ControlSettings {
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
            ("noise_speed_mps", s.noise_speed_mps),
            ("collision_margin_m", s.collision_margin_m),
            ("leaving_speed_mps", s.leaving_speed_mps),
            ("error_sigmas", s.error_sigmas),
            ("lane_entry_m", s.lane_entry_m),
            ("sight_memory_s", s.sight_memory_s),
            ("announcement_s", s.announcement_s),
            ("perception_delay_s", s.perception_delay_s),
            ("knowledge_age_max_s", s.knowledge_age_max_s),
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
            Err(SettingsError { name, value, must })
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
}
