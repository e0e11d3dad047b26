//! The end-to-end variant: the action is the control input, two numbers of a deterministic actor
//! (DDPG). The critic is truncated as in Alg. 2, and the actor climbs its slope by the own input.

use rand::Rng;

use super::{InputShares, Learner, LearningError, Losses, Situation, Workspace};
use crate::learning::input_shares::{INPUTS, squashed};

impl Learner {
    /// Control inputs for each situation. Exploring adds Gaussian noise, of the standard deviation
    /// that the settings call the share of exploration, drawn anew every `exploration_steps`
    /// decisions.
    pub fn steer<'s>(
        &mut self,
        situation: impl Fn(usize) -> Situation<'s>,
        explores: bool,
        workspace: &mut Workspace,
        inputs: &mut [InputShares],
    ) {
        let deviation = self.settings.exploration(self.decisions);
        if explores {
            self.noise.resize(inputs.len(), (0, InputShares::default()));
        }
        let most = workspace.minibatch.now.shape().rows;
        let batch = &mut workspace.minibatch.now;
        for (chunk, inputs) in inputs.chunks_mut(most).enumerate() {
            batch.write_all(inputs.len(), |item| situation(chunk * most + item));
            let outputs =
                self.actor
                    .network
                    .forward(&self.actor.weights, batch, &mut workspace.actor);
            for (row, outputs) in outputs.chunks_exact(INPUTS).enumerate() {
                inputs[batch.order[row]] = squashed(outputs);
            }
        }
        if explores {
            for (input, (left, noise)) in inputs.iter_mut().zip(&mut self.noise) {
                if *left == 0 {
                    *left = self.settings.exploration_steps;
                    *noise = gaussian(&mut self.draws);
                }
                *left -= 1;
                for (share, noise) in input.iter_mut().zip(noise) {
                    *share = (*share + deviation * *noise).clamp(-1.0, 1.0);
                }
            }
            self.decisions += 1;
        }
    }

    /// The critic towards y = r + gamma Q'(s', pi'(s'), a'^N), the actor up dQ/da at a = pi(s).
    pub(super) fn update_steering(
        &mut self,
        workspace: &mut Workspace,
    ) -> Result<Losses, LearningError> {
        self.write_steering_targets(workspace);
        let Self { actor, critic, .. } = self;
        let now = &mut workspace.minibatch.now;
        let scale = 1.0 / now.rows() as f32;
        let mut losses = Losses::default();

        let values = (critic.network).forward(&critic.weights, now, &mut workspace.critic);
        let gradient = &mut workspace.values_gradient[..now.rows()];
        for ((to, value), target) in gradient.iter_mut().zip(values).zip(&workspace.targets) {
            let error = value - target;
            losses.critic += scale * error * error;
            *to = 2.0 * scale * error;
        }
        workspace.critic_gradient.fill(0.0);
        critic.network.backward(
            &critic.weights,
            now,
            &mut workspace.critic,
            gradient,
            &mut workspace.critic_gradient,
        );

        let outputs = (actor.network).forward(&actor.weights, now, &mut workspace.actor);
        for (row, outputs) in outputs.chunks_exact(INPUTS).enumerate() {
            now.set_input(row, squashed(outputs));
        }
        let values = (critic.network).forward(&critic.weights, now, &mut workspace.critic);
        losses.value = scale * values.iter().sum::<f32>();
        let slopes = &mut workspace.slopes[..now.rows() * INPUTS];
        (critic.network).input_slopes(&critic.weights, &workspace.critic, slopes);
        let downhill = &mut workspace.logits_gradient[..now.rows() * INPUTS];
        for ((to, slope), share) in downhill.iter_mut().zip(slopes).zip(now.inputs()) {
            *to = -scale * *slope * (1.0 - share * share);
        }
        workspace.actor_gradient.fill(0.0);
        actor.network.backward(
            &actor.weights,
            now,
            &mut workspace.actor,
            downhill,
            &mut workspace.actor_gradient,
        );
        self.step(losses, workspace)
    }

    fn write_steering_targets(&self, workspace: &mut Workspace) {
        let (actor, critic) = (&self.actor, &self.critic);
        let minibatch = &mut workspace.minibatch;
        let next = &mut minibatch.next;
        let outputs = (actor.network).forward(&actor.target, next, &mut workspace.actor);
        for (row, outputs) in outputs.chunks_exact(INPUTS).enumerate() {
            next.set_input(row, squashed(outputs));
        }
        let values = (critic.network).forward(&critic.target, next, &mut workspace.critic);
        for (row, target) in workspace.targets.iter_mut().enumerate() {
            let future = minibatch.next_row[row].map_or(0.0, |next_row| values[next_row]);
            *target = minibatch.reward[row] + self.settings.discount * future;
        }
    }
}

/// Two independent numbers of the standard normal distribution (Box and Muller).
fn gaussian(rng: &mut impl Rng) -> InputShares {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * rng.random::<f32>()).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn noise_is_normal_and_uncorrelated() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let draws: Vec<InputShares> = (0..20_000).map(|_| gaussian(&mut rng)).collect();
        let mean = |of: fn(&InputShares) -> f32| draws.iter().map(of).sum::<f32>() / 20_000.0;
        for (name, found, expected) in [
            ("mean", mean(|x| x[0]), 0.0),
            ("variance", mean(|x| x[1] * x[1]), 1.0),
            ("fourth moment", mean(|x| x[0].powi(4)), 3.0),
            ("correlation", mean(|x| x[0] * x[1]), 0.0),
        ] {
            assert!((found - expected).abs() < 0.2, "{name}: {found}");
        }
    }
}
