use super::{Loops, algorithm, collisions, over_time, quantity};
use crate::experiment::{Diagram, Experiment, Headways, LoopFigures, Results, Row, paper};

/// The least headway over time.
pub(super) fn headway(loops: &Loops<'_>) -> Results {
    let (mut rows, mut lines) = (Vec::new(), [Vec::new(), Vec::new()]);
    for &behaviour in Experiment::Headway.behaviours() {
        let runs: Vec<_> = (loops.iter())
            .filter(|(case, _)| case.behaviour == behaviour)
            .map(|(_, figures)| *figures)
            .collect();
        if runs.is_empty() {
            continue;
        }
        let cavs = |run: &LoopFigures| {
            let over_time = run.headways.as_ref()?.cavs_m.iter().flatten();
            over_time.copied().min_by(f64::total_cmp)
        };
        rows.push(Row {
            keys: vec![algorithm(behaviour)],
            seeds: runs.len(),
            quantities: vec![
                quantity(
                    ("min_headway_m", "least headway, m", 1),
                    &runs,
                    |run| run.min_headway_m,
                    paper::min_headway_m(behaviour),
                ),
                quantity(("min_cav_headway_m", "of CAVs, m", 1), &runs, cavs, None),
                collisions(&runs),
            ],
        });
        for (lines, of) in lines.iter_mut().zip([
            (|run| &run.all_m) as fn(&Headways) -> &Vec<Option<f64>>,
            |run| &run.cavs_m,
        ]) {
            let curves: Vec<_> = runs
                .iter()
                .filter_map(|run| run.headways.as_ref().map(of))
                .collect();
            lines.push(over_time(behaviour.name(), &curves));
        }
    }
    let [all, cavs] = lines.map(|lines| lines.into_iter());
    let diagram = |title: &str, lines| Diagram {
        title: title.to_owned(),
        x: "time in s".to_owned(),
        y: "least headway in m".to_owned(),
        lines,
    };
    Results {
        diagrams: vec![
            diagram("All vehicles", all.collect()),
            diagram("CAVs", cavs.collect()),
        ],
        notes: vec![
            "Between the bodies' centres along the road, so bodies overlap below about 5 m. Curves are of the ends of behaviour steps (0.5 s), the mean over the seeds; the least headway of all vehicles is of all steps, that of CAVs of those ends. The paper shows 500 time steps.".into(),
            "The promise of 18.5 m is the CAVs': human drivers by IDM follow closer, and may cut in.".into(),
        ],
        rows,
        claims: Vec::new(),
    }
}
