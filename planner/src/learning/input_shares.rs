/// Numbers of a control input.
pub(super) const INPUTS: usize = 2;

/// A control input as an end-to-end actor gives it: tan(delta), positive to the left, and
/// acceleration, each as a share in [-1, 1] of its bound.
pub type InputShares = [f32; INPUTS];

/// What an actor's outputs amount to: squashed by tanh, so that no bound is left.
pub(super) fn squashed(outputs: &[f32]) -> InputShares {
    std::array::from_fn(|index| outputs[index].tanh())
}
