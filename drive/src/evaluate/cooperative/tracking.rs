//! CLEAR MOT: which track shows which vehicle, and for how long.

use std::collections::{BTreeMap, BTreeSet};

use covista_traffic::VehicleId;
use covista_world::Track;

use super::targets::{Target, is_within_range};
use crate::CavSnapshot;

/// A track shows a vehicle up to this distance between their centres, as in nuScenes, in metres.
const SHOWN_WITHIN_M: f64 = 2.0;

/// The tracks of all egos against the truth.
#[derive(Default)]
pub(super) struct TrackingTally {
    pub identity_switches: usize,
    pub fragmentations: usize,
    pub false_tracks: usize,
    errors: Vec<(Target, [f64; 2])>,
    identities: BTreeMap<VehicleId, Identities>,
}

/// For each vehicle the track that showed it last.
type Identities = BTreeMap<VehicleId, Shown>;

#[derive(Debug, Clone, Copy)]
struct Shown {
    track: u32,
    in_last_frame: bool,
}

/// Squared errors, summed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Errors {
    pub count: usize,
    position_m2: f64,
    velocity_m2ps2: f64,
}

impl Errors {
    pub fn position_rmse_m(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.position_m2 / self.count as f64).sqrt())
    }

    pub fn velocity_rmse_mps(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.velocity_m2ps2 / self.count as f64).sqrt())
    }
}

impl TrackingTally {
    /// Forgets who is who: another run begins.
    pub fn next_run(&mut self) {
        self.identities.clear();
    }

    /// Takes up one frame of one ego.
    ///
    /// A vehicle that leaves the range is another one when it comes back.
    pub fn take(&mut self, ego: &CavSnapshot<'_>, targets: &[Target], tracks: &[Track]) {
        let identities = self.identities.entry(ego.id).or_default();
        let matches = matches(identities, targets, tracks);
        for (target, found) in targets.iter().zip(&matches) {
            if !target.within_range {
                identities.remove(&target.id);
                continue;
            }
            let Some(track) = found.map(|index| &tracks[index]) else {
                if let Some(shown) = identities.get_mut(&target.id) {
                    shown.in_last_frame = false;
                }
                continue;
            };
            let shown = Shown {
                track: track.id,
                in_last_frame: true,
            };
            if let Some(before) = identities.insert(target.id, shown) {
                self.identity_switches += usize::from(before.track != track.id);
                self.fragmentations += usize::from(!before.in_last_frame);
            }
            let velocity_error = track.state.velocity_mps - target.velocity_mps;
            self.errors
                .push((*target, [distance_m(target, track), velocity_error.norm()]));
        }
        let used: BTreeSet<usize> = matches.into_iter().flatten().collect();
        self.false_tracks += (tracks.iter().enumerate())
            .filter(|(index, track)| {
                !used.contains(index) && is_within_range(ego, track.state.center.position())
            })
            .count();
    }

    /// The errors of the tracks that show vehicles which `counts` picks.
    pub fn errors_of(&self, counts: impl Fn(&Target) -> bool) -> Errors {
        let errors = self.errors.iter().filter(|(target, _)| counts(target));
        errors.fold(Errors::default(), |sum, (_, [position_m, velocity_mps])| {
            Errors {
                count: sum.count + 1,
                position_m2: sum.position_m2 + position_m.powi(2),
                velocity_m2ps2: sum.velocity_m2ps2 + velocity_mps.powi(2),
            }
        })
    }
}

/// For each target the index of the track that shows it: the one that did last where it still
/// does, then the nearest pairs first.
fn matches(identities: &Identities, targets: &[Target], tracks: &[Track]) -> Vec<Option<usize>> {
    let mut found = vec![None; targets.len()];
    let mut taken = vec![false; tracks.len()];
    let mut pairs: Vec<(bool, f64, usize, usize)> = Vec::new();
    for (i, target) in targets.iter().enumerate() {
        for (j, track) in tracks.iter().enumerate() {
            let distance_m = distance_m(target, track);
            if distance_m <= SHOWN_WITHIN_M {
                let is_new = identities
                    .get(&target.id)
                    .is_none_or(|shown| shown.track != track.id);
                pairs.push((is_new, distance_m, i, j));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    for (_, _, i, j) in pairs {
        if found[i].is_none() && !taken[j] {
            found[i] = Some(j);
            taken[j] = true;
        }
    }
    found
}

fn distance_m(target: &Target, track: &Track) -> f64 {
    (track.state.center.position() - target.footprint.center_m.xy()).norm()
}

#[cfg(test)]
mod tests {
    use covista_sharing::OwnState;
    use covista_world::{
        Action, Detection3d, LaneIndex, ObjectClass, ObjectState, Se2Pose, Sighting, StationId,
    };
    use nalgebra::{Vector2, Vector3};

    use super::*;

    fn ego() -> CavSnapshot<'static> {
        CavSnapshot {
            id: VehicleId(1),
            own: OwnState {
                pose: Se2Pose::default(),
                speed_mps: 0.0,
                accel_mps2: 0.0,
                lane: LaneIndex::LEFTMOST,
                action: Action::KeepLane,
                announced_s: 0.0,
            },
            percepts: None,
        }
    }

    /// At (x, 0), driving along x with 10 m/s.
    fn target(id: u32, x_m: f64) -> Target {
        Target {
            id: VehicleId(id),
            footprint: Detection3d {
                center_m: Vector3::new(x_m, 0.0, 0.0),
                size_m: Vector3::new(4.6, 1.9, 1.5),
                yaw_rad: 0.0,
                class: ObjectClass::Car,
                score: 1.0,
            },
            velocity_mps: Vector2::new(10.0, 0.0),
            within_range: x_m <= 100.0,
            is_cav: false,
            seen_by_ego: true,
            seen_by_a_cav: true,
        }
    }

    fn track(id: u32, x_m: f64, y_m: f64, speed_mps: f64) -> Track {
        Track {
            id,
            station: None,
            state: ObjectState {
                center: Se2Pose::new(x_m, y_m, 0.0),
                velocity_mps: Vector2::new(speed_mps, 0.0),
                length_m: 4.6,
                width_m: 1.9,
                height_m: 1.5,
                class: ObjectClass::Car,
            },
            time_s: 0.0,
            position_std_m: 0.3,
            velocity_std_mps: 0.3,
            confidence: 0.9,
            lane: None,
            action: None,
            announced_s: None,
            sightings: vec![Sighting {
                station: StationId(1),
                measured_s: 0.0,
            }],
        }
    }

    /// Frames of one vehicle at x = 20 m, shown by tracks of these names and places.
    fn one_vehicle(frames: &[&[(u32, f64)]]) -> TrackingTally {
        let mut tally = TrackingTally::default();
        for tracks in frames {
            let tracks: Vec<Track> = tracks
                .iter()
                .map(|&(id, x_m)| track(id, x_m, 0.0, 10.0))
                .collect();
            tally.take(&ego(), &[target(2, 20.0)], &tracks);
        }
        tally
    }

    fn counts(tally: &TrackingTally) -> [usize; 3] {
        [
            tally.identity_switches,
            tally.fragmentations,
            tally.false_tracks,
        ]
    }

    #[test]
    fn errors_in_closed_form() {
        let mut tally = TrackingTally::default();
        let targets = [target(2, 20.0), target(3, 40.0), target(4, 60.0)];
        // 0.5 m and 1.2 m off along and across, 3 m/s and 0 m/s off; nothing near the third.
        let tracks = [
            track(7, 20.3, 0.4, 13.0),
            track(8, 40.0, 1.2, 10.0),
            track(9, 63.0, 0.0, 10.0),
        ];
        tally.take(&ego(), &targets, &tracks);
        let errors = tally.errors_of(|_| true);
        assert_eq!(errors.count, 2);
        let position_m = errors.position_rmse_m().expect("errors");
        assert!((position_m - ((0.25_f64 + 1.44) / 2.0).sqrt()).abs() < 1e-12);
        let velocity_mps = errors.velocity_rmse_mps().expect("errors");
        assert!((velocity_mps - 4.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(counts(&tally), [0, 0, 1]);
        let of_third = tally.errors_of(|target| target.id == VehicleId(4));
        assert_eq!((of_third.count, of_third.position_rmse_m()), (0, None));
    }

    #[test]
    fn a_new_name_for_the_same_vehicle_is_a_switch() {
        let steady: &[(u32, f64)] = &[(7, 20.1)];
        assert_eq!(counts(&one_vehicle(&[steady; 3])), [0, 0, 0]);
        assert_eq!(
            counts(&one_vehicle(&[steady, &[(8, 20.0)], steady])),
            [2, 0, 0]
        );
        // The one that showed it goes on to, though another is nearer.
        let nearer: &[(u32, f64)] = &[(8, 20.0), (7, 21.9)];
        assert_eq!(counts(&one_vehicle(&[steady, nearer])), [0, 0, 1]);
        let too_far: &[(u32, f64)] = &[(8, 20.0), (7, 22.1)];
        assert_eq!(counts(&one_vehicle(&[steady, too_far])), [1, 0, 1]);
    }

    #[test]
    fn a_gap_is_a_fragmentation_and_the_name_is_remembered() {
        let steady: &[(u32, f64)] = &[(7, 20.1)];
        assert_eq!(
            counts(&one_vehicle(&[&[], steady, &[], &[], steady])),
            [0, 1, 0]
        );
        assert_eq!(
            counts(&one_vehicle(&[steady, &[], &[(8, 20.0)]])),
            [1, 1, 0]
        );
        assert_eq!(counts(&one_vehicle(&[steady, &[]])), [0, 0, 0]);
    }

    #[test]
    fn beyond_the_range_nothing_counts() {
        let mut tally = TrackingTally::default();
        let shown = |x_m: f64, name: u32| ([target(2, x_m)], [track(name, x_m, 0.0, 10.0)]);
        for (targets, tracks) in [shown(99.0, 7), shown(101.0, 7), shown(99.0, 8)] {
            tally.take(&ego(), &targets, &tracks);
        }
        tally.take(&ego(), &[], &[track(9, 100.5, 0.0, 0.0)]);
        assert_eq!(counts(&tally), [0, 0, 0]);
        assert_eq!(tally.errors_of(|_| true).count, 2);
    }

    #[test]
    fn egos_and_runs_have_their_own_names() {
        let mut tally = one_vehicle(&[&[(7, 20.0)]]);
        let other = CavSnapshot {
            id: VehicleId(5),
            ..ego()
        };
        tally.take(&other, &[target(2, 20.0)], &[track(1, 20.0, 0.0, 10.0)]);
        tally.next_run();
        tally.take(&ego(), &[target(2, 20.0)], &[track(3, 20.0, 0.0, 10.0)]);
        assert_eq!(counts(&tally), [0, 0, 0]);
    }
}
