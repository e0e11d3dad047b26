use covista_world::{ControlInput, FrenetPose};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::plant::Disturbance;

/// Whose inputs a campaign asks the filter for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nominals {
    /// Hostile ones and the controller's own, in turns.
    All,
    /// The controller's own reference only.
    Own,
}

/// What is asked of the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NominalPolicy {
    /// Flat-out acceleration along the lane.
    FlatOut,
    /// Flat-out acceleration, and steering from lock to lock.
    FlatOutSwerving,
    /// Random steering and acceleration, held for a while.
    Random,
    /// Hardest acceleration and braking, lock to lock, in turns.
    BangBang,
    /// The controller's own reference.
    Reference,
}

/// The nominal input of one episode.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    pub policy: NominalPolicy,
    /// Steps for which an input is held.
    pub hold: usize,
    held: ControlInput,
}

/// More than any vehicle can: the filter has to bound it.
const ACCEL_MPS2: f64 = 12.0;
const TAN_DELTA: f64 = 1.0;

impl Nominal {
    pub fn new(policy: NominalPolicy, hold: usize) -> Self {
        Self {
            policy,
            hold,
            held: ControlInput::default(),
        }
    }

    /// The input at `step`, or `None` where the controller's own reference is asked for.
    ///
    /// `target_d_m` is the centre of the lane that the vehicle is to drive in.
    pub fn input(
        &mut self,
        step: usize,
        frenet: &FrenetPose,
        speed_mps: f64,
        wheelbase_m: f64,
        target_d_m: f64,
        dice: &mut ChaCha8Rng,
    ) -> Option<ControlInput> {
        let anew = step.is_multiple_of(self.hold);
        let sign = |on: bool| if on { 1.0 } else { -1.0 };
        match self.policy {
            NominalPolicy::Reference => return None,
            NominalPolicy::FlatOut => {
                self.held = ControlInput {
                    tan_delta: lane_keeping(frenet, speed_mps, wheelbase_m, target_d_m),
                    accel_mps2: ACCEL_MPS2,
                };
            }
            NominalPolicy::FlatOutSwerving => {
                self.held.accel_mps2 = ACCEL_MPS2;
                if anew {
                    self.held.tan_delta = TAN_DELTA * sign(dice.random());
                }
            }
            NominalPolicy::Random => {
                if anew {
                    self.held = ControlInput {
                        tan_delta: dice.random_range(-TAN_DELTA..TAN_DELTA),
                        accel_mps2: dice.random_range(-6.0..ACCEL_MPS2),
                    };
                }
            }
            NominalPolicy::BangBang => {
                if anew {
                    self.held = ControlInput {
                        tan_delta: TAN_DELTA * sign(dice.random()),
                        accel_mps2: ACCEL_MPS2 * sign(dice.random_bool(0.7)),
                    };
                }
            }
        }
        Some(self.held)
    }
}

/// Steers towards the offset `target_d_m` along the road.
fn lane_keeping(frenet: &FrenetPose, speed_mps: f64, wheelbase_m: f64, target_d_m: f64) -> f64 {
    let length_m = (0.8 * speed_mps).max(4.0);
    let error_m = (frenet.d_m - target_d_m).clamp(-1.0, 1.0);
    let back = error_m / length_m.powi(2) + 2.0 * frenet.psi_rad.sin() / length_m;
    let stretch = 1.0 - frenet.curvature_per_m * frenet.d_m;
    wheelbase_m * (frenet.curvature_per_m / stretch - back)
}

/// Who draws the noise of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoiseMode {
    /// There is none.
    None,
    /// At its bounds, each sign drawn anew every step.
    RandomSign,
    /// At its bounds, always the worse: forward, faster, and towards the nearer edge of the lane.
    Worst,
    /// As the worst, but to one side for a second and then to the other.
    Weaving,
    /// Anywhere within the bounds.
    Uniform,
}

impl NoiseMode {
    /// The disturbance of one step of a vehicle `off_m` to the left of its lane's centre.
    pub fn draw(self, step: usize, off_m: f64, dice: &mut ChaCha8Rng) -> Disturbance {
        let side = if off_m >= 0.0 { 1.0 } else { -1.0 };
        let all = |along: f64, across: f64| Disturbance {
            position: along,
            speed: along,
            slip: across,
            curvature: across,
        };
        match self {
            Self::None => Disturbance::default(),
            Self::Worst => all(1.0, side),
            Self::Weaving => all(
                1.0,
                if (step / 100).is_multiple_of(2) {
                    1.0
                } else {
                    -1.0
                },
            ),
            Self::RandomSign => {
                let mut sign = || if dice.random() { 1.0 } else { -1.0 };
                Disturbance {
                    position: sign(),
                    speed: sign(),
                    slip: sign(),
                    curvature: sign(),
                }
            }
            Self::Uniform => {
                let mut share = || dice.random_range(-1.0..=1.0);
                Disturbance {
                    position: share(),
                    speed: share(),
                    slip: share(),
                    curvature: share(),
                }
            }
        }
    }
}
