//! `covista report`: the experiments of a folder on one page.

use std::{fmt::Write as _, fs};

use anyhow::bail;
use base64::{Engine, engine::general_purpose::STANDARD};
use covista_drive::Experiment;

use crate::{
    cli::ReportArgs,
    experiment::{Document, Store, claims_table, pictures, table},
    output::{prepare_file, say, write_whole},
};

const STYLE: &str = "body{font:16px/1.5 sans-serif;max-width:75em;margin:2em auto;padding:0 1em}\
    table{border-collapse:collapse;margin:1em 0}\
    th,td{border:1px solid #ccc;padding:.25em .6em;text-align:right;font-size:14px}\
    th:first-child,td:first-child{text-align:left}img{max-width:100%}\
    pre{background:#f4f4f4;padding:1em;overflow:auto;font-size:13px}.missing{color:#b00}";

/// `covista report`.
pub fn run(args: &ReportArgs) -> anyhow::Result<()> {
    let page = args.dir.join("report.html");
    let mut sections = String::new();
    let mut told = Vec::new();
    for experiment in Experiment::ALL {
        let store = Store::new(&args.dir, experiment);
        let Some(plan) = store.plan()? else {
            continue;
        };
        let (driven, missing) = store.cases(&plan)?;
        let document = Document::new(&plan, &driven, &missing);
        told.push(format!(
            "{}: {} of {} cases",
            experiment.name(),
            driven.len(),
            driven.len() + missing.len()
        ));
        section(&mut sections, &document)?;
    }
    if told.is_empty() {
        bail!(
            "there is no experiment in {}; run `covista experiment NAME --out` into it first",
            args.dir.display()
        );
    }
    prepare_file(&page)?;
    let text = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <title>covista: experiments</title><style>{STYLE}</style></head><body>\n\
         <h1>covista: experiments</h1>\n{sections}</body></html>\n"
    );
    write_whole(&page, text.as_bytes())?;
    say(&format!(
        "{}\nwritten to {}",
        told.join("\n"),
        page.display()
    ))
}

fn section(page: &mut String, document: &Document<'_>) -> anyhow::Result<()> {
    let name = document.plan.experiment.name();
    writeln!(page, "<h2 id=\"{name}\">{name}</h2>")?;
    writeln!(page, "<p>{}</p>", escaped(&document.settings()))?;
    if !document.missing.is_empty() {
        let (count, names) = (document.missing.len(), document.missing.join(", "));
        writeln!(
            page,
            "<details class=\"missing\"><summary>{count} cases are missing</summary>{}</details>",
            escaped(&names)
        )?;
    }
    write_table(page, &table(&document.results.rows))?;
    if !document.results.claims.is_empty() {
        write_table(page, &claims_table(&document.results.claims))?;
    }
    for note in &document.results.notes {
        writeln!(page, "<p>{}</p>", escaped(note))?;
    }
    let folder = tempfile::tempdir()?;
    let picture = folder.path().join("picture.png");
    pictures(&picture, &document.results)?;
    let encoded = STANDARD.encode(fs::read(&picture)?);
    writeln!(
        page,
        "<img alt=\"{name}\" src=\"data:image/png;base64,{encoded}\">"
    )?;
    let settings = serde_json::to_string_pretty(&document.report())?;
    writeln!(
        page,
        "<details><summary>Settings, version and rows</summary><pre>{}</pre></details>",
        escaped(&settings)
    )?;
    Ok(())
}

fn write_table(page: &mut String, rows: &[Vec<String>]) -> std::fmt::Result {
    page.push_str("<table>\n");
    for (index, row) in rows.iter().enumerate() {
        let tag = if index == 0 { "th" } else { "td" };
        let cells: String = row
            .iter()
            .map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)))
            .collect();
        writeln!(page, "<tr>{cells}</tr>")?;
    }
    page.push_str("</table>\n");
    Ok(())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
