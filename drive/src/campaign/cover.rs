use covista_control::{ControlSettings, SafetySettings};
use rayon::prelude::*;

use super::{
    CampaignError, CampaignSpec, Family, PlantModel, Tally, exact::closed_m, run_families,
};

/// W_p in metres and W_v in m/s that are tried.
const POSITION_M: [f64; 10] = [
    1e-3, 3e-3, 6e-3, 10e-3, 15e-3, 20e-3, 25e-3, 30e-3, 40e-3, 60e-3,
];
const SPEED_MPS: [f64; 4] = [5e-3, 10e-3, 20e-3, 40e-3];
/// Bounds on slip in rad and on curvature in 1/m that are tried.
const SLIP_RAD: [f64; 7] = [2e-3, 5e-3, 10e-3, 20e-3, 30e-3, 45e-3, 60e-3];
const CURVATURE_PER_M: [f64; 4] = [1e-4, 5e-4, 1e-3, 2e-3];
/// A candidate is thrown out after this share of the steps where it fails early.
const SCREEN_SHARE: u64 = 8;

/// The plants unlike the model.
pub const PLANTS: [PlantModel; 4] = [
    PlantModel::Lag {
        time_constant_s: 0.1,
    },
    PlantModel::Lag {
        time_constant_s: 0.2,
    },
    PlantModel::Lag {
        time_constant_s: 0.3,
    },
    PlantModel::Dynamic,
];

/// Which noise bounds cover a plant unlike the model, and what they cost.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantCover {
    /// The plant.
    pub plant: PlantModel,
    /// What the default bounds find: how wrong the model is.
    pub with_defaults: Tally,
    /// W_p in metres and W_v in m/s with which no headway is broken and nothing is hit.
    pub along: Option<[f64; 2]>,
    /// Bounds on slip in rad and curvature in 1/m with which no corner leaves its lane.
    pub across: Option<[f64; 2]>,
    /// What the bounds that cover it find, over all steps.
    pub covered: Option<Tally>,
    /// How much D(v, v) grows with W_p and W_v, in metres, at 15 and 30 m/s.
    pub headway_cost_m: Option<[f64; 2]>,
}

/// Looks for the cheapest bounds under which `plant` keeps its headway and its lane, in a grid.
///
/// # Errors
/// When the settings are refused.
pub fn cover_plant(
    plant: PlantModel,
    control: &ControlSettings,
    seed: u64,
    steps: u64,
) -> Result<PlantCover, CampaignError> {
    let along_families = [Family::Leaders, Family::Standing];
    let across_families = [Family::Open];
    let every = [Family::Open, Family::Leaders, Family::Standing];
    let run = |safety: SafetySettings, families: &[Family], steps: u64| {
        let control = ControlSettings { safety, ..*control };
        let spec = CampaignSpec {
            seed,
            steps,
            control,
            broken: None,
            plant,
        };
        let found = run_families(&spec, families, &|_| {})?;
        let mut all = Tally::default();
        found.iter().for_each(|(_, tally)| all.add(tally));
        Ok::<_, CampaignError>(all)
    };
    let covers = |safety: SafetySettings, families: &[Family], holds: fn(&Tally) -> bool| {
        for share in [SCREEN_SHARE, 1] {
            if !holds(&run(safety, families, steps.div_ceil(share))?) {
                return Ok::<_, CampaignError>(false);
            }
        }
        Ok(true)
    };
    let with_defaults = run(control.safety, &every, steps)?;

    let mut along = None;
    for bounds in along_grid(&control.safety) {
        if covers(
            with_along(control.safety, bounds),
            &along_families,
            keeps_headway,
        )? {
            along = Some(bounds);
            break;
        }
    }
    let mut across = None;
    for bounds in across_grid() {
        if covers(
            with_across(control.safety, bounds),
            &across_families,
            keeps_lane,
        )? {
            across = Some(bounds);
            break;
        }
    }
    let covered = match (along, across) {
        (Some(along), Some(across)) => {
            let safety = with_across(with_along(control.safety, along), across);
            Some(run(safety, &every, 2 * steps)?)
        }
        _ => None,
    };
    let headway_cost_m = along.map(|bounds| {
        [15.0, 30.0].map(|v| {
            let of = |safety: &SafetySettings| closed_m(safety, v, v, 1.0, 1.0);
            of(&with_along(control.safety, bounds)) - of(&control.safety)
        })
    });
    Ok(PlantCover {
        plant,
        with_defaults,
        along,
        across,
        covered,
        headway_cost_m,
    })
}

/// Every plant of [`PLANTS`].
///
/// # Errors
/// When the settings are refused.
pub fn cover_plants(
    control: &ControlSettings,
    seed: u64,
    steps: u64,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<PlantCover>, CampaignError> {
    PLANTS
        .par_iter()
        .map(|&plant| {
            let cover = cover_plant(plant, control, seed, steps)?;
            progress(steps);
            Ok(cover)
        })
        .collect()
}

fn keeps_headway(tally: &Tally) -> bool {
    tally.headway_violations == 0 && tally.collisions == 0
}

fn keeps_lane(tally: &Tally) -> bool {
    tally.lane_excess_steps == 0
}

/// The grid in the order of what it costs at 30 m/s.
fn along_grid(safety: &SafetySettings) -> Vec<[f64; 2]> {
    let cost_m = |bounds: [f64; 2]| closed_m(&with_along(*safety, bounds), 30.0, 30.0, 1.0, 1.0);
    let mut grid: Vec<_> = POSITION_M
        .iter()
        .flat_map(|&position_m| SPEED_MPS.map(|speed_mps| [position_m, speed_mps]))
        .filter(|bounds| bounds[1] < safety.brake_mps2 * covista_world::STEP_S)
        .collect();
    grid.sort_by(|a, b| cost_m(*a).total_cmp(&cost_m(*b)));
    grid
}

/// The grid in the order of how far a body drifts within a second at 20 m/s.
fn across_grid() -> Vec<[f64; 2]> {
    let drift = |[slip, curvature]: [f64; 2]| 20.0 * slip + 0.5 * 400.0 * curvature;
    let mut grid: Vec<_> = SLIP_RAD
        .iter()
        .flat_map(|&slip| CURVATURE_PER_M.map(|curvature| [slip, curvature]))
        .collect();
    grid.sort_by(|a, b| drift(*a).total_cmp(&drift(*b)));
    grid
}

fn with_along(safety: SafetySettings, [position_m, speed_mps]: [f64; 2]) -> SafetySettings {
    SafetySettings {
        noise_position_m: position_m,
        noise_speed_mps: speed_mps,
        ..safety
    }
}

fn with_across(safety: SafetySettings, [slip_rad, curvature_per_m]: [f64; 2]) -> SafetySettings {
    SafetySettings {
        noise_slip_rad: slip_rad,
        noise_curvature_per_m: curvature_per_m,
        ..safety
    }
}
