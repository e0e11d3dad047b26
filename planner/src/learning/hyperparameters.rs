use serde::{Deserialize, Serialize};

use super::LearningError;
use super::nn::AdamSettings;

/// The settings of Alg. 2.
///
/// [`Hyperparameters::paper`] has the paper's table; the default differs where it says so. On the
/// corridor of the tests (128 units, four seeds, 600 decisions) the default finds the best policy
/// with every seed, the paper's learning rate with one: with the others the softmax is sure of a bad
/// action before the critic knows better. The corridor does not tell apart gradients shortened to 10
/// or left as they are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hyperparameters {
    /// Adam's learning rate of the critic. Paper: 0.01; default 0.001.
    pub critic_learning_rate: f32,
    /// Adam's learning rate of the actor. Paper: 0.01; default 0.0005.
    pub actor_learning_rate: f32,
    /// Adam's other constants.
    pub adam: AdamSettings,
    /// The discount factor gamma a behaviour step. Paper: 0.9.
    pub discount: f32,
    /// What is taken off every reward, and what the rest is multiplied by, before it is learnt from:
    /// values near zero are learnt sooner, and the best policy stays the same, because the last
    /// reward of who collides is less by what would have been taken off for ever. Paper and default:
    /// 0 and 1. Reports have the rewards as they are.
    pub reward_center: f32,
    /// See [`Self::reward_center`].
    pub reward_scale: f32,
    /// Transitions in a minibatch. Paper: 64.
    pub minibatch: usize,
    /// Units of the LSTM and of the fully connected layer. Paper: 128.
    pub hidden: usize,
    /// Transitions that the replay buffer keeps. Paper: 10^6.
    pub replay: usize,
    /// Transitions before the first update: at least a minibatch.
    pub warm_up: usize,
    /// tau: how far the target networks move to the learnt ones with each update.
    pub target_rate: f32,
    /// Share of random actions of the safe set at first (the paper's 1 - epsilon).
    pub first_exploration: f32,
    /// The same in the end.
    pub last_exploration: f32,
    /// Decisions that a random action is repeated for, while it is safe. A lane change spans about
    /// eight; who draws anew at each of them takes nearly every one back. Paper and default: 1.
    pub exploration_steps: u32,
    /// Decisions of a learner over which the one becomes the other, linearly.
    pub exploration_decisions: u64,
    /// What the actor gains by an undecided distribution, for each nat of its entropy. Paper: 0;
    /// default 0.01, which on the corridor is no worse and with one seed of four sooner.
    /// A softmax that is sure of itself has no gradient left; a little entropy keeps it able to
    /// change its mind.
    pub entropy_weight: f32,
    /// Longest gradient of a network; longer ones are shortened. Paper and default: none.
    pub gradient_norm: Option<f32>,
    /// Updates of each learner after each decision. Alg. 2: 1.
    pub updates_per_decision: usize,
}

impl Default for Hyperparameters {
    fn default() -> Self {
        Self {
            critic_learning_rate: 1e-3,
            actor_learning_rate: 5e-4,
            entropy_weight: 0.01,
            ..Self::paper()
        }
    }
}

impl Hyperparameters {
    /// The paper's values (its table of hyperparameters); what it leaves open as in the default.
    pub fn paper() -> Self {
        Self {
            critic_learning_rate: 0.01,
            actor_learning_rate: 0.01,
            adam: AdamSettings::default(),
            discount: 0.9,
            reward_center: 0.0,
            reward_scale: 1.0,
            minibatch: 64,
            hidden: 128,
            replay: 1_000_000,
            warm_up: 64,
            target_rate: 0.01,
            first_exploration: 0.5,
            last_exploration: 0.05,
            exploration_steps: 1,
            exploration_decisions: 4_000,
            entropy_weight: 0.0,
            gradient_norm: None,
            updates_per_decision: 1,
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first that makes no sense, with what is allowed.
    pub fn validate(&self) -> Result<(), LearningError> {
        fn check(
            name: &'static str,
            value: impl std::fmt::Display,
            must: &'static str,
            holds: bool,
        ) -> Result<(), LearningError> {
            if holds {
                return Ok(());
            }
            Err(LearningError::Hyperparameter {
                name,
                value: value.to_string(),
                must,
            })
        }
        let is_rate = |rate: f32| rate > 0.0 && rate <= 1.0;
        let is_share = |share: f32| (0.0..=1.0).contains(&share);
        let is_decay = |decay: f32| (0.0..1.0).contains(&decay);
        let rate = "above 0 and at most 1";
        let share = "between 0 and 1";
        let decay = "at least 0 and below 1";
        let critic = self.critic_learning_rate;
        check("critic_learning_rate", critic, rate, is_rate(critic))?;
        let actor = self.actor_learning_rate;
        check("actor_learning_rate", actor, rate, is_rate(actor))?;
        check(
            "adam.beta1",
            self.adam.beta1,
            decay,
            is_decay(self.adam.beta1),
        )?;
        check(
            "adam.beta2",
            self.adam.beta2,
            decay,
            is_decay(self.adam.beta2),
        )?;
        let epsilon = self.adam.epsilon;
        check("adam.epsilon", epsilon, rate, is_rate(epsilon))?;
        check("discount", self.discount, decay, is_decay(self.discount))?;
        let center = self.reward_center;
        check("reward_center", center, "finite", center.is_finite())?;
        let scale = self.reward_scale;
        let is_scale = scale > 0.0 && scale.is_finite();
        check("reward_scale", scale, "finite and above 0", is_scale)?;
        let at_most = "between 1 and 65536";
        let fits = |n: usize| (1..=65_536).contains(&n);
        check("minibatch", self.minibatch, at_most, fits(self.minibatch))?;
        check("hidden", self.hidden, at_most, fits(self.hidden))?;
        let kept = (2..=usize::try_from(u32::MAX).unwrap_or(usize::MAX) - 1).contains(&self.replay);
        check("replay", self.replay, "between 2 and 2^32 - 2", kept)?;
        let enough = self.warm_up >= self.minibatch && self.warm_up <= self.replay;
        let must = "at least a minibatch and at most the replay buffer";
        check("warm_up", self.warm_up, must, enough)?;
        check(
            "target_rate",
            self.target_rate,
            rate,
            is_rate(self.target_rate),
        )?;
        let first = self.first_exploration;
        check("first_exploration", first, share, is_share(first))?;
        let last = self.last_exploration;
        check("last_exploration", last, share, is_share(last))?;
        let repeated = self.exploration_steps;
        let must = "between 1 and 1000";
        check(
            "exploration_steps",
            repeated,
            must,
            (1..=1000).contains(&repeated),
        )?;
        let entropy = self.entropy_weight;
        let must = "finite and not negative";
        check(
            "entropy_weight",
            entropy,
            must,
            entropy >= 0.0 && entropy.is_finite(),
        )?;
        if let Some(norm) = self.gradient_norm {
            check(
                "gradient_norm",
                norm,
                "finite and above 0",
                norm > 0.0 && norm.is_finite(),
            )?;
        }
        let updates = self.updates_per_decision;
        check("updates_per_decision", updates, at_most, fits(updates))
    }

    /// The probability that exploring begins after so many decisions, so that its share comes out.
    pub(super) fn exploration_begins(&self, decisions: u64) -> f32 {
        let (share, steps) = (self.exploration(decisions), self.exploration_steps as f32);
        share / (steps - share * (steps - 1.0))
    }

    /// A reward as it is learnt from; `is_last` where the agent has no future.
    pub fn learnt_reward(&self, reward: f32, is_last: bool) -> f32 {
        let ahead = if is_last {
            1.0 / (1.0 - self.discount)
        } else {
            1.0
        };
        (reward - ahead * self.reward_center) * self.reward_scale
    }

    /// Share of random actions after so many decisions.
    pub fn exploration(&self, decisions: u64) -> f32 {
        let span = self.exploration_decisions.max(1);
        let done = (decisions.min(span) as f64 / span as f64) as f32;
        self.first_exploration + done * (self.last_exploration - self.first_exploration)
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;

    #[test]
    fn bad_values_are_named() {
        assert!(Hyperparameters::default().validate().is_ok());
        assert!(Hyperparameters::paper().validate().is_ok());
        let message = |change: fn(&mut Hyperparameters)| {
            let mut settings = Hyperparameters::default();
            change(&mut settings);
            settings.validate().expect_err("refused").to_string()
        };
        let of_discount = message(|s| s.discount = 1.0);
        assert_eq!(
            of_discount,
            "hyperparameter discount is 1, it must be at least 0 and below 1"
        );
        assert!(
            message(|s| s.critic_learning_rate = f32::NAN).contains("critic_learning_rate is NaN")
        );
        assert!(message(|s| s.warm_up = 3).contains("warm_up is 3"));
        assert!(message(|s| s.reward_scale = 0.0).contains("reward_scale is 0"));
        assert!(message(|s| s.reward_center = f32::NAN).contains("reward_center is NaN"));
        assert!(message(|s| s.minibatch = 0).contains("minibatch is 0"));
        assert!(message(|s| s.gradient_norm = Some(f32::INFINITY)).contains("gradient_norm"));
    }

    #[test]
    fn an_unknown_field_is_refused() {
        let read = |text| serde_json::from_str::<Hyperparameters>(text);
        assert_eq!(read("{\"discount\": 0.95}").expect("read").discount, 0.95);
        let error = read("{\"discout\": 0.95}")
            .expect_err("refused")
            .to_string();
        assert!(error.contains("unknown field `discout`"), "{error}");
    }

    #[test]
    fn a_reward_is_centred_and_scaled() {
        let settings = Hyperparameters {
            reward_center: 17.0,
            reward_scale: 0.5,
            ..Hyperparameters::default()
        };
        assert_eq!(settings.learnt_reward(19.0, false), 1.0);
        assert_eq!(Hyperparameters::paper().learnt_reward(19.0, true), 19.0);
        // Whatever the way to it, an episode is worth the same less the same: here 3 + 0.5 * 5 for
        // who ends after two steps, all of it moved by 17 / (1 - 0.5).
        let settings = Hyperparameters {
            discount: 0.5,
            reward_scale: 1.0,
            ..settings
        };
        let moved = settings.learnt_reward(3.0, false) + 0.5 * settings.learnt_reward(5.0, true);
        assert_eq!(moved, 3.0 + 0.5 * 5.0 - 17.0 / 0.5);
    }

    #[test]
    fn exploration_fades() {
        let settings = Hyperparameters::default();
        assert_eq!(settings.exploration(0), settings.first_exploration);
        assert_eq!(settings.exploration_begins(0), settings.first_exploration);
        let last = settings.exploration(u64::MAX);
        assert!((last - settings.last_exploration).abs() < 1e-6);
    }
}
