use std::time::Instant as Clock;

use super::*;

/// A step with one CAV and six others on a curve, each of them tracked.
#[test]
#[ignore = "a timing, for a machine at rest"]
fn a_step_takes_microseconds() {
    let segment = RoadSegment::Clothoid {
        length_m: 500.0,
        from_per_m: 0.0,
        to_per_m: 0.008,
    };
    for others in [1, 6] {
        let road = Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road");
        let truth: Vec<TrueVehicle> = (0..=others)
            .map(|i| {
                let s_m = 100.0 + 30.0 * f64::from(i);
                let state = BicycleState {
                    pose: road.pose_from_frenet(s_m, 3.5 * f64::from(i % 3) - 3.5, 0.0),
                    speed_mps: 15.0,
                };
                TrueVehicle::new(VehicleId(i), VehicleKind::Cav, SEDAN, state, s_m, &road)
            })
            .collect();
        let tracks: Vec<Track> = truth[1..]
            .iter()
            .map(|other| track_of(other, 0.0))
            .collect();
        let sight = SightLine::new([165.0; 3], 0.0);
        let mut monitor = Monitor::new(SafetySettings::default());
        let steps = 200_000;
        let start = Clock::now();
        for step in 0..steps {
            let view = CavView {
                id: VehicleId(0),
                tracks: &tracks,
                sight: Some(&sight),
                manoeuvre: Manoeuvre::KeepLane { lane: lane(2) },
                state: BicycleState::default(),
                wheelbase_m: SEDAN.wheelbase_m,
                input: Some(ControlInput::default()),
            };
            monitor.observe(f64::from(step) * STEP_S, &road, &truth, &[view], []);
        }
        let each_us = start.elapsed().as_secs_f64() * 1e6 / f64::from(steps);
        assert!(each_us < 3.0, "{others} others: {each_us} us");
    }
}
