use std::sync::Arc;

use covista_world::{LANE_COUNT, Road, STEP_S};

use crate::{ControlSettings, ReferenceSettings, SafetySettings};

/// What the controller needs of a road, computed once for a road and its settings: how fast the
/// curvature ahead lets a vehicle be that brakes as hard as it can, or comfortably. A clone shares
/// it.
#[derive(Debug, Clone)]
pub struct RoadProfile {
    road: Arc<Road>,
    hardest: SpeedProfile,
    comfortable: SpeedProfile,
    counter_floor_per_m: f64,
}

impl RoadProfile {
    /// For `road` under `settings`, which must be valid.
    pub fn new(road: Arc<Road>, settings: &ControlSettings) -> Self {
        let settings = settings.effective();
        let ControlSettings {
            safety, reference, ..
        } = &settings;
        Self {
            hardest: SpeedProfile::new(&road, sure_brake_mps2(&road, safety), safety),
            comfortable: SpeedProfile::new(&road, comfort_brake_mps2(&road, reference), safety),
            counter_floor_per_m: counter_floor_per_m(&road, safety),
            road,
        }
    }

    /// The road.
    pub fn road(&self) -> &Arc<Road> {
        &self.road
    }

    /// Metres of the reference line per metre driven, at the most: on the inside of the sharpest
    /// curve.
    pub fn longest_metre(&self) -> f64 {
        1.0 / inner_share(&self.road)
    }

    /// Counter-curvature that is left anywhere ahead for a vehicle within its speed limit, in 1/m.
    pub fn counter_floor_per_m(&self) -> f64 {
        self.counter_floor_per_m
    }

    /// Largest speed at road s from which hardest braking meets the limit of every curve ahead.
    pub fn speed_limit_mps(&self, s_m: f64) -> f64 {
        self.hardest.speed_mps(s_m)
    }

    /// The least of it between two road s.
    pub fn least_speed_limit_mps(&self, [from_m, to_m]: [f64; 2]) -> f64 {
        self.hardest.least_mps(from_m, to_m)
    }

    /// The same as [`Self::speed_limit_mps`] with the reference's comfortable braking.
    pub fn comfortable_speed_mps(&self, s_m: f64) -> f64 {
        self.comfortable.speed_mps(s_m)
    }
}

/// Braking by metre of the road that is sure to be reached: less the noise in speed, on the
/// innermost path, which is the shortest, and less what the noise in position takes of the way.
fn sure_brake_mps2(road: &Road, safety: &SafetySettings) -> f64 {
    let brake = safety.brake_mps2 - safety.noise_speed_mps / STEP_S;
    let slowest = curve_speed_squared(road.sharpest_per_m(), road, safety).sqrt();
    brake * inner_share(road) / (1.0 + safety.noise_position_m / (slowest * STEP_S))
}

/// k_min, less what position noise takes (a step drives farther than it turns for) and less the
/// noise in curvature.
fn counter_floor_per_m(road: &Road, safety: &SafetySettings) -> f64 {
    let sharpest = road.sharpest_per_m();
    let slowest = curve_speed_squared(sharpest, road, safety).sqrt();
    let share = 1.0 / (1.0 + safety.overrun(slowest));
    let floor = safety.counter_curvature_min_per_m * share
        - path_curvature(sharpest, road) * (1.0 - share)
        - safety.noise_curvature_per_m;
    floor.max(LEAST_COUNTER_PER_M)
}

/// A way back is not taken to be longer than this allows.
const LEAST_COUNTER_PER_M: f64 = 1e-4;

fn comfort_brake_mps2(road: &Road, reference: &ReferenceSettings) -> f64 {
    reference.brake_mps2 * inner_share(road)
}

fn inner_share(road: &Road) -> f64 {
    1.0 - road.sharpest_per_m() * half_width_m(road)
}

/// v^2 <= a_lat_max / (|kappa| + k_min), kappa that of the sharpest path along the road.
fn curve_speed_squared(curvature_per_m: f64, road: &Road, safety: &SafetySettings) -> f64 {
    safety.lateral_accel_max_mps2
        / (path_curvature(curvature_per_m, road) + safety.counter_curvature_min_per_m)
}

/// |kappa| / (1 - |kappa| d_max): the curvature of the sharpest path along the road.
pub(crate) fn path_curvature(curvature_per_m: f64, road: &Road) -> f64 {
    curvature_per_m / (1.0 - curvature_per_m * half_width_m(road))
}

/// Offset d of the road's left edge.
pub(crate) fn half_width_m(road: &Road) -> f64 {
    0.5 * f64::from(LANE_COUNT) * road.lane_width_m()
}

/// Road that is looked at as one, in metres: stretches that do not move with the vehicle, so that
/// the limit ahead never drops at once.
const STRETCH_M: f64 = 2.0;

/// In steps of explicit Euler, braking from v to v_c takes `(v^2 - v_c^2) / (2 b) + (v - v_c) Ts / 2`
/// metres; the second term is bounded by `v Ts / 2`. So with V = v^2 + v b Ts the limit at s is the
/// least over the stretches ahead of `v_c^2 + 2 b (s_stretch - s)`: a recursion from behind.
#[derive(Debug, Clone)]
struct SpeedProfile {
    brake_mps2: f64,
    /// V of each stretch alone.
    own: Arc<[f64]>,
    /// V at the start of each stretch, with all that lies ahead.
    ahead: Arc<[f64]>,
}

impl SpeedProfile {
    fn new(road: &Road, brake_mps2: f64, safety: &SafetySettings) -> Self {
        let count = (road.length_m() / STRETCH_M).ceil() as usize + 2;
        let own: Vec<f64> = (0..count)
            .map(|i| {
                let from_m = STRETCH_M * i as f64;
                let curvature = road.max_abs_curvature(from_m, from_m + STRETCH_M);
                curve_speed_squared(curvature, road, safety)
            })
            .collect();
        let mut ahead = own.clone();
        for i in (0..count - 1).rev() {
            ahead[i] = own[i].min(ahead[i + 1] + 2.0 * brake_mps2 * STRETCH_M);
        }
        Self {
            brake_mps2,
            own: own.into(),
            ahead: ahead.into(),
        }
    }

    fn speed_mps(&self, s_m: f64) -> f64 {
        let last = self.own.len() - 1;
        // Before its start the road is straight, as it is beyond its end.
        let (here, next) = if s_m < 0.0 {
            (self.own[last], 0)
        } else {
            let stretch = ((s_m / STRETCH_M) as usize).min(last);
            (self.own[stretch], (stretch + 1).min(last))
        };
        let way_m = (STRETCH_M * next as f64 - s_m).max(0.0);
        self.of_squared(here.min(self.ahead[next] + 2.0 * self.brake_mps2 * way_m))
    }

    /// Within a stretch the speed does not rise, so that the least is at `to_m` or at the end of a
    /// stretch before.
    fn least_mps(&self, from_m: f64, to_m: f64) -> f64 {
        let stretch = |s_m: f64| (s_m.max(0.0) / STRETCH_M) as usize;
        let last = self.own.len() - 1;
        (stretch(from_m)..stretch(to_m))
            .map(|i| self.own[i.min(last)].min(self.ahead[(i + 1).min(last)]))
            .map(|squared| self.of_squared(squared))
            .fold(self.speed_mps(to_m), f64::min)
    }

    fn of_squared(&self, squared: f64) -> f64 {
        let half = 0.5 * self.brake_mps2 * STEP_S;
        (squared + half * half).sqrt() - half
    }
}

#[cfg(test)]
mod tests {
    use covista_world::{RoadSegment, Se2Pose};

    use super::*;

    #[test]
    fn the_limit_is_the_least_over_the_road_ahead() {
        let segments = [
            RoadSegment::Straight { length_m: 90.0 },
            RoadSegment::Arc {
                length_m: 60.0,
                curvature_per_m: 0.0125,
            },
            RoadSegment::Straight { length_m: 50.0 },
            RoadSegment::Arc {
                length_m: 40.0,
                curvature_per_m: -0.02,
            },
        ];
        let road = Arc::new(Road::new(Se2Pose::default(), &segments, 3.5).expect("a road"));
        let settings = ControlSettings::default();
        let profile = RoadProfile::new(road.clone(), &settings);
        let brake = sure_brake_mps2(&road, &settings.safety);
        for i in -200..1200 {
            let s_m = 0.25 * f64::from(i) + 0.01;
            let first_m = (s_m / STRETCH_M).floor() * STRETCH_M;
            let expected = (0..200)
                .map(|k| first_m + STRETCH_M * f64::from(k))
                .map(|from_m| {
                    let curvature = road.max_abs_curvature(from_m, from_m + STRETCH_M);
                    curve_speed_squared(curvature, &road, &settings.safety)
                        + 2.0 * brake * (from_m - s_m).max(0.0)
                })
                .fold(f64::INFINITY, f64::min);
            let half = 0.5 * brake * STEP_S;
            let expected = (expected + half * half).sqrt() - half;
            let found = profile.speed_limit_mps(s_m);
            assert!((found - expected).abs() < 1e-9, "{s_m}: {found} {expected}");
        }
    }

    #[test]
    fn a_radius_of_80_m_allows_15_6_mps() {
        let arc = RoadSegment::Arc {
            length_m: 400.0,
            curvature_per_m: 0.0125,
        };
        let road = Arc::new(Road::new(Se2Pose::default(), &[arc], 3.5).expect("a road"));
        let limit = RoadProfile::new(road, &ControlSettings::default()).speed_limit_mps(100.0);
        // 4 / (0.0125 / (1 - 0.0125 * 5.25) + 0.003) = 15.6^2, less half a step of braking.
        assert!((limit - 15.57).abs() < 0.05, "{limit}");
    }
}
