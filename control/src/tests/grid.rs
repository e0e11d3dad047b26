//! One-step invariance on a dense grid of (g, v, v_k, psi, d, kappa): from every state with h >= 0
//! the extreme inputs that the rows leave, with noise and leader at their worst, lead to a state
//! with h >= 0 whose rows leave an input.

use covista_world::FrenetPose;

use super::*;
use crate::LaneSet;
use crate::barriers::Input;

/// A place on a road, and the lane that is kept there.
struct Place<'a> {
    profile: &'a RoadProfile,
    s_m: f64,
    lane: LaneIndex,
}

/// What the grid showed.
#[derive(Debug, Default)]
struct Seen {
    points: usize,
    steps: usize,
    infeasible: usize,
    lowest_h: f64,
    lowest_lateral_m: f64,
    worst: String,
}

impl Seen {
    fn join(self, other: Self) -> Self {
        let lower =
            other.lowest_h.min(other.lowest_lateral_m) < self.lowest_h.min(self.lowest_lateral_m);
        Self {
            points: self.points + other.points,
            steps: self.steps + other.steps,
            infeasible: self.infeasible + other.infeasible,
            lowest_h: self.lowest_h.min(other.lowest_h),
            lowest_lateral_m: self.lowest_lateral_m.min(other.lowest_lateral_m),
            worst: if lower { other.worst } else { self.worst },
        }
    }
}

/// Ego and leader at one instant.
#[derive(Debug, Clone, Copy)]
struct State {
    ego: EgoState,
    leader: Neighbour,
}

impl Place<'_> {
    fn ego(&self, d_m: f64, psi_rad: f64, speed_mps: f64) -> EgoState {
        let road = self.profile.road();
        let d_m = road.lane_center_m(self.lane) + d_m;
        EgoState {
            station: STATION,
            state: BicycleState {
                pose: road.pose_from_frenet(self.s_m, d_m, psi_rad),
                speed_mps,
            },
            dimensions: SEDAN,
            frenet: FrenetPose {
                s_m: self.s_m,
                d_m,
                psi_rad,
                curvature_per_m: road.curvature(self.s_m),
            },
        }
    }

    fn leader(&self, rear_s_m: f64, speed_mps: f64) -> Neighbour {
        let center_m = self.profile.road().lane_center_m(self.lane);
        let mut lanes = LaneSet::default();
        lanes.insert(self.lane);
        Neighbour {
            id: 1,
            station: None,
            lanes,
            s_rear_m: rear_s_m,
            s_front_m: rear_s_m + 4.6,
            d_right_m: center_m - 0.9,
            d_left_m: center_m + 0.9,
            speed_mps,
            length_m: 4.6,
            reach_m: 2.3,
            best_s_rear_m: rear_s_m,
            best_fast_mps: speed_mps,
            worst_s_rear_m: rear_s_m,
            worst_slow_mps: speed_mps,
            worst_s_front_m: rear_s_m + 4.6,
            worst_fast_mps: speed_mps,
            action: None,
            announced_s: None,
        }
    }

    fn rows(&self, state: &State, into: &mut Rows) {
        let situation = Situation {
            profile: self.profile,
            ego: state.ego,
            neighbours: &[state.leader],
            sight: &SightLine::new([1e4; 3], 0.0),
            time_s: 0.0,
            desired_speed_mps: 10.0,
        };
        let safety = SafetySettings::default();
        into.collect(
            &situation,
            &Course::keep(self.lane),
            &Memory::default(),
            &safety,
        );
    }

    /// The leader so far ahead that h is `h_m`, with the rows of that state; `None` where the gap
    /// for it lies in a curve and is not found at once.
    fn behind(&self, ego: EgoState, leader_mps: f64, h_m: f64, rows: &mut Rows) -> Option<State> {
        let road = self.profile.road();
        let center_m = road.lane_center_m(self.lane);
        let mut rear_s_m = self.s_m + 250.0;
        for _ in 0..4 {
            let leader = self.leader(rear_s_m, leader_mps);
            let state = State { ego, leader };
            self.rows(&state, rows);
            let off_m = front_m(rows) - h_m;
            if off_m.abs() < 1e-10 {
                return Some(state);
            }
            rear_s_m -= off_m / (1.0 - road.curvature(rear_s_m) * center_m);
        }
        None
    }

    /// One step of the plant, everything at its bound: `side` is where slip and curvature err to.
    fn step(&self, state: &State, u: ControlInput, side: f64) -> State {
        let safety = SafetySettings::default();
        let BicycleState { pose, speed_mps: v } = state.ego.state;
        let moves = if v > 0.0 { 1.0 } else { 0.0 };
        let way_m = v * STEP_S * (1.0 + safety.overrun(v));
        let course_rad = pose.yaw_rad + side * moves * safety.noise_slip_rad;
        let curvature = u.tan_delta / SEDAN.wheelbase_m + side * safety.noise_curvature_per_m;
        let next_mps = v + u.accel_mps2 * STEP_S;
        let noise_mps = if next_mps > 1e-12 {
            safety.noise_speed_mps
        } else {
            0.0
        };
        let pose = Se2Pose::new(
            pose.x_m + way_m * course_rad.cos(),
            pose.y_m + way_m * course_rad.sin(),
            pose.yaw_rad + v * STEP_S * curvature,
        );
        let road = self.profile.road();
        let leader = &state.leader;
        let center_m = road.lane_center_m(self.lane);
        let metre = 1.0 / (1.0 - road.curvature(leader.s_rear_m) * center_m);
        let slower = leader.speed_mps - safety.leader_brake_mps2 * STEP_S;
        State {
            ego: EgoState {
                state: BicycleState {
                    pose,
                    speed_mps: (next_mps + noise_mps).max(0.0),
                },
                frenet: road.to_frenet_pose_near(pose, state.ego.frenet.s_m + way_m),
                ..state.ego
            },
            leader: self.leader(
                leader.s_rear_m + leader.speed_mps * STEP_S * metre,
                slower.max(0.0),
            ),
        }
    }

    fn check(&self, state: &State, now: &Rows, next: &mut Rows, seen: &mut Seen) {
        if lowest(now) < 0.0 || now.h_lateral_m < 0.0 {
            return;
        }
        seen.points += 1;
        let (least_tan, most_tan) = now.interval(Input::TanDelta);
        let (hardest, most) = now.interval(Input::Accel);
        if least_tan > most_tan + 1e-9 || hardest > most + 1e-9 {
            seen.infeasible += 1;
            seen.worst = format!("{:?} {:?} {now:?}", state.ego.frenet, state.ego.state);
            return;
        }
        for accel in [most, hardest] {
            for (tan, side) in [(most_tan, 1.0), (least_tan, -1.0)] {
                let reached = self.step(state, input(tan, accel), side);
                self.rows(&reached, next);
                seen.steps += 1;
                let (h, lateral_m) = (lowest(next), next.h_lateral_m);
                if h.min(lateral_m) < seen.lowest_h.min(seen.lowest_lateral_m) {
                    seen.worst = format!(
                        "{:?} {:?} a {accel} tan {tan}: {next:?}",
                        state.ego.frenet, state.ego.state
                    );
                }
                seen.lowest_h = seen.lowest_h.min(h);
                seen.lowest_lateral_m = seen.lowest_lateral_m.min(lateral_m);
            }
        }
    }

    fn check_all(&self, rows: [&mut Rows; 2], seen: &mut Seen) {
        let [now, next] = rows;
        let limit_mps = self.profile.speed_limit_mps(self.s_m).min(40.0);
        let slower = [0.0, 0.004, 0.05, 0.3, 1.5, 4.0, 8.0, 12.0, 16.0, 25.0];
        let speeds = slower.into_iter().filter(|v| *v < 0.96 * limit_mps);
        for speed_mps in speeds.chain([0.97 * limit_mps, limit_mps - 1e-9]) {
            for psi_rad in PSI_RAD {
                for d_m in D_M {
                    let ego = self.ego(d_m, psi_rad, speed_mps);
                    let far = self.leader(self.s_m + 500.0, 30.0);
                    self.rows(&State { ego, leader: far }, now);
                    if now.h_lateral_m < 0.0 {
                        continue;
                    }
                    for leader_mps in [0.0, 0.05, 11.0] {
                        for h_m in [0.0, 0.03, 1.0] {
                            if let Some(state) = self.behind(ego, leader_mps, h_m + 1e-9, now) {
                                self.check(&state, now, next, seen);
                            }
                        }
                    }
                }
            }
        }
    }
}

const PSI_RAD: [f64; 13] = [
    -0.3, -0.12, -0.06, -0.03, -0.01, -0.002, 0.0, 0.002, 0.01, 0.03, 0.06, 0.12, 0.3,
];
const D_M: [f64; 9] = [-0.8, -0.7, -0.5, -0.2, 0.0, 0.2, 0.5, 0.7, 0.8];

fn front_m(rows: &Rows) -> f64 {
    rows.hard[0].h
}

/// Smallest h of the rows that bound the acceleration.
fn lowest(rows: &Rows) -> f64 {
    rows.hard
        .iter()
        .filter(|row| row.input == Input::Accel && !is_lateral(row.kind))
        .fold(f64::INFINITY, |least, row| least.min(row.h))
}

fn is_lateral(kind: covista_world::BarrierKind) -> bool {
    use covista_world::BarrierKind::{LateralMax, LateralMin};
    matches!(kind, LateralMax | LateralMin)
}

/// Into a curve and out of it again, `clothoid_m` each way; 0 begins it at once.
fn curve(curvature_per_m: f64, clothoid_m: f64) -> Road {
    let arc = RoadSegment::Arc {
        length_m: 60.0,
        curvature_per_m,
    };
    let straight = RoadSegment::Straight { length_m: 100.0 };
    let clothoid = |from_per_m, to_per_m| RoadSegment::Clothoid {
        length_m: clothoid_m,
        from_per_m,
        to_per_m,
    };
    let segments = if clothoid_m > 0.0 {
        vec![
            straight,
            clothoid(0.0, curvature_per_m),
            arc,
            clothoid(curvature_per_m, 0.0),
            RoadSegment::Straight { length_m: 900.0 },
        ]
    } else {
        vec![straight, arc, RoadSegment::Straight { length_m: 900.0 }]
    };
    Road::new(Se2Pose::new(3.0, -4.0, 0.7), &segments, 3.5).expect("a road")
}

fn over(road: Road, first: usize) -> Seen {
    let profile = RoadProfile::new(Arc::new(road), &ControlSettings::default());
    let (mut now, mut next, mut seen) = (Rows::default(), Rows::default(), Seen::default());
    for (i, s_m) in [30.0, 80.0, 99.0, 112.0, 128.0, 150.0, 175.0, 215.0]
        .into_iter()
        .enumerate()
    {
        let place = Place {
            profile: &profile,
            s_m,
            lane: lane(((i + first) % 3) as u8),
        };
        place.check_all([&mut now, &mut next], &mut seen);
    }
    seen
}

#[test]
fn every_step_from_the_set_ends_in_the_set() {
    let seen = std::thread::scope(|scope| {
        let roads = [
            straight(),
            curve(1.0 / 80.0, 40.0),
            curve(-1.0 / 80.0, 40.0),
            curve(0.02, 0.0),
            curve(-0.02, 15.0),
            curve(0.004, 30.0),
        ];
        let threads = roads.map(|road| scope.spawn(move || over(road, 1)));
        threads
            .into_iter()
            .map(|thread| thread.join().expect("no panic"))
            .fold(Seen::default(), Seen::join)
    });
    assert!(seen.points > 200_000, "{seen:?}");
    assert_eq!(seen.infeasible, 0, "{seen:?}");
    assert!(
        seen.lowest_h > -1e-6 && seen.lowest_lateral_m > -1e-6,
        "{seen:?}"
    );
}
