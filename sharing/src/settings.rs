use serde::{Deserialize, Serialize};

use crate::PoseNoise;

/// How a [`crate::Tracker`] weighs and forgets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerSettings {
    /// Standard deviation of a detected position, each axis, in metres.
    pub position_std_m: f64,
    /// Spectral density of the white-noise acceleration of the constant-velocity model, in
    /// m^2/s^3.
    pub process_noise_m2ps3: f64,
    /// Standard deviation, along the heading of the box, of the speed of an object seen once.
    pub unknown_speed_std_mps: f64,
    /// The same across the heading.
    pub unknown_drift_std_mps: f64,
    /// Below this speed an object may be standing still.
    pub standing_speed_mps: f64,
    /// Own detections after which an object is believed to exist.
    pub confirming_hits: u32,
    /// Score at which a single own detection is enough.
    pub confirming_score: f64,
    /// A moving object is forgotten this long after its newest measurement.
    pub forget_moving_s: f64,
    /// An object that stood still is forgotten this long after its newest measurement.
    pub forget_standing_s: f64,
    /// Within this distance an object that no other object hides must be seen.
    pub certain_view_m: f64,
    /// Own frames that fail to show such an object before it is forgotten.
    pub certain_view_misses: u32,
    /// Messages older than this are refused.
    pub oldest_message_s: f64,
    /// By how much other stations are taken to be wrong about their own poses: it adds to the
    /// standard deviation of whatever they report.
    pub pose_noise: PoseNoise,
}

impl Default for TrackerSettings {
    fn default() -> Self {
        Self {
            position_std_m: 0.3,
            process_noise_m2ps3: 3.0,
            unknown_speed_std_mps: 10.0,
            unknown_drift_std_mps: 1.0,
            standing_speed_mps: 1.0,
            confirming_hits: 2,
            confirming_score: 0.8,
            forget_moving_s: 1.5,
            forget_standing_s: 10.0,
            certain_view_m: 25.0,
            certain_view_misses: 3,
            oldest_message_s: 1.0,
            pose_noise: PoseNoise::default(),
        }
    }
}
