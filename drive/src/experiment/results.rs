use serde::{Serialize, Serializer, ser::SerializeMap};

use super::Spread;

/// What the cases of an experiment come to together.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Results {
    /// The table: all rows have the same columns.
    pub rows: Vec<Row>,
    /// What should hold, and whether it does; none while cases are missing.
    pub claims: Vec<Claim>,
    /// The figures.
    pub diagrams: Vec<Diagram>,
    /// What to know when reading them.
    pub notes: Vec<String>,
}

/// One row of the table: one behaviour in one setting, over all seeds.
///
/// It is written flat, with the names of its quantities as fields: the mean, its standard deviation
/// as `..._std`, and the paper's value as `paper_...` where there is one.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What tells it from the others, by name.
    pub keys: Vec<(&'static str, Key)>,
    /// Seeds that it is the mean of.
    pub seeds: usize,
    /// What was measured.
    pub quantities: Vec<Quantity>,
}

/// What tells a row from the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Key {
    /// A name.
    Text(String),
    /// A setting.
    Number(f64),
}

/// One quantity of a row.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Its name with its unit, as a field.
    pub name: &'static str,
    /// The same for readers.
    pub title: &'static str,
    /// Over the seeds; `None` where it has no value in any.
    pub spread: Option<Spread>,
    /// The paper's.
    pub paper: Option<f64>,
    /// Digits after the point in tables.
    pub digits: usize,
}

/// Something that should hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Claim {
    /// What.
    pub claim: String,
    /// What was found.
    pub found: String,
    /// Whether it holds.
    pub holds: bool,
}

/// A figure: lines over one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagram {
    /// What stands above it.
    pub title: String,
    /// The axis to the right, with its unit.
    pub x: String,
    /// The axis upwards, with its unit.
    pub y: String,
    /// Its lines.
    pub lines: Vec<Line>,
}

/// A line of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// What it is.
    pub label: String,
    /// Place, mean and standard deviation of each point.
    pub points: Vec<[f64; 3]>,
}

impl Row {
    /// A quantity by its name.
    pub fn get(&self, name: &str) -> Option<&Quantity> {
        self.quantities
            .iter()
            .find(|quantity| quantity.name == name)
    }

    /// The key of this name, where it is a text.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.keys.iter().find_map(|(key, value)| match value {
            Key::Text(text) if *key == name => Some(text.as_str()),
            _ => None,
        })
    }

    /// The key of this name, where it is a number.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.keys.iter().find_map(|(key, value)| match value {
            Key::Number(number) if *key == name => Some(*number),
            _ => None,
        })
    }
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, key) in &self.keys {
            map.serialize_entry(name, key)?;
        }
        map.serialize_entry("seeds", &self.seeds)?;
        for Quantity {
            name,
            spread,
            paper,
            ..
        } in &self.quantities
        {
            map.serialize_entry(name, &spread.map(|spread| spread.mean))?;
            map.serialize_entry(&format!("{name}_std"), &spread.map(|spread| spread.std))?;
            if let Some(paper) = paper {
                map.serialize_entry(&format!("paper_{name}"), paper)?;
            }
        }
        map.end()
    }
}
