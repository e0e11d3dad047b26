mod allocation;
mod checkpoints;
mod corridor;
mod gradients;
mod replay;
