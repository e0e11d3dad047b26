use covista_world::LANE_COUNT;
use serde::{Deserialize, Serialize};

use crate::RingError;

/// P_safe: the least distance of a CAV to the vehicle ahead, between the bodies' centres.
pub const SAFE_DISTANCE_M: f64 = 18.5;
const LIMITS_MPS: [f64; 2] = [5.0, 35.0];

/// Who drives on a ring, and how dense they are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RingSettings {
    /// All vehicles.
    pub vehicles: usize,
    /// How many of them are CAVs: those with the ids 1 to `cavs`.
    pub cavs: usize,
    /// rho = vehicles * P_safe / (lanes * length): 1 is a road packed at P_safe.
    pub density: f64,
    /// Nobody wants to drive faster, and no corner is too tight for it.
    pub speed_limit_mps: f64,
    /// Mean of the desired speeds in m/s, those of CAVs and humans alike.
    pub desired_speed_mps: f64,
    /// Half width of their uniform distribution, as a share of the mean.
    pub desired_speed_spread: f64,
    /// Half width of the uniform distribution of every other IDM parameter, as a share of its mean.
    pub idm_spread: f64,
    /// The longest episode, in seconds: for so long the road is unrolled.
    pub duration_s: f64,
    /// Draws starts, models, desired speeds and drivers.
    pub seed: u64,
}

impl Default for RingSettings {
    fn default() -> Self {
        Self {
            vehicles: 30,
            cavs: 0,
            density: 0.3,
            speed_limit_mps: 20.0,
            desired_speed_mps: 16.0,
            desired_speed_spread: 0.2,
            idm_spread: 0.15,
            duration_s: 500.0,
            seed: 0,
        }
    }
}

impl RingSettings {
    /// Length of the loop in metres.
    pub fn period_m(&self) -> f64 {
        self.vehicles as f64 * SAFE_DISTANCE_M / (f64::from(LANE_COUNT) * self.density)
    }

    /// The farthest that anybody drives in an episode.
    pub fn way_m(&self) -> f64 {
        self.speed_limit_mps * self.duration_s
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first that makes no sense.
    pub fn check(&self) -> Result<(), RingError> {
        if self.vehicles == 0 {
            return Err(RingError::NoVehicles);
        }
        if self.cavs > self.vehicles {
            return Err(RingError::TooManyCavs {
                cavs: self.cavs,
                vehicles: self.vehicles,
            });
        }
        let [low, high] = LIMITS_MPS;
        let limit = self.speed_limit_mps;
        let fastest = self.desired_speed_mps * (1.0 + self.desired_speed_spread);
        let ranges = [
            ("density", self.density, 0.001, 1.0),
            ("speed_limit_mps", limit, low, high),
            ("desired_speed_mps", self.desired_speed_mps, 1.0, limit),
            ("desired_speed_spread", self.desired_speed_spread, 0.0, 0.9),
            ("idm_spread", self.idm_spread, 0.0, 0.5),
            ("duration_s", self.duration_s, 0.01, 10_000.0),
            (
                "desired_speed_mps * (1 + desired_speed_spread)",
                fastest,
                1.0,
                limit,
            ),
        ];
        let wrong = ranges
            .into_iter()
            .find(|(_, value, least, most)| !(least..=most).contains(&value));
        match wrong {
            Some((field, value, least, most)) => Err(RingError::OutOfRange {
                field,
                value,
                least,
                most,
            }),
            None => Ok(()),
        }
    }
}
