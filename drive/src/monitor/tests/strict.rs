//! An excuse holds only where h was negative when its reason came.

use super::*;

#[test]
fn a_cut_in_with_room_to_spare_is_no_excuse() {
    let mut scene = Scene::new(25.0, 20.0, 8.0);
    scene.other.state.pose.y_m = 3.5;
    scene.run(0.2);
    scene.other.state.pose.y_m = 0.0;
    assert_eq!(scene.run(0.5).causes(), []);
    assert_eq!(scene.run(3.0).causes(), [Cause::Unattributed]);
}

#[test]
fn an_excuse_ends_when_the_set_is_reached() {
    let mut scene = Scene::new(20.0, 20.0, -3.0);
    scene.run(0.1);
    scene.other.accel_mps2 = 2.0;
    scene.run(4.0);
    assert!(scene.h_m() > 5.0);
    scene.other.accel_mps2 = -2.0;
    assert_eq!(
        scene.run(12.0).causes(),
        [Cause::Start, Cause::Unattributed]
    );
}

#[test]
fn an_excuse_lasts_within_the_allowance_of_the_promise() {
    // h is just above zero, but not less what the promise allows for noise: the filter is still
    // winning its distance back when the one ahead brakes.
    let mut scene = Scene::new(20.0, 20.0, -0.02);
    scene.run(0.2);
    scene.ego.state.pose.x_m -= 0.05;
    scene.run(0.2);
    assert!(scene.h_m() > 0.0);
    scene.ego.state.pose.x_m += 0.05;
    scene.run(0.2);
    assert_eq!(scene.monitor.violations().get(&Cause::Start), Some(&2));
    assert_eq!(scene.causes(), [Cause::Start]);
}

/// The CAV, which knows nothing of the standing vehicle ahead, has it in sight for so long before h
/// becomes negative, towards it and where it comes into sight.
fn seen_before_the_violation(seconds: f64) -> Vec<Cause> {
    let mut scene = Scene::new(15.0, 0.0, 30.0);
    (scene.know, scene.visible) = (nothing, false);
    let rear_m = scene.vehicles()[1].s_range_m[0];
    scene.sight = Some(SightLine::new([rear_m - 0.5; 3], 0.0));
    scene.run(30.0 / 15.0 - seconds);
    scene.visible = true;
    scene.run(seconds + 0.2);
    scene.causes()
}

#[test]
fn what_comes_into_sight_with_room_to_stop_is_no_reveal() {
    assert_eq!(seen_before_the_violation(0.3), [Cause::Unattributed]);
    assert_eq!(seen_before_the_violation(1.4), [Cause::Unattributed]);
    assert_eq!(seen_before_the_violation(1.6), [Cause::MissedObject]);
}

#[test]
fn what_hides_beyond_the_own_sight_is_no_reveal() {
    let mut scene = Scene::new(20.0, 0.0, 5.0);
    (scene.know, scene.visible) = (nothing, false);
    let rear_m = scene.vehicles()[1].s_range_m[0];
    scene.sight = Some(SightLine::new([rear_m - 0.5; 3], 0.0));
    assert_eq!(scene.run(0.5).causes(), [Cause::Unattributed]);
}

#[test]
fn a_glimpse_lost_is_no_reveal() {
    let mut scene = Scene::new(15.0, 0.0, 30.0);
    scene.know = nothing;
    scene.sight = Some(SightLine::new([300.0; 3], 0.0));
    scene.run(1.4);
    scene.visible = false;
    scene.run(0.5);
    scene.visible = true;
    assert_eq!(scene.run(0.4).causes(), [Cause::MissedObject]);
}
