//! `covista bench`: how fast the stages are on this machine.

mod control;
mod perception;
mod python;
mod sensors;
mod traffic;
mod training;
mod turns;

use crate::cli::{BenchArgs, BenchWhat};

/// `covista bench`.
pub fn run(args: &BenchArgs) -> anyhow::Result<()> {
    match &args.what {
        BenchWhat::Sensors(args) => sensors::run(args),
        BenchWhat::Perception(args) => perception::run(args),
        BenchWhat::Control(args) => control::run(args),
        BenchWhat::Traffic(args) => traffic::run(args),
        BenchWhat::Training(args) => training::run(args),
    }
}
