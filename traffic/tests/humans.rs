//! Human drivers in whole simulations: they follow, stop, pass and never touch anybody.
#![allow(clippy::expect_used, reason = "helpers of tests")]

use std::collections::BTreeMap;

use covista_traffic::{
    BRAKING_MAX_MPS2, Scenario, Traffic, TrafficVehicle, VehicleId, VehicleKind,
};
use covista_world::{ControlInput, LaneIndex};

const STRAIGHT: &str = r#"
name = "straight"
description = "A straight road."
duration_s = 60.0
perception_period_s = 0.5
lane_width_m = 3.5
look = { sun_elevation_deg = 40.0, sun_azimuth_deg = 0.0, direct_light = 0.5, paint_wear = 0.2, asphalt_albedo = 0.3, haze_per_m = 0.0 }
road = [{ kind = "straight", length_m = 600.0 }]
"#;

fn vehicle(kind: &str, lane: u8, s_m: f64, speed_mps: f64) -> String {
    format!(
        "[[vehicles]]\nkind = \"{kind}\"\nmodel = \"sedan\"\nlane = {lane}\ns_m = {s_m:?}\n\
         speed_mps = {speed_mps:?}\ndesired_speed_mps = 14.0\n"
    )
}

fn obstacle(lane: u8, s_m: f64) -> String {
    format!("[[obstacles]]\nmodel = \"suv\"\nlane = {lane}\ns_m = {s_m:?}\n")
}

fn straight(parts: &[String], seed: u64) -> Traffic {
    let text = format!("{STRAIGHT}{}", parts.concat());
    let scenario = Scenario::parse(&text, "test").expect("a scenario");
    Traffic::new(&scenario, seed).expect("traffic")
}

/// Steps for `duration_s`, checking every step that nobody overlaps or brakes beyond the bound.
fn run(traffic: &mut Traffic, duration_s: f64, mut each: impl FnMut(&Traffic)) {
    let inputs = BTreeMap::new();
    for _ in 0..(duration_s * 100.0) as usize {
        traffic.step(&inputs);
        assert_eq!(traffic.overlapping_pairs(), [], "at {} s", traffic.time_s());
        for vehicle in traffic.vehicles() {
            assert!(vehicle.accel_mps2 >= -BRAKING_MAX_MPS2 - 1e-9);
        }
        each(traffic);
    }
}

fn first(traffic: &Traffic) -> &TrafficVehicle {
    &traffic.vehicles()[0]
}

#[test]
fn a_driver_stops_behind_a_blocked_road() {
    for seed in 0..10 {
        let blocked: Vec<_> = (0..3).map(|lane| obstacle(lane, 200.0)).collect();
        let parts = [vec![vehicle("human", 0, 20.0, 15.0)], blocked].concat();
        let mut traffic = straight(&parts, seed);
        run(&mut traffic, 60.0, |_| ());
        let human = first(&traffic);
        // Sedan and SUV: bumper gap = difference of the axles - 3.6 m - 1.0 m.
        let gap_m = 200.0 - human.frenet.s_m - 4.6;
        assert!(human.state.speed_mps < 0.05, "{}", human.state.speed_mps);
        assert!((1.7..12.0).contains(&gap_m), "{gap_m}");
    }
}

#[test]
fn a_driver_passes_a_stopped_vehicle_and_starts_only_in_sight() {
    for (seed, speed_mps, from_m) in [(0, 15.0, 20.0), (1, 14.0, 60.0), (2, 0.0, 187.0)] {
        let parts = [vehicle("human", 0, from_m, speed_mps), obstacle(0, 200.0)];
        let mut traffic = straight(&parts, seed);
        let mut started_m = None;
        run(&mut traffic, 60.0, |traffic| {
            if started_m.is_none() && first(traffic).human_lane_change().is_some() {
                started_m = Some(first(traffic).frenet.s_m);
            }
        });
        let human = first(&traffic);
        assert!(human.frenet.s_m > 250.0, "{:?}", human.frenet);
        assert_eq!(traffic.road().lane_at(human.frenet.d_m), LaneIndex::new(1));
        assert!(human.frenet.d_m.abs() < 0.05 && human.frenet.psi_rad.abs() < 0.01);
        assert!(started_m.is_some_and(|s_m| s_m > 99.0), "{started_m:?}");
    }
}

#[test]
fn a_driver_waits_for_a_gap() {
    // A column in the next lane, denser than a lane change asks for, then nothing.
    let column = (0..6).map(|i| vehicle("human", 1, 30.0 + 14.0 * f64::from(i), 10.0));
    let parts: Vec<_> = [vehicle("human", 0, 100.0, 10.0), obstacle(0, 150.0)]
        .into_iter()
        .chain(column)
        .collect();
    let mut traffic = straight(&parts, 4);
    run(&mut traffic, 60.0, |_| ());
    assert!(first(&traffic).frenet.s_m > 200.0);
}

#[test]
fn nobody_runs_into_a_leader_that_brakes_as_hard_as_it_can() {
    for seed in 0..10 {
        let parts = [
            vehicle("cav", 1, 80.0, 14.0),
            vehicle("human", 1, 52.0, 14.0),
        ];
        let mut traffic = straight(&parts, seed);
        let full = ControlInput {
            tan_delta: 0.0,
            accel_mps2: -100.0,
        };
        for step in 0..3000 {
            let input = if step < 100 {
                ControlInput::default()
            } else {
                full
            };
            traffic.step(&BTreeMap::from([(VehicleId(1), input)]));
            assert_eq!(traffic.overlapping_pairs(), []);
        }
        // 14 m for the first second, then v^2 / 2b.
        let expected_m = 80.0 + 14.0 + 14.0_f64.powi(2) / (2.0 * BRAKING_MAX_MPS2);
        assert!((first(&traffic).frenet.s_m - expected_m).abs() < 0.1);
    }
}

#[test]
fn an_input_that_is_not_finite_brakes() {
    let mut traffic = straight(&[vehicle("cav", 1, 80.0, 14.0)], 0);
    let input = ControlInput {
        tan_delta: f64::NAN,
        accel_mps2: 1.0,
    };
    traffic.step(&BTreeMap::from([(VehicleId(1), input)]));
    assert!((first(&traffic).state.speed_mps - 13.92).abs() < 1e-12);
}

fn all_human(name: &str) -> Scenario {
    let mut scenario = Scenario::builtin(name).expect(name);
    for entry in &mut scenario.vehicles {
        entry.kind = VehicleKind::Human;
    }
    scenario
}

#[test]
fn humans_alone_drive_the_corner_without_touching() {
    for name in ["obstacle-at-corner", "obstacle-at-corner-mirrored"] {
        for seed in 0..10 {
            let mut traffic = Traffic::new(&all_human(name), seed).expect(name);
            run(&mut traffic, 60.0, |_| ());
        }
    }
}

#[test]
fn a_clear_corner_is_driven_in_the_middle_of_the_lane() {
    let mut traffic = Traffic::new(&all_human("open-corner"), 3).expect("traffic");
    let lanes: Vec<_> = traffic.vehicles().iter().map(|v| v.frenet.d_m).collect();
    run(&mut traffic, 30.0, |traffic| {
        for (vehicle, d_m) in traffic.vehicles().iter().zip(&lanes) {
            assert!(
                (vehicle.frenet.d_m - d_m).abs() < 0.1,
                "{:?}",
                vehicle.frenet
            );
            assert_eq!(vehicle.human_lane_change(), None);
        }
    });
}

#[test]
fn the_wall_hides_the_obstacles() {
    let text = include_str!("../../assets/scenarios/obstacle-at-corner.toml");
    let mut scenario = Scenario::parse(text, "test").expect("a scenario");
    scenario
        .vehicles
        .retain(|entry| entry.lane == LaneIndex::LEFTMOST);
    scenario.vehicles.truncate(1);
    scenario.vehicles[0].kind = VehicleKind::Human;
    let mut traffic = Traffic::new(&scenario, 0).expect("traffic");
    let mut started_m = None;
    run(&mut traffic, 60.0, |traffic| {
        if started_m.is_none() && first(traffic).human_lane_change().is_some() {
            started_m = Some(first(traffic).frenet.s_m);
        }
    });
    // The sight distance past the wall is about 41 m in the left lane.
    assert!(started_m.is_some_and(|s_m| s_m > 205.0), "{started_m:?}");
    assert!(first(&traffic).frenet.s_m > 290.0);
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let scenario = all_human("obstacle-at-corner");
    let states = |seed| {
        let mut traffic = Traffic::new(&scenario, seed).expect("traffic");
        run(&mut traffic, 20.0, |_| ());
        format!("{:?}", traffic.scene())
    };
    assert_eq!(states(5), states(5));
    assert_ne!(states(5), states(6));
}
