mod allocation;
mod cart;
mod checkpoints;
mod corridor;
mod features;
mod gradients;
mod replay;
