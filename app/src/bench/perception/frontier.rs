//! The rows of a run as the frontier: accuracy against images/s.

use covista_viewer::{FrontierPanel, FrontierPoint, FrontierSeries};

use super::member::Member;
use super::rows::{COVISTA, END_TO_END, Row};

/// What the paper's points were measured on.
pub(super) const PAPER: &str = "the paper (Table: vision network): NVIDIA RTX 2080 Ti, PyTorch, \
    its own CARLA data, mAP; another machine and other data, so not comparable one to one";

/// One panel for detectors and one for lane networks, with the paper's points.
pub(super) fn panels(rows: &[Row], is_detector: impl Fn(&str) -> bool) -> Vec<FrontierPanel> {
    let of =
        |title: &str, accuracy: &str, wanted: bool, published: &[(&str, f64, f64)]| FrontierPanel {
            title: title.to_owned(),
            accuracy: accuracy.to_owned(),
            series: series(rows, &|row| is_detector(&row.model) == wanted),
            published: published
                .iter()
                .map(|&(label, img_per_s, accuracy)| FrontierPoint {
                    label: label.to_owned(),
                    img_per_s,
                    accuracy,
                })
                .collect(),
        };
    vec![
        of(
            "Detectors",
            "car 3D AP moderate R40, %",
            true,
            &[("paper, dense", 28.0, 76.5), ("paper, pruned", 99.0, 73.6)],
        ),
        of(
            "Lane networks",
            "TuSimple accuracy, %",
            false,
            &[("paper", 313.0, 95.82)],
        ),
    ]
}

/// The members of a family on one provider in one precision, the slowest first; a network that
/// only had weights set to 0 is on its own.
fn series(rows: &[Row], is_wanted: &dyn Fn(&Row) -> bool) -> Vec<FrontierSeries> {
    let mut series: Vec<(Member<'_>, FrontierSeries)> = Vec::new();
    let measured = rows
        .iter()
        .filter(|row| row.run_by == COVISTA && row.stage == END_TO_END && is_wanted(row));
    for row in measured {
        let (member, Some(accuracy)) = (Member::of(&row.model), row.accuracy) else {
            continue;
        };
        let point = FrontierPoint {
            label: label(member),
            img_per_s: row.img_per_s,
            accuracy,
        };
        let home = series.iter_mut().find(|(of, series)| {
            of.family == member.family
                && of.is_structured()
                && member.is_structured()
                && series.provider == row.provider
                && series.precision == row.precision
        });
        match home {
            Some((_, series)) => series.points.push(point),
            None => series.push((
                member,
                FrontierSeries {
                    provider: row.provider.to_owned(),
                    precision: row.precision.to_owned(),
                    points: vec![point],
                },
            )),
        }
    }
    let sorted = series.into_iter().map(|(_, mut series)| {
        series
            .points
            .sort_by(|a, b| a.img_per_s.total_cmp(&b.img_per_s));
        series
    });
    sorted.collect()
}

/// What stands beside a point: the cut, and the family for the dense network.
fn label(member: Member<'_>) -> String {
    if member.cut.is_empty() {
        member.family.to_owned()
    } else {
        member.cut.to_owned()
    }
}
