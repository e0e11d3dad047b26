use covista_control::Mode;
use covista_planner::learning::{Environment, InputShares, Outcome, Situations};
use covista_traffic::RingSettings;
use covista_world::Action;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

fn settings(cavs: usize, density: f64, steps: u64) -> RingEnvironmentSettings {
    RingEnvironmentSettings {
        ring: RingSettings {
            vehicles: 12,
            cavs,
            density,
            ..RingSettings::default()
        },
        steps,
        ..RingEnvironmentSettings::default()
    }
}

/// Drives an episode with random actions of the safe set, or of the legal one; gives all rewards.
fn drive(environment: &mut RingEnvironment, seed: u64, is_safe: bool) -> Vec<f32> {
    let shape = environment.shape();
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut rewards = Vec::new();
    environment
        .reset(seed, &mut situations)
        .expect("an episode");
    while !outcome.is_over {
        let choose = |agent| {
            let options = situations.get(agent).options;
            let set = if is_safe { options.safe } else { options.legal };
            let actions: Vec<Action> = set.iter().collect();
            match actions.len() {
                0 => Action::EmergencyStop,
                count => actions[dice.random_range(0..count)],
            }
        };
        let actions: Vec<Action> = (0..shape.agents).map(choose).collect();
        situations.clear();
        outcome.clear();
        environment
            .step(&actions, &mut outcome, &mut situations)
            .expect("a step");
        rewards.extend_from_slice(&outcome.rewards);
    }
    rewards
}

#[test]
fn the_same_seed_gives_the_same_episode_and_another_another() {
    let episode = |seed| {
        let mut environment = RingEnvironment::new(settings(4, 0.4, 10)).expect("a ring");
        drive(&mut environment, seed, true)
    };
    assert_eq!(episode(3), episode(3));
    assert_ne!(episode(3), episode(4));
    // An environment that has driven before forgets it.
    let mut environment = RingEnvironment::new(settings(4, 0.4, 10)).expect("a ring");
    drive(&mut environment, 4, true);
    assert_eq!(drive(&mut environment, 3, true), episode(3));
}

#[test]
fn percepts_with_errors_are_the_same_for_a_seed_and_drive_another_episode_than_exact_ones() {
    let with = |perception| {
        let settings = RingEnvironmentSettings {
            perception,
            ..settings(6, 0.4, 10)
        };
        RingEnvironment::new(settings).expect("a ring")
    };
    let mut statistical = with(RingPerception::Statistical);
    let episode = drive(&mut statistical, 3, true);
    assert_ne!(episode, drive(&mut statistical, 4, true));
    assert_eq!(episode, drive(&mut statistical, 3, true));
    assert_eq!(
        episode,
        drive(&mut with(RingPerception::Statistical), 3, true)
    );
    assert_ne!(episode, drive(&mut with(RingPerception::Exact), 3, true));
}

#[test]
fn safe_actions_leave_no_violation_that_nothing_explains() {
    for (density, sharing) in [(0.2, true), (0.5, true), (0.5, false), (0.8, true)] {
        let mut environment = RingEnvironment::new(RingEnvironmentSettings {
            sharing,
            ..settings(8, density, 40)
        })
        .expect("a ring");
        for seed in 0..2 {
            drive(&mut environment, seed, true);
            let safety = environment.safety().expect("it is watched");
            assert_eq!(environment.tally().unsafe_actions, 0);
            assert_eq!(safety.cav_steps, 8 * 40 * 50);
            assert_eq!(
                safety.violations_unattributed, 0,
                "{density} {sharing} {seed}"
            );
            assert_eq!(safety.unsafe_lane_changes, 0, "{density} {sharing} {seed}");
            assert_eq!(environment.ring().report().collisions, 0);
        }
    }
}

#[test]
fn without_mapping_and_filter_it_crashes_and_that_ends_the_episode() {
    let mut settings = settings(8, 0.8, 60);
    settings.control.mode = Mode::Off;
    let mut environment = RingEnvironment::new(settings).expect("a ring");
    let (mut ended, mut unsafe_actions) = (0, 0);
    for seed in 0..4 {
        let rewards = drive(&mut environment, seed, false);
        unsafe_actions += environment.tally().unsafe_actions;
        let collided = environment.ring().report().collisions > 0;
        if collided && rewards.len() < 60 * 8 {
            ended += 1;
            let last = &rewards[rewards.len() - 8..];
            assert!(last.iter().any(|reward| *reward < -50.0), "{last:?}");
        }
    }
    assert!(unsafe_actions > 0);
    assert!(ended > 0, "no episode ended by a collision");
}

#[test]
fn with_sharing_more_is_known_and_who_tells_is_known_by_name() {
    let known = |sharing| {
        let environment = RingEnvironment::new(RingEnvironmentSettings {
            sharing,
            ..settings(6, 0.6, 1)
        })
        .expect("a ring");
        let neighbours = environment.cavs.iter().flat_map(|cav| &cav.neighbours);
        let stations = neighbours.clone().filter(|other| other.station.is_some());
        (neighbours.count(), stations.count())
    };
    let ((alone, named_alone), (together, named)) = (known(false), known(true));
    assert!(alone < together, "{alone} {together}");
    assert_eq!(named_alone, 0);
    assert!(named > 0);
}

#[test]
fn everybody_is_met_in_the_nearest_lap() {
    let mut environment = RingEnvironment::new(settings(12, 0.4, 100)).expect("a ring");
    drive(&mut environment, 1, true);
    let ring = environment.ring();
    let period_m = ring.road().period_m();
    let mut farther = 0;
    for cav in &environment.cavs {
        for neighbour in &cav.neighbours {
            let away_m = neighbour.s_rear_m - cav.frenet.s_m;
            assert!(away_m.abs() < period_m / 2.0 + 10.0, "{away_m}");
            let vehicle = &ring.vehicles()[neighbour.id as usize - 1];
            let driven_m = vehicle.frenet().s_m;
            farther += usize::from((neighbour.s_rear_m - driven_m).abs() > period_m / 2.0);
        }
    }
    assert!(
        farther > 0,
        "nobody met anybody across the beginning of a lap"
    );
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refusal = |change: fn(&mut RingEnvironmentSettings)| {
        let mut settings = settings(4, 0.3, 10);
        change(&mut settings);
        let refused = RingEnvironment::new(settings).err().expect("refused");
        refused.to_string()
    };
    assert!(refusal(|s| s.ring.cavs = 0).contains("set ring.cavs to 1 or more"));
    assert!(refusal(|s| s.steps = 0).contains("set steps to 1 or more"));
    assert!(refusal(|s| s.communication_m = f64::NAN).contains("communication_m"));
    assert!(refusal(|s| s.ring.cavs = 13).contains("13"));
    assert!(refusal(|s| s.ring.density = 5.0).contains("density is 5"));
    assert!(refusal(|s| s.control.safety.brake_mps2 = -1.0).contains("brake"));
}

/// Steers an episode by `choose`, from the CAV's offset and a random number in [-1, 1].
fn steer(
    environment: &mut RingEnvironment,
    seed: u64,
    choose: impl Fn(f64, f32) -> InputShares,
) -> Vec<f32> {
    let shape = environment.shape();
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut rewards = Vec::new();
    environment
        .reset(seed, &mut situations)
        .expect("an episode");
    environment.record_motion();
    while !outcome.is_over {
        let cavs = environment.cavs.iter();
        let inputs: Vec<InputShares> = cavs
            .map(|cav| choose(cav.frenet.d_m, dice.random_range(-1.0..1.0)))
            .collect();
        situations.clear();
        outcome.clear();
        environment
            .steer(&inputs, &mut outcome, &mut situations)
            .expect("a step");
        rewards.extend_from_slice(&outcome.rewards);
    }
    rewards
}

#[test]
fn who_steers_wildly_stays_in_the_lane_and_on_the_promise() {
    let mut environment = RingEnvironment::new(settings(8, 0.5, 40)).expect("a ring");
    let wild = |_: f64, draw: f32| [draw.signum(), 1.0 - draw.abs()];
    for seed in 0..2 {
        let rewards = steer(&mut environment, seed, wild);
        assert_eq!(rewards.len(), 8 * 40 * 5);
        let (safety, tally) = (environment.safety().expect("watched"), environment.tally());
        assert_eq!(safety.violations_unattributed, 0, "{seed}");
        assert_eq!(environment.ring().report().collisions, 0, "{seed}");
        assert_eq!((tally.decisions, tally.behaviour_steps), (8 * 40, 12 * 40));
        let motion = environment.motion().expect("it is kept");
        assert!(motion.lane_changes_per_km.abs() < 1e-12, "{motion:?}");
        assert!(motion.steering_reversals_per_km > 20.0, "{motion:?}");
        assert_eq!(rewards, steer(&mut environment, seed, wild));
    }
}

#[test]
fn a_lane_keeper_drives_more_smoothly_than_who_steers_at_random() {
    let mut environment = RingEnvironment::new(settings(8, 0.3, 20)).expect("a ring");
    drive(&mut environment, 1, true);
    assert_eq!(environment.motion(), None, "nobody asked for it");
    steer(&mut environment, 1, |_, draw| [draw, 0.5]);
    let rough = environment.motion().expect("it is kept");
    let (mut situations, mut outcome) = (
        Situations::new(environment.shape()),
        Outcome::new(environment.shape().agents),
    );
    environment.reset(1, &mut situations).expect("an episode");
    environment.record_motion();
    while !outcome.is_over {
        environment
            .step(&[Action::KeepLane; 8], &mut outcome, &mut situations)
            .expect("a step");
    }
    let smooth = environment.motion().expect("it is kept");
    assert!(smooth.way_km > 0.5, "{smooth:?}");
    assert!(smooth.lateral_jerk_rms_mps3 < 0.2 * rough.lateral_jerk_rms_mps3);
    assert!(smooth.lateral_way_m_per_km < 0.2 * rough.lateral_way_m_per_km);
    assert!(smooth.steering_reversals_per_km < 0.2 * rough.steering_reversals_per_km);
    assert!(smooth.trace.len() > 50 && smooth.trace[0][0].abs() < 1e-12);
}

#[test]
fn who_steers_off_the_road_without_the_filter_ends_the_episode() {
    let mut settings = settings(2, 0.2, 60);
    settings.control.mode = Mode::Off;
    let mut environment = RingEnvironment::new(settings).expect("a ring");
    let rewards = steer(&mut environment, 1, |_, _| [-1.0, 0.0]);
    assert!(rewards.len() < 2 * 60 * 5, "{}", rewards.len());
    let last = &rewards[rewards.len() - 2..];
    assert!(last.iter().any(|reward| *reward < -50.0), "{last:?}");
}
