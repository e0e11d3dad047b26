use covista_world::{BarrierKind, Road, STEP_S, bicycle_step, wrap_angle};

use super::curve_speed::road_curvature;
use super::{Input, Row, target};
use crate::SafetySettings;
use crate::distance::largest;
use crate::situation::{EgoState, half_width_m};

/// The strip between two offsets d in which the body has to stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strip {
    /// Right edge.
    pub right_m: f64,
    /// Left edge.
    pub left_m: f64,
}

/// The body's reach from the rear axle, in metres.
#[derive(Debug, Clone, Copy)]
struct Body {
    front_m: f64,
    rear_m: f64,
    half_width_m: f64,
}

/// The side of the strip, as the sign that mirrors it to the left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

impl Side {
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
}

/// The lateral barriers of one state.
#[derive(Debug, Clone)]
pub struct Lateral<'a> {
    settings: &'a SafetySettings,
    body: Body,
    wheelbase_m: f64,
    strip: Strip,
    speed_mps: f64,
    s_m: f64,
    d_m: f64,
    psi_rad: f64,
    next_s_m: f64,
    next_d_m: f64,
    /// Heading relative to the road at x+ when driving straight on.
    straight_psi_rad: f64,
    /// Largest |kappa| from the body on to the end of each stretch of road.
    curvature_ahead: CurvatureAhead,
    /// How far a body's end lies off the parallel of the road through the rear axle.
    sagitta_m: f64,
}

impl<'a> Lateral<'a> {
    /// For `ego` in `strip`. The position at x+ does not depend on u and is exact.
    pub fn new(road: &'a Road, ego: &EgoState, strip: Strip, settings: &'a SafetySettings) -> Self {
        let straight = bicycle_step(ego.state, Default::default(), ego.dimensions.wheelbase_m);
        let next = road.to_frenet_pose_near(straight.pose, ego.frenet.s_m);
        let body = Body {
            front_m: ego.front_m(),
            rear_m: ego.dimensions.rear_overhang_m,
            half_width_m: ego.dimensions.width_m / 2.0,
        };
        let sharpest = road_curvature(road.sharpest_per_m(), road);
        Self {
            curvature_ahead: CurvatureAhead::new(road, ego.frenet.s_m - body.rear_m),
            settings,
            body,
            wheelbase_m: ego.dimensions.wheelbase_m,
            strip,
            speed_mps: ego.state.speed_mps,
            s_m: ego.frenet.s_m,
            d_m: ego.frenet.d_m,
            psi_rad: ego.frenet.psi_rad,
            next_s_m: next.s_m,
            next_d_m: next.d_m,
            straight_psi_rad: next.psi_rad,
            sagitta_m: 0.5 * sharpest * (body.front_m.hypot(body.half_width_m)).powi(2),
        }
    }

    /// The smaller of h_y,max and h_y,min at x, in metres.
    pub fn h_m(&self) -> f64 {
        [Side::Left, Side::Right]
            .map(|side| self.front_h_m(side).min(self.rear_h_m(side)))
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    }

    /// The rows on tan(delta) when v+ is at most `v + accel Ts`.
    pub fn rows(&self, accel_mps2: f64) -> Vec<Row> {
        let v = self.speed_mps;
        if v * STEP_S < 1e-7 {
            return Vec::new();
        }
        let next_mps = (v + accel_mps2 * STEP_S + self.settings.noise_speed_mps).max(0.0);
        let limit = tan_delta_limit(v, self.wheelbase_m, self.settings);
        [Side::Left, Side::Right]
            .into_iter()
            .flat_map(|side| {
                [
                    self.front_row(side, next_mps, limit),
                    self.rear_row(side, limit),
                ]
            })
            .collect()
    }

    /// Whether the rows on tan(delta) leave an input at this acceleration.
    pub fn is_feasible(&self, accel_mps2: f64) -> bool {
        let limit = tan_delta_limit(self.speed_mps, self.wheelbase_m, self.settings);
        let (lower, upper) = self
            .rows(accel_mps2)
            .iter()
            .fold((-limit, limit), |(lower, upper), row| {
                (lower.max(row.lower), upper.min(row.upper))
            });
        lower <= upper
    }

    /// h of the side towards which the body is steered back with the counter-curvature that is
    /// left: the edge less the body's farthest reach on the way.
    fn front_h_m(&self, side: Side) -> f64 {
        let reach = self.excursion_m(self.s_m, self.speed_mps, side.sign() * self.psi_rad);
        self.edge_m(side) - side.sign() * self.d_m - reach
    }

    /// h of the rear corner, which swings out when the heading points away from the edge.
    fn rear_h_m(&self, side: Side) -> f64 {
        let swing = self.rear_swing_m(side.sign() * self.psi_rad);
        self.edge_m(side) - side.sign() * self.d_m - swing
    }

    /// The front row: h falls with the heading at x+, so it bounds tan(delta) on the side's side.
    fn front_row(&self, side: Side, next_mps: f64, limit: f64) -> Row {
        let h = self.front_h_m(side);
        let room = self.edge_m(side) - side.sign() * self.next_d_m - target(h, self.settings.eta);
        // The road of the return manoeuvre is cut in stretches: a heading must not end on a cut.
        let next_s_m = self.next_s_m + 1e-6;
        let fits = |psi: f64| self.excursion_m(next_s_m, next_mps, psi) <= room + 1e-9;
        self.steering_row(side, h, limit, fits)
    }

    /// The rear row: the swing grows as the heading turns away from the edge, so it bounds
    /// tan(delta) on the other side. Holding the heading always satisfies it.
    fn rear_row(&self, side: Side, limit: f64) -> Row {
        let h = self.rear_h_m(side);
        let room = self.edge_m(side) - side.sign() * self.next_d_m - target(h, self.settings.eta);
        let mirrored = match side {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        };
        let fits = |psi: f64| self.rear_swing_m(-psi) <= room + 1e-9;
        Row {
            kind: side.kind(),
            ..self.steering_row(mirrored, h, limit, fits)
        }
    }

    /// The row for a condition on the heading towards `side` that fails from some heading on.
    fn steering_row(&self, side: Side, h: f64, limit: f64, fits: impl Fn(f64) -> bool) -> Row {
        let per_tan = self.speed_mps * STEP_S / self.wheelbase_m;
        let psi_of = |tan: f64| side.sign() * self.straight_psi_rad + per_tan * tan;
        let most = largest(-limit, limit, |tan| fits(psi_of(tan)));
        let most = most.unwrap_or(f64::NEG_INFINITY);
        match side {
            Side::Left => Row::at_most(side.kind(), Input::TanDelta, most, h),
            Side::Right => Row::at_least(side.kind(), Input::TanDelta, -most, h),
        }
    }

    fn edge_m(&self, side: Side) -> f64 {
        let edge = match side {
            Side::Left => self.strip.left_m,
            Side::Right => -self.strip.right_m,
        };
        edge - self.sagitta_m
    }

    /// How far from the rear axle's offset the body reaches to the left until a vehicle with
    /// heading `psi_rad` runs parallel to the road, when it steers back at once.
    ///
    /// At heading theta on the way the axle has moved by (cos theta - cos psi) / k_c, and the
    /// front corner lies x_f sin theta + w/2 cos theta off it: the sum peaks where
    /// tan theta = x_f / (1/k_c + w/2). For a sampled controller two terms join: the step driven
    /// before the steering acts, v Ts sin psi, and the road's own turn within a step, by which psi
    /// is taken larger.
    fn excursion_m(&self, s_m: f64, speed_mps: f64, psi_rad: f64) -> f64 {
        let Body {
            front_m,
            rear_m,
            half_width_m: half,
        } = self.body;
        let (counter, road) = self.counter_curvature(s_m, speed_mps, psi_rad);
        let shift = road * speed_mps * STEP_S;
        let psi = (psi_rad + shift).min(std::f64::consts::FRAC_PI_2);
        let flat = half + rear_m * shift;
        if psi <= 0.0 {
            return flat;
        }
        if counter <= 0.0 {
            return f64::INFINITY;
        }
        let arm = 1.0 / counter + half;
        let (sin, cos) = psi.sin_cos();
        let corner = if psi <= (front_m / arm).atan() {
            front_m * sin + half * cos
        } else {
            arm.hypot(front_m) - cos / counter
        };
        corner + rear_m * shift + speed_mps * STEP_S * sin
    }

    /// k_c, and the road's own curvature within it, over the road of the return manoeuvre: at
    /// least k_min of counter-curvature brings the heading back, so that road ends at a point that
    /// does not run away from a vehicle which steers back.
    fn counter_curvature(&self, s_m: f64, speed_mps: f64, psi_rad: f64) -> (f64, f64) {
        let settings = self.settings;
        let length = psi_rad.abs() / settings.counter_curvature_min_per_m + 2.0 * self.body.front_m;
        let road = self.curvature_ahead.up_to(s_m + length);
        let own = tan_delta_limit(speed_mps, self.wheelbase_m, settings) / self.wheelbase_m;
        (own - road, road)
    }

    fn rear_swing_m(&self, psi_rad: f64) -> f64 {
        let Body {
            rear_m,
            half_width_m,
            ..
        } = self.body;
        let widest = (rear_m / half_width_m).atan();
        let (sin, cos) = (-psi_rad).clamp(0.0, widest).sin_cos();
        rear_m * sin + half_width_m * cos
    }
}

/// Running maxima of the road's curvature, in stretches that do not move with the vehicle.
#[derive(Debug, Clone)]
struct CurvatureAhead {
    first_m: f64,
    /// |kappa| / (1 - |kappa| d_max) up to the end of each stretch.
    running_max: [f64; STRETCHES],
    /// The same of the whole road, which stands for what lies beyond.
    sharpest: f64,
}

const STRETCH_M: f64 = 8.0;
const STRETCHES: usize = 16;

impl CurvatureAhead {
    fn new(road: &Road, from_m: f64) -> Self {
        let first_m = (from_m / STRETCH_M).floor() * STRETCH_M;
        let mut sharpest = 0.0_f64;
        let running_max = std::array::from_fn(|i| {
            let start_m = (first_m + STRETCH_M * i as f64).max(from_m);
            let end_m = first_m + STRETCH_M * (i + 1) as f64;
            sharpest = sharpest.max(road.max_abs_curvature(start_m, end_m));
            road_curvature(sharpest, road)
        });
        Self {
            first_m,
            running_max,
            sharpest: road_curvature(road.sharpest_per_m(), road),
        }
    }

    fn up_to(&self, s_m: f64) -> f64 {
        let stretch = ((s_m - self.first_m) / STRETCH_M).max(0.0) as usize;
        self.running_max
            .get(stretch)
            .copied()
            .unwrap_or(self.sharpest)
    }
}

/// |tan(delta)| in U at this speed: the steering's stop and the lateral acceleration.
pub fn tan_delta_limit(speed_mps: f64, wheelbase_m: f64, settings: &SafetySettings) -> f64 {
    let grip = settings.lateral_accel_max_mps2 * wheelbase_m / speed_mps.powi(2).max(1e-9);
    settings.tan_delta_max.min(grip)
}

/// The lanes' strip: from the right edge of the rightmost to the left edge of the leftmost.
pub fn strip_of(road: &Road, lanes: &[covista_world::LaneIndex]) -> Strip {
    let start = Strip {
        right_m: half_width_m(road),
        left_m: -half_width_m(road),
    };
    lanes.iter().fold(start, |strip, &lane| {
        let (right_m, left_m) = road.lane_bounds_m(lane);
        Strip {
            right_m: strip.right_m.min(right_m),
            left_m: strip.left_m.max(left_m),
        }
    })
}

/// Whether a heading difference is small enough to call a lane change done.
pub fn is_parallel(psi_rad: f64) -> bool {
    wrap_angle(psi_rad).abs() < 0.03
}
