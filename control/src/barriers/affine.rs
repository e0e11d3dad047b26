use covista_world::{BarrierKind, ControlInput, FrenetPose, STEP_S};
use serde::{Deserialize, Serialize};

use super::target;

/// The control state of Appendix A along the road: x = [s, d, psi, v].
pub type State = [f64; 4];

/// h = p'x + q, the paper's affine barrier (Section IV-B), in road coordinates x = [s, d, psi, v].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AffineBarrier {
    /// p.
    pub p: State,
    /// q.
    pub q: f64,
}

/// A row `coefficients . u >= least` of the QP, with u = [tan(delta), a].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AffineRow {
    /// The barrier.
    pub kind: BarrierKind,
    /// p'g(x).
    pub coefficients: [f64; 2],
    /// What they must reach.
    pub least: f64,
}

/// x+ = f(x) + g(x) u of Appendix A at one state, along the road.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    x: State,
    f: State,
    /// g's entry for psi and tan(delta), and for v and a.
    g: [f64; 2],
}

impl Dynamics {
    /// At road position `frenet` and speed v: one explicit Euler step in the Frenet frame.
    pub fn new(frenet: &FrenetPose, speed_mps: f64, wheelbase_m: f64) -> Self {
        let (sin, cos) = frenet.psi_rad.sin_cos();
        let along_m =
            speed_mps * cos * STEP_S / (1.0 - frenet.curvature_per_m * frenet.d_m).max(0.2);
        Self {
            x: [frenet.s_m, frenet.d_m, frenet.psi_rad, speed_mps],
            f: [
                frenet.s_m + along_m,
                frenet.d_m + speed_mps * sin * STEP_S,
                frenet.psi_rad - frenet.curvature_per_m * along_m,
                speed_mps,
            ],
            g: [speed_mps * STEP_S / wheelbase_m, STEP_S],
        }
    }
}

impl AffineBarrier {
    /// h(x).
    pub fn h(&self, dynamics: &Dynamics) -> f64 {
        self.of(&dynamics.x)
    }

    /// h(f(x) + g(x) u), without noise.
    pub fn h_next(&self, dynamics: &Dynamics, u: ControlInput) -> f64 {
        self.of(&dynamics.f)
            + self.p[2] * dynamics.g[0] * u.tan_delta
            + self.p[3] * dynamics.g[1] * u.accel_mps2
    }

    /// The row `p'g(x) u >= (1 - eta) h(x) - p'f(x) - q + noise`, with h(x) itself in the place of
    /// `(1 - eta) h(x)` where it is negative.
    pub fn row(&self, kind: BarrierKind, dynamics: &Dynamics, eta: f64, noise: f64) -> AffineRow {
        AffineRow {
            kind,
            coefficients: [self.p[2] * dynamics.g[0], self.p[3] * dynamics.g[1]],
            least: target(self.h(dynamics), eta) - self.of(&dynamics.f) + noise,
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.q.is_finite() && self.p.iter().all(|p| p.is_finite())
    }

    fn of(&self, x: &State) -> f64 {
        self.p.iter().zip(x).fold(self.q, |sum, (p, x)| sum + p * x)
    }
}

impl AffineRow {
    /// By how much `u` misses the row, in units of h.
    pub fn shortfall(&self, u: ControlInput) -> f64 {
        let [tan, accel] = self.coefficients;
        (self.least - tan * u.tan_delta - accel * u.accel_mps2).max(0.0)
    }
}
