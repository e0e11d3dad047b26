use std::{
    fs,
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
};

use anyhow::{Context, bail};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// A Python program to compare with: a process that stays, told over its standard input, one JSON
/// object a line, and answering the same way.
pub(super) struct Python {
    /// What `--against` calls it.
    name: &'static str,
    /// What it needs, as pip names it.
    packages: &'static str,
    child: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
    log: PathBuf,
}

impl Python {
    /// Starts `python3` on `script` with `arguments`; the script and what it complains of go to
    /// `folder`.
    pub(super) fn start(
        (name, packages): (&'static str, &'static str),
        script: &str,
        arguments: &[&str],
        folder: &Path,
    ) -> anyhow::Result<Self> {
        let (path, log) = (folder.join("peer.py"), folder.join(name));
        let place = || format!("cannot write to {}", folder.display());
        fs::write(&path, script).with_context(place)?;
        let stderr = fs::File::create(&log).with_context(place)?;
        let mut child = Command::new("python3")
            .arg(path)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(stderr)
            .spawn()
            .context("python3 can't be run: install Python 3.11 or leave out --against")?;
        let (Some(requests), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            bail!("python3 can't be talked to");
        };
        Ok(Self {
            name,
            packages,
            child,
            requests,
            answers: BufReader::new(answers),
            log,
        })
    }

    /// Its answer to `request`.
    pub(super) fn ask<T: DeserializeOwned>(&mut self, request: &Value) -> anyhow::Result<T> {
        let mut line = String::new();
        // A process that has ended takes no request; why it did is in its log.
        let sent = writeln!(self.requests, "{request}").and_then(|()| self.requests.flush());
        let read = sent.and_then(|()| self.answers.read_line(&mut line));
        let answer: Value = serde_json::from_str(&line)
            .unwrap_or_else(|_| json!({"error": self.last_words(read.err())}));
        let error = match answer.get("error").and_then(Value::as_str) {
            Some(error) => error.to_owned(),
            None => match serde_json::from_value(answer) {
                Ok(answer) => return Ok(answer),
                Err(error) => format!("its answer makes no sense ({error})"),
            },
        };
        bail!(
            "--against {}: {error}: install what it needs (python3 -m pip install {}) or leave it \
             out",
            self.name,
            self.packages
        )
    }

    /// Why it ended: the last line of its log.
    fn last_words(&mut self, error: Option<std::io::Error>) -> String {
        // Its log is whole once it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let log = fs::read(&self.log).unwrap_or_default();
        let log = String::from_utf8_lossy(&log);
        match (log.lines().rfind(|line| !line.trim().is_empty()), error) {
            (Some(line), _) => line.trim().to_owned(),
            (None, Some(error)) => error.to_string(),
            (None, None) => "it ended without a word".to_owned(),
        }
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
