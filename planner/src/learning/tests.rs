mod allocation;
mod checkpoints;
mod corridor;
mod features;
mod gradients;
mod replay;
