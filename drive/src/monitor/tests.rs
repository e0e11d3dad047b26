use covista_world::{
    FrenetPose, ObjectClass, ObjectState, RoadSegment, Se2Pose, Sighting, StationId,
    VehicleDimensions,
};
use nalgebra::Vector2;

use super::*;

const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.7,
    width_m: 1.8,
    height_m: 1.45,
    wheelbase_m: 2.51,
    rear_overhang_m: 1.0,
};

fn road() -> Road {
    let segment = RoadSegment::Straight { length_m: 500.0 };
    Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road")
}

fn vehicle(id: u32, s_m: f64, d_m: f64, speed_mps: f64) -> TrueVehicle {
    TrueVehicle {
        id: VehicleId(id),
        kind: VehicleKind::Cav,
        dimensions: SEDAN,
        frenet: FrenetPose {
            s_m,
            d_m,
            ..FrenetPose::default()
        },
        s_range_m: [s_m - 1.0, s_m + 3.7],
        d_range_m: [d_m - 0.9, d_m + 0.9],
        center: Vector2::new(s_m + 1.35, d_m),
        velocity: Vector2::new(speed_mps, 0.0),
        speed_mps,
        lane: road().lane_at(d_m),
    }
}

fn track_of(vehicle: &TrueVehicle, error_m: f64) -> Track {
    Track {
        id: vehicle.id.0,
        station: None,
        state: ObjectState {
            center: Se2Pose::new(vehicle.center.x + error_m, vehicle.center.y, 0.0),
            velocity_mps: vehicle.velocity,
            length_m: 4.7,
            width_m: 1.8,
            height_m: 1.45,
            class: ObjectClass::Car,
        },
        time_s: 10.0,
        position_std_m: 0.2,
        velocity_std_mps: 0.3,
        confidence: 1.0,
        lane: None,
        action: None,
        announced_s: None,
        sightings: vec![Sighting {
            station: StationId(1),
            measured_s: 10.0,
        }],
    }
}

/// The causes after a safe state and then a short gap, with what the CAV knows then.
fn causes(
    before: [TrueVehicle; 2],
    after: [TrueVehicle; 2],
    known: &[Track],
    in_sight: bool,
) -> Vec<Cause> {
    let mut monitor = Monitor::new(SafetySettings::default());
    let keep = Manoeuvre::KeepLane {
        lane: LaneIndex::RIGHTMOST,
    };
    monitor.sight(VehicleId(1), VehicleId(2), in_sight, 0.0);
    let known_before = [track_of(&before[1], 0.0)];
    let steps = [
        (9.99, &before, known_before.as_slice()),
        (10.0, &after, known),
    ];
    for (time_s, state, tracks) in steps {
        let view = CavView {
            id: VehicleId(1),
            tracks,
            sight: None,
            manoeuvre: keep,
            state: BicycleState::default(),
            wheelbase_m: 2.51,
            input: None,
        };
        monitor.observe(time_s, &road(), state, &[view], []);
    }
    monitor.violations().keys().copied().collect()
}

#[test]
fn barriers_in_closed_form() {
    let mut monitor = Monitor::new(SafetySettings::default());
    let pair = [vehicle(1, 100.0, 0.0, 10.0), vehicle(2, 140.0, 0.0, 10.0)];
    let view = CavView {
        id: VehicleId(1),
        tracks: &[],
        sight: None,
        manoeuvre: Manoeuvre::KeepLane {
            lane: LaneIndex::RIGHTMOST,
        },
        state: BicycleState::default(),
        wheelbase_m: 2.51,
        input: None,
    };
    monitor.observe(0.0, &road(), &pair, &[view], []);
    let barriers = monitor.barriers_of(VehicleId(1)).expect("a leader");
    // Reference points 40 m apart, equal speeds: nothing closes.
    assert!((barriers.headway_m - 40.0).abs() < 1e-9);
    assert!((barriers.h_m - (40.0 - 18.5)).abs() < 1e-9);
    assert!((barriers.h0_m - (40.0 - 4.7 - 2.0)).abs() < 1e-9);
    assert!(monitor.violations().is_empty());
}

#[test]
fn each_broken_assumption_is_named() {
    let ego = vehicle(1, 100.0, 0.0, 10.0);
    let (far, near) = (vehicle(2, 140.0, 0.0, 10.0), vehicle(2, 115.0, 0.0, 10.0));
    let human = |vehicle| TrueVehicle {
        kind: VehicleKind::Human,
        ..vehicle
    };
    let beside = vehicle(2, 115.0, 3.5, 10.0);
    let known = |error_m| [track_of(&near, error_m)];
    assert_eq!(
        causes([ego, human(beside)], [ego, human(near)], &known(0.0), true),
        [Cause::CutIn]
    );
    assert_eq!(
        causes([ego, far], [ego, near], &[], true),
        [Cause::MissedObject]
    );
    assert_eq!(
        causes([ego, far], [ego, near], &[], false),
        [Cause::Revealed]
    );
    assert_eq!(
        causes([ego, far], [ego, near], &known(3.0), true),
        [Cause::PerceptionError]
    );
    let mut old = known(0.0);
    old[0].sightings[0].measured_s = 8.5;
    assert_eq!(
        causes([ego, far], [ego, near], &old, true),
        [Cause::MessageAge]
    );
    assert_eq!(
        causes([ego, far], [ego, near], &known(0.0), true),
        [Cause::Unattributed]
    );
}

#[test]
fn standing_for_five_seconds_is_stuck() {
    let mut monitor = Monitor::new(SafetySettings::default());
    let standing = [vehicle(1, 100.0, 0.0, 0.0)];
    for step in 0..490 {
        monitor.observe(f64::from(step) * 0.01, &road(), &standing, &[], []);
    }
    assert_eq!(monitor.stuck(), 0);
    for step in 490..520 {
        monitor.observe(f64::from(step) * 0.01, &road(), &standing, &[], []);
    }
    assert_eq!(monitor.stuck(), 1);
}
