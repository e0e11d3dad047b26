use covista_drive::RunSummary;
use covista_world::Detection3d;

/// The runs side by side, as text for the terminal.
pub fn side_by_side(runs: &[RunSummary]) -> String {
    let mut rows: Vec<Vec<String>> = vec![row("", runs, |run| {
        format!("sharing {}", if run.sharing { "on" } else { "off" })
    })];
    let mut add = |name: &str, cell: &dyn Fn(&RunSummary) -> String| {
        rows.push(row(name, runs, cell));
    };
    add("mean speed, m/s", &|run| {
        format!("{:.2}", run.mean_velocity_mps)
    });
    add("  of the CAVs", &|run| {
        format!("{:.2}", run.cav_mean_velocity_mps)
    });
    add("mean comfort, 0 to 3", &|run| {
        format!("{:.2}", run.mean_comfort)
    });
    add("vehicles stuck", &|run| run.vehicles_stuck.to_string());
    add("lane changes before own sight", &|run| {
        run.lane_changes_before_sight.to_string()
    });
    add("smallest headway, m", &|run| optional(run.min_headway_m, 1));
    add("hardest braking, m/s^2", &|run| {
        format!("{:.1}", run.hardest_braking_mps2)
    });
    add("collisions", &|run| run.collisions.to_string());
    add("unsafe actions", &|run| run.unsafe_actions.to_string());
    add("emergency stops (a km)", &|run| {
        format!(
            "{} ({:.2})",
            run.emergency_stops, run.emergency_stops_per_km
        )
    });
    add("lane changes (a km)", &|run| {
        format!("{} ({:.2})", run.lane_changes, run.lane_changes_per_km)
    });
    add("actions overruled, %", &|run| {
        format!("{:.1}", 100.0 * run.actions_overruled_share)
    });
    add("violations of h >= 0 (unattributed)", &|run| {
        format!("{} ({})", run.violations, run.violations_unattributed)
    });
    add("  share of the CAVs' time, %", &|run| {
        let violated = run
            .excused_share
            .values()
            .fold(0.0, |sum, share| sum + share);
        format!("{:.1}", 100.0 * violated)
    });
    add("frames perceived", &|run| run.frames_perceived.to_string());
    add("bytes shared", &|run| run.bytes_shared.to_string());
    let ids: Vec<u32> = runs
        .first()
        .map(|run| run.vehicles.iter().map(|cav| cav.id).collect())
        .unwrap_or_default();
    for (index, id) in ids.iter().enumerate() {
        let lane = runs[0].vehicles[index].initial_lane;
        add(
            &format!("CAV {id} (lane {lane}): sight / lane change, s"),
            &|run| {
                run.vehicles.get(index).map_or_else(String::new, |cav| {
                    format!(
                        "{} / {}",
                        optional(cav.first_line_of_sight_s, 1),
                        optional(cav.lane_change_start_s, 1)
                    )
                })
            },
        );
    }
    add("wall time, s", &|run| format!("{:.1}", run.wall_s));
    add("  sensors / perception", &|run| {
        format!(
            "{:.1} / {:.1}",
            run.stages.sensors_s, run.stages.perception_s
        )
    });
    add("  sharing / planner", &|run| {
        format!("{:.1} / {:.1}", run.stages.sharing_s, run.stages.planner_s)
    });
    add("  control / traffic / record", &|run| {
        format!(
            "{:.1} / {:.1} / {:.1}",
            run.stages.control_s, run.stages.traffic_s, run.stages.record_s
        )
    });
    aligned(&rows)
}

/// A table of boxes in the LIDAR frame.
pub fn box_rows(found: &[Detection3d]) -> Vec<Vec<String>> {
    let header = [
        "class", "x_m", "y_m", "z_m", "l_m", "w_m", "h_m", "yaw_rad", "score",
    ];
    let rows = found.iter().map(|found| {
        let lengths = found.center_m.iter().chain(&found.size_m);
        std::iter::once(format!("{:?}", found.class).to_lowercase())
            .chain(lengths.map(|length| format!("{length:.2}")))
            .chain([
                format!("{:.3}", found.yaw_rad),
                format!("{:.3}", found.score),
            ])
            .collect()
    });
    std::iter::once(header.map(str::to_owned).to_vec())
        .chain(rows)
        .collect()
}

fn row(name: &str, runs: &[RunSummary], cell: impl Fn(&RunSummary) -> String) -> Vec<String> {
    std::iter::once(name.to_owned())
        .chain(runs.iter().map(cell))
        .collect()
}

/// A number to so many digits, or `-`.
pub fn optional(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

/// Rows of cells as text, the first column to the left and the others to the right.
pub fn aligned(rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        rows.iter()
            .filter_map(|row| row.get(column))
            .map(|cell| cell.chars().count())
            .max()
            .unwrap_or(0)
    };
    let mut text = String::new();
    for row in rows {
        for (column, cell) in row.iter().enumerate() {
            if column == 0 {
                text.push_str(&format!("{cell:<0$}", width(0)));
            } else {
                text.push_str(&format!("  {cell:>0$}", width(column)));
            }
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}
