mod checkpoints;
mod corridor;
mod gradients;
