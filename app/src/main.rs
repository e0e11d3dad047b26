//! The binary `covista`: arguments, progress, tables, errors. It holds no logic of its own.
//!
//! *Architecture invariant:* every error that reaches this crate is told once, here, in one line,
//! and ends the process with exit code 2.

mod bench;
mod cli;
mod dataset;
mod demo;
mod eval;
mod experiment;
mod frames;
mod models;
mod output;
mod record;
mod replay;
mod report;
mod table;
mod train;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let cli = match cli::Cli::try_parse() {
        Ok(cli) => cli,
        Err(asked) if !asked.use_stderr() => asked.exit(),
        Err(error) => {
            let text = error.render().to_string();
            // What is wrong ends at the first empty line; missing arguments are a list.
            let said: Vec<_> = text
                .lines()
                .take_while(|line| !line.trim().is_empty())
                .map(str::trim)
                .collect();
            let said = said.join(" ");
            eprintln!(
                "covista: {}; see --help",
                said.trim_start_matches("error: ")
            );
            return ExitCode::from(2);
        }
    };
    let result = match cli.command {
        None => demo::run_demo(&cli::DemoArgs::default()),
        Some(cli::Command::Demo(args)) => demo::run_demo(&args),
        Some(cli::Command::Dataset(args)) => dataset::run(&args),
        Some(cli::Command::Eval(args)) => eval::run(&args),
        Some(cli::Command::Bench(args)) => bench::run(&args),
        Some(cli::Command::Train(args)) => train::run(&args),
        Some(cli::Command::Experiment(args)) => experiment::run(&args),
        Some(cli::Command::Report(args)) => report::run(&args),
        Some(cli::Command::Models(args)) => models::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("covista: {}", one_line(&error));
            ExitCode::from(2)
        }
    }
}

/// The error and its causes on one line.
fn one_line(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Many an error's own text ends with its cause.
        if !said.contains(&cause) {
            let colon = if said.is_empty() { "" } else { ": " };
            said.push_str(colon);
            said.push_str(&cause);
        }
    }
    said.split_whitespace().collect::<Vec<_>>().join(" ")
}
