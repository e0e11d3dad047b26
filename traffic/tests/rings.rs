//! Traffic on the loop: nobody touches anybody, everybody is where the road says, and the numbers
//! are those of the IDM.
#![allow(clippy::expect_used, reason = "helpers of tests")]

use covista_traffic::{
    Idm, Ring, RingError, RingSettings, RingVehicle, SAFE_DISTANCE_M, VehicleKind, VehicleModel,
};
use covista_world::{ControlInput, LaneIndex, STEP_S, bicycle_step};

fn settings(density: f64, seed: u64) -> RingSettings {
    RingSettings {
        density,
        seed,
        ..RingSettings::default()
    }
}

fn ring(settings: RingSettings) -> Ring {
    Ring::new(settings).expect("a ring")
}

fn run(ring: &mut Ring, duration_s: f64) {
    for _ in 0..(duration_s / STEP_S) as usize {
        ring.step(&[]).expect("a step");
    }
}

/// The vehicles of a lane, by the middles of their bodies in the lap.
fn lane(ring: &Ring, lane: LaneIndex) -> Vec<(f64, &RingVehicle)> {
    let road = ring.road().road();
    let mut found: Vec<_> = ring
        .vehicles()
        .iter()
        .filter(|vehicle| road.lane_at(vehicle.frenet().d_m) == Some(lane))
        .map(|vehicle| {
            let middle_m = vehicle.frenet().s_m + vehicle.dimensions().center_ahead_of_axle_m();
            (middle_m.rem_euclid(ring.road().period_m()), vehicle)
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

/// Distances of the middles of bodies that follow each other.
fn headways_m(ring: &Ring, of: LaneIndex) -> Vec<f64> {
    let middles: Vec<_> = lane(ring, of)
        .iter()
        .map(|(middle_m, _)| *middle_m)
        .collect();
    let next = middles.iter().cycle().skip(1);
    let distance = |(a, b): (&f64, &f64)| (b - a).rem_euclid(ring.road().period_m());
    middles.iter().zip(next).map(distance).collect()
}

#[test]
fn humans_never_touch_nor_brake_hard_at_any_density() {
    for tenths in 1..=9 {
        for seed in 0..5 {
            let mut ring = ring(settings(f64::from(tenths) / 10.0, seed));
            let mut hardest_mps2 = 0.0_f64;
            for _ in 0..40_000 {
                ring.step(&[]).expect("a step");
                let accels = ring.vehicles().iter().map(|vehicle| vehicle.accel_mps2);
                hardest_mps2 = accels.fold(hardest_mps2, f64::min);
            }
            let report = ring.report();
            assert_eq!(report.collisions, 0, "{tenths} {seed}: {report:?}");
            // MOBIL asks nobody to brake harder than 2.5 m/s^2; the speeds go on changing.
            assert!(hardest_mps2 > -3.0, "{tenths} {seed}: {hardest_mps2}");
            let changes = report.human_lane_changes;
            assert!(tenths > 4 || changes > 0, "{tenths} {seed}: {report:?}");
        }
    }
}

#[test]
fn every_start_is_outside_everybodys_safe_distance() {
    for (vehicles, density) in [
        (30, 0.1),
        (30, 0.5),
        (30, 0.9),
        (31, 0.8),
        (7, 0.3),
        (1000, 0.9),
    ] {
        for seed in 0..5 {
            let ring = ring(RingSettings {
                vehicles,
                ..settings(density, seed)
            });
            let speed_mps = ring.vehicles()[0].speed_mps;
            assert!(speed_mps > 1.0, "{speed_mps}");
            // Both brake as hard as they can, process noise off the CAV's: the way it closes in.
            let closing_m = speed_mps.powi(2) / 2.0 * (1.0 / 7.5 - 1.0 / 8.0) + speed_mps / 75.0;
            for of in LaneIndex::all() {
                for headway_m in headways_m(&ring, of) {
                    assert!(headway_m > SAFE_DISTANCE_M + 0.4 + closing_m, "{headway_m}");
                }
            }
            let expected = vehicles as f64 * 18.5 / (3.0 * density);
            assert!((ring.road().period_m() - expected).abs() < 1e-9);
        }
    }
}

#[test]
fn equal_drivers_come_to_the_equilibrium_of_the_idm() {
    for density in [0.5, 0.7] {
        let mut ring = ring(RingSettings {
            desired_speed_spread: 0.0,
            idm_spread: 0.0,
            ..settings(density, 1)
        });
        run(&mut ring, 1500.0);
        let idm = Idm::treiber2000(16.0);
        for of in LaneIndex::all() {
            let vehicles = lane(&ring, of);
            let lengths_m: f64 = vehicles.iter().map(|(_, v)| v.dimensions().length_m).sum();
            let gap_m = (ring.road().period_m() - lengths_m) / vehicles.len() as f64;
            // v with gap = (s0 + v T) / sqrt(1 - (v / v0)^4), Treiber 2000, Eq. 8.
            let v_mps = vehicles[0].1.speed_mps;
            let closed_form_m = (2.0 + 1.6 * v_mps) / (1.0 - (v_mps / 16.0).powi(4)).sqrt();
            assert!(
                (closed_form_m - gap_m).abs() < 0.02,
                "{closed_form_m} {gap_m}"
            );
            assert!((idm.equilibrium_speed_mps(gap_m) - v_mps).abs() < 0.01);
            for (_, vehicle) in vehicles {
                assert!((vehicle.speed_mps - v_mps).abs() < 0.01, "{vehicle:?}");
            }
        }
    }
}

#[test]
fn flow_is_what_passes_a_line() {
    let mut ring = ring(settings(0.4, 3));
    let period_m = ring.road().period_m();
    let laps = |ring: &Ring| -> f64 {
        let vehicles = ring.vehicles().iter();
        vehicles.map(|v| (v.frenet().s_m / period_m).floor()).sum()
    };
    let before = laps(&ring);
    run(&mut ring, 2000.0);
    let passed = laps(&ring) - before;
    let report = ring.report();
    let counted = passed / 3.0 / (report.time_s / 3600.0);
    assert!(
        (counted / report.flow_per_h_lane - 1.0).abs() < 0.01,
        "{counted} {report:?}"
    );
    assert!((report.mean_velocity_mph / report.mean_velocity_mps - 2.236_936).abs() < 1e-5);
    assert!((report.time_s - 2000.0).abs() < 1e-6);
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let end = |seed| {
        let mut ring = ring(settings(0.3, seed));
        run(&mut ring, 60.0);
        format!("{:?} {:?}", ring.vehicles(), ring.report())
    };
    assert_eq!(end(5), end(5));
    assert_ne!(end(5), end(6));
    let mut again = ring(settings(0.3, 9));
    run(&mut again, 20.0);
    again.reset(5).expect("a ring");
    run(&mut again, 60.0);
    assert_eq!(
        end(5),
        format!("{:?} {:?}", again.vehicles(), again.report())
    );
}

#[test]
fn more_cavs_leave_everybody_where_they_were() {
    let rings = [0, 12, 30].map(|cavs| {
        ring(RingSettings {
            cavs,
            ..settings(0.6, 2)
        })
    });
    for (ring, cavs) in rings.iter().zip([0, 12, 30]) {
        for (index, vehicle) in ring.vehicles().iter().enumerate() {
            let known = &rings[0].vehicles()[index];
            let middle = |v: &RingVehicle| v.frenet().s_m + v.dimensions().center_ahead_of_axle_m();
            let moved_m = (middle(vehicle) - middle(known)).abs();
            let laps_m = (moved_m - ring.road().period_m()).abs();
            assert!(moved_m.min(laps_m) < 1e-9);
            assert!((vehicle.desired_speed_mps - known.desired_speed_mps).abs() < 1e-12);
            assert_eq!(vehicle.id.0 as usize, index + 1);
            let (kind, model) = if index < cavs {
                (VehicleKind::Cav, VehicleModel::Sedan)
            } else {
                (VehicleKind::Human, known.model)
            };
            assert_eq!((vehicle.kind(), vehicle.model), (kind, model));
        }
    }
}

#[test]
fn images_are_nearest_and_consistent() {
    let mut ring = ring(RingSettings {
        cavs: 15,
        ..settings(0.9, 4)
    });
    for _ in 0..3000 {
        ring.step(&[ControlInput::default(); 15]).expect("a step");
    }
    let (road, period_m) = (ring.road().road(), ring.road().period_m());
    for one in ring.vehicles() {
        let near_s_m = one.frenet().s_m;
        let own = ring.image_near(one, near_s_m);
        assert_eq!((own.state, own.frenet), (one.state(road), one.frenet()));
        for (other, seen) in ring
            .vehicles()
            .iter()
            .zip(ring.scene_near(near_s_m).vehicles)
        {
            let image = ring.image_near(other, near_s_m);
            assert_eq!(image.state, seen.state);
            assert!((image.frenet.s_m - near_s_m).abs() <= period_m / 2.0 + 1e-9);
            let laps = (image.frenet.s_m - other.frenet().s_m) / period_m;
            assert!((laps - laps.round()).abs() < 1e-9);
            let found = road.to_frenet_pose_near(image.state.pose, image.frenet.s_m);
            assert!((found.s_m - image.frenet.s_m).abs() < 1e-6);
            assert!((found.d_m - image.frenet.d_m).abs() < 1e-6);
            assert!((found.psi_rad - image.frenet.psi_rad).abs() < 1e-9);
            assert!((found.curvature_per_m - image.frenet.curvature_per_m).abs() < 1e-9);
            // Seen from the one as the one is seen from the other.
            let back = ring.image_near(one, image.frenet.s_m);
            let forth_m = image.frenet.s_m - near_s_m;
            assert!((back.frenet.s_m - image.frenet.s_m + forth_m).abs() < 1e-6);
        }
    }
}

#[test]
fn a_cav_is_the_plant_of_the_controller() {
    let mut ring = ring(RingSettings {
        vehicles: 3,
        cavs: 2,
        ..settings(0.2, 0)
    });
    let input = ControlInput {
        tan_delta: 0.002,
        accel_mps2: -0.3,
    };
    let nan = ControlInput {
        tan_delta: f64::NAN,
        accel_mps2: 0.0,
    };
    let road = ring.road().road().clone();
    let mut expected = ring.vehicles()[0].state(&road);
    let start_mps = ring.vehicles()[1].speed_mps;
    for _ in 0..100 {
        ring.step(&[input, nan]).expect("a step");
        expected = bicycle_step(
            expected,
            input,
            VehicleModel::Sedan.dimensions().wheelbase_m,
        );
        assert_eq!(ring.vehicles()[0].state(&road), expected);
    }
    assert!((ring.vehicles()[0].accel_mps2 + 0.3).abs() < 1e-9);
    // Not a number: it brakes as hard as it can.
    assert!((ring.vehicles()[1].speed_mps - start_mps + 8.0).abs() < 1e-9);
}

#[test]
fn the_road_is_long_enough_for_the_duration_and_its_end_is_an_error() {
    let settings = RingSettings {
        vehicles: 1,
        cavs: 1,
        duration_s: 60.0,
        desired_speed_mps: 20.0,
        desired_speed_spread: 0.0,
        ..settings(0.05, 0)
    };
    let mut ring = ring(settings);
    let mut ended_s = None;
    for step in 0..20_000 {
        let cav = &ring.vehicles()[0];
        let place = cav.frenet();
        let input = ControlInput {
            tan_delta: 2.51 * (place.curvature_per_m - 0.02 * place.d_m - 0.3 * place.psi_rad),
            accel_mps2: 20.0 - cav.speed_mps,
        };
        if let Err(error) = ring.step(&[input]) {
            let text = error.to_string();
            assert!(text.starts_with("vehicle 1 has driven"), "{text}");
            assert!(text.contains("raise duration_s"), "{text}");
            ended_s = Some(f64::from(step) * STEP_S);
            break;
        }
        assert!(place.d_m.abs() < 5.0, "{place:?}");
    }
    assert!(ended_s.is_some_and(|s| s > 60.0), "{ended_s:?}");
}

#[test]
fn humans_wait_for_a_cav_and_pass_it() {
    // A CAV that stands: those behind it stop or go round it, and nobody touches anybody.
    for seed in 0..5 {
        let mut ring = ring(RingSettings {
            cavs: 1,
            ..settings(0.2, seed)
        });
        let stop = ControlInput {
            tan_delta: 0.0,
            accel_mps2: -3.0,
        };
        for _ in 0..20_000 {
            ring.step(&[stop]).expect("a step");
        }
        let report = ring.report();
        assert_eq!(report.collisions, 0, "{seed}: {report:?}");
        assert!(report.human_lane_changes > 10, "{seed}: {report:?}");
        assert!(report.mean_velocity_mps > 5.0, "{seed}: {report:?}");
    }
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let base = RingSettings::default();
    let refused = |settings: RingSettings, expected: &str| {
        let error = Ring::new(settings).expect_err(expected);
        let text = error.to_string();
        assert!(text.contains(expected), "{text}");
        assert!(!text.contains('\n'));
    };
    refused(
        RingSettings {
            vehicles: 0,
            ..base
        },
        "set vehicles to 1 or more",
    );
    refused(
        RingSettings { cavs: 31, ..base },
        "31 CAVs among 30 vehicles",
    );
    for density in [0.0, -0.1, 1.01, f64::NAN, f64::INFINITY] {
        refused(RingSettings { density, ..base }, "a number from 0.001 to 1");
    }
    refused(
        RingSettings {
            desired_speed_mps: f64::NAN,
            ..base
        },
        "desired_speed_mps is NaN; set it to a number from 1 to 20",
    );
    refused(
        RingSettings {
            desired_speed_mps: 18.0,
            ..base
        },
        "(1 + desired_speed_spread) is 21.",
    );
    refused(
        RingSettings {
            speed_limit_mps: 50.0,
            ..base
        },
        "speed_limit_mps is 50",
    );
    refused(
        RingSettings {
            desired_speed_spread: -0.1,
            ..base
        },
        "desired_speed_spread is -0.1",
    );
    refused(
        RingSettings {
            idm_spread: f64::INFINITY,
            ..base
        },
        "idm_spread is inf",
    );
    refused(
        RingSettings {
            duration_s: 0.0,
            ..base
        },
        "duration_s is 0",
    );
    refused(
        RingSettings {
            vehicles: 2,
            density: 0.9,
            ..base
        },
        "80 to 200000 m",
    );
    refused(
        RingSettings {
            vehicles: 100_000,
            density: 0.001,
            ..base
        },
        "80 to 200000 m",
    );
    refused(
        RingSettings {
            density: 1.0,
            ..base
        },
        "the loop of 185.0 m holds 27 vehicles outside each other's safe distance, not 30",
    );
    let mut ring = ring(RingSettings { cavs: 2, ..base });
    let error = ring
        .step(&[ControlInput::default()])
        .expect_err("one input for two");
    assert_eq!(error, RingError::Inputs { given: 1, cavs: 2 });
    assert!(error.to_string().contains("1 control inputs for 2 CAVs"));
}
