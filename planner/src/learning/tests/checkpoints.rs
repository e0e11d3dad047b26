//! Checkpoints come back as they were, and bad ones are refused by name.

use std::path::Path;

use safetensors::tensor::TensorView;

use super::corridor::{Corridor, settings};
use crate::learning::{
    Algorithm, Environment, EnvironmentError, Hyperparameters, LearnedPolicy, LearningError,
    Outcome, Shape, Sharing, Situations, Trainer, TrainingSettings,
};

fn trained(rounds: usize) -> Trainer<Corridor> {
    let settings = settings(Algorithm::SafeActorCritic, Sharing::Independent);
    let mut trainer = Trainer::new(vec![Corridor::new()], settings).expect("a trainer");
    for _ in 0..rounds {
        trainer.train_round().expect("a round");
    }
    trainer
}

fn resume(path: &Path) -> Result<Trainer<Corridor>, LearningError> {
    Trainer::resume(vec![Corridor::new()], path)
}

fn problem(path: &Path) -> String {
    match resume(path) {
        Ok(_) => panic!("{} was taken", path.display()),
        Err(error) => error.to_string(),
    }
}

#[test]
fn what_is_resumed_goes_on_alike() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.safetensors");
    let saved = trained(20);
    saved.save(&path).expect("saved");
    let mut one = resume(&path).expect("resumed");
    assert_eq!(one.fingerprint(), saved.fingerprint());
    assert_eq!(one.rounds(), 20);
    one.save(&folder.path().join("b.safetensors"))
        .expect("saved");
    let bytes = |name| std::fs::read(folder.path().join(name)).expect("a file");
    assert_eq!(bytes("a.safetensors"), bytes("b.safetensors"));

    let mut other = resume(&path).expect("resumed");
    for _ in 0..10 {
        assert_eq!(
            one.train_round().expect("a round"),
            other.train_round().expect("a round")
        );
    }
    assert_ne!(one.fingerprint(), saved.fingerprint());
    assert_eq!(one.fingerprint(), other.fingerprint());
}

#[test]
fn bad_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.safetensors");
    assert!(problem(&path).contains("cannot be read"));
    trained(1).save(&path).expect("saved");
    let bytes = std::fs::read(&path).expect("a file");

    for kept in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..kept]).expect("written");
        assert!(problem(&path).contains("is damaged"), "{}", problem(&path));
    }
    let mut poisoned = bytes;
    let end = poisoned.len() - 4;
    poisoned[end..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, &poisoned).expect("written");
    assert!(problem(&path).contains("not finite"), "{}", problem(&path));

    trained(1).save_policy(&path).expect("saved");
    assert!(
        problem(&path).contains("has no tensor 0.actor.target"),
        "{}",
        problem(&path)
    );
    let none: [(&str, TensorView<'_>); 0] = [];
    let foreign = safetensors::serialize(none, None).expect("an empty file");
    std::fs::write(&path, foreign).expect("written");
    assert!(
        problem(&path).contains("has no entry"),
        "{}",
        problem(&path)
    );
}

/// A corridor that tells of one neighbour more.
struct Wider(Corridor);

impl Environment for Wider {
    fn shape(&self) -> Shape {
        Shape {
            neighbours: 2,
            ..Corridor::SHAPE
        }
    }
    fn reset(&mut self, seed: u64, situations: &mut Situations) -> Result<(), EnvironmentError> {
        self.0.reset(seed, situations)
    }
    fn step(
        &mut self,
        actions: &[covista_world::Action],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        self.0.step(actions, outcome, situations)
    }
}

#[test]
fn other_sizes_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.safetensors");
    trained(1).save(&path).expect("saved");
    let error = Trainer::resume(vec![Wider(Corridor::new())], &path)
        .err()
        .expect("refused");
    assert!(error.to_string().contains("neighbours: 1"), "{error}");

    // A header of another size over the same tensors.
    let mut bytes = std::fs::read(&path).expect("a file");
    let of_32 = br#"hidden\":32,"#;
    let at = bytes
        .windows(of_32.len())
        .position(|part| part == of_32)
        .expect("the header");
    bytes[at..][..of_32.len()].copy_from_slice(br#"hidden\":64,"#);
    std::fs::write(&path, &bytes).expect("written");
    assert!(
        problem(&path).contains("the network needs F32"),
        "{}",
        problem(&path)
    );

    let error = LearnedPolicy::load(&path, 0, None).expect_err("refused");
    assert!(
        error.to_string().contains("the network needs F32"),
        "{error}"
    );
}

#[test]
fn without_agents_or_environments_nothing_is_trained() {
    let settings = TrainingSettings::default();
    let none: Vec<Corridor> = Vec::new();
    let error = Trainer::new(none, settings).err().expect("refused");
    assert!(error.to_string().contains("no environment"), "{error}");
    let bad = TrainingSettings {
        hyperparameters: Hyperparameters {
            minibatch: 0,
            ..Hyperparameters::default()
        },
        ..settings
    };
    let error = Trainer::new(vec![Corridor::new()], bad)
        .err()
        .expect("refused");
    assert!(error.to_string().contains("minibatch is 0"), "{error}");
}
