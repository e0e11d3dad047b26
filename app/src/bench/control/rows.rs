use covista_drive::{Broken, Family, PlantCover, Solver, StepTiming, Tally};
use serde::Serialize;

use crate::table::aligned;

/// A row of `--json`.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Row {
    Timing(TimingRow),
    Campaign(CampaignRow),
    Plant(PlantRow),
}

#[derive(Debug, Serialize)]
pub struct TimingRow {
    solver: &'static str,
    stage: &'static str,
    situations: &'static str,
    neighbours: usize,
    calls: usize,
    median_us: f64,
    p99_us: f64,
    clock_us: f64,
}

/// The whole campaign with its families beside it, or one with an assumption broken.
#[derive(Debug, Serialize)]
pub struct CampaignRow {
    broken_on_purpose: bool,
    /// The assumption that was broken.
    #[serde(skip_serializing_if = "Option::is_none")]
    broken: Option<&'static str>,
    /// Whether the monitor named it most often.
    #[serde(skip_serializing_if = "Option::is_none")]
    named: Option<bool>,
    seed: u64,
    family: &'static str,
    most_frequent_cause: Option<&'static str>,
    #[serde(flatten)]
    tally: Tally,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    families: Vec<FamilyRow>,
}

#[derive(Debug, Serialize)]
struct FamilyRow {
    family: &'static str,
    #[serde(flatten)]
    tally: Tally,
}

#[derive(Debug, Serialize)]
pub struct PlantRow {
    plant: String,
    seed: u64,
    steps_with_defaults: u64,
    headway_violations_with_defaults: u64,
    collisions_with_defaults: u64,
    lane_excess_steps_with_defaults: u64,
    smallest_headway_m_with_defaults: f64,
    largest_lane_excess_m_with_defaults: f64,
    /// Whether the bounds keep headway and lane in a campaign they were not searched with.
    covered: bool,
    eta: f64,
    w_p_mm: f64,
    headway_kept_with_w_p: bool,
    smallest_w_p_mm: Option<f64>,
    covered_by_slip_mrad: Option<f64>,
    own_reference_covered_by_slip_mrad: Option<f64>,
    headway_cost_m_at_15: f64,
    headway_cost_m_at_30: f64,
    headway_cost_s_at_15: f64,
    headway_cost_s_at_30: f64,
    steps_covered: Option<u64>,
    headway_violations_covered: Option<u64>,
    collisions_covered: Option<u64>,
    lane_excess_steps_covered: Option<u64>,
    infeasible_covered: Option<u64>,
    smallest_headway_m_covered: Option<f64>,
}

impl Row {
    pub fn timing(timing: &StepTiming) -> Self {
        Self::Timing(TimingRow {
            solver: match timing.solver {
                Solver::ClosedForm => "closed-form",
                Solver::Clarabel => "clarabel",
            },
            stage: timing.stage.name(),
            situations: timing.situations,
            neighbours: timing.neighbours,
            calls: timing.calls,
            median_us: timing.median_us,
            p99_us: timing.p99_us,
            clock_us: timing.clock_us,
        })
    }

    pub fn plant(seed: u64, cover: &PlantCover) -> Self {
        let found = &cover.with_defaults;
        let covered = cover.covered.as_ref();
        let holds = covered.is_some_and(|tally| {
            tally.headway_violations + tally.collisions + tally.lane_excess_steps == 0
        });
        let cost_m = cover.headway_cost_m;
        let slow = if cover.case.is_slow {
            ", small eta"
        } else {
            ""
        };
        Self::Plant(PlantRow {
            plant: format!("{}{slow}", cover.case.plant.name()),
            seed,
            steps_with_defaults: found.campaign_steps,
            headway_violations_with_defaults: found.headway_violations,
            collisions_with_defaults: found.collisions,
            lane_excess_steps_with_defaults: found.lane_excess_steps,
            smallest_headway_m_with_defaults: found.smallest_headway_m,
            largest_lane_excess_m_with_defaults: found.largest_lane_excess_m,
            covered: holds,
            eta: cover.eta,
            w_p_mm: cover.position_m * 1e3,
            headway_kept_with_w_p: cover.keeps_headway,
            smallest_w_p_mm: cover.smallest_position_m.map(|position_m| position_m * 1e3),
            covered_by_slip_mrad: cover.across.map(|slip_rad| slip_rad * 1e3),
            own_reference_covered_by_slip_mrad: cover.across_own.map(|slip_rad| slip_rad * 1e3),
            headway_cost_m_at_15: cost_m[0],
            headway_cost_m_at_30: cost_m[1],
            headway_cost_s_at_15: cost_m[0] / 15.0,
            headway_cost_s_at_30: cost_m[1] / 30.0,
            steps_covered: covered.map(|tally| tally.campaign_steps),
            headway_violations_covered: covered.map(|tally| tally.headway_violations),
            collisions_covered: covered.map(|tally| tally.collisions),
            lane_excess_steps_covered: covered.map(|tally| tally.lane_excess_steps),
            infeasible_covered: covered.map(|tally| tally.infeasible),
            smallest_headway_m_covered: covered.map(|tally| tally.smallest_headway_m),
        })
    }
}

impl CampaignRow {
    pub fn whole(seed: u64, families: &[(Family, Tally)]) -> Self {
        let mut all = Tally::default();
        families.iter().for_each(|(_, tally)| all.add(tally));
        let row = |(family, tally): &(Family, Tally)| FamilyRow {
            family: family.name(),
            tally: tally.clone(),
        };
        Self {
            broken_on_purpose: false,
            broken: None,
            named: None,
            seed,
            family: "all",
            most_frequent_cause: all.most_frequent_cause(),
            tally: all,
            families: families.iter().map(row).collect(),
        }
    }

    pub fn broken(seed: u64, broken: Broken, found: &Tally) -> Self {
        let most_frequent = if broken.is_about_followers() {
            found.most_frequent_rear_cause()
        } else {
            found.most_frequent_cause()
        };
        Self {
            broken_on_purpose: true,
            broken: Some(broken.name()),
            named: Some(most_frequent == Some(broken.cause())),
            seed,
            family: "all",
            most_frequent_cause: most_frequent,
            tally: found.clone(),
            families: Vec::new(),
        }
    }
}

/// The rows as text: timings, campaign, broken assumptions, plants.
pub fn tables(rows: &[Row]) -> [String; 4] {
    let mut timings = vec![header(&[
        "one vehicle-step",
        "neighbours",
        "calls",
        "median, us",
        "p99, us",
        "clock, us",
    ])];
    let mut families = vec![campaign_header("campaign")];
    let mut broken = vec![campaign_header("broken on purpose")];
    let mut plants = vec![header(&[
        "plant",
        "headways broken",
        "lane left, steps",
        "eta",
        "W_p, mm",
        "headway kept",
        "smallest W_p, mm",
        "slip, mrad",
        "own steering, mrad",
        "covered",
        "cost at 15 m/s, m",
        "at 30 m/s, m",
    ])];
    for row in rows {
        match row {
            Row::Timing(row) => timings.push(vec![
                format!("{}, {}, {}", row.solver, row.stage, row.situations),
                row.neighbours.to_string(),
                row.calls.to_string(),
                format!("{:.2}", row.median_us),
                format!("{:.2}", row.p99_us),
                format!("{:.3}", row.clock_us),
            ]),
            Row::Campaign(row) if row.broken_on_purpose => {
                let name = row.broken.unwrap_or_default();
                broken.push(campaign_cells(name, &row.tally, row.most_frequent_cause));
            }
            Row::Campaign(row) => {
                families.extend(row.families.iter().map(|of| {
                    campaign_cells(of.family, &of.tally, of.tally.most_frequent_cause())
                }));
                families.push(campaign_cells("all", &row.tally, row.most_frequent_cause));
            }
            Row::Plant(row) => plants.push(vec![
                row.plant.clone(),
                row.headway_violations_with_defaults.to_string(),
                row.lane_excess_steps_with_defaults.to_string(),
                format!("{:.4}", row.eta),
                or_dash(Some(row.w_p_mm)),
                yes_or_no(row.headway_kept_with_w_p),
                or_dash(row.smallest_w_p_mm),
                or_dash(row.covered_by_slip_mrad),
                or_dash(row.own_reference_covered_by_slip_mrad),
                yes_or_no(row.covered),
                or_dash(Some(row.headway_cost_m_at_15)),
                or_dash(Some(row.headway_cost_m_at_30)),
            ]),
        }
    }
    [timings, families, broken, plants].map(|rows| aligned(&rows))
}

fn header(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| (*cell).to_owned()).collect()
}

fn campaign_header(first: &str) -> Vec<String> {
    header(&[
        first,
        "steps",
        "violations",
        "infeasible",
        "excused",
        "collisions",
        "touched",
        "rear gaps",
        "smallest h, m",
        "headway, m",
        "unattributed",
        "cause",
    ])
}

fn campaign_cells(name: &str, tally: &Tally, cause: Option<&str>) -> Vec<String> {
    vec![
        name.to_owned(),
        tally.campaign_steps.to_string(),
        tally.violations.to_string(),
        tally.infeasible.to_string(),
        tally.excused.to_string(),
        tally.collisions.to_string(),
        tally.touched.to_string(),
        tally.rear_gap_breaches.to_string(),
        or_dash(Some(tally.smallest_h_m)),
        or_dash(Some(tally.smallest_headway_m)),
        tally.unattributed.to_string(),
        cause.unwrap_or("-").to_owned(),
    ]
}

fn yes_or_no(is_so: bool) -> String {
    if is_so { "yes" } else { "no" }.to_owned()
}

/// Two digits; a dash where there is nothing.
fn or_dash(value: Option<f64>) -> String {
    match value {
        Some(value) if value.is_finite() => format!("{value:.2}"),
        _ => "-".to_owned(),
    }
}
