use covista_sensors::{Ground, Lidar, SensorTimings, busy_road, time_sensors};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::{
    cli::SensorBenchArgs,
    output::{Report, prepare_file, say, write_json},
    table::aligned,
};

const ONE_MS: f64 = 1e-3;

/// What is measured: the LIDAR, the ground and the number of vehicles.
const SCENES: [(&str, Ground, usize); 8] = [
    ("hdl-64e", Ground::Flat, 10),
    ("hdl-64e", Ground::Flat, 30),
    ("hdl-64e", Ground::Flat, 100),
    ("hdl-64e", Ground::Flat, 300),
    ("hdl-64e", Ground::Flat, 1000),
    ("hdl-64e", Ground::Hilly, 30),
    ("vlp-32c", Ground::Flat, 30),
    ("os1-64", Ground::Flat, 30),
];

/// A row of `--json`.
#[derive(Debug, Serialize)]
struct Row {
    lidar: &'static str,
    ground: &'static str,
    vehicles: usize,
    parts: usize,
    rays: usize,
    ns_per_ray: f64,
    mrays_per_s_core: f64,
    mrays_per_s: f64,
    sweep_ms: f64,
    camera_frames_per_s_core: f64,
    camera_frames_per_s: f64,
    prepare_ms: f64,
    scene_kib: f64,
}

/// `covista bench sensors`.
pub(super) fn run(args: &SensorBenchArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let bar = ProgressBar::new(SCENES.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} scenes, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.tick();
    let mut rows = Vec::new();
    for (name, ground, vehicles) in SCENES {
        let lidar = Lidar::builtin(name)?;
        let timings = time_sensors(&busy_road(vehicles, ground)?, &lidar);
        rows.extend(timings.map(|timings| row(name, ground, vehicles, &timings)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    say(table(&rows).trim_end())?;
    match &args.json {
        Some(path) => write_json(path, &Report::new("bench sensors", rows)),
        None => Ok(()),
    }
}

fn row(lidar: &'static str, ground: Ground, vehicles: usize, timings: &SensorTimings) -> Row {
    let rays = timings.rays as f64;
    let [cast_core_s, cast_s] = [timings.cast_core, timings.cast].map(|time| time.as_secs_f64());
    Row {
        lidar,
        ground: match ground {
            Ground::Flat => "flat",
            Ground::Hilly => "hilly",
        },
        vehicles,
        parts: timings.parts,
        rays: timings.rays,
        ns_per_ray: cast_core_s / rays * 1e9,
        mrays_per_s_core: rays / cast_core_s / 1e6,
        mrays_per_s: rays / cast_s / 1e6,
        sweep_ms: timings.sweep.as_secs_f64() / ONE_MS,
        camera_frames_per_s_core: 1.0 / timings.picture_core.as_secs_f64(),
        camera_frames_per_s: 1.0 / timings.picture.as_secs_f64(),
        prepare_ms: timings.prepare.as_secs_f64() / ONE_MS,
        scene_kib: timings.scene_bytes as f64 / 1024.0,
    }
}

fn table(rows: &[Row]) -> String {
    let header = [
        "LIDAR, ground, vehicles",
        "rays",
        "ns a ray",
        "Mrays/s core",
        "Mrays/s",
        "sweep, ms",
        "pictures/s core",
        "pictures/s",
        "parts",
        "prepare, ms",
        "memory, KiB",
    ];
    let cells = rows.iter().map(|row| {
        vec![
            format!("{}, {}, {}", row.lidar, row.ground, row.vehicles),
            row.rays.to_string(),
            format!("{:.0}", row.ns_per_ray),
            format!("{:.1}", row.mrays_per_s_core),
            format!("{:.1}", row.mrays_per_s),
            format!("{:.1}", row.sweep_ms),
            format!("{:.1}", row.camera_frames_per_s_core),
            format!("{:.1}", row.camera_frames_per_s),
            row.parts.to_string(),
            format!("{:.1}", row.prepare_ms),
            format!("{:.0}", row.scene_kib),
        ]
    });
    let rows: Vec<_> = std::iter::once(header.map(String::from).to_vec())
        .chain(cells)
        .collect();
    aligned(&rows)
}
