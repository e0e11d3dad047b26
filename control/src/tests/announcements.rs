//! Who may take a gap that two want, with and without the messages that tell.

use covista_world::{ActionVerdict, BarrierKind};

use super::*;
use crate::Manoeuvre;

/// From lane 0 into lane 1; `other` is in lane 2, `away_m` ahead, and was heard `ago_s` ago.
fn with_a_cav_two_lanes_over(away_m: f64, action: Action, ago_s: f64) -> ActionVerdict {
    let mut drive = Drive::new(straight(), 0, 100.0, 14.0);
    drive.time_s = 10.0;
    drive.controller.set_action(Action::ChangeRight, 9.7);
    let other = Other::new(4, 100.0 + away_m, -3.5, 14.0).cav(3, action, 9.0);
    drive.others = vec![Other {
        heard_s: Some(10.0 - ago_s),
        ..other
    }];
    drive.verdict(Action::ChangeRight)
}

#[test]
fn a_cav_two_lanes_over_that_is_heard_keeps_its_lane() {
    for ago_s in [0.0, 0.1, 0.3] {
        for away_m in [-8.0, 0.0, 8.0] {
            let verdict = with_a_cav_two_lanes_over(away_m, Action::KeepLane, ago_s);
            assert_eq!(verdict, ActionVerdict::Safe, "{ago_s} {away_m}");
        }
    }
}

#[test]
fn a_cav_two_lanes_over_that_is_not_heard_counts_as_entering() {
    for ago_s in [0.301, 0.5, 3.0] {
        let ahead = with_a_cav_two_lanes_over(8.0, Action::KeepLane, ago_s);
        assert_eq!(ahead, ActionVerdict::Unsafe(BarrierKind::FrontTarget));
        let behind = with_a_cav_two_lanes_over(-8.0, Action::KeepLane, ago_s);
        assert_eq!(behind, ActionVerdict::Unsafe(BarrierKind::RearTarget));
        // Whatever it said then.
        let left = with_a_cav_two_lanes_over(8.0, Action::ChangeLeft, ago_s);
        assert_eq!(left, ActionVerdict::Unsafe(BarrierKind::FrontTarget));
        // Far ahead it leaves room.
        let far = with_a_cav_two_lanes_over(60.0, Action::KeepLane, ago_s);
        assert_eq!(far, ActionVerdict::Safe);
    }
}

#[test]
fn an_earlier_announcement_for_the_gap_forbids_it_ahead_and_behind() {
    let taken = ActionVerdict::Unsafe(BarrierKind::Arbitration);
    assert_eq!(
        with_a_cav_two_lanes_over(8.0, Action::ChangeLeft, 0.1),
        taken
    );
    assert_eq!(
        with_a_cav_two_lanes_over(-8.0, Action::ChangeLeft, 0.1),
        taken
    );
    // It goes the other way.
    let away = with_a_cav_two_lanes_over(8.0, Action::ChangeRight, 0.1);
    assert_eq!(away, ActionVerdict::Safe);
}

#[test]
fn one_in_the_own_lane_or_standing_two_lanes_over_does_not_enter() {
    let verdict = |other: Other| {
        let mut drive = Drive::new(straight(), 0, 100.0, 14.0);
        drive.others = vec![other];
        drive.verdict(Action::ChangeRight)
    };
    assert_eq!(verdict(Other::new(1, 70.0, 3.5, 14.0)), ActionVerdict::Safe);
    assert_eq!(
        verdict(Other::new(1, 104.0, -3.5, 0.4)),
        ActionVerdict::Safe
    );
    assert_ne!(
        verdict(Other::new(1, 104.0, -3.5, 0.6)),
        ActionVerdict::Safe
    );
}

#[test]
fn from_the_other_side_it_is_the_same() {
    let mut drive = Drive::new(straight(), 2, 100.0, 14.0);
    drive.others = vec![Other::new(1, 108.0, 3.5, 14.0)];
    let front = ActionVerdict::Unsafe(BarrierKind::FrontTarget);
    assert_eq!(drive.verdict(Action::ChangeLeft), front);
    drive.time_s = 5.0;
    drive.others = vec![Other::new(1, 108.0, 3.5, 14.0).cav(2, Action::ChangeRight, 4.0)];
    let taken = ActionVerdict::Unsafe(BarrierKind::Arbitration);
    assert_eq!(drive.verdict(Action::ChangeLeft), taken);
}

/// Two CAVs on both sides of the lane that both want: each has its controller, senses the other,
/// and hears of its intention ten times a second unless the message is lost.
struct Pair {
    drives: [Drive; 2],
    loss: f64,
    dice: Dice,
}

/// Of the two, the one in lane 2 first where both announce at once.
const STATIONS: [u32; 2] = [8, 3];

impl Pair {
    fn new(away_m: f64, speeds_mps: [f64; 2], loss: f64, seed: u64) -> Self {
        let from = |in_lane, s_m, v| Drive::new(straight(), in_lane, s_m, v);
        let mut drives = [
            from(0, 200.0, speeds_mps[0]),
            from(2, 200.0 + away_m, speeds_mps[1]),
        ];
        let placed = [0, 1].map(|i| {
            let ego = drives[1 - i].ego();
            let d_m = ego.frenet.d_m;
            Other {
                heard_s: Some(-1.0),
                ..Other::new(9, 0.0, d_m, 0.0).cav(STATIONS[1 - i], Action::KeepLane, 0.0)
            }
        });
        for (i, (drive, other)) in drives.iter_mut().zip(placed).enumerate() {
            drive.station = StationId(STATIONS[i]);
            drive.others = vec![other];
        }
        Self {
            drives,
            loss,
            dice: Dice(seed),
        }
    }

    fn step(&mut self, step: usize) {
        for i in [0, 1] {
            let sender = &self.drives[1 - i];
            let (center, speed_mps) =
                (SEDAN.center_pose(sender.state.pose), sender.state.speed_mps);
            let (manoeuvre, time_s) = (sender.controller.manoeuvre(), sender.time_s);
            let road = &self.drives[i].road;
            let place = road.to_frenet(center.position());
            let is_heard = step.is_multiple_of(10) && self.dice.uniform(0.0, 1.0) >= self.loss;
            let other = &mut self.drives[i].others[0];
            (other.s_m, other.d_m, other.speed_mps) = (place.s_m, place.d_m, speed_mps);
            if is_heard {
                other.heard_s = Some(time_s);
                other.action = Some(manoeuvre.action());
                other.announced_s = match manoeuvre {
                    Manoeuvre::Announced { since_s, .. } => Some(since_s),
                    Manoeuvre::ChangeLane { announced_s, .. } => Some(announced_s),
                    Manoeuvre::KeepLane { .. } | Manoeuvre::Abort { .. } => None,
                };
            }
        }
        let outputs = self.drives.each_mut().map(Drive::control);
        for (drive, output) in self.drives.iter_mut().zip(outputs) {
            drive.apply(output.u);
        }
    }

    fn distance_m(&self) -> f64 {
        let s_m = |drive: &Drive| drive.state.pose.x_m;
        (s_m(&self.drives[0]) - s_m(&self.drives[1])).abs()
    }

    fn in_the_middle(&self) -> [bool; 2] {
        self.drives.each_ref().map(|drive| {
            let manoeuvre = drive.controller.manoeuvre();
            let runs = matches!(manoeuvre, Manoeuvre::ChangeLane { .. });
            runs || manoeuvre == (Manoeuvre::KeepLane { lane: lane(1) })
        })
    }
}

/// Runs a pair that announces at the given times; whether each came to the middle lane in the end.
fn contest(away_m: f64, speeds_mps: [f64; 2], at: [usize; 2], loss: f64, seed: u64) -> [bool; 2] {
    let mut pair = Pair::new(away_m, speeds_mps, loss, seed);
    let wants = [Action::ChangeRight, Action::ChangeLeft];
    for step in 0..900 {
        for i in [0, 1] {
            if step == at[i] {
                let time_s = pair.drives[i].time_s;
                pair.drives[i].controller.set_action(wants[i], time_s);
            }
        }
        pair.step(step);
        assert!(
            pair.in_the_middle() != [true; 2] || pair.distance_m() > 18.5 - 1e-6,
            "{away_m} {speeds_mps:?} {at:?} {loss} {seed}: {step}, {} m",
            pair.distance_m()
        );
    }
    pair.in_the_middle()
}

#[test]
fn two_that_announce_for_one_gap_never_both_start() {
    let mut dice = Dice(9);
    let mut one = 0;
    for seed in 1..30 {
        let away_m = dice.uniform(-15.0, 15.0);
        let v = dice.uniform(5.0, 20.0);
        let at = [20, 20 + dice.uniform(0.0, 40.0) as usize];
        let ends = contest(away_m, [v, v], at, 0.0, seed);
        one += usize::from(ends[0] != ends[1]);
    }
    // Messages arrive: somebody gets it.
    assert_eq!(one, 29);
}

#[test]
fn of_two_that_announce_at_once_the_lower_station_goes() {
    assert_eq!(contest(0.0, [14.0, 14.0], [20, 20], 0.0, 1), [false, true]);
    assert_eq!(contest(0.0, [14.0, 14.0], [20, 30], 0.0, 1), [true, false]);
}

#[test]
fn where_messages_are_lost_never_both_start_either() {
    let mut dice = Dice(21);
    for seed in 1..50 {
        let loss = [0.3, 0.7, 0.9, 1.0][seed as usize % 4];
        let away_m = dice.uniform(-25.0, 25.0);
        let v = dice.uniform(5.0, 20.0);
        let slower = v - dice.uniform(0.0, 3.0);
        let at = [20, 20].map(|at| at + dice.uniform(0.0, 60.0) as usize);
        contest(away_m, [v, slower], at, loss, seed);
    }
}

#[test]
fn without_any_message_nobody_beside_another_starts() {
    for away_m in [-6.0, 0.0, 6.0] {
        assert_eq!(contest(away_m, [14.0, 14.0], [20, 20], 1.0, 5), [false; 2]);
    }
}
