use covista_world::Road;

use crate::profile::half_width_m;

/// Bounds c_min and c_max on the lane metres per metre driven, for a vehicle that is at most
/// `off_center_m` from the centre of the lane in which the gap is measured.
///
/// ds/dt of the lane is v cos(psi) (1 - kappa d_lane) / (1 - kappa d), with |kappa| of the whole
/// road: one constant for the road, so that the bound of the next step is never the larger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ArcRates {
    /// c_min.
    pub low: f64,
    /// c_max.
    pub high: f64,
}

impl ArcRates {
    pub fn new(road: &Road, off_center_m: f64) -> Self {
        let curvature = road.sharpest_per_m();
        let share = curvature * off_center_m / (1.0 - curvature * half_width_m(road));
        Self {
            low: (1.0 - share).max(0.0),
            high: 1.0 + share,
        }
    }
}
