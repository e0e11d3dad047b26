use covista_world::{BarrierKind, ControlInput, FrenetPose, LaneIndex, Road, STEP_S};

use super::bounds::tan_delta_limit;
use super::{Barrier, Input, Row, target};
use crate::monotone::largest;
use crate::profile::{half_width_m, path_curvature};
use crate::{EgoState, RoadProfile, SafetySettings};

/// The strip between two offsets d in which the body has to stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strip {
    /// Right edge.
    pub right_m: f64,
    /// Left edge.
    pub left_m: f64,
}

impl Strip {
    /// From the right edge of the rightmost of `lanes` to the left edge of the leftmost.
    pub fn of(road: &Road, lanes: &[LaneIndex]) -> Self {
        let none = Self {
            right_m: half_width_m(road),
            left_m: -half_width_m(road),
        };
        lanes.iter().fold(none, |strip, &lane| {
            let (right_m, left_m) = road.lane_bounds_m(lane);
            Self {
                right_m: strip.right_m.min(right_m),
                left_m: strip.left_m.max(left_m),
            }
        })
    }
}

/// The side of the strip, as the sign that mirrors it to the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

impl Side {
    const BOTH: [Self; 2] = [Self::Left, Self::Right];

    fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    fn kind(self) -> BarrierKind {
        match self {
            Self::Left => BarrierKind::LateralMax,
            Self::Right => BarrierKind::LateralMin,
        }
    }

    fn mirrored(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

/// What the lateral barriers of one state have in common.
///
/// Each side has two barriers: that of the front, which counts the excursion until the body can be
/// steered back parallel to the road, and that of the rear corner, which swings out when the
/// heading points away from the edge.
#[derive(Debug, Clone, Copy)]
pub struct Lateral<'a> {
    road: &'a Road,
    safety: &'a SafetySettings,
    /// The body's reach from the rear axle to its front, its rear and its sides.
    front_m: f64,
    rear_m: f64,
    half_width_m: f64,
    wheelbase_m: f64,
    strip: Strip,
    speed_mps: f64,
    now: FrenetPose,
    /// At x+ when driving straight on, and from where to where on the road noise may take it.
    next: FrenetPose,
    next_s_m: [f64; 2],
    /// How far a body's end lies off the parallel of the road through the rear axle.
    sagitta_m: f64,
    /// Metres of the road per metre driven, at the most.
    longest_metre: f64,
    /// |kappa| / (1 - |kappa| d_max) of the whole road.
    sharpest_per_m: f64,
    /// Counter-curvature that is left in any case: none for a vehicle above its speed limit.
    floor_per_m: f64,
    /// Largest |tan(delta)| now.
    lock: f64,
    /// What the heading relative to the road may differ by after this step.
    heading_noise_rad: f64,
    /// h at x of each side's front and rear.
    h_m: [[f64; 2]; 2],
}

impl<'a> Lateral<'a> {
    /// For `ego` in `strip`; `next` is where it is one step on when it drives straight on. The
    /// position at x+ does not depend on u and is exact but for the noise.
    pub fn new(
        profile: &'a RoadProfile,
        ego: &EgoState,
        next: FrenetPose,
        strip: Strip,
        safety: &'a SafetySettings,
    ) -> Self {
        let road = profile.road();
        let (front_m, half_width_m) = (ego.front_m(), ego.dimensions.width_m / 2.0);
        let sharpest_per_m = path_curvature(road.sharpest_per_m(), road);
        let v = ego.state.speed_mps;
        let is_slow_enough = v <= profile.speed_limit_mps(ego.frenet.s_m) + ROUNDING_MPS;
        let mut lateral = Self {
            road,
            safety,
            front_m,
            rear_m: ego.dimensions.rear_overhang_m,
            half_width_m,
            wheelbase_m: ego.dimensions.wheelbase_m,
            strip,
            speed_mps: v,
            now: ego.frenet,
            next,
            next_s_m: [next.s_m; 2],
            sagitta_m: 0.5 * sharpest_per_m * (front_m.powi(2) + half_width_m.powi(2)),
            longest_metre: profile.longest_metre(),
            sharpest_per_m,
            floor_per_m: if is_slow_enough {
                profile.counter_floor_per_m()
            } else {
                f64::NEG_INFINITY
            },
            lock: tan_delta_limit(v, ego.dimensions.wheelbase_m, safety),
            heading_noise_rad: 0.0,
            h_m: [[0.0; 2]; 2],
        };
        lateral.heading_noise_rad = lateral.heading_noise_rad(v, safety.overrun(v));
        lateral.next_s_m = lateral.next_s_m();
        let back = lateral.way_back(v);
        lateral.h_m = Side::BOTH.map(|side| {
            let room_m = lateral.edge_m(side) - side.sign() * lateral.now.d_m;
            let psi_rad = side.sign() * lateral.now.psi_rad;
            [
                room_m - lateral.excursion_m([lateral.now.s_m; 2], &back, psi_rad),
                room_m - lateral.rear_swing_m(psi_rad),
            ]
        });
        lateral
    }

    /// The smaller of h_y,max and h_y,min at x, in metres.
    pub fn h_m(&self) -> f64 {
        self.h_m
            .as_flattened()
            .iter()
            .fold(f64::INFINITY, |least, h| least.min(*h))
    }

    /// The four barriers, when v+ is at most `v + accel Ts`; none at standstill, where the body
    /// can't turn.
    pub fn barriers(&self, accel_mps2: f64) -> impl Iterator<Item = Steering<'_>> {
        let moves = self.speed_mps * STEP_S >= 1e-7;
        let back = self.way_back(self.next_mps(accel_mps2));
        let next_room_m = Side::BOTH.map(|side| self.edge_m(side) - self.next_d_m(side));
        Side::BOTH
            .into_iter()
            .flat_map(|side| [(side, Part::Front), (side, Part::Rear)])
            .filter(move |_| moves)
            .map(move |(side, part)| Steering {
                lateral: self,
                side,
                part,
                next_room_m: next_room_m[side as usize],
                back,
            })
    }

    /// The row that keeps v+ slow enough for the steering to bring the body back, where not all of
    /// the accelerations from `slowest` to `fastest` are.
    pub fn speed_row(&self, slowest: f64, fastest: f64) -> Option<Row> {
        if self.steering_room(fastest) >= 0.0 {
            return None;
        }
        let accel = largest(slowest, fastest, |accel| self.steering_room(accel));
        let accel = accel.unwrap_or(slowest);
        let kind = BarrierKind::LateralMax;
        Some(Row::at_most(kind, Input::Accel, accel, self.h_m()))
    }

    /// The room that full counter-steering leaves at this acceleration, in metres: negative where
    /// no steering meets the front's rows.
    fn steering_room(&self, accel_mps2: f64) -> f64 {
        self.barriers(accel_mps2)
            .filter(|steering| steering.part == Part::Front)
            .map(|steering| steering.margin_m(steering.side.sign() * -self.lock))
            // An infinite excursion leaves no room, whatever it is to be compared with.
            .map(|room_m| {
                if room_m.is_nan() {
                    f64::NEG_INFINITY
                } else {
                    room_m
                }
            })
            .fold(f64::INFINITY, f64::min)
    }

    fn next_mps(&self, accel_mps2: f64) -> f64 {
        (self.speed_mps + accel_mps2 * STEP_S + self.safety.noise_speed_mps).max(0.0)
    }

    fn edge_m(&self, side: Side) -> f64 {
        let edge = match side {
            Side::Left => self.strip.left_m,
            Side::Right => -self.strip.right_m,
        };
        edge - self.sagitta_m
    }

    /// Offset towards `side` at x+, at the most: with side slip, and a step that is longer by the
    /// noise in position.
    fn next_d_m(&self, side: Side) -> f64 {
        let step_m = self.speed_mps * STEP_S;
        let heading = side.sign() * self.now.psi_rad;
        let sideways = (heading + self.safety.noise_slip_rad).sin();
        // Driving towards the side a longer step is the worse one, away from it a shorter one.
        let farther = self.safety.overrun(self.speed_mps) * sideways.abs();
        side.sign() * self.next.d_m + step_m * (sideways + farther - heading.sin())
    }

    /// From where to where on the road the vehicle may be at x+.
    fn next_s_m(&self) -> [f64; 2] {
        let step_m = self.speed_mps * STEP_S;
        let slip = self.safety.noise_slip_rad * self.now.psi_rad.sin().abs();
        let noise_m = self.longest_metre * step_m * (self.safety.overrun(self.speed_mps) + slip);
        [self.next.s_m - noise_m, self.next.s_m + noise_m]
    }

    /// What the heading relative to the road may differ by after a step: the noise in curvature,
    /// and the road's turn over the noise in position.
    fn heading_noise_rad(&self, speed_mps: f64, overrun: f64) -> f64 {
        let per_m = self.safety.noise_curvature_per_m + self.sharpest_per_m * overrun;
        speed_mps * STEP_S * (1.0 + overrun) * per_m
    }

    /// What it takes to steer back at `speed_mps`.
    ///
    /// For a sampled controller with noise the heading is taken larger by the side slip and by the
    /// road's own turn within a step. The rear corner swings by as much when the way back ends.
    ///
    /// A slower vehicle has no less curvature of its own, so that braking never takes any: the share
    /// of noise in position rises as the speed falls, and at the lock of the wheels counts in full.
    fn way_back(&self, speed_mps: f64) -> WayBack {
        let speed_mps = speed_mps.max(self.first_step_mps());
        let overrun = self.safety.overrun(speed_mps);
        let step_m = speed_mps * STEP_S * (1.0 + overrun);
        let shift_rad = self.sharpest_per_m * step_m + self.safety.noise_slip_rad;
        let swing = shift_rad + 2.0 * self.heading_noise_rad(speed_mps, overrun);
        let lock = tan_delta_limit(speed_mps, self.wheelbase_m, self.safety);
        let sure_per_m = |tan_delta: f64, overrun: f64| {
            (tan_delta / self.wheelbase_m - self.safety.noise_curvature_per_m) / (1.0 + overrun)
        };
        let wheels = sure_per_m(self.safety.tan_delta_max, self.safety.overrun(0.0));
        let own_per_m = sure_per_m(lock, overrun).min(wheels);
        WayBack {
            step_m,
            shift_rad,
            rear_m: self.rear_m * swing,
            own_per_m,
            least_per_m: (own_per_m - self.sharpest_per_m).max(self.floor_per_m),
        }
    }

    /// How far from the rear axle's offset the body reaches to the left until a vehicle with
    /// heading `psi_rad` runs parallel to the road, when it steers back at once.
    ///
    /// At heading theta on the way the axle has moved by (cos theta - cos psi) / k_c, and the
    /// front corner lies x_f sin theta + w/2 cos theta off it: the sum peaks where
    /// tan theta = x_f / (1/k_c + w/2). The step driven before the steering acts joins,
    /// v Ts sin psi.
    ///
    /// `s_m` is from where to where on the road it may be.
    fn excursion_m(&self, s_m: [f64; 2], back: &WayBack, psi_rad: f64) -> f64 {
        let psi = (psi_rad + back.shift_rad).min(std::f64::consts::FRAC_PI_2);
        if psi <= 0.0 {
            return self.half_width_m + back.rear_m;
        }
        let counter = self.counter_curvature(s_m, back, psi);
        if counter <= 0.0 {
            return f64::INFINITY;
        }
        let arm = 1.0 / counter + self.half_width_m;
        let (sin, cos) = psi.sin_cos();
        let corner = if sin * arm <= cos * self.front_m {
            self.front_m * sin + self.half_width_m * cos
        } else {
            arm.hypot(self.front_m) - cos / counter
        };
        corner + back.rear_m + back.step_m * sin
    }

    /// At standstill there is no steering: what the first step's speed costs is counted before.
    fn first_step_mps(&self) -> f64 {
        self.safety.accel_max_mps2 * STEP_S + self.safety.noise_speed_mps
    }

    /// k_c: the vehicle's own curvature by which it can turn in a metre driven, less the road's,
    /// over the road of the return manoeuvre. Where that road is too sharp for the speed of now,
    /// the speed's own barrier sees to it that the floor is left.
    ///
    /// The return takes as long a road as the least counter-curvature needs for the heading, so
    /// that its end does not run away from a vehicle which steers back.
    fn counter_curvature(&self, s_m: [f64; 2], back: &WayBack, psi_rad: f64) -> f64 {
        if back.least_per_m <= 0.0 {
            return back.least_per_m;
        }
        // On the inside of a curve a metre driven is more than one of the road's.
        let length_m = FARTHER * self.longest_metre * psi_rad / back.least_per_m;
        let sharpest = self.road.max_abs_curvature(s_m[0], s_m[1] + length_m);
        (back.own_per_m - path_curvature(sharpest, self.road)).max(self.floor_per_m)
    }

    /// Reach of the rear corner at a heading towards the side: it swings out while the heading
    /// points away, the farthest at tan = rear / half width.
    fn rear_swing_m(&self, psi_rad: f64) -> f64 {
        if psi_rad >= 0.0 {
            return self.half_width_m;
        }
        let (sin, cos) = (-psi_rad).sin_cos();
        if sin * self.half_width_m >= cos * self.rear_m {
            return self.rear_m.hypot(self.half_width_m);
        }
        self.rear_m * sin + self.half_width_m * cos
    }
}

/// What it takes to steer back at one speed.
#[derive(Debug, Clone, Copy)]
struct WayBack {
    /// Way driven before the steering acts, in metres.
    step_m: f64,
    /// Heading that noise and the road add within that step.
    shift_rad: f64,
    /// What the rear corner swings by when the way back ends, in metres.
    rear_m: f64,
    /// Curvature at full lock that is sure to be reached, in 1/m.
    own_per_m: f64,
    /// Counter-curvature that it leaves anywhere on the road, in 1/m.
    least_per_m: f64,
}

/// Which end of the body a barrier is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Front,
    Rear,
}

/// h_y,max or h_y,min, of one end of the body.
#[derive(Debug, Clone, Copy)]
pub struct Steering<'a> {
    lateral: &'a Lateral<'a>,
    side: Side,
    part: Part,
    /// From the rear axle to the edge at x+, in metres, at the least.
    next_room_m: f64,
    /// At the largest v+.
    back: WayBack,
}

impl Steering<'_> {
    /// h(x+) less its target at `tan_delta`. It falls as the front turns towards the side, or the
    /// rear away from it.
    fn margin_m(&self, tan_delta: f64) -> f64 {
        self.h_at_m(tan_delta, &self.back) - self.target()
    }

    fn h_at_m(&self, tan_delta: f64, back: &WayBack) -> f64 {
        let Self { lateral, side, .. } = *self;
        let step_m = lateral.speed_mps * STEP_S;
        let noise = lateral.heading_noise_rad;
        let turned = lateral.next.psi_rad + step_m / lateral.wheelbase_m * tan_delta;
        let reach_m = match self.part {
            Part::Front => {
                let psi = side.sign() * turned + noise;
                lateral.excursion_m(lateral.next_s_m, back, psi)
            }
            Part::Rear => lateral.rear_swing_m(side.sign() * turned - noise),
        };
        self.next_room_m - reach_m
    }
}

/// The road of the return manoeuvre is looked at a little farther, so that noise of second order
/// does not move its end away.
const FARTHER: f64 = 1.01;
/// Room below which a row is met: the rounding of positions on a curved road.
const ROUNDING_M: f64 = 1e-9;
/// A speed above its limit by no more than this is rounding.
const ROUNDING_MPS: f64 = 1e-6;
/// What rounding may add up to.
const ROUNDING_IN_ALL_M: f64 = 1e-7;

impl Barrier for Steering<'_> {
    fn kind(&self) -> BarrierKind {
        self.side.kind()
    }

    fn h(&self) -> f64 {
        self.lateral.h_m[self.side as usize][self.part as usize]
    }

    fn h_next(&self, u: ControlInput) -> f64 {
        let next_mps = self.lateral.next_mps(u.accel_mps2);
        self.h_at_m(u.tan_delta, &self.lateral.way_back(next_mps))
    }

    /// The rear corner may use its room up at once: the steering moves it directly, and a decay
    /// would keep the front from being steered back.
    fn target(&self) -> f64 {
        match self.part {
            Part::Front => target(self.h(), self.lateral.safety.eta),
            Part::Rear => self.h().min(0.0),
        }
    }

    fn row(&self) -> Row {
        let Self { lateral, .. } = *self;
        let h = self.h();
        let target = self.target();
        let kept = (target - ROUNDING_M).max(target.min(-ROUNDING_IN_ALL_M));
        let lock = lateral.lock;
        // The front must not turn towards the side too much, the rear not away from it.
        let towards = match self.part {
            Part::Front => self.side,
            Part::Rear => self.side.mirrored(),
        };
        let margin = |most: f64| self.h_at_m(towards.sign() * most, &self.back) - kept;
        let most = match largest(-lock, lock, margin) {
            Some(most) if most >= lock => f64::INFINITY,
            Some(most) => most,
            None => f64::NEG_INFINITY,
        };
        match towards {
            Side::Left => Row::at_most(self.kind(), Input::TanDelta, most, h),
            Side::Right => Row::at_least(self.kind(), Input::TanDelta, -most, h),
        }
    }
}
