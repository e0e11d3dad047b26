use nalgebra::Vector2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::{FRAME_S, at, nearest, observer, percept, tracker};

#[test]
fn vehicles_keep_their_identity_and_get_a_velocity() {
    let noise = Normal::new(0.0, 0.25).expect("a distribution");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut tracker = tracker(1);
    let truth = |t: f64| {
        // A column of two, one overtaking in the next lane, and one that changes lane behind it.
        [
            Vector2::new(25.0 + 14.0 * t, 0.0),
            Vector2::new(45.0 + 13.0 * t, 0.0),
            Vector2::new(5.0 + 19.0 * t, 3.5),
            Vector2::new(-20.0 + 14.0 * t, (0.9 * t).min(3.5)),
        ]
    };
    let mut ids = None;
    for i in 0..14 {
        let t = FRAME_S * f64::from(i);
        let pose = at(14.0 * t, -3.5);
        let percepts: Vec<_> = truth(t)
            .into_iter()
            .enumerate()
            .filter(|(k, _)| !(i == 6 && *k == 1))
            .map(|(_, center)| {
                let noise = Vector2::new(noise.sample(&mut rng), noise.sample(&mut rng));
                percept(pose, center + noise, None)
            })
            .collect();
        tracker.observe(t, pose, 14.0, &percepts);
        if i < 2 {
            continue;
        }
        let tracks = tracker.tracks(t);
        assert_eq!(tracks.len(), 4, "frame {i}");
        let now = truth(t).map(|center| nearest(&tracks, center).id);
        assert_eq!(now, *ids.get_or_insert(now), "frame {i}");
        let overtaking = nearest(&tracks, truth(t)[2]);
        assert!((overtaking.state.velocity_mps.x - 19.0).abs() < 2.5);
    }
}

#[test]
fn an_object_seen_once_waits_for_a_second_frame_unless_it_is_sure() {
    let pose = at(0.0, 0.0);
    let mut seen = percept(pose, Vector2::new(30.0, 0.0), None);
    let mut doubtful = tracker(1);
    doubtful.observe(0.0, pose, 0.0, &[seen]);
    assert!(doubtful.tracks(0.0).is_empty());
    doubtful.observe(0.5, pose, 0.0, &[seen]);
    assert_eq!(doubtful.tracks(0.5).len(), 1);
    seen.detection.score = 0.95;
    let mut sure = tracker(1);
    sure.observe(0.0, pose, 0.0, &[seen]);
    assert!(sure.tracks(0.0)[0].velocity_std_mps > 9.0);
}

#[test]
fn a_parked_vehicle_stays_known_while_hidden_and_a_moving_one_does_not() {
    let pose = at(0.0, 0.0);
    let mut tracker = tracker(1);
    for i in 0..4 {
        let t = FRAME_S * f64::from(i);
        let seen = [
            percept(pose, Vector2::new(45.0, 3.5), None),
            percept(pose, Vector2::new(20.0 + 14.0 * t, -3.5), None),
        ];
        tracker.observe(t, pose, 0.0, &seen);
    }
    assert_eq!(tracker.tracks(1.5).len(), 2);
    for i in 4..20 {
        tracker.observe(FRAME_S * f64::from(i), pose, 0.0, &[]);
    }
    let tracks = tracker.tracks(9.5);
    assert_eq!(tracks.len(), 1);
    assert!((tracks[0].state.center.position() - Vector2::new(45.0, 3.5)).norm() < 0.1);
    assert!(tracks[0].state.velocity_mps.norm() < 1e-12);
    assert!(tracker.tracks(12.0).is_empty());
}

#[test]
fn a_parked_vehicle_that_left_from_plain_sight_is_forgotten() {
    let pose = at(0.0, 0.0);
    let mut tracker = observer(1, pose, &[Vector2::new(15.0, 0.0)], 4);
    for i in 4..7 {
        tracker.observe(FRAME_S * f64::from(i), pose, 0.0, &[]);
    }
    assert!(tracker.tracks(3.0).is_empty());
}
