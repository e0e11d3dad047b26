use std::collections::VecDeque;

use covista_control::SafetySettings;
use covista_traffic::{VehicleId, VehicleKind};
use covista_world::{Action, BicycleState, Road, STEP_S, StationId, VehicleDimensions};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::TrueVehicle;

/// No vehicle is faster than this.
pub(super) const TOP_MPS: f64 = 40.0;
/// Hardest acceleration of a leader, in m/s^2.
const ACCEL_MPS2: f64 = 3.0;
/// How far back a vehicle's motion is remembered, in steps.
pub(super) const MEMORY_STEPS: usize = 401;

/// How another vehicle drives along its lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Script {
    /// Constant speed.
    Hold,
    /// Constant speed, and the hardest braking from a step on.
    BrakeFrom(usize),
    /// A new random acceleration every few steps.
    Random { period: usize },
    /// Hardest braking and hardest acceleration in turns.
    BangBang { period: usize },
    /// Brakes to a stop as hard as it can, waits, drives off.
    StopAndGo { wait: usize },
    /// Behind the ego vehicle in the lane that this one enters: accelerates for its reaction
    /// time, then keeps the distance in the manner of RSS.
    Follow {
        reaction_s: f64,
        accel_mps2: f64,
        brake_mps2: f64,
        /// What it takes its own braking for.
        promised_mps2: f64,
    },
}

/// A smooth move across the road.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sideways {
    pub start: usize,
    pub steps: usize,
    pub to_m: f64,
}

/// Where a vehicle was and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    /// Road s and offset d of the body's centre.
    pub s_m: f64,
    pub d_m: f64,
    /// Speed along the road's parallel through the centre.
    pub speed_mps: f64,
    /// Speed across, to the left, of a vehicle that is not slow.
    pub sideways_mps: f64,
}

/// Another vehicle: it follows its script within the bounds that the promise assumes.
#[derive(Debug, Clone)]
pub(super) struct Other {
    pub id: u32,
    pub station: Option<StationId>,
    pub dimensions: VehicleDimensions,
    pub now: Motion,
    pub script: Script,
    pub sideways: Option<Sideways>,
    /// What it announced, where it is a CAV, and when in seconds.
    pub announced: Option<(Action, f64)>,
    /// Whether the ego vehicle hears what it announces.
    pub is_heard: bool,
    /// Hardest braking, in m/s^2.
    pub brake_mps2: f64,
    /// Hardest acceleration, in m/s^2.
    pub accel_max_mps2: f64,
    accel_mps2: f64,
    from_d_m: f64,
    /// Steps of its move across that are done.
    crossed: f64,
    past: VecDeque<Motion>,
}

/// What a follower sees of the ego vehicle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Merging {
    /// Since the lane change began, in seconds.
    pub since_s: f64,
    /// Gap to where the ego vehicle's rear may swing.
    pub gap_m: f64,
    /// What the ego vehicle drives when it brakes as hard as it can.
    pub ego_stop_m: f64,
    /// P_bumper between the two.
    pub keep_m: f64,
}

impl Other {
    /// A vehicle that has driven at constant speed so far.
    pub fn new(id: u32, dimensions: VehicleDimensions, now: Motion, brake_mps2: f64) -> Self {
        Self {
            id,
            station: None,
            dimensions,
            now,
            script: Script::Hold,
            sideways: None,
            announced: None,
            is_heard: true,
            brake_mps2,
            accel_max_mps2: ACCEL_MPS2,
            accel_mps2: 0.0,
            from_d_m: now.d_m,
            crossed: 0.0,
            past: VecDeque::new(),
        }
    }

    /// Where it was `steps` ago; before the start it drove at constant speed.
    pub fn before(&self, steps: usize, road: &Road) -> Motion {
        if steps == 0 {
            return self.now;
        }
        if let Some(motion) = self.past.get(steps - 1) {
            return *motion;
        }
        let mut motion = *self.past.back().unwrap_or(&self.now);
        for _ in self.past.len()..steps {
            let stretch = 1.0 - road.curvature(motion.s_m) * motion.d_m;
            motion.s_m -= motion.speed_mps * STEP_S / stretch;
        }
        motion
    }

    /// One step of its script.
    pub fn step(
        &mut self,
        step: usize,
        road: &Road,
        merging: Option<Merging>,
        dice: &mut ChaCha8Rng,
    ) {
        let accel_mps2 = self.accel(step, merging, dice);
        self.accel_mps2 = accel_mps2.clamp(-self.brake_mps2, self.accel_max_mps2);
        let before = self.now;
        self.past.push_front(before);
        self.past.truncate(MEMORY_STEPS);
        if (self.sideways).is_some_and(|sideways| step + 1 >= sideways.start) {
            self.crossed += share_of_full(before.speed_mps);
        }
        let (d_m, sideways_mps) = self.across();
        let stretch = 1.0 - road.curvature(before.s_m) * before.d_m;
        self.now = Motion {
            s_m: before.s_m + before.speed_mps * STEP_S / stretch,
            d_m,
            speed_mps: (before.speed_mps + self.accel_mps2 * STEP_S).clamp(0.0, TOP_MPS),
            sideways_mps,
        };
    }

    /// A CAV announces its lane change `ahead` steps before it begins, unless the lane is `taken` by
    /// one that announced it before: then it stays where it is.
    pub fn announce(&mut self, step: usize, ahead: usize, taken_d_m: Option<f64>) {
        let Some(sideways) = self.sideways.filter(|_| self.station.is_some()) else {
            return;
        };
        if self.crossed >= sideways.steps as f64 {
            self.announced = None;
        }
        if step + ahead != sideways.start {
            return;
        }
        if taken_d_m.is_some_and(|d_m| (d_m - sideways.to_m).abs() < 0.5) {
            self.sideways = None;
            return;
        }
        let action = if sideways.to_m > self.now.d_m {
            Action::ChangeLeft
        } else {
            Action::ChangeRight
        };
        self.announced = Some((action, step as f64 * STEP_S));
    }

    fn across(&self) -> (f64, f64) {
        let Some(sideways) = self.sideways.filter(|_| self.crossed > 0.0) else {
            return (self.now.d_m, 0.0);
        };
        let share = (self.crossed / sideways.steps as f64).min(1.0);
        let angle = std::f64::consts::PI * share;
        let rise_m = sideways.to_m - self.from_d_m;
        let per_s = std::f64::consts::PI / (sideways.steps as f64 * STEP_S);
        let d_m = self.from_d_m + 0.5 * rise_m * (1.0 - angle.cos());
        (d_m, 0.5 * rise_m * angle.sin() * per_s)
    }

    fn accel(&self, step: usize, merging: Option<Merging>, dice: &mut ChaCha8Rng) -> f64 {
        let (brake, accel) = (-self.brake_mps2, self.accel_max_mps2);
        match self.script {
            Script::Hold => 0.0,
            Script::BrakeFrom(from) => {
                if step >= from {
                    brake
                } else {
                    0.0
                }
            }
            Script::Random { period } => {
                if !step.is_multiple_of(period) {
                    self.accel_mps2
                } else if dice.random_bool(0.3) {
                    brake
                } else {
                    dice.random_range(brake..accel)
                }
            }
            Script::BangBang { period } => {
                if (step / period).is_multiple_of(2) {
                    brake
                } else {
                    accel
                }
            }
            Script::StopAndGo { wait } => {
                let phase = step % (3 * wait);
                if phase < wait { brake } else { accel }
            }
            Script::Follow {
                reaction_s,
                accel_mps2,
                brake_mps2,
                promised_mps2,
            } => match merging {
                Some(merging) if merging.since_s < reaction_s => accel_mps2,
                Some(merging) if self.is_too_near(merging, promised_mps2) => -brake_mps2,
                _ => 0.0,
            },
        }
    }

    /// Whether its own stopping distance is no longer shorter than the room and the ego vehicle's.
    fn is_too_near(&self, merging: Merging, brake_mps2: f64) -> bool {
        let v = self.now.speed_mps;
        let own_stop_m = v * v / (2.0 * brake_mps2) + 1.5 * v * STEP_S;
        let room_m = merging.gap_m - merging.keep_m;
        room_m < (own_stop_m - merging.ego_stop_m).max(0.5)
    }

    /// The body as it truly is.
    pub fn truth(&self, road: &Road) -> TrueVehicle {
        let Motion {
            s_m,
            d_m,
            speed_mps,
            ..
        } = self.now;
        let center = road.pose_from_frenet(s_m, d_m, heading_rad(&self.now));
        let pose = self.dimensions.axle_pose(center);
        let state = BicycleState { pose, speed_mps };
        // One that drives as it likes keeps none of the promises of a CAV.
        let kind = match (self.station, self.script) {
            (Some(_), Script::Follow { .. }) => VehicleKind::Cav,
            _ => VehicleKind::Human,
        };
        let mut truth =
            TrueVehicle::new(VehicleId(self.id), kind, self.dimensions, state, s_m, road);
        // Along the road it is as fast as its script says, wherever its axle points.
        truth.speed_mps = speed_mps / truth.frenet.psi_rad.cos().max(LEAST_COSINE);
        truth.velocity = pose.forward() * truth.speed_mps;
        truth
    }
}

/// No vehicle is turned farther from the road than this.
const LEAST_COSINE: f64 = 0.1;
/// A slower vehicle moves across the slower, and not at all when it stands.
const SLOW_MPS: f64 = 3.0;

fn share_of_full(speed_mps: f64) -> f64 {
    (speed_mps / SLOW_MPS).min(1.0)
}

/// Speed across the road, to the left.
pub(super) fn sideways_mps(motion: &Motion) -> f64 {
    motion.sideways_mps * share_of_full(motion.speed_mps)
}

/// Heading relative to the road.
pub(super) fn heading_rad(motion: &Motion) -> f64 {
    motion.sideways_mps.atan2(motion.speed_mps.max(SLOW_MPS))
}

/// A car or a truck, drawn at random.
pub(super) fn draw_dimensions(dice: &mut ChaCha8Rng) -> VehicleDimensions {
    let truck = dice.random_bool(0.2);
    let length_m = if truck {
        dice.random_range(7.0..16.0)
    } else {
        dice.random_range(3.6..5.2)
    };
    VehicleDimensions {
        length_m,
        width_m: if truck { 2.4 } else { 1.85 },
        height_m: if truck { 3.5 } else { 1.5 },
        wheelbase_m: 0.55 * length_m,
        rear_overhang_m: 0.2 * length_m,
    }
}

/// The acceleration of a follower until it reacts and its braking, as the settings assume them.
pub(super) fn follow(settings: &SafetySettings, reaction_s: f64) -> Script {
    Script::Follow {
        reaction_s,
        accel_mps2: settings.follower_accel_mps2,
        brake_mps2: settings.follower_brake_mps2,
        promised_mps2: settings.follower_brake_mps2,
    }
}
