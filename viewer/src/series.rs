use covista_world::{Action, FilterOutcome, LaneIndex};
use rerun::{RecordingStream, RecordingStreamResult};

use crate::objects::path_of;
use crate::palette::{self, Rgb};
use crate::{SceneRecord, StepRecord, VehicleInfo, VehicleKind, VehicleStep};

/// A quantity of a CAV over time.
struct Curve {
    /// Folder of its entities, one entity for each CAV.
    folder: &'static str,
    value: fn(&VehicleStep) -> Option<f64>,
}

const CURVES: [Curve; 4] = [
    Curve {
        folder: "plots/speed",
        value: |vehicle| Some(vehicle.speed_mps),
    },
    Curve {
        folder: "plots/acceleration",
        value: |vehicle| Some(vehicle.accel_mps2),
    },
    Curve {
        folder: "plots/headway",
        value: |vehicle| vehicle.headway_m,
    },
    Curve {
        folder: "plots/h",
        value: |vehicle| vehicle.h_m,
    },
];

/// A discrete state of a CAV over time.
struct State {
    folder: &'static str,
    values: &'static [(&'static str, Rgb)],
    value: fn(&VehicleStep) -> Option<&'static str>,
}

const STATES: [State; 3] = [
    State {
        folder: "states/action",
        values: &[
            (KEEP, palette::GREY),
            (LEFT, palette::SKY_BLUE),
            (RIGHT, palette::ORANGE),
            (STOP, palette::VERMILLION),
        ],
        value: |vehicle| vehicle.action.map(action_name),
    },
    State {
        folder: "states/filter",
        values: &[
            (NOMINAL, palette::GREY),
            (FILTERED, palette::GREEN),
            (RELAXED, palette::ORANGE),
            (BACKUP, palette::VERMILLION),
        ],
        value: |vehicle| vehicle.outcome.map(outcome_name),
    },
    State {
        folder: "states/lane",
        values: &[
            ("left", palette::SKY_BLUE),
            ("middle", palette::GREY),
            ("right", palette::ORANGE),
        ],
        value: |vehicle| vehicle.lane.map(lane_name),
    },
];

const KEEP: &str = "keep lane";
const LEFT: &str = "change left";
const RIGHT: &str = "change right";
const STOP: &str = "emergency stop";
const NOMINAL: &str = "nominal";
const FILTERED: &str = "filtered";
const RELAXED: &str = "relaxed";
const BACKUP: &str = "backup";

fn action_name(action: Action) -> &'static str {
    match action {
        Action::KeepLane => KEEP,
        Action::ChangeLeft => LEFT,
        Action::ChangeRight => RIGHT,
        Action::EmergencyStop => STOP,
    }
}

fn outcome_name(outcome: FilterOutcome) -> &'static str {
    match outcome {
        FilterOutcome::Nominal => NOMINAL,
        FilterOutcome::Filtered => FILTERED,
        FilterOutcome::Relaxed => RELAXED,
        FilterOutcome::Backup => BACKUP,
    }
}

fn lane_name(lane: LaneIndex) -> &'static str {
    match lane {
        LaneIndex::LEFTMOST => "left",
        LaneIndex::RIGHTMOST => "right",
        _ => "middle",
    }
}

/// The last state that was logged of each CAV: a state is logged when it changes.
#[derive(Debug, Default)]
pub struct StateMemory(std::collections::BTreeMap<(u32, &'static str), Option<&'static str>>);

fn cavs(scene: &SceneRecord) -> impl Iterator<Item = &VehicleInfo> {
    scene
        .vehicles
        .iter()
        .filter(|vehicle| vehicle.kind == VehicleKind::Cav)
}

/// Logs names and colours.
pub fn log_styles(stream: &RecordingStream, scene: &SceneRecord) -> RecordingStreamResult<()> {
    for (index, cav) in cavs(scene).enumerate() {
        for curve in &CURVES {
            stream.log_static(
                path_of(curve.folder, &cav.label),
                &rerun::SeriesLines::new()
                    .with_names([cav.label.as_str()])
                    .with_colors([rerun::Color::from(palette::series_color(index))])
                    .with_widths([1.5]),
            )?;
        }
        for state in &STATES {
            stream.log_static(
                path_of(state.folder, &cav.label),
                &rerun::StateConfiguration::new()
                    .with_values(state.values.iter().map(|(name, _)| *name))
                    .with_colors(state.values.iter().map(|(_, rgb)| rerun::Color::from(*rgb))),
            )?;
        }
    }
    Ok(())
}

/// Logs one instant of all curves and states.
pub fn log_series(
    stream: &RecordingStream,
    scene: &SceneRecord,
    step: &StepRecord,
    memory: &mut StateMemory,
) -> RecordingStreamResult<()> {
    for cav in cavs(scene) {
        let Some(vehicle) = step.vehicles.iter().find(|vehicle| vehicle.id == cav.id) else {
            continue;
        };
        for curve in &CURVES {
            // A gap in the curve where there is no value.
            let value = (curve.value)(vehicle).unwrap_or(f64::NAN);
            stream.log(
                path_of(curve.folder, &cav.label),
                &rerun::Scalars::single(value),
            )?;
        }
        for state in &STATES {
            let value = (state.value)(vehicle);
            if memory.0.insert((cav.id, state.folder), value) != Some(value) {
                stream.log(
                    path_of(state.folder, &cav.label),
                    &rerun::StateChange::new().with_state_opt([value]),
                )?;
            }
        }
    }
    Ok(())
}
