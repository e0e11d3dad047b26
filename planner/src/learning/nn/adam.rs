use pulp::NullaryFnOnce;
use serde::{Deserialize, Serialize};

/// Constants of Adam (Kingma and Ba 2015); the learning rate is given with each step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamSettings {
    /// Decay of the first moment.
    pub beta1: f32,
    /// Decay of the second moment.
    pub beta2: f32,
    /// What is added to the denominator.
    pub epsilon: f32,
}

impl Default for AdamSettings {
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
        }
    }
}

/// Adam's moments for one network.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    pub mean: Vec<f32>,
    pub square: Vec<f32>,
    pub steps: u64,
}

impl Adam {
    pub fn new(parameters: usize) -> Self {
        Self {
            mean: vec![0.0; parameters],
            square: vec![0.0; parameters],
            steps: 0,
        }
    }

    /// Moves `parameters` one step against `gradient`.
    pub fn step(
        &mut self,
        settings: &AdamSettings,
        learning_rate: f32,
        parameters: &mut [f32],
        gradient: &[f32],
    ) {
        self.steps += 1;
        let AdamSettings {
            beta1,
            beta2,
            epsilon,
        } = *settings;
        let power = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let mean_scale = 1.0 / (1.0 - beta1.powi(power));
        let square_scale = 1.0 / (1.0 - beta2.powi(power));
        pulp::Arch::new().dispatch(Step {
            beta1,
            beta2,
            epsilon,
            rate: learning_rate * mean_scale,
            square_scale,
            mean: &mut self.mean,
            square: &mut self.square,
            parameters,
            gradient,
        });
    }
}

struct Step<'a> {
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    rate: f32,
    square_scale: f32,
    mean: &'a mut [f32],
    square: &'a mut [f32],
    parameters: &'a mut [f32],
    gradient: &'a [f32],
}

impl NullaryFnOnce for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let weights = self.parameters.iter_mut().zip(self.gradient);
        let moments = self.mean.iter_mut().zip(self.square);
        for ((weight, &slope), (mean, square)) in weights.zip(moments) {
            *mean = self.beta1 * *mean + (1.0 - self.beta1) * slope;
            *square = self.beta2 * *square + (1.0 - self.beta2) * slope * slope;
            *weight -= self.rate * *mean / ((self.square_scale * *square).sqrt() + self.epsilon);
        }
    }
}

/// theta' <- tau theta + (1 - tau) theta'.
pub fn soft_update(target: &mut [f32], parameters: &[f32], tau: f32) {
    for (target, &weight) in target.iter_mut().zip(parameters) {
        *target += tau * (weight - *target);
    }
}

/// The Euclidean norm, in f64 and in the same order on every machine.
pub fn norm(gradient: &[f32]) -> f32 {
    pulp::Arch::new().dispatch(Norm { gradient })
}

struct Norm<'a> {
    gradient: &'a [f32],
}

impl NullaryFnOnce for Norm<'_> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        let mut sums = [0.0_f64; 32];
        let chunks = self.gradient.chunks_exact(sums.len());
        let rest = chunks
            .remainder()
            .iter()
            .map(|&slope| f64::from(slope).powi(2));
        for chunk in chunks {
            for (sum, &slope) in sums.iter_mut().zip(chunk) {
                *sum += f64::from(slope) * f64::from(slope);
            }
        }
        let rest: f64 = rest.sum();
        (sums.iter().sum::<f64>() + rest).sqrt() as f32
    }
}

/// Shortens `gradient` to `limit` where its norm, which is returned, is longer.
pub fn clip_to_norm(gradient: &mut [f32], limit: f32) -> f32 {
    let length = norm(gradient);
    if length > limit {
        let scale = limit / length;
        gradient.iter_mut().for_each(|slope| *slope *= scale);
    }
    length
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_learning_rate_against_the_sign() {
        let (mut adam, mut weights) = (Adam::new(2), [1.0, 1.0]);
        adam.step(&AdamSettings::default(), 0.01, &mut weights, &[3.0, -1e-3]);
        assert!((weights[0] - 0.99).abs() < 1e-6 && (weights[1] - 1.01).abs() < 1e-6);
    }

    #[test]
    fn the_second_step_is_that_of_the_formula() {
        let (mut adam, mut weights) = (Adam::new(1), [0.0]);
        for slope in [1.0, -2.0] {
            adam.step(&AdamSettings::default(), 0.1, &mut weights, &[slope]);
        }
        // m = 0.09 - 0.2 = -0.11 and v = 0.000999 + 0.004 = 0.004999, over 0.19 and 0.001999.
        let second = 0.1 * (0.11 / 0.19) / (0.004_999_f32 / 0.001_999).sqrt();
        assert!((weights[0] - (-0.1 + second)).abs() < 1e-5, "{weights:?}");
    }

    #[test]
    fn targets_follow_and_gradients_are_shortened() {
        let mut target = [1.0, 0.0];
        soft_update(&mut target, &[0.0, 1.0], 0.25);
        assert_eq!(target, [0.75, 0.25]);
        let mut gradient = [3.0, 4.0];
        assert!((clip_to_norm(&mut gradient, 1.0) - 5.0).abs() < 1e-6);
        assert!((norm(&gradient) - 1.0).abs() < 1e-6);
    }
}
