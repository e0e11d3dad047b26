use covista_control::SafetySettings;
use covista_world::STEP_S;

use super::{PlantModel, lag::lead_s};

/// A plant unlike the model, and what is done about it besides the noise bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoverCase {
    /// The plant.
    pub plant: PlantModel,
    /// Whether eta is so small that h falls no faster than the lag lets it: Ts / (4 tau).
    ///
    /// Near its edge `h' = -lambda h` is held with an input that comes late:
    /// `tau h'' + h' + lambda h = 0` does not overshoot for `lambda tau <= 1/4`.
    pub is_slow: bool,
}

/// The plants unlike the model.
pub const COVERS: [CoverCase; 10] = [
    lag(0.1, false, false),
    lag(0.2, false, false),
    lag(0.3, false, false),
    lag(0.1, false, true),
    lag(0.2, false, true),
    lag(0.3, false, true),
    lag(0.1, true, false),
    lag(0.2, true, false),
    lag(0.3, true, false),
    CoverCase {
        plant: PlantModel::Dynamic,
        is_slow: false,
    },
];

pub(super) const fn lag(time_constant_s: f64, is_told: bool, is_slow: bool) -> CoverCase {
    let plant = PlantModel::Lag {
        time_constant_s,
        is_told,
    };
    CoverCase { plant, is_slow }
}

impl CoverCase {
    /// The settings with its eta.
    pub(super) fn settings(&self, safety: &SafetySettings) -> SafetySettings {
        match self.plant {
            PlantModel::Lag {
                time_constant_s, ..
            } if self.is_slow => SafetySettings {
                eta: safety.eta.min(STEP_S / (4.0 * time_constant_s)),
                ..*safety
            },
            _ => *safety,
        }
    }

    /// What W_p needs beyond its default, by the derivation: while a lag of tau goes from full
    /// throttle to full braking it falls behind in speed by up to `tau (a_max + b_e)`. Told, it
    /// needs nothing; nor do tyres, which are not about speed.
    pub(super) fn more_position_m(&self, safety: &SafetySettings) -> f64 {
        match self.plant {
            PlantModel::Lag {
                time_constant_s,
                is_told: false,
            } => time_constant_s * (safety.accel_max_mps2 + safety.brake_mps2) * STEP_S,
            _ => 0.0,
        }
    }

    /// Seconds by which a controller that is told what a lag leads to is ahead of the vehicle.
    pub(super) fn lead_s(&self) -> f64 {
        match self.plant {
            PlantModel::Lag {
                time_constant_s,
                is_told: true,
            } => lead_s(time_constant_s),
            _ => 0.0,
        }
    }
}
