use covista_world::{ControlInput, FrenetPose};

use super::*;

fn ring(cavs: usize, density: f64) -> Ring {
    let settings = RingSettings {
        cavs,
        density,
        duration_s: 60.0,
        ..RingSettings::default()
    };
    Ring::new(settings).expect("a ring")
}

/// Inputs that swerve a little, another for each CAV and time.
fn swerving(cavs: usize, step: usize) -> Vec<ControlInput> {
    let input = |cav: usize| {
        let phase = 0.02 * step as f64 + cav as f64;
        ControlInput {
            tan_delta: 0.01 * phase.cos(),
            accel_mps2: 0.5 * phase.sin(),
        }
    };
    (0..cavs).map(input).collect()
}

/// The same ring, everybody some laps further on.
fn shifted(ring: &Ring, laps: f64) -> Ring {
    let mut other = ring.clone();
    let road = other.road.road();
    for vehicle in &mut other.vehicles {
        vehicle.lap_from_m += laps * ring.road.period_m();
        let FrenetPose {
            s_m, d_m, psi_rad, ..
        } = vehicle.frenet();
        if let Mover::Cav(state) = &mut vehicle.mover {
            state.pose = road.pose_from_frenet(s_m, d_m, psi_rad);
        }
    }
    other
}

#[test]
fn humans_a_lap_further_on_drive_the_same_to_the_last_bit() {
    let mut here = ring(0, 0.3);
    let mut there = shifted(&here, 3.0);
    let way_m = 3.0 * here.road.period_m();
    for _ in 0..20_000 {
        here.step(&[]).expect("a step");
        there.step(&[]).expect("a step");
    }
    assert_eq!(here.report(), there.report());
    assert!(here.report().human_lane_changes > 0);
    for (one, other) in here.vehicles().iter().zip(there.vehicles()) {
        assert_eq!(one.place, other.place);
        assert!((other.frenet().s_m - one.frenet().s_m - way_m).abs() < 1e-6);
    }
}

#[test]
fn cavs_a_lap_further_on_drive_the_same_but_for_rounding() {
    let mut here = ring(10, 0.6);
    let mut there = shifted(&here, 2.0);
    for step in 0..1000 {
        let inputs = swerving(10, step);
        here.step(&inputs).expect("a step");
        there.step(&inputs).expect("a step");
    }
    for (one, other) in here.vehicles().iter().zip(there.vehicles()) {
        let (a, b) = (one.place, other.place);
        assert!((a.s_m - b.s_m).abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.d_m - b.d_m).abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.psi_rad - b.psi_rad).abs() < 1e-7, "{a:?} {b:?}");
    }
}

#[test]
fn humans_and_cavs_have_the_same_plant() {
    // A human moves along the road, a CAV in the plane: for the same inputs they stay together.
    let cavs = ring(30, 0.6);
    let mut both = [cavs.vehicles.clone(), ring(0, 0.6).vehicles];
    for (cav, human) in both[0].clone().iter().zip(&mut both[1]) {
        human.place = cav.place;
        human.dimensions = cav.dimensions;
    }
    for step in 0..500 {
        let inputs = swerving(30, step);
        for vehicles in &mut both {
            for (vehicle, input) in vehicles.iter_mut().zip(&inputs) {
                let wheelbase_m = vehicle.dimensions.wheelbase_m;
                let along = wheelbase_m * vehicle.place.curvature_per_m;
                let input = ControlInput {
                    tan_delta: input.tan_delta + along - 0.1 * vehicle.place.psi_rad,
                    ..*input
                };
                vehicle.advance(input, &cavs.road);
            }
        }
    }
    for (cav, human) in both[0].iter().zip(&both[1]) {
        let (a, b) = (cav.frenet(), human.frenet());
        assert!((a.s_m - cav.lap_from_m).abs() > 1.0);
        assert!((a.s_m - b.s_m).abs() < 0.02, "{a:?} {b:?}");
        assert!((a.d_m - b.d_m).abs() < 0.05, "{a:?} {b:?}");
        assert!((a.psi_rad - b.psi_rad).abs() < 0.005, "{a:?} {b:?}");
    }
}

#[test]
fn neighbours_are_those_of_a_search_among_all() {
    let mut ring = ring(0, 0.3);
    let mut compared = 0;
    for round in 0..200 {
        for _ in 0..50 {
            ring.step(&[]).expect("a step");
        }
        let road = &ring.road;
        for (index, vehicle) in ring.vehicles.iter().enumerate() {
            let Some(found) = vehicle.leader else {
                continue;
            };
            let Mover::Human(driver) = &vehicle.mover else {
                panic!("a human")
            };
            if driver.lane_change().is_some() {
                continue;
            }
            // Ahead and in the way, the least way on.
            let lane = road.road().lane_at(vehicle.place.d_m).expect("a lane");
            let swath = driver.swath(lane, road.road());
            let (nearest, _) = ring
                .vehicles
                .iter()
                .enumerate()
                .filter(|&(other, one)| other != index && one.strip(road).across.overlaps(swath))
                .map(|(other, one)| (other, ring.gap_m(vehicle, one)))
                .map(|(other, gap_m)| (other, gap_m.rem_euclid(road.period_m())))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .expect("somebody");
            // Who decides later may have begun to change into the lane since.
            if ring.vehicles[nearest].human_lane_change().is_none() {
                assert_eq!(found as usize, nearest, "round {round}, vehicle {index}");
                compared += 1;
            }
        }
    }
    assert!(compared > 5000, "{compared}");
}

#[test]
fn a_contact_is_counted_once_and_across_the_end_of_a_lap() {
    let mut ring = ring(0, 0.1);
    let period_m = ring.road.period_m();
    let far = ring.vehicles[0].place;
    for (index, vehicle) in ring.vehicles.iter_mut().enumerate() {
        vehicle.lap_from_m = period_m;
        vehicle.place.d_m = 0.0;
        vehicle.place.s_m = 40.0 + 50.0 * index as f64;
    }
    // One at the end of lap 1, the other at the beginning of lap 3: images overlap.
    ring.vehicles[0].place = FrenetPose {
        s_m: period_m - 1.0,
        d_m: 0.0,
        ..far
    };
    ring.vehicles[1].place = FrenetPose {
        s_m: 1.5,
        d_m: 1.0,
        ..far
    };
    ring.vehicles[1].lap_from_m = 3.0 * period_m;
    ring.find_contacts();
    assert_eq!(ring.contacts, [(0, 1)]);
    assert_eq!(ring.sums.collisions, 1);
    ring.find_contacts();
    assert_eq!(ring.sums.collisions, 1);
    ring.vehicles[1].place.d_m = 2.5;
    ring.find_contacts();
    assert_eq!(ring.contacts, []);
    ring.vehicles[1].place.d_m = 1.0;
    ring.find_contacts();
    assert_eq!(ring.sums.collisions, 2);
}
