//! The replay buffer gives back what was put in, joined rightly.

use covista_world::Action;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::learning::batch::BatchShape;
use crate::learning::replay::{FrameId, Minibatch, ReplayBuffer};
use crate::learning::{ACTIONS, ActionSet, LearningError, Options, Situation, action_index};

const SHAPE: BatchShape = BatchShape {
    rows: 32,
    own: 1,
    neighbours: 2,
    neighbour: 1,
    action: ACTIONS,
    central: 0,
};
/// What the own feature goes up by in each step.
const STEP: f32 = 0.01;

fn push(replay: &mut ReplayBuffer, own: f32, neighbours: &[f32]) -> Result<FrameId, LearningError> {
    let safe = if own < 4.5 * STEP {
        ActionSet::ALL
    } else {
        ActionSet::EMPTY
    };
    let situation = Situation {
        own: &[own],
        neighbours,
        agents: &[None, None][..neighbours.len()],
        options: Options { legal: safe, safe },
    };
    replay.push(4, &situation, safe, &[])
}

/// An episode of `steps` steps; its rewards are the own feature.
fn episode(replay: &mut ReplayBuffer, steps: usize, is_terminated: bool) {
    let mut before = None;
    for step in 0..=steps {
        let own = step as f32 * STEP;
        let neighbours = [own, -own];
        let now = push(replay, own, &neighbours[..step % 3]).expect("pushed");
        let action = Action::ALL[step % 3];
        let told = [Some(action), None];
        replay.decide(
            now,
            action,
            told[..step % 3].iter().copied(),
            [].into_iter(),
        );
        if let Some((before, reward)) = before.replace((now, own)) {
            let next = (step < steps || !is_terminated).then_some(now);
            replay.complete(4, before, reward, next).expect("completed");
        }
    }
}

fn check_sample(replay: &ReplayBuffer, ends_at: Option<f32>) {
    let mut minibatch = Minibatch::new(SHAPE);
    assert!(replay.sample(&mut ChaCha8Rng::seed_from_u64(1), &mut minibatch));
    let close = |a: f32, b: f32| (a - b).abs() < 5e-5;
    let mut starts = std::collections::BTreeSet::new();
    for row in 0..SHAPE.rows {
        let own = minibatch.now.own()[row];
        let step = (own / STEP).round() as usize;
        starts.insert(step);
        assert!(close(minibatch.reward[row], own));
        assert_eq!(
            usize::from(minibatch.action[row]),
            action_index(Action::ALL[step % 3])
        );
        assert_eq!(minibatch.now.safe[row].is_empty(), own > 4.5 * STEP);
        match minibatch.next_row[row] {
            Some(next) => {
                assert!(close(minibatch.next.own()[next], own + STEP));
                assert_eq!(minibatch.next.safe[next].is_empty(), own > 3.5 * STEP);
            }
            None => assert!(ends_at.is_some_and(|end| close(own + STEP, end)), "{own}"),
        }
        if !step.is_multiple_of(3) {
            let last = minibatch.now.neighbours.steps() - 1;
            let (state, action) = {
                let input = minibatch.now.neighbours.input_mut(last, row);
                (input[0], input[1..].to_vec())
            };
            assert!(close(state, own));
            let place = action_index(Action::ALL[step % 3]);
            let expected: Vec<f32> = (0..4)
                .map(|index| f32::from(u8::from(index == place)))
                .collect();
            assert_eq!(action, expected);
        }
    }
    assert!(starts.len() > 3, "{starts:?}");
}

#[test]
fn a_transition_leads_to_the_next_frame() {
    let mut replay = ReplayBuffer::new(SHAPE, 0, 1000);
    episode(&mut replay, 10, true);
    assert_eq!(replay.len(), 10);
    check_sample(&replay, Some(10.0 * STEP));
}

#[test]
fn what_is_truncated_still_has_a_future() {
    let mut replay = ReplayBuffer::new(SHAPE, 0, 1000);
    episode(&mut replay, 10, false);
    check_sample(&replay, None);
}

#[test]
fn old_transitions_give_way() {
    let mut replay = ReplayBuffer::new(SHAPE, 0, 7);
    for steps in [9, 8, 4] {
        episode(&mut replay, steps, true);
        assert!(replay.len() < 7, "{}", replay.len());
        check_sample(
            &replay,
            Some(steps as f32 * STEP)
                .filter(|_| steps > 6)
                .or(Some(4.0 * STEP)),
        );
        if steps == 8 {
            break;
        }
    }
    assert!(replay.bytes() <= 7 * replay.bytes_per_transition());
}

#[test]
fn the_paper_s_buffer_is_taken_as_it_fills() {
    let mut replay = ReplayBuffer::new(SHAPE, 0, 1_000_000);
    assert_eq!(replay.bytes(), 0);
    episode(&mut replay, 10, true);
    assert_eq!(replay.bytes(), 4096 * replay.bytes_per_transition());
}

#[test]
fn what_is_not_finite_is_refused() {
    let mut replay = ReplayBuffer::new(SHAPE, 0, 10);
    for (own, neighbour) in [(f32::NAN, 0.0), (0.0, f32::INFINITY)] {
        let error = push(&mut replay, own, &[neighbour]).expect_err("refused");
        assert!(
            error.to_string().starts_with("agent 4 got a feature"),
            "{error}"
        );
    }
    let frame = push(&mut replay, 0.0, &[]).expect("pushed");
    let error = replay
        .complete(4, frame, f32::INFINITY, None)
        .expect_err("refused");
    assert!(
        error.to_string().starts_with("agent 4 got a reward"),
        "{error}"
    );
    assert_eq!(replay.len(), 0);
    assert!(!replay.sample(
        &mut ChaCha8Rng::seed_from_u64(1),
        &mut Minibatch::new(SHAPE)
    ));
}
