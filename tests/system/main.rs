//! The system as its users meet it. Each module is one concern:
//!
//! - `workspace`: the dependency rule of ARCHITECTURE.md, read off the Cargo.toml files;
//! - `demo`: the obstacle-at-corner demo through the binary;
//! - `dataset`: data sets written, stopped and read, recorded frames, and bad ones;
//! - `bench`: the benchmarks, their table and rows;
//! - `statistical`: the error model against the networks, and in the closed loop;
//! - `errors`: bad input, one clear line and exit code 2.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    reason = "a test stops where it fails"
)]

mod bench;
mod binary;
mod dataset;
mod demo;
mod errors;
mod statistical;
mod workspace;
