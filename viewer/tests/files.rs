//! What ends up on the disk.

#![allow(clippy::expect_used)]

use std::path::{Path, PathBuf};

use covista_viewer::{
    Curve, CurvePanel, FocusFrame, FrontierPanel, FrontierPoint, FrontierSeries, Recording,
    RunSeries, SceneRecord, SceneryPart, StepRecord, VehicleInfo, VehicleKind, VehicleSample,
    VehicleSeries, VehicleStep, ViewerError, plot_curves, plot_frontier, plot_speeds,
    plot_trajectories,
};
use covista_world::{
    Calibration, CameraImage, PointCloud, Road, RoadSegment, Se2Pose, StationId, VehicleDimensions,
};
use nalgebra::Point3;

fn road() -> Road {
    let straight = RoadSegment::Straight { length_m: 100.0 };
    Road::new(Se2Pose::default(), &[straight], 3.5).expect("a road")
}

fn cav() -> VehicleInfo {
    VehicleInfo {
        id: 1,
        label: "CAV 1".to_owned(),
        kind: VehicleKind::Cav,
        dimensions: VehicleDimensions {
            length_m: 4.6,
            width_m: 1.85,
            height_m: 1.5,
            wheelbase_m: 2.7,
            rear_overhang_m: 0.95,
        },
    }
}

fn wall() -> SceneryPart {
    SceneryPart {
        vertices_m: (0..8)
            .map(|i| {
                Point3::new(
                    f64::from(i & 1) * 20.0,
                    6.0 + f64::from(i >> 1 & 1),
                    f64::from(i >> 2) * 2.0,
                )
            })
            .collect(),
        color: [130, 130, 130],
    }
}

fn scene() -> SceneRecord {
    SceneRecord {
        scenario: "tiny".to_owned(),
        run: "sharing on".to_owned(),
        description: String::new(),
        road: road(),
        scenery: vec![wall()],
        vehicles: vec![cav()],
        focus: StationId(1),
        calibration: Calibration::kitti(),
    }
}

fn step(x_m: f64) -> StepRecord {
    StepRecord {
        time_s: 0.1,
        vehicles: vec![VehicleStep {
            id: 1,
            pose: Se2Pose::new(x_m, 0.0, 0.0),
            speed_mps: 10.0,
            accel_mps2: 0.0,
            lane: None,
            action: None,
            outcome: None,
            h_m: None,
            headway_m: None,
        }],
        links: vec![[StationId(1), StationId(99)]],
        focus: Some(FocusFrame {
            image: Some(CameraImage {
                width_px: 8,
                height_px: 4,
                rgb: vec![100; 96],
            }),
            cloud: Some(PointCloud {
                points: vec![[5.0, 0.0, -1.0, 0.5]],
            }),
            ..FocusFrame::default()
        }),
    }
}

fn runs() -> Vec<RunSeries> {
    let samples = (0..50).map(|i| VehicleSample {
        time_s: f64::from(i) * 0.1,
        pose: Se2Pose::new(f64::from(i), 0.0, 0.0),
        speed_mps: 10.0,
    });
    let vehicle = VehicleSeries {
        info: cav(),
        samples: samples.collect(),
        lane_change_starts_s: vec![2.0],
    };
    ["Sharing on", "Sharing off"]
        .map(|title| RunSeries {
            title: title.to_owned(),
            vehicles: vec![vehicle.clone()],
        })
        .into()
}

/// An empty folder of a test's own.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
        std::fs::remove_dir_all(&path).ok();
        std::fs::create_dir_all(&path).expect("a folder");
        Self(path)
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<_> = entries
        .map(|entry| entry.expect("an entry").file_name())
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_finished_recording_is_a_whole_rrd_file() {
    let folder = Folder::new("a_finished_recording_is_a_whole_rrd_file");
    let path = folder.path().join("run.rrd");
    let mut recording = Recording::create(&path, scene()).expect("created");
    recording.log_step(&step(3.0)).expect("logged");
    assert_eq!(names(folder.path()), ["run.rrd.part"]);
    recording.finish().expect("finished");
    assert_eq!(names(folder.path()), ["run.rrd"]);
    let bytes = std::fs::read(&path).expect("read");
    assert_eq!(&bytes[..3], b"RRF");
    let has = |name: &[u8]| bytes.windows(name.len()).any(|window| window == name);
    assert!(has(b"/world/vehicles/CAV-1"), "the vehicle is recorded");
}

#[test]
fn an_unfinished_recording_leaves_nothing() {
    let folder = Folder::new("an_unfinished_recording_leaves_nothing");
    let recording = Recording::create(&folder.path().join("run.rrd"), scene()).expect("created");
    drop(recording);
    assert!(names(folder.path()).is_empty());
}

#[test]
fn a_missing_folder_is_one_clear_line() {
    let path = Path::new("/proc/nowhere/run.rrd");
    let errors = [
        Recording::create(path, scene()).err(),
        plot_speeds(&path.with_extension("png"), &runs()).err(),
    ];
    for error in errors {
        let error = error.expect("refused");
        assert!(matches!(error, ViewerError::Write { .. }));
        let message = error.to_string();
        assert!(
            message.starts_with("cannot write /proc/nowhere/run."),
            "{message}"
        );
        assert_eq!(message.lines().count(), 1);
    }
}

#[test]
fn a_number_that_is_not_finite_is_named() {
    let folder = Folder::new("a_number_that_is_not_finite_is_named");
    let mut recording =
        Recording::create(&folder.path().join("run.rrd"), scene()).expect("created");
    let message = recording
        .log_step(&step(f64::NAN))
        .expect_err("refused")
        .to_string();
    assert_eq!(
        message,
        "the record at 0.10 s can't be drawn: the state of vehicle 1 is not finite"
    );
}

#[test]
fn plots_are_pictures_of_the_announced_width() {
    let folder = Folder::new("plots_are_pictures_of_the_announced_width");
    let (paths, speeds) = (folder.path().join("xy.png"), folder.path().join("v.png"));
    plot_trajectories(&paths, &road(), &[wall()], &runs()).expect("drawn");
    plot_speeds(&speeds, &runs()).expect("drawn");
    let picture = image::open(&paths).expect("decodes");
    assert_eq!(picture.width(), 1800);
    let picture = image::open(&speeds).expect("decodes").to_rgb8();
    assert_eq!(picture.dimensions(), (1600, 960));
    let blue = image::Rgb([0, 114, 178]);
    assert!(
        picture.pixels().any(|pixel| *pixel == blue),
        "the curve is drawn"
    );
    assert_eq!(names(folder.path()), ["v.png", "xy.png"]);
}

#[test]
fn no_runs_and_empty_runs_draw_empty_plots() {
    let folder = Folder::new("no_runs_and_empty_runs_draw_empty_plots");
    let empty = RunSeries {
        title: String::new(),
        vehicles: Vec::new(),
    };
    for runs in [vec![], vec![empty]] {
        plot_trajectories(&folder.path().join("xy.png"), &road(), &[], &runs).expect("drawn");
        plot_speeds(&folder.path().join("v.png"), &runs).expect("drawn");
    }
}

/// A panel with three networks on two providers, and one that others published.
fn panel() -> FrontierPanel {
    let point = |label: &str, img_per_s: f64, accuracy: f64| FrontierPoint {
        label: label.to_owned(),
        img_per_s,
        accuracy,
    };
    let series = |provider: &str, precision: &str, faster: f64| FrontierSeries {
        provider: provider.to_owned(),
        precision: precision.to_owned(),
        points: vec![
            point("dense", 3.0 * faster, 82.0),
            point("p4", 8.0 * faster, 81.6),
            point("p16", 25.0 * faster, 80.3),
        ],
    };
    FrontierPanel {
        title: "Detectors".to_owned(),
        accuracy: "average precision, %".to_owned(),
        series: vec![series("cpu", "fp32", 1.0), series("openvino", "bf16", 3.5)],
        published: vec![point("paper", 28.0, 76.5)],
    }
}

#[test]
fn a_frontier_has_a_panel_each_and_a_colour_a_provider() {
    let folder = Folder::new("a_frontier_has_a_panel_each_and_a_colour_a_provider");
    let path = folder.path().join("frontier.png");
    plot_frontier(&path, &[panel(), panel()], "what others published").expect("drawn");
    let picture = image::open(&path).expect("decodes").to_rgb8();
    assert_eq!(picture.width(), 1700);
    let [blue, vermillion] = [[0, 114, 178], [213, 94, 0]].map(image::Rgb);
    for half in [0..850, 850..1700] {
        for color in [blue, vermillion] {
            let mut pixels = picture.enumerate_pixels();
            assert!(pixels.any(|(x, _, pixel)| half.contains(&x) && *pixel == color));
        }
    }
    // Nothing measured, nothing published, one of each: a picture all the same.
    let nothing = FrontierPanel {
        series: Vec::new(),
        published: Vec::new(),
        ..panel()
    };
    let published = FrontierPanel {
        series: Vec::new(),
        ..panel()
    };
    for panels in [vec![], vec![nothing], vec![published]] {
        plot_frontier(&path, &panels, "").expect("drawn");
    }
}

fn curves(label: &str, points: Vec<[f64; 3]>) -> CurvePanel {
    let label = label.to_owned();
    CurvePanel {
        title: "Velocity".to_owned(),
        x: "CAV ratio".to_owned(),
        y: "mph".to_owned(),
        curves: vec![Curve { label, points }],
    }
}

#[test]
fn curves_have_a_colour_each_whatever_the_number_of_points() {
    let folder = Folder::new("curves_have_a_colour_each_whatever_the_number_of_points");
    let path = folder.path().join("curves.png");
    let long = (0..500)
        .map(|i| [f64::from(i), f64::from(i % 7), 1.0])
        .collect();
    let few = vec![[1.0, 2.0, 0.5], [2.0, f64::NAN, 0.0], [3.0, 1.0, 0.0]];
    plot_curves(&path, &[curves("ours", long), curves("idm", few)]).expect("drawn");
    let picture = image::open(&path).expect("decodes").to_rgb8();
    assert_eq!(picture.width(), 1600);
    for (half, color) in [(0..800, [0, 114, 178]), (800..1600, [230, 159, 0])] {
        let mut pixels = picture.enumerate_pixels();
        assert!(pixels.any(|(x, _, pixel)| half.contains(&x) && pixel.0 == color));
    }
    for panels in [
        vec![],
        vec![curves("ours", vec![])],
        vec![curves("ours", vec![[1.0, 0.0, 0.0]])],
    ] {
        plot_curves(&path, &panels).expect("drawn");
    }
}
