use std::{
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
};

use anyhow::{Context, anyhow};
use covista_drive::{Case, Experiment, Figures, Plan};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;

use crate::output::{prepare_folder, write_json};

/// Cases with what driving them gave.
type Driven = Vec<(Case, Figures)>;

const PLAN_FILE: &str = "plan.json";

/// The folder of an experiment: its plan, and a file for each case that has been driven.
pub struct Store {
    folder: PathBuf,
}

/// A case that has been driven, as a file.
#[derive(Serialize)]
struct Written<'a> {
    version: &'a str,
    case: &'a Case,
    figures: &'a Figures,
}

/// The same, read.
#[derive(Deserialize)]
struct Read {
    version: String,
    case: Value,
    figures: Figures,
}

impl Store {
    /// That of `experiment` in the output folder `out`.
    pub fn new(out: &Path, experiment: Experiment) -> Self {
        Self {
            folder: out.join(experiment.name()),
        }
    }

    /// Where it is.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Makes the folder and keeps the plan in it.
    pub fn begin(&self, plan: &Plan) -> anyhow::Result<()> {
        prepare_folder(&self.folder)?;
        write_json(&self.folder.join(PLAN_FILE), plan)
    }

    /// The plan, where the experiment was ever begun.
    pub fn plan(&self) -> anyhow::Result<Option<Plan>> {
        read(&self.folder.join(PLAN_FILE))
    }

    /// Keeps what a case came to.
    pub fn keep(&self, plan: &Plan, case: &Case, figures: &Figures) -> anyhow::Result<()> {
        let written = Written {
            version: &plan.version,
            case,
            figures,
        };
        write_json(&self.file(case), &written)
    }

    /// What the case came to, where it has been driven with the same settings and version.
    pub fn find(&self, plan: &Plan, case: &Case) -> anyhow::Result<Option<Figures>> {
        let Some(found) = read::<Read>(&self.file(case))? else {
            return Ok(None);
        };
        // By way of text, as the other one came: numbers may lose their last bit in it.
        let asked: Value = serde_json::from_str(&serde_json::to_string(case)?)?;
        let is_same = found.version == plan.version && found.case == asked;
        Ok(is_same.then_some(found.figures))
    }

    /// The cases of the plan that have been driven, with their figures, and the names of the others.
    pub fn cases(&self, plan: &Plan) -> anyhow::Result<(Driven, Vec<String>)> {
        let (mut driven, mut missing) = (Vec::new(), Vec::new());
        for case in plan.cases()? {
            match self.find(plan, &case)? {
                Some(figures) => driven.push((case, figures)),
                None => missing.push(case.name()),
            }
        }
        Ok((driven, missing))
    }

    fn file(&self, case: &Case) -> PathBuf {
        self.folder.join(format!("{}.json", case.name()))
    }
}

/// The JSON of a file; `None` where there is no such file.
fn read<T: DeserializeOwned>(path: &Path) -> anyhow::Result<Option<T>> {
    let text = match fs::read_to_string(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        text => text.with_context(|| format!("cannot read {}", path.display()))?,
    };
    serde_json::from_str(&text).map(Some).map_err(|error| {
        anyhow!(
            "{} is damaged ({error}); delete it to have it made again",
            path.display()
        )
    })
}
