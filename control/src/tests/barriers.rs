//! Every barrier: its row admits what its h(x+) says, and h(x+) is the worst of one simulated step.

use std::collections::BTreeMap;

use covista_world::BarrierKind;
use proptest::prelude::*;

use super::*;
use crate::barriers::lateral::{Lateral, Strip};
use crate::barriers::{Barrier, Input};
use crate::rows::longitudinal;

const EXACT: f64 = 1e-6;

/// The barriers of a change from lane 1 to lane 0, or of keeping lane 1.
fn visit(
    situation: &Situation<'_>,
    changes: bool,
    accel: f64,
    visit: &mut dyn FnMut(&dyn Barrier),
) {
    let course = if changes {
        Course::change(lane(1), lane(0))
    } else {
        Course::keep(lane(1))
    };
    let safety = SafetySettings::default();
    let road = situation.road();
    let ego = &situation.ego;
    let straight_on = bicycle_step(ego.state, ControlInput::default(), SEDAN.wheelbase_m);
    let next = road.to_frenet_pose_near(straight_on.pose, ego.frenet.s_m);
    longitudinal(
        situation,
        &course,
        &next,
        &Memory::default(),
        &safety,
        visit,
    );
    let strip = Strip::of(road, &course.strip);
    let lateral = Lateral::new(situation.profile, ego, next, strip, &safety);
    for barrier in lateral.barriers(accel) {
        visit(&barrier);
    }
}

/// Whether the row and h(x+) say the same of `u`; a row within rounding of u may say either.
fn agree(barrier: &dyn Barrier, u: ControlInput) -> bool {
    let row = barrier.row();
    let missing = barrier.target() - barrier.h_next(u);
    if row.admits(u) {
        missing <= EXACT
    } else {
        // The other way round: it doesn't forbid what is safe.
        missing >= -EXACT || row.violation(u) < 1e-6
    }
}

/// A state of the corner or a straight road at which one kind of barrier is near zero.
fn random_drive(dice: &mut Dice, kind: BarrierKind) -> Drive {
    let straight_on = kind != BarrierKind::CurveSpeed && dice.uniform(0.0, 1.0) < 0.3;
    let road = if straight_on { straight() } else { corner() };
    let mut drive = Drive::new(road, 1, 100.0, 10.0);
    let s_m = dice.uniform(20.0, 330.0);
    let (d_m, psi_rad) = match kind {
        BarrierKind::LateralMax => (0.3, dice.uniform(0.0, 0.1)),
        BarrierKind::LateralMin => (-0.3, dice.uniform(-0.1, 0.0)),
        _ => (dice.uniform(-0.6, 0.6), dice.uniform(-0.05, 0.05)),
    };
    let limit_mps = drive.profile.speed_limit_mps(s_m).min(30.0);
    let v = match dice.uniform(0.0, 4.0) as usize {
        _ if kind == BarrierKind::CurveSpeed => limit_mps - dice.uniform(0.0, 0.1),
        0 => dice.uniform(0.0, 0.1),
        _ => dice.uniform(0.0, limit_mps),
    };
    drive.state = BicycleState {
        pose: drive.road.pose_from_frenet(s_m, d_m, psi_rad),
        speed_mps: v,
    };
    drive.clear_s_m = s_m + 500.0;
    let speed_mps = dice.uniform(0.0, 15.0);
    drive.others = match kind {
        BarrierKind::FrontCurrent => vec![Other::new(1, s_m + 200.0, 0.0, speed_mps)],
        BarrierKind::FrontTarget => vec![Other::new(1, s_m + 200.0, 3.5, speed_mps)],
        BarrierKind::RearTarget => vec![Other::new(1, s_m - 200.0, 3.5, speed_mps)],
        _ => Vec::new(),
    };
    let room_m = dice.uniform(0.0, 0.4);
    for _ in 0..4 {
        if kind == BarrierKind::CurveSpeed || (v < 1e-4 && is_lateral(kind)) {
            break;
        }
        let h = of_kind(&mut drive, !is_lateral(kind), ControlInput::default(), kind).0;
        match kind {
            BarrierKind::FrontCurrent | BarrierKind::FrontTarget => {
                drive.others[0].s_m -= h - room_m;
            }
            BarrierKind::RearTarget => drive.others[0].s_m += h - room_m,
            BarrierKind::Sight => drive.clear_s_m -= h - room_m,
            _ => {
                let side = if kind == BarrierKind::LateralMax {
                    1.0
                } else {
                    -1.0
                };
                let away = Se2Pose::new(0.0, side * (h - 0.1 * room_m), 0.0);
                drive.state.pose = drive.state.pose.compose(away);
            }
        }
    }
    drive
}

fn is_lateral(kind: BarrierKind) -> bool {
    matches!(kind, BarrierKind::LateralMax | BarrierKind::LateralMin)
}

const KINDS: [BarrierKind; 7] = [
    BarrierKind::FrontCurrent,
    BarrierKind::FrontTarget,
    BarrierKind::RearTarget,
    BarrierKind::Sight,
    BarrierKind::CurveSpeed,
    BarrierKind::LateralMax,
    BarrierKind::LateralMin,
];

#[test]
fn a_row_admits_an_input_where_h_reaches_its_target() {
    let mut dice = Dice(31);
    // How often each kind was looked at and had a finite limit.
    let mut seen = BTreeMap::<String, (usize, usize)>::new();
    for round in 0..3500 {
        let mut drive = random_drive(&mut dice, KINDS[round % KINDS.len()]);
        let changes = round % 3 != 0;
        drive.with_situation(|_, situation| {
            let v = situation.ego.state.speed_mps;
            let hardest = (-8.0_f64).max(-v / STEP_S);
            let fastest = dice.uniform(hardest, 3.0);
            let lock = 0.6_f64.min(4.0 * SEDAN.wheelbase_m / (v * v).max(1e-9));
            visit(situation, changes, fastest, &mut |barrier| {
                // Below zero there are excuses; those are told apart elsewhere.
                if barrier.h() < 0.0 {
                    return;
                }
                let row = barrier.row();
                let mut inputs = vec![
                    input(dice.uniform(-lock, lock), dice.uniform(hardest, 3.0)),
                    input(-lock, hardest),
                    input(lock, 3.0),
                ];
                let limits = [row.lower, row.upper]
                    .into_iter()
                    .filter(|limit| limit.is_finite());
                for limit in limits {
                    for near in [-1e-4, -1e-7, 0.0, 1e-7, 1e-4] {
                        inputs.push(match row.input {
                            Input::TanDelta => input((limit + near).clamp(-lock, lock), 0.0),
                            Input::Accel => input(0.0, (limit + near).clamp(hardest, 3.0)),
                        });
                    }
                }
                for mut u in inputs {
                    if row.input == Input::TanDelta {
                        u.accel_mps2 = fastest;
                    }
                    assert!(
                        agree(barrier, u),
                        "{:?} {u:?} {row:?}: target {} h+ {}",
                        situation.ego,
                        barrier.target(),
                        barrier.h_next(u)
                    );
                }
                let (count, finite) = seen.entry(format!("{:?}", barrier.kind())).or_default();
                *count += 1;
                *finite += usize::from(row.lower.is_finite() || row.upper.is_finite());
            });
        });
    }
    for kind in KINDS {
        let (count, finite) = seen[&format!("{kind:?}")];
        assert!(count > 200 && finite > 50, "{kind:?} {count} {finite}");
    }
}

/// W_p and sup over n of the way that closes while both brake, added up step by step, with the noise
/// of the last step in proportion to its speed.
fn closing_m(mut v: f64, mut v_k: f64) -> f64 {
    let safety = SafetySettings::default();
    let (mut sum, mut most) = (0.0_f64, 0.0_f64);
    let loss = safety.brake_mps2 * STEP_S - safety.noise_speed_mps;
    if v <= 1e-12 {
        return 0.0;
    }
    while v > 1e-12 {
        sum += (v - v_k) * STEP_S + safety.noise_position_m * (v / loss).min(1.0);
        most = most.max(sum);
        v -= loss;
        v_k = (v_k - safety.leader_brake_mps2 * STEP_S).max(0.0);
    }
    safety.noise_position_m + most
}

/// What a follower drives from the step after next to its stop, and the ego vehicle likewise.
fn follower_stop_m(mut v: f64, reaction_s: f64) -> f64 {
    let mut sum = 0.0;
    for _ in 0..(reaction_s / STEP_S).round() as usize {
        sum += v * STEP_S;
        v += STEP_S;
    }
    while v > 0.0 {
        sum += v * STEP_S;
        v -= 4.0 * STEP_S;
    }
    sum
}

fn own_stop_m(mut v: f64) -> f64 {
    let mut sum = 0.0;
    while v > 0.0 {
        sum += v * STEP_S - 1e-3;
        v -= 8.0 * STEP_S + 5e-3;
    }
    sum.max(0.0)
}

/// (kind, h(x), h(x+)) of the first barrier of a kind.
fn of_kind(drive: &mut Drive, changes: bool, u: ControlInput, kind: BarrierKind) -> (f64, f64) {
    drive.with_situation(|_, situation| {
        let mut found = None;
        visit(situation, changes, u.accel_mps2, &mut |barrier| {
            if barrier.kind() == kind && found.is_none() {
                found = Some((barrier.h(), barrier.h_next(u)));
            }
        });
        found.expect("such a barrier")
    })
}

/// From the rear axle to the farthest corner ahead, and behind.
fn reaches_m() -> (f64, f64) {
    let half = SEDAN.width_m / 2.0;
    let front = SEDAN.length_m - SEDAN.rear_overhang_m;
    (front.hypot(half), SEDAN.rear_overhang_m.hypot(half))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn the_front_barrier_is_the_simulated_worst_case(
        v in 0.01..30.0_f64, v_k in 0.0..30.0_f64, away_m in 5.0..150.0_f64, a in -8.0..3.0_f64,
    ) {
        let mut drive = Drive::new(straight(), 1, 100.0, v);
        drive.others = vec![Other::new(1, 100.0 + away_m, 0.0, v_k)];
        let a = a.max(-v / STEP_S);
        let (h, h_next) = of_kind(&mut drive, false, input(0.0, a), BarrierKind::FrontCurrent);
        let circle_m = 0.5 * SEDAN.length_m.hypot(SEDAN.width_m);
        let gap_m = 100.0 + away_m - circle_m - drive.state.pose.x_m - reaches_m().0;
        let keep_m = 18.5 - 4.6;
        prop_assert!((h - (gap_m - keep_m - closing_m(v, v_k))).abs() < EXACT);
        let next_gap_m = gap_m - (v - v_k) * STEP_S - 1e-3;
        let next_mps = v + a * STEP_S;
        let next_mps = if next_mps > 0.0 { next_mps + 5e-3 } else { 0.0 };
        let next = next_gap_m - keep_m - closing_m(next_mps, (v_k - 0.08).max(0.0));
        prop_assert!((h_next - next).abs() < EXACT, "{h_next} {next}");
    }

    #[test]
    fn the_sight_barrier_is_that_of_a_short_vehicle_that_stands(
        v in 0.01..30.0_f64, away_m in 30.0..150.0_f64, a in -8.0..3.0_f64,
    ) {
        let mut drive = Drive::new(straight(), 1, 100.0, v);
        drive.clear_s_m = 100.0 + away_m;
        let a = a.max(-v / STEP_S);
        let (h, h_next) = of_kind(&mut drive, false, input(0.0, a), BarrierKind::Sight);
        let safety = drive.safety();
        // The circle round 3 m by 2.6 m reaches 0.4848 m before it.
        let clear_m = 100.0 + away_m - safety.sight_error_m - 0.484_943_324_127_92;
        let gap_m = clear_m - drive.state.pose.x_m - reaches_m().0;
        let keep_m = 18.5 - 0.5 * (4.6 + safety.shortest_vehicle_m);
        prop_assert!((h - (gap_m - keep_m - closing_m(v, 0.0))).abs() < EXACT);
        let next_mps = v + a * STEP_S;
        let next_mps = if next_mps > 0.0 { next_mps + 5e-3 } else { 0.0 };
        let next = gap_m - v * STEP_S - 1e-3 - keep_m - closing_m(next_mps, 0.0);
        prop_assert!((h_next - next).abs() < EXACT, "{h_next} {next}");
    }

    /// On the safe side of the simulation, by no more than a step of either and rounding up.
    #[test]
    fn the_rear_barrier_bounds_the_simulated_worst_case(
        v in 0.01..30.0_f64, v_b in 0.0..30.0_f64, away_m in 5.0..150.0_f64, a in -8.0..3.0_f64,
        is_cav in any::<bool>(),
    ) {
        let mut drive = Drive::new(straight(), 1, 100.0, v);
        let behind = Other::new(1, 100.0 - away_m, 3.5, v_b);
        drive.others = vec![if is_cav { behind.cav(3, Action::KeepLane, 0.0) } else { behind }];
        let a = a.max(-v / STEP_S);
        let (h, h_next) = of_kind(&mut drive, true, input(0.0, a), BarrierKind::RearTarget);
        let gap_m = drive.state.pose.x_m - reaches_m().1 - (100.0 - away_m + 2.3);
        let reaction_s = if is_cav { 0.1 } else { 0.75 };
        let simulated = |gap_m: f64, v_b: f64, v: f64| {
            gap_m - (18.5 - 4.6) - (follower_stop_m(v_b, reaction_s) - own_stop_m(v)).max(0.0)
        };
        let slack_m = 0.02 * (v + v_b) + 0.2;
        let now = simulated(gap_m, v_b, v);
        prop_assert!((now - slack_m..=now + EXACT).contains(&h), "{h} {now}");
        let next_gap_m = gap_m + v * STEP_S - 1e-3 - v_b * STEP_S;
        let next = simulated(next_gap_m, v_b + STEP_S, (v + a * STEP_S - 5e-3).max(0.0));
        prop_assert!((next - slack_m..=next + EXACT).contains(&h_next), "{h_next} {next}");
    }

    /// Without noise, on a straight road: the corner's way on an arc back to parallel, sampled.
    #[test]
    fn the_lateral_barrier_is_the_simulated_way_back(
        v in 1.0..30.0_f64, d_m in -0.7..0.7_f64, psi in -0.3..0.3_f64,
    ) {
        let settings = formulated(Formulation::NoiseFree);
        let mut drive = Drive::with(settings, straight(), 1, 100.0, v);
        drive.state.pose = Se2Pose::new(100.0, d_m, psi);
        let h = drive.control().h_lateral_m;
        let counter = (0.6 / SEDAN.wheelbase_m).min(4.0 / (v * v));
        let (front_m, half_m) = (SEDAN.length_m - SEDAN.rear_overhang_m, SEDAN.width_m / 2.0);
        let side = |d_m: f64, psi: f64| {
            let rear = SEDAN.rear_overhang_m * (-psi).max(0.0).sin() + half_m * psi.cos();
            let reach = |theta: f64| {
                let drift = (theta.cos() - psi.cos()) / counter;
                drift + front_m * theta.sin() + half_m * theta.cos()
            };
            let ahead = (0..=4000).map(|i| reach(psi * f64::from(i) / 4000.0)).fold(half_m, f64::max);
            let ahead = if psi > 0.0 { ahead + v * STEP_S * psi.sin() } else { half_m };
            let behind = if psi < 0.0 { rear } else { half_m };
            1.75 - d_m - ahead.max(behind)
        };
        let expected = side(d_m, psi).min(side(-d_m, -psi));
        prop_assert!((h - expected).abs() < EXACT, "{h} {expected}");
    }
}

#[test]
fn the_speed_barrier_is_the_limit_less_the_speed() {
    let mut drive = Drive::new(corner(), 1, 100.0, 14.0);
    for s_m in [20.0, 130.0, 180.0, 230.0] {
        drive.state.pose = drive.road.pose_from_frenet(s_m, 0.0, 0.0);
        let (h, h_next) = of_kind(&mut drive, false, input(0.0, 2.0), BarrierKind::CurveSpeed);
        assert!((h - (drive.profile.speed_limit_mps(s_m) - 14.0)).abs() < 1e-9);
        // One step on and 1 mm of noise on the inside of the curve, 5 mm/s of noise, 2 cm/s faster.
        let next_s_m = s_m + 0.14 + 1e-3 * drive.profile.longest_metre();
        let expected = drive.profile.speed_limit_mps(next_s_m) - 14.02 - 5e-3;
        assert!(
            (h_next - expected).abs() < 1e-4,
            "{s_m}: {h_next} {expected}"
        );
    }
}
