//! Features of situations, and the learned policy that reads them.

use covista_world::{Action, LaneIndex, StationId};
use proptest::prelude::*;

use crate::learning::{
    Algorithm, CapCount, Environment, EnvironmentError, FeatureEncoder, GLOBAL_FEATURES,
    InvalidFeatures, LearnedPolicy, NEIGHBOUR_FEATURES, OWN_FEATURES, Outcome, Shape, Sharing,
    Situations, Trainer,
};
use crate::{Manoeuvre, Neighbour, Observation, Policy};

const LOOP_M: f64 = 1000.0;
const SHAPE: Shape = Shape {
    agents: 1,
    own: OWN_FEATURES,
    neighbours: 2,
    neighbour: NEIGHBOUR_FEATURES,
    global: GLOBAL_FEATURES,
};

fn lane(index: u8) -> LaneIndex {
    LaneIndex::new(index).expect("a lane")
}

fn neighbour(id: u32, s_m: f64, lane_index: u8) -> Neighbour {
    Neighbour {
        id,
        station: None,
        lane: Some(lane(lane_index)),
        entering: None,
        s_m,
        d_m: 3.5 * (1.0 - f64::from(lane_index)),
        speed_mps: 10.0,
        speed_std_mps: 0.5,
        length_m: 5.0,
        width_m: 1.9,
        age_s: 0.0,
        action: None,
    }
}

fn observation(neighbours: Vec<Neighbour>) -> Observation {
    Observation {
        lane: lane(1),
        s_m: 10.0,
        d_m: 0.0,
        psi_rad: 0.0,
        speed_mps: 13.0,
        length_m: 5.0,
        desired_speed_mps: 15.0,
        manoeuvre: Manoeuvre::KeepingLane,
        curvature_per_m: 0.0,
        neighbours,
    }
}

fn encode(observation: &Observation) -> (Situations, CapCount) {
    let mut encoder = FeatureEncoder::new(Some(LOOP_M));
    let mut situations = Situations::new(SHAPE);
    let agent_of = |station: StationId| (station.0 < 30).then_some(station.0);
    encoder
        .encode(observation, agent_of, &mut situations.get_mut(0))
        .expect("finite");
    (situations, encoder.cap)
}

#[test]
fn the_nearest_are_kept_nearest_first() {
    let mut near = neighbour(1, 985.0, 0); // 25 m behind, round the loop
    near.station = Some(StationId(7));
    near.action = Some(Action::ChangeRight);
    near.entering = Some(lane(1));
    let (far, next) = (neighbour(2, 110.0, 1), neighbour(3, 40.0, 2));
    let (situations, cap) = encode(&observation(vec![far, near, next]));
    let seen = situations.get(0);
    assert_eq!(seen.agents, [Some(7), None]);
    assert_eq!(
        cap,
        CapCount {
            situations: 1,
            capped: 1,
            left_out: 1
        }
    );
    let close = |a: f32, b: f32| (a - b).abs() < 1e-5;
    let first = &seen.neighbours[..NEIGHBOUR_FEATURES];
    assert!(
        close(first[0], -25.0 / 150.0) && close(first[1], -1.0 / 3.0),
        "{first:?}"
    );
    assert!(close(first[2], 0.35) && close(first[3], -0.2));
    assert_eq!(first[7..12], [0.0, 1.0, 0.0, 0.0, 0.0]);
    assert_eq!(first[12..], [1.0, 0.0, 1.0, 0.0, 1.0]);
    let second = &seen.neighbours[NEIGHBOUR_FEATURES..];
    assert!(close(second[0], 0.2), "{second:?}");
    assert_eq!(second[7..12], [0.0, 0.0, 0.0, 1.0, 0.0]);
    assert_eq!(second[12..], [0.0; 5]);
}

#[test]
fn the_phase_of_a_lane_change_is_seen() {
    let mut changing = observation(Vec::new());
    changing.manoeuvre = Manoeuvre::ChangingLane {
        from: lane(1),
        to: lane(0),
        progress: 0.25,
    };
    let (situations, cap) = encode(&changing);
    assert_eq!(situations.get(0).own[10..], [1.0, 0.25, 0.25]);
    assert_eq!(cap.capped, 0);
    assert_eq!(&situations.global()[..OWN_FEATURES], situations.get(0).own);
}

#[test]
fn what_is_not_finite_is_refused() {
    let mut encoder = FeatureEncoder::new(None);
    let mut situations = Situations::new(SHAPE);
    let mut bad = observation(vec![neighbour(9, f64::NAN, 1)]);
    let mut refused = |bad: &Observation| {
        let row = &mut situations.get_mut(0);
        encoder.encode(bad, |_| None, row).expect_err("refused")
    };
    assert_eq!(refused(&bad), InvalidFeatures::Neighbour(9));
    bad.speed_mps = f64::INFINITY;
    assert_eq!(refused(&bad), InvalidFeatures::OwnState);
}

proptest! {
    #[test]
    fn features_stay_within_one(
        numbers in prop::array::uniform12(prop_oneof![-1e3..1e3_f64, -1e300..1e300_f64]),
        lanes in (0..3_u8, 0..3_u8),
    ) {
        let mut other = neighbour(1, numbers[0], lanes.0);
        (other.d_m, other.speed_mps, other.length_m) = (numbers[1], numbers[2], numbers[3]);
        (other.speed_std_mps, other.age_s) = (numbers[4], numbers[5]);
        let mut own = observation(vec![other]);
        own.lane = lane(lanes.1);
        (own.s_m, own.d_m, own.psi_rad) = (numbers[6], numbers[7], numbers[8]);
        (own.speed_mps, own.length_m, own.curvature_per_m) = (numbers[9], numbers[10], numbers[11]);
        let (situations, _) = encode(&own);
        let seen = situations.get(0);
        let all = seen.own.iter().chain(seen.neighbours).chain(situations.global());
        for &feature in all {
            prop_assert!((-1.0..=1.0).contains(&feature), "{feature}");
        }
    }
}

/// One vehicle on an empty road that ends after one step.
struct EmptyRoad(FeatureEncoder);

impl Environment for EmptyRoad {
    fn shape(&self) -> Shape {
        SHAPE
    }

    fn reset(&mut self, _: u64, situations: &mut Situations) -> Result<(), EnvironmentError> {
        let row = &mut situations.get_mut(0);
        *row.legal = Action::ALL.into_iter().collect();
        *row.safe = *row.legal;
        let encoded = self.0.encode(&observation(Vec::new()), |_| None, row);
        encoded.map_err(|error| EnvironmentError {
            when: "at its start".into(),
            source: error.into(),
        })
    }

    fn step(
        &mut self,
        _: &[Action],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        outcome.is_over = true;
        self.reset(0, situations)
    }
}

#[test]
fn a_saved_policy_decides_as_the_learner_does() {
    let settings = super::corridor::settings(Algorithm::SafeActorCritic, Sharing::Shared);
    let road = EmptyRoad(FeatureEncoder::new(None));
    let trainer = Trainer::new(vec![road], settings).expect("a trainer");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("policy.safetensors");
    trainer.save_policy(&path).expect("saved");
    let mut loaded = LearnedPolicy::load(&path, 0, Some(LOOP_M)).expect("loaded");
    let mut kept = trainer.policy(0, Some(LOOP_M)).expect("a policy");
    let seen = observation(vec![neighbour(1, 40.0, 1)]);
    let values = loaded.values(&seen);
    assert_eq!(values, kept.values(&seen));
    assert_ne!(values, loaded.values(&observation(Vec::new())));
    let mut bad = seen;
    bad.s_m = f64::NAN;
    assert_eq!(loaded.values(&bad).in_order()[0], Action::KeepLane);
}
