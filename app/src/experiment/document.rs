use std::{fmt::Write as _, path::Path};

use covista_drive::{Case, Claim, Diagram, Figures, Key, Percepts, Plan, Quantity, Results, Row};
use covista_viewer::{Curve, CurvePanel, plot_curves};
use serde_json::json;

use crate::{
    output::{Report, write_whole},
    table::aligned,
};

/// Fewer seeds carry no claim.
const ENOUGH_SEEDS: usize = 5;

/// What an experiment came to, for its readers.
pub struct Document<'a> {
    /// Its plan.
    pub plan: &'a Plan,
    /// Table, claims and figures.
    pub results: Results,
    /// Names of the cases that have not been driven.
    pub missing: &'a [String],
}

impl<'a> Document<'a> {
    /// Of the cases that have been driven.
    pub fn new(plan: &'a Plan, driven: &[(Case, Figures)], missing: &'a [String]) -> Self {
        Self {
            results: plan.results(driven, missing.is_empty()),
            plan,
            missing,
        }
    }

    /// The table with the claims, for the terminal.
    pub fn text(&self) -> String {
        let mut text = aligned(&table(&self.results.rows));
        if let Some(note) = self.few_seeds() {
            text.push_str(&format!("\n{note}"));
        }
        for Claim {
            claim,
            found,
            holds,
        } in &self.results.claims
        {
            let mark = if *holds { "holds" } else { "FAILS" };
            text.push_str(&format!("\n{mark}  {claim}: {found}"));
        }
        text
    }

    /// What `--json` has.
    pub fn report(&self) -> Report<Row> {
        let command = format!("experiment {}", self.plan.experiment.name());
        Report::new(command, self.results.rows.clone()).with_settings(json!({
            "plan": self.plan,
            "case": self.plan.cases().ok().and_then(|cases| cases.into_iter().next()),
            "claims": self.results.claims,
            "notes": self.results.notes,
        }))
    }

    /// Writes the table, the claims, the notes and the settings as Markdown, with the picture
    /// beside it.
    pub fn write_markdown(&self, path: &Path) -> anyhow::Result<()> {
        let name = self.plan.experiment.name();
        let mut text = format!("# {name}\n\n{}\n", self.settings());
        text.push_str(&markdown_table(&table(&self.results.rows)));
        if !self.results.claims.is_empty() {
            text.push('\n');
            text.push_str(&markdown_table(&claims_table(&self.results.claims)));
        }
        let few = self.few_seeds();
        for note in self.results.notes.iter().chain(&few) {
            write!(text, "\n{note}\n")?;
        }
        write!(text, "\n![{name}]({name}.png)\n")?;
        write_whole(path, text.as_bytes())
    }

    /// What to hold against claims from a few seeds.
    fn few_seeds(&self) -> Option<String> {
        let count = self.results.rows.iter().map(|row| row.seeds).min()?;
        (count < ENOUGH_SEEDS).then(|| {
            format!("From {count} of at least {ENOUGH_SEEDS} seeds: what holds or fails here may be chance.")
        })
    }

    /// How it was made, in one paragraph.
    pub fn settings(&self) -> String {
        let options = &self.plan.options;
        let mut text = format!("covista {}, ", self.plan.version);
        if self.plan.trainings.is_empty() {
            let covista_drive::Seeds { first, last } = options.seeds;
            text.push_str(&format!("seeds {first} to {last}"));
        } else {
            text.push_str("of trainings that were given");
        }
        if let Some(steps) = options.steps {
            text.push_str(&format!(", episodes of {steps} behaviour steps"));
        }
        text.push_str(match options.percepts {
            Percepts::Truth => "",
            Percepts::Statistical => ", statistical perception",
            Percepts::Network => ", perception by networks",
        });
        for (id, sha256) in &self.plan.networks {
            text.push_str(&format!(", {id} {}", short(sha256)));
        }
        for (behaviour, sha256) in &self.plan.policies {
            text.push_str(&format!(", policy {} {}", behaviour.name(), short(sha256)));
        }
        text.push_str(". Means over the seeds, with the standard deviation.\n");
        text
    }
}

/// Enough of a hash to tell files apart.
fn short(sha256: &str) -> &str {
    sha256.get(..12).unwrap_or(sha256)
}

/// Draws the figures side by side.
pub fn pictures(path: &Path, results: &Results) -> anyhow::Result<()> {
    let panel = |diagram: &Diagram| CurvePanel {
        title: diagram.title.clone(),
        x: diagram.x.clone(),
        y: diagram.y.clone(),
        curves: (diagram.lines.iter())
            .map(|line| Curve {
                label: line.label.clone(),
                points: line.points.clone(),
            })
            .collect(),
    };
    let panels: Vec<_> = results.diagrams.iter().map(panel).collect();
    Ok(plot_curves(path, &panels)?)
}

/// The claims as rows of cells.
pub fn claims_table(claims: &[Claim]) -> Vec<Vec<String>> {
    let header = ["claim", "found", "holds"].map(str::to_owned).to_vec();
    let rows = claims.iter().map(|claim| {
        let holds = if claim.holds { "yes" } else { "no" };
        vec![claim.claim.clone(), claim.found.clone(), holds.to_owned()]
    });
    std::iter::once(header).chain(rows).collect()
}

/// The rows as cells; a quantity of which the paper has a value in any row has it in a column
/// beside.
pub fn table(rows: &[Row]) -> Vec<Vec<String>> {
    let Some(first) = rows.first() else {
        return Vec::new();
    };
    let has_paper = |index: usize| {
        rows.iter().any(|row| {
            let quantity = row.quantities.get(index);
            quantity.is_some_and(|quantity| quantity.paper.is_some())
        })
    };
    let mut header: Vec<String> = first
        .keys
        .iter()
        .map(|(name, _)| name.replace('_', " "))
        .collect();
    header.push("seeds".to_owned());
    for (index, quantity) in first.quantities.iter().enumerate() {
        header.push(quantity.title.to_owned());
        if has_paper(index) {
            header.push("paper".to_owned());
        }
    }
    let cells = rows.iter().map(|row| {
        let keys = row.keys.iter().map(|(_, key)| match key {
            Key::Text(text) => text.clone(),
            Key::Number(number) => number.to_string(),
        });
        let mut cells: Vec<String> = keys.collect();
        cells.push(row.seeds.to_string());
        for (index, quantity) in row.quantities.iter().enumerate() {
            cells.push(measured(quantity));
            if has_paper(index) {
                cells.push(
                    quantity
                        .paper
                        .map_or_else(|| "-".to_owned(), |paper| paper.to_string()),
                );
            }
        }
        cells
    });
    std::iter::once(header).chain(cells).collect()
}

fn measured(quantity: &Quantity) -> String {
    let digits = quantity.digits;
    let Some(spread) = quantity.spread else {
        return "-".to_owned();
    };
    if spread.count == 1 {
        return format!("{:.digits$}", spread.mean);
    }
    format!("{:.digits$} ± {:.digits$}", spread.mean, spread.std)
}

fn markdown_table(rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = String::new();
    for (index, row) in rows.iter().enumerate() {
        text.push_str(&line(row));
        if index == 0 {
            text.push_str(&format!("|{}\n", "---|".repeat(row.len())));
        }
    }
    text
}
