//! Exactly one assumption broken, and the monitor names it; none broken, and h holds.

use super::*;

/// The CAV, little more than the promise's allowance outside of its set, is about to brake as hard
/// as it can, and so is the one ahead.
fn both_brake() -> Scene {
    let mut scene = Scene::new(25.0, 22.0, 4.5);
    scene.run(0.2);
    scene.ego.accel_mps2 = -8.0;
    scene.other.accel_mps2 = -8.0;
    scene
}

/// The CAV, on the border of its set behind a standing vehicle, drives into it.
fn drives_on(know: Know) -> Scene {
    let mut scene = Scene::new(15.0, 0.0, 40.0);
    scene.know = know;
    scene
}

#[test]
fn nothing_broken_means_no_violation() {
    let mut scene = both_brake();
    scene.run(6.0);
    assert!(scene.h_m() >= 0.0);
    assert_eq!(scene.causes(), []);
    assert_eq!(scene.monitor.steps_violated().count(), 0);
    assert_eq!(scene.monitor.collision_set_left(), 0);
    assert!(scene.monitor.min_headway_m(EGO).expect("a leader") >= 18.5);
}

#[test]
fn a_run_that_begins_inside_the_set_is_a_start() {
    let mut scene = Scene::new(20.0, 20.0, -1.0);
    assert_eq!(scene.run(0.5).causes(), [Cause::Start]);
    assert_eq!(
        scene.monitor.steps_violated().collect::<Vec<_>>(),
        [(Cause::Start, 50)]
    );
    assert_eq!(scene.monitor.cav_steps(), 50);
}

#[test]
fn a_human_that_comes_over_the_line_inside_the_set_cuts_in() {
    let mut scene = Scene::new(20.0, 20.0, -5.0);
    scene.other.state.pose.y_m = 3.5;
    scene.run(0.5);
    assert_eq!(scene.causes(), []);
    scene.other.state.pose.y_m = 1.0;
    assert_eq!(scene.run(0.5).causes(), [Cause::CutIn]);
}

#[test]
fn what_a_leader_uncovers_inside_the_set_is_revealed() {
    // The free sight reaches past the hidden vehicle: it is hidden behind another in the lane.
    let mut scene = Scene::new(20.0, 0.0, 5.0);
    (scene.know, scene.visible) = (nothing, false);
    scene.sight = Some(SightLine::new([200.0; 3], 0.0));
    scene.run(0.5);
    scene.visible = true;
    assert_eq!(scene.run(0.2).causes(), [Cause::Revealed]);
}

#[test]
fn what_comes_to_lie_before_a_sight_that_broke_off_is_revealed() {
    let mut scene = Scene::new(20.0, 0.0, 3.0);
    (scene.know, scene.visible) = (nothing, false);
    let rear_m = scene.vehicles()[1].s_range_m[0];
    scene.sight = Some(SightLine::new([rear_m + 20.0; 3], 0.0));
    scene.run(0.1);
    scene.sight = Some(SightLine::new([rear_m - 20.0; 3], 0.1));
    assert_eq!(scene.run(0.4).causes(), [Cause::Revealed]);
}

/// The CAV's sight past a leader breaks off, `h_m` before the set of a vehicle seen just before.
fn uncovered_at(h_m: f64) -> Vec<Cause> {
    let mut scene = Scene::new(20.0, 0.0, h_m + 4.0);
    scene.know = nothing;
    let rear_m = scene.vehicles()[1].s_range_m[0];
    scene.sight = Some(SightLine::new([rear_m + 40.0; 3], 0.0).with_open([rear_m - 20.0; 3]));
    scene.run(0.2);
    scene.sight = Some(SightLine::new([rear_m - 6.0; 3], 0.2));
    scene.run(0.5);
    scene.causes()
}

#[test]
fn what_a_cut_out_has_just_uncovered_inside_the_set_is_revealed() {
    assert_eq!(uncovered_at(0.0), [Cause::Revealed]);
    assert_eq!(uncovered_at(5.0), [Cause::Unattributed]);
}

#[test]
fn going_round_a_standing_vehicle_is_leaving() {
    let mut scene = Scene::new(3.0, 0.0, 0.5);
    scene.manoeuvre = Manoeuvre::ChangeLane {
        from: lane(1),
        to: lane(0),
        announced_s: 0.0,
        started_s: 0.0,
    };
    assert_eq!(scene.run(0.5).causes(), [Cause::Leaving]);
    assert_eq!(scene.monitor.collision_set_left(), 0);
    // The collision level is never excused.
    assert_eq!(
        scene.run(8.0).causes(),
        [Cause::Leaving, Cause::Unattributed]
    );
}

#[test]
fn a_leader_that_brakes_harder_than_promised_is_named() {
    let mut scene = both_brake();
    scene.other.accel_mps2 = -12.0;
    assert_eq!(scene.run(3.0).causes(), [Cause::LeaderBraking]);
    let mut reversing = Scene::new(0.0, 0.0, 0.8);
    for _ in 0..60 {
        reversing.other.state.speed_mps = -2.0;
        reversing.run(STEP_S);
    }
    assert_eq!(reversing.causes(), [Cause::LeaderBraking]);
}

#[test]
fn a_plant_that_strays_from_its_input_is_named() {
    let claimed = |accel_mps2: f64, tan_delta: f64| {
        let mut scene = both_brake();
        scene.ego.accel_mps2 = -5.0;
        scene.claimed = Some(ControlInput {
            accel_mps2,
            tan_delta,
        });
        scene.run(4.0);
        scene.causes()
    };
    assert_eq!(claimed(-8.0, 0.0), [Cause::ProcessNoise]);
    assert_eq!(claimed(-5.0, 0.01), [Cause::ProcessNoise]);
    // Within W_v, and within the bound on curvature.
    assert_eq!(claimed(-5.4, 0.0), [Cause::Unattributed]);
    assert_eq!(claimed(-5.0, 2.4e-4), [Cause::Unattributed]);

    let moved = |along_m: f64, across_m: f64| {
        let mut scene = both_brake();
        scene.ego.accel_mps2 = -5.0;
        for _ in 0..400 {
            scene.run(STEP_S);
            scene.ego.state.pose.x_m += along_m;
            scene.ego.state.pose.y_m += across_m;
        }
        scene.causes()
    };
    assert_eq!(moved(2e-3, 0.0), [Cause::ProcessNoise]);
    assert_eq!(moved(0.9e-3, 0.0), [Cause::Unattributed]);
    assert_eq!(moved(0.0, 1e-3), [Cause::ProcessNoise]);
}

#[test]
fn a_vehicle_in_plain_view_that_is_never_known_is_missed() {
    assert_eq!(drives_on(nothing).run(4.0).causes(), [Cause::MissedObject]);
}

#[test]
fn knowledge_that_is_too_old_is_named() {
    let aged = |track: Track, time_s: f64| {
        // Measured once, and carried on.
        let mut track = track;
        track.sightings[0].measured_s = time_s.min(1.0);
        Some(track)
    };
    assert_eq!(drives_on(aged).run(4.0).causes(), [Cause::MessageAge]);
}

#[test]
fn an_error_beyond_its_bound_is_named() {
    let wrong: [Know; 3] = [
        // Farther than it is by more than three deviations of 0.05 m.
        |mut track, _| {
            track.state.center.x_m += 0.25;
            Some(track)
        },
        // Faster than it is by more than three deviations of 0.05 m/s.
        |mut track, _| {
            track.state.velocity_mps.x += 0.25;
            Some(track)
        },
        // Not in the lane that it is in.
        |mut track, _| {
            track.state.center.y_m += 3.0;
            Some(track)
        },
    ];
    for know in wrong {
        assert_eq!(drives_on(know).run(4.0).causes(), [Cause::PerceptionError]);
    }
    let harmless: [Know; 4] = [
        exactly,
        |mut track, _| {
            track.state.center.x_m += 0.14;
            track.state.velocity_mps.x += 0.14;
            Some(track)
        },
        // Nearer and slower than it is: the CAV is only the more careful.
        |mut track, _| {
            track.state.center.x_m -= 2.0;
            Some(track)
        },
        // It is only vision that puts it into the lane.
        |mut track, _| {
            (track.state.center.y_m, track.lane) = (3.0, LaneIndex::new(1));
            Some(track)
        },
    ];
    for know in harmless {
        assert_eq!(drives_on(know).run(4.0).causes(), [Cause::Unattributed]);
    }
}

#[test]
fn a_free_sight_that_reaches_past_what_is_unknown_is_named() {
    let mut scene = drives_on(nothing);
    scene.visible = false;
    scene.sight = Some(SightLine::new([150.0; 3], 0.0));
    let until_inside_s = 40.0 / 15.0;
    scene.run(until_inside_s - 0.8);
    scene.visible = true;
    let rear_m = scene.vehicles()[1].s_range_m[0];
    scene.sight = Some(SightLine::new([rear_m + 2.5; 3], 0.0));
    assert_eq!(scene.run(1.0).causes(), [Cause::SightError]);
}

#[test]
fn a_cav_that_comes_in_unknowing_breaks_its_own_assumption() {
    // The other is a CAV that changes lanes close before the ego vehicle.
    let cuts_in = |error_m: f64| {
        let mut scene = Scene::new(20.0, 20.0, -5.0);
        scene.other = Body::new(VehicleKind::Cav, scene.other.state.pose.x_m, 3.5, 20.0);
        scene.run(1.0);
        let truth = scene.vehicles();
        let mut wrong = track_of(&truth[0], scene.time_s());
        wrong.state.center.x_m -= error_m;
        let own = [PlacedTrack::new(
            track_of(&truth[1], scene.time_s()),
            &road(),
        )];
        let view = |id, tracks, state| CavView {
            id,
            tracks,
            sight: None,
            manoeuvre: Manoeuvre::KeepLane { lane: lane(1) },
            state,
            wheelbase_m: SEDAN.wheelbase_m,
            input: None,
        };
        let wrong = [PlacedTrack::new(wrong, &road())];
        let views = [
            view(EGO, own.as_slice(), scene.ego.state),
            view(OTHER, wrong.as_slice(), scene.other.state),
        ];
        let time_s = scene.time_s();
        scene.monitor.observe(time_s, &road(), &truth, &views, []);
        scene.step += 1;
        scene.other.state.pose.y_m = 0.0;
        scene.run(0.5);
        scene.causes()
    };
    assert_eq!(cuts_in(2.0), [Cause::PerceptionError]);
    assert_eq!(cuts_in(0.0), [Cause::Unattributed]);
}
