use std::collections::BTreeMap;

use covista_world::{Se2Pose, StationId, VehicleDimensions};
use rerun::RecordingStream;

use crate::palette::{self, Rgb};
use crate::{SceneRecord, StepRecord, VehicleKind};

/// What rerun is told about a shape; the annotation context gives each its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// A CAV.
    Cav = 1,
    /// The CAV whose knowledge is shown.
    FocusCav,
    /// A human driver.
    Human,
    /// A stationary vehicle.
    Obstacle,
    /// Seen by the focus CAV's own sensors.
    SeenByItself,
    /// Seen by others only.
    SeenByOthers,
    /// Seen by both.
    SeenByBoth,
    /// A V2V link.
    Link,
}

impl Class {
    const ALL: [Self; 8] = [
        Self::Cav,
        Self::FocusCav,
        Self::Human,
        Self::Obstacle,
        Self::SeenByItself,
        Self::SeenByOthers,
        Self::SeenByBoth,
        Self::Link,
    ];

    fn of(kind: VehicleKind, is_focus: bool) -> Self {
        match kind {
            VehicleKind::Cav if is_focus => Self::FocusCav,
            VehicleKind::Cav => Self::Cav,
            VehicleKind::Human => Self::Human,
            VehicleKind::Obstacle => Self::Obstacle,
        }
    }

    fn name_and_color(self) -> (&'static str, Rgb, &'static str) {
        match self {
            Self::Cav => ("CAV", palette::SKY_BLUE, "sky blue"),
            Self::FocusCav => ("chosen CAV", palette::WHITE, "white"),
            Self::Human => ("human driver", palette::ORANGE, "orange"),
            Self::Obstacle => ("stationary vehicle", palette::VERMILLION, "vermillion"),
            Self::SeenByItself => ("seen by the chosen CAV", palette::GREEN, "green"),
            Self::SeenByOthers => ("seen by others only", palette::PURPLE, "pink"),
            Self::SeenByBoth => ("seen by both", palette::YELLOW, "yellow"),
            Self::Link => ("V2V link", palette::GREY, "grey"),
        }
    }

    /// The class's id in the annotation context.
    pub fn id(self) -> rerun::components::ClassId {
        (self as u16).into()
    }

    /// The colours, for rerun.
    pub fn annotation_context() -> rerun::AnnotationContext {
        rerun::AnnotationContext::new(Self::ALL.map(|class| {
            let (name, [r, g, b], _) = class.name_and_color();
            (class as u16, name, rerun::Rgba32::from_rgb(r, g, b))
        }))
    }

    /// The colours, for people, in Markdown.
    pub fn legend() -> String {
        let rows = Self::ALL.map(|class| {
            let (name, _, color) = class.name_and_color();
            format!("| {color} | {name} |\n")
        });
        format!(
            "## Colours\n\n| colour | meaning |\n|---|---|\n{}\n\
             Solid bodies are the truth; wire boxes are what detectors see in this instant; \
             outlines on the ground with a line for the velocity are the chosen CAV's tracks. \
             LIDAR points are coloured by height.\n",
            rows.concat()
        )
    }
}

/// Folder of the vehicles' bodies.
pub const BODIES: &str = "world/vehicles";

/// Entity path of what `folder` holds for the vehicle with this label.
pub fn path_of(folder: &str, label: &str) -> rerun::EntityPath {
    let name = label.replace(' ', "-");
    rerun::EntityPath::from(folder).join(&rerun::EntityPath::from_single_string(name))
}

/// Logs the vehicles' bodies, which [`log_vehicles`] then moves.
pub fn log_bodies(
    stream: &RecordingStream,
    scene: &SceneRecord,
) -> rerun::RecordingStreamResult<()> {
    for vehicle in &scene.vehicles {
        let class = Class::of(vehicle.kind, StationId(vehicle.id) == scene.focus);
        let body = body_boxes(&vehicle.dimensions)
            .with_class_ids([class.id()])
            .with_labels([vehicle.label.as_str()])
            .with_show_labels(true);
        stream.log_static(path_of(BODIES, &vehicle.label), &body)?;
    }
    Ok(())
}

/// A lower body and a cabin, in the vehicle frame.
fn body_boxes(dimensions: &VehicleDimensions) -> rerun::Boxes3D {
    const CLEARANCE_M: f64 = 0.2;
    let (length, width, height) = (dimensions.length_m, dimensions.width_m, dimensions.height_m);
    let center_x = dimensions.center_ahead_of_axle_m();
    let is_tall = height > 1.9;
    let (waist, cabin_length, cabin_x) = if is_tall {
        (0.45 * height, 0.86 * length, center_x - 0.06 * length)
    } else {
        (0.58 * height, 0.56 * length, center_x - 0.05 * length)
    };
    let boxes = [
        ([center_x, 0.0], [length, width], [CLEARANCE_M, waist]),
        ([cabin_x, 0.0], [cabin_length, 0.9 * width], [waist, height]),
    ];
    rerun::Boxes3D::from_centers_and_sizes(
        boxes.map(|([x, y], _, [low, high])| [x as f32, y as f32, ((low + high) / 2.0) as f32]),
        boxes.map(|(_, [l, w], [low, high])| [l as f32, w as f32, (high - low) as f32]),
    )
    .with_fill_mode(rerun::FillMode::Solid)
}

/// Moves the vehicles and draws the links between them.
pub fn log_vehicles(
    stream: &RecordingStream,
    scene: &SceneRecord,
    step: &StepRecord,
) -> rerun::RecordingStreamResult<()> {
    let mut roofs = BTreeMap::new();
    for vehicle in &step.vehicles {
        let Some(info) = scene.vehicles.iter().find(|info| info.id == vehicle.id) else {
            continue;
        };
        stream.log(
            path_of(BODIES, &info.label),
            &ground_transform(vehicle.pose),
        )?;
        let center = info.dimensions.center_pose(vehicle.pose);
        let roof_m = info.dimensions.height_m + 0.3;
        roofs.insert(
            StationId(vehicle.id),
            [center.x_m as f32, center.y_m as f32, roof_m as f32],
        );
    }
    let links = step
        .links
        .iter()
        .filter_map(|[a, b]| Some([*roofs.get(a)?, *roofs.get(b)?]));
    stream.log(
        "world/v2v",
        &rerun::LineStrips3D::new(links)
            .with_class_ids([Class::Link.id()])
            .with_show_labels(false)
            .with_radii([rerun::Radius::new_ui_points(1.5)]),
    )
}

/// The vehicle frame in the world.
pub fn ground_transform(pose: Se2Pose) -> rerun::Transform3D {
    rerun::Transform3D::from_translation_rotation(
        [pose.x_m as f32, pose.y_m as f32, 0.0],
        rerun::RotationAxisAngle::new(
            [0.0, 0.0, 1.0],
            rerun::Angle::from_radians(pose.yaw_rad as f32),
        ),
    )
}
