mod corridor;
mod gradients;
