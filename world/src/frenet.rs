use serde::{Deserialize, Serialize};

/// A position along (`s_m`) and to the left (`d_m`) of the reference line.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrenetPoint {
    /// Arc length along the reference line in metres.
    pub s_m: f64,
    /// Signed distance from the reference line in metres, positive to the left.
    pub d_m: f64,
}

/// A Frenet position with the heading relative to the road.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrenetPose {
    /// Arc length along the reference line in metres.
    pub s_m: f64,
    /// Signed distance from the reference line in metres, positive to the left.
    pub d_m: f64,
    /// Heading minus the road's heading, in (-pi, pi].
    pub psi_rad: f64,
    /// Curvature of the reference line at `s_m` in 1/m.
    pub curvature_per_m: f64,
}
