use covista_planner::learning::{Environment, Situations};
use covista_traffic::RingSettings;
use covista_world::{Action, LaneIndex, ObjectClass, ObjectState, PerceivedObject, StationId};

use super::{super::sights::Seen, *};
use crate::{
    RingEnvironment, RingEnvironmentSettings, RingPerception,
    environment::{BEHAVIOUR_STEPS, FRAME_STEPS},
};

/// A track within this distance of a vehicle stands for it.
const SAME_OBJECT_M: f64 = 3.0;

/// A ring of 12 vehicles, 6 of them CAVs, on which everybody keeps the lane for `steps` behaviour
/// steps, looked at after each frame.
fn drive(
    perception: RingPerception,
    sharing: bool,
    steps: u64,
    each: &mut dyn FnMut(&RingEnvironment),
) {
    let settings = RingEnvironmentSettings {
        ring: RingSettings {
            vehicles: 12,
            cavs: 6,
            density: 0.3,
            seed: 5,
            ..RingSettings::default()
        },
        perception,
        sharing,
        steps,
        watched: false,
        ..RingEnvironmentSettings::default()
    };
    let mut environment = RingEnvironment::new(settings).expect("a ring");
    let mut situations = Situations::new(environment.shape());
    for _ in 0..steps {
        let time_s = environment.ring.time_s();
        situations.clear();
        environment.observe(&mut situations).expect("observed");
        for cav in &mut environment.cavs {
            let is_safe = cav.options.safe.contains(Action::KeepLane);
            let action = if is_safe {
                Action::KeepLane
            } else {
                Action::EmergencyStop
            };
            cav.set_action(action, time_s);
        }
        for _ in 0..BEHAVIOUR_STEPS / FRAME_STEPS {
            for _ in 0..FRAME_STEPS {
                environment.control_step().expect("a step");
            }
            each(&environment);
        }
    }
}

/// Where the CAV meets a vehicle: the centre of the body.
pub(super) fn met(environment: &RingEnvironment, cav: usize, vehicle: usize) -> Se2Pose {
    let ring = &environment.ring;
    let vehicle = &ring.vehicles()[vehicle];
    let near_m = environment.cavs[cav].frenet.s_m;
    let pose = ring.image_near(vehicle, near_m).state.pose;
    vehicle.dimensions().center_pose(pose)
}

/// The CAV's track of a vehicle, and how far it is from there.
pub(super) fn track_of(
    environment: &RingEnvironment,
    cav: usize,
    vehicle: usize,
) -> Option<(Track, f64)> {
    let center = met(environment, cav, vehicle).position();
    let tracks = environment.knowledge.tracks(&environment.ring, cav);
    let with_error = tracks.into_iter().map(|track| {
        let error_m = (track.state.center.position() - center).norm();
        (track, error_m)
    });
    with_error
        .min_by(|one, other| one.1.total_cmp(&other.1))
        .filter(|(_, error_m)| *error_m < SAME_OBJECT_M)
}

#[test]
fn tracks_lie_about_the_truth_and_some_vehicles_are_missed() {
    let (mut errors_m, mut seen, mut missed) = (Vec::new(), 0, 0);
    drive(RingPerception::Statistical, false, 40, &mut |environment| {
        for cav in 0..6 {
            for Seen { vehicle, .. } in environment.sights.seen(cav) {
                seen += 1;
                match track_of(environment, cav, vehicle) {
                    Some((_, error_m)) => errors_m.push(error_m),
                    None => missed += 1,
                }
            }
        }
    });
    let mean_m = errors_m.iter().sum::<f64>() / errors_m.len() as f64;
    let missed_share = f64::from(missed) / f64::from(seen);
    // Half of the model's errors along a car lie within 0.12 to 0.35 m, depending on distance.
    assert!((0.05..0.5).contains(&mean_m), "{mean_m}");
    assert!((0.002..0.2).contains(&missed_share), "{missed} of {seen}");
}

#[test]
fn whoever_is_met_across_the_beginning_of_a_lap_is_tracked_without_a_jump() {
    let mut before: Vec<Option<(u32, i64, Se2Pose, f64)>> = vec![None; 6 * 12];
    let (mut crossings, mut kept, mut farther, mut tracked) = (0, 0, 0, 0);
    drive(RingPerception::Statistical, true, 120, &mut |environment| {
        let ring = &environment.ring;
        let period_m = ring.road().period_m();
        let then_seen = std::mem::replace(&mut before, vec![None; 6 * 12]);
        let lap_of = |index: usize| (ring.vehicles()[index].frenet().s_m / period_m) as i64;
        for cav in 0..6 {
            for Seen { vehicle, laps, .. } in environment.sights.seen(cav) {
                let now = track_of(environment, cav, vehicle);
                if laps != 0.0 {
                    farther += 1;
                    tracked += usize::from(now.is_some());
                }
                let place = met(environment, cav, vehicle);
                let now = now.map(|(track, error_m)| {
                    (track.id, lap_of(cav) + lap_of(vehicle), place, error_m)
                });
                before[cav * 12 + vehicle] = now;
                let then = then_seen[cav * 12 + vehicle];
                let Some((then, now)) = then.zip(now).filter(|(then, now)| then.1 != now.1) else {
                    continue;
                };
                // One of the two has just begun another lap.
                crossings += 1;
                kept += usize::from(then.0 == now.0);
                let moved_m = (now.2.position() - then.2.position()).norm();
                assert!(
                    moved_m < 2.5 && (now.3 - then.3).abs() < 1.5,
                    "{then:?} {now:?}"
                );
            }
        }
    });
    assert!(
        crossings > 20 && kept * 10 >= crossings * 9,
        "{kept} of {crossings}"
    );
    assert!(
        farther > 100 && tracked * 10 > farther * 8,
        "{tracked} of {farther}"
    );
}

#[test]
fn with_sharing_a_cav_knows_of_vehicles_that_are_hidden_from_it() {
    let hidden_known = |sharing| {
        let (mut hidden, mut known) = (0, 0);
        drive(
            RingPerception::Statistical,
            sharing,
            20,
            &mut |environment| {
                for cav in 0..6 {
                    let own = environment.cavs[cav].state.pose.position();
                    for vehicle in (0..12).filter(|&vehicle| vehicle != cav) {
                        let away_m = (met(environment, cav, vehicle).position() - own).norm();
                        if away_m < 100.0 && !environment.sights.sees(cav, vehicle) {
                            hidden += 1;
                            known += usize::from(track_of(environment, cav, vehicle).is_some());
                        }
                    }
                }
            },
        );
        f64::from(u32::try_from(known).expect("a few")) / f64::from(hidden)
    };
    let (alone, together) = (hidden_known(false), hidden_known(true));
    assert!(
        together > 0.5 && together > alone + 0.3,
        "{alone} {together}"
    );
}

#[test]
fn what_is_told_is_placed_at_the_image_nearest_to_the_one_who_hears_it() {
    let lap_m = Vector2::new(300.0, 40.0);
    let at = |place: Vector2<f64>| Se2Pose::new(place.x, place.y, 0.1);
    let own = Vector2::new(910.0, 125.0);
    let object = |object_id, place| PerceivedObject {
        object_id,
        state: ObjectState {
            center: at(place),
            velocity_mps: Vector2::new(14.0, 1.0),
            length_m: 4.5,
            width_m: 1.8,
            height_m: 1.5,
            class: ObjectClass::Car,
        },
        position_std_m: 0.3,
        velocity_std_mps: 0.5,
        lane: None,
        measured_s: 1.0,
        confidence: 0.9,
    };
    // The sender is a lap behind, and sees somebody still farther behind, who is a lap before us.
    let message = CollectivePerceptionMessage {
        station: StationId(2),
        time_s: 1.0,
        pose: at(own - lap_m - Vector2::new(40.0, 0.0)),
        speed_mps: 14.0,
        accel_mps2: 0.0,
        dimensions: covista_traffic::VehicleModel::Sedan.dimensions(),
        lane: LaneIndex::LEFTMOST,
        action: Action::KeepLane,
        announced_s: 0.0,
        objects: vec![
            object(1, own - lap_m + Vector2::new(20.0, 0.0)),
            object(2, own + Vector2::new(20.0, 0.0)),
        ],
    };
    let heard = nearest(&message, own, lap_m);
    let away = |pose: Se2Pose| pose.position() - own;
    assert!((away(heard.pose) - Vector2::new(-40.0, 0.0)).norm() < 1e-9);
    for object in &heard.objects {
        assert!((away(object.state.center) - Vector2::new(20.0, 0.0)).norm() < 1e-9);
        assert!((object.state.center.yaw_rad - 0.1).abs() < 1e-12);
    }
    assert!(matches!(heard, Cow::Owned(_)));
    let near = heard.into_owned();
    assert!(matches!(nearest(&near, own, lap_m), Cow::Borrowed(_)));
}
