use serde::{Deserialize, Serialize};

/// A piece of the reference line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum RoadSegment {
    /// Curvature zero.
    Straight {
        /// Length along the reference line.
        length_m: f64,
    },
    /// Curvature that goes linearly from the one end's to the other's.
    Clothoid {
        /// Length along the reference line.
        length_m: f64,
        /// Curvature at the start in 1/m, positive to the left.
        from_per_m: f64,
        /// Curvature at the end in 1/m, positive to the left.
        to_per_m: f64,
    },
    /// Constant curvature.
    Arc {
        /// Length along the reference line.
        length_m: f64,
        /// Curvature in 1/m, positive to the left.
        curvature_per_m: f64,
    },
}

impl RoadSegment {
    /// Length along the reference line in metres.
    pub fn length_m(&self) -> f64 {
        match *self {
            Self::Straight { length_m }
            | Self::Clothoid { length_m, .. }
            | Self::Arc { length_m, .. } => length_m,
        }
    }

    /// Curvature at the start and at the end.
    pub(crate) fn curvatures(&self) -> (f64, f64) {
        match *self {
            Self::Straight { .. } => (0.0, 0.0),
            Self::Clothoid {
                from_per_m,
                to_per_m,
                ..
            } => (from_per_m, to_per_m),
            Self::Arc {
                curvature_per_m, ..
            } => (curvature_per_m, curvature_per_m),
        }
    }
}
