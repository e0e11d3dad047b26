//! The system as its users meet it. Each module is one concern:
//!
//! - `workspace`: the dependency rule of ARCHITECTURE.md, read off the Cargo.toml files;
//! - `demo`: the obstacle-at-corner demo through the binary;
//! - `dataset`: data sets written, stopped and read, recorded frames, and bad ones;
//! - `fusion`: the lanes of vehicles, measured on a data set with its truth;
//! - `networks`: one network of the folder on recorded frames, and what it says of strange ones;
//! - `provider`: what computes the networks, named on the command line;
//! - `bench`: the benchmarks, their table and rows;
//! - `cooperative`: what CAVs know alone and with sharing, on exact percepts;
//! - `statistical`: the error model against the networks, and in the closed loop;
//! - `train`: training, its files and going on with it;
//! - `experiment`: the paper's experiments, their cases, policies and report;
//! - `errors`: bad input, one clear line and exit code 2.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test stops where it fails"
)]

mod bench;
mod binary;
mod cooperative;
mod dataset;
mod demo;
mod errors;
mod experiment;
mod fusion;
mod networks;
mod provider;
mod statistical;
mod train;
mod workspace;
