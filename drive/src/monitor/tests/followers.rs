use super::*;

/// A CAV in the middle lane changes to the left, `h0_m` outside of the collision set towards a
/// human driver who follows there.
fn change_before(h0_m: f64, ego_mps: f64, behind_mps: f64) -> Scene {
    let mut scene = Scene::new(ego_mps, behind_mps, 100.0);
    scene.other.state.pose.y_m = 3.5;
    let settings = SafetySettings::default();
    let reacted_mps = behind_mps + 0.75;
    let needed_m =
        (0.75 * (behind_mps + 0.375) + reacted_mps.powi(2) / 8.0 - ego_mps.powi(2) / 16.0).max(0.0);
    let apart_m = SEDAN.length_m + settings.collision_margin_m + needed_m + h0_m;
    scene.other.state.pose.x_m = scene.ego.state.pose.x_m - apart_m;
    scene.manoeuvre = Manoeuvre::ChangeLane {
        from: lane(1),
        to: lane(0),
        announced_s: 0.0,
        started_s: 0.0,
    };
    scene
}

fn losses(scene: &Scene) -> Vec<Cause> {
    scene.monitor.rear_losses().keys().copied().collect()
}

#[test]
fn the_start_is_judged_on_the_truth() {
    for (h0_m, unsafe_actions) in [(-0.1, 1), (0.1, 0)] {
        let mut scene = change_before(h0_m, 20.0, 22.0);
        scene.run(0.5);
        assert_eq!(scene.monitor.unsafe_actions(), unsafe_actions);
    }
}

#[test]
fn a_follower_within_its_bounds_loses_nothing() {
    let mut scene = change_before(0.05, 20.0, 22.0);
    scene.other.accel_mps2 = 1.0;
    scene.ego.accel_mps2 = -8.0;
    scene.run(0.75);
    scene.other.accel_mps2 = -4.0;
    scene.run(8.0);
    assert_eq!(losses(&scene), []);
    assert_eq!(scene.causes(), []);
}

#[test]
fn a_follower_beyond_its_bounds_is_named() {
    let mut speeding = change_before(0.05, 20.0, 22.0);
    speeding.other.accel_mps2 = 2.0;
    speeding.ego.accel_mps2 = -8.0;
    speeding.run(0.75);
    speeding.other.accel_mps2 = -4.0;
    speeding.run(8.0);
    assert_eq!(losses(&speeding), [Cause::FollowerMotion]);
    assert_eq!(speeding.causes(), []);

    let mut lazy = change_before(0.05, 20.0, 22.0);
    lazy.run(0.75);
    lazy.other.accel_mps2 = -2.0;
    lazy.ego.accel_mps2 = -8.0;
    lazy.run(8.0);
    assert_eq!(losses(&lazy), [Cause::FollowerMotion]);
}
