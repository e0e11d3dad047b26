use covista_world::{
    Calibration, CameraImage, MARK_COUNT, ObjectState, PointCloud, StationId, Track,
};
use image::codecs::jpeg::JpegEncoder;
use nalgebra::Isometry3;
use rerun::{RecordingStream, RecordingStreamResult};

use crate::objects::{Class, ground_transform};
use crate::palette;
use crate::projection::{box_corners, project_box};
use crate::{FocusFrame, SceneRecord, SeenBox};

/// More LIDAR points than this are thinned out, to keep the file small.
const MAX_POINTS: usize = 30_000;
const JPEG_QUALITY: u8 = 85;
/// A measurement older than this does not count as being seen, in seconds.
const FRESH_S: f64 = 1.0;
/// The frame of the focus CAV at the time stamp of its measurements.
const EGO: &str = "world/perception";
/// Its camera, which holds the image.
pub const CAMERA: &str = "world/perception/camera";
/// Its LIDAR, which holds the sweep.
pub const LIDAR: &str = "world/perception/lidar";

/// Logs where the sensors sit on the vehicle, for all times or for the one that is set.
pub fn log_mounting(
    stream: &RecordingStream,
    calibration: &Calibration,
    is_static: bool,
) -> RecordingStreamResult<()> {
    let camera = &calibration.intrinsics;
    stream.log_with_static(
        CAMERA,
        is_static,
        &transform(&calibration.vehicle_from_camera),
    )?;
    stream.log_with_static(
        CAMERA,
        is_static,
        &rerun::Pinhole::from_focal_length_and_resolution(
            [camera.fx_px as f32, camera.fy_px as f32],
            [camera.width_px as f32, camera.height_px as f32],
        )
        .with_principal_point([camera.cx_px as f32, camera.cy_px as f32])
        .with_camera_xyz(rerun::components::ViewCoordinates::RDF)
        .with_image_plane_distance(6.0),
    )?;
    stream.log_with_static(
        LIDAR,
        is_static,
        &transform(&calibration.vehicle_from_lidar),
    )
}

/// Logs what the focus CAV measured and knows.
pub fn log_focus(
    stream: &RecordingStream,
    scene: &SceneRecord,
    frame: &FocusFrame,
    time_s: f64,
) -> RecordingStreamResult<()> {
    log_measured(stream, frame, &scene.calibration, scene.focus)?;
    stream.log(
        "world/tracks",
        &track_outlines(&frame.tracks, scene.focus, time_s),
    )
}

/// Logs what it measured and what its networks found in it.
pub fn log_measured(
    stream: &RecordingStream,
    frame: &FocusFrame,
    calibration: &Calibration,
    focus: StationId,
) -> RecordingStreamResult<()> {
    stream.log(EGO, &ground_transform(frame.pose))?;
    if let Some(cloud) = &frame.cloud {
        let sensor_height_m = calibration.vehicle_from_lidar.translation.z as f32;
        stream.log(LIDAR, &points(cloud, sensor_height_m))?;
    }
    if let Some(jpeg) = frame.image.as_ref().and_then(encode_jpeg) {
        stream.log(
            CAMERA,
            &rerun::EncodedImage::from_file_contents(jpeg).with_media_type(rerun::MediaType::JPEG),
        )?;
    }
    if let Some(marks) = &frame.marks {
        stream.log("world/perception/camera/marks", &mark_points(marks))?;
    }
    stream.log("world/boxes", &seen_boxes(&frame.boxes, focus))?;
    stream.log(
        "world/perception/camera/boxes",
        &projected_boxes(frame, calibration, focus),
    )
}

fn transform(a_from_b: &Isometry3<f64>) -> rerun::Transform3D {
    let (t, q) = (&a_from_b.translation, a_from_b.rotation.coords);
    rerun::Transform3D::from_translation_rotation(
        [t.x as f32, t.y as f32, t.z as f32],
        rerun::Quaternion::from_xyzw([q.x as f32, q.y as f32, q.z as f32, q.w as f32]),
    )
}

fn points(cloud: &PointCloud, sensor_height_m: f32) -> rerun::Points3D {
    let stride = cloud.points.len().div_ceil(MAX_POINTS).max(1);
    let kept = || cloud.points.iter().step_by(stride);
    rerun::Points3D::new(kept().map(|&[x, y, z, _]| [x, y, z]))
        .with_colors(
            kept().map(|&[_, _, z, _]| {
                rerun::Color::from(palette::height_color(z + sensor_height_m))
            }),
        )
        .with_radii([rerun::Radius::new_ui_points(1.0)])
}

fn encode_jpeg(image: &CameraImage) -> Option<Vec<u8>> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
        .encode(
            &image.rgb,
            image.width_px,
            image.height_px,
            image::ExtendedColorType::Rgb8,
        )
        .ok()?;
    Some(jpeg)
}

fn mark_points(marks: &[Vec<[f64; 2]>; MARK_COUNT]) -> rerun::Points2D {
    let found = marks.iter().enumerate().flat_map(|(mark, points)| {
        let points = points.iter();
        points.map(move |point| (mark, point.map(|px| px as f32)))
    });
    let (mark_of, points): (Vec<_>, Vec<_>) = found.unzip();
    rerun::Points2D::new(points)
        .with_colors(
            mark_of
                .into_iter()
                .map(|mark| rerun::Color::from(MARK_COLORS[mark])),
        )
        .with_radii([rerun::Radius::new_ui_points(2.5)])
}

const MARK_COLORS: [palette::Rgb; MARK_COUNT] = [
    palette::VERMILLION,
    palette::YELLOW,
    palette::SKY_BLUE,
    palette::PURPLE,
];

fn seer(seen: &SeenBox, focus: StationId) -> Class {
    if seen.seen_by == focus {
        Class::SeenByItself
    } else {
        Class::SeenByOthers
    }
}

fn seen_boxes(boxes: &[SeenBox], focus: StationId) -> rerun::Boxes3D {
    let center = |state: &ObjectState| {
        [
            state.center.x_m as f32,
            state.center.y_m as f32,
            (state.height_m / 2.0) as f32,
        ]
    };
    let size = |state: &ObjectState| {
        [
            state.length_m as f32,
            state.width_m as f32,
            state.height_m as f32,
        ]
    };
    rerun::Boxes3D::from_centers_and_sizes(
        boxes.iter().map(|seen| center(&seen.state)),
        boxes.iter().map(|seen| size(&seen.state)),
    )
    .with_rotation_axis_angles(boxes.iter().map(|seen| {
        rerun::RotationAxisAngle::new(
            [0.0, 0.0, 1.0],
            rerun::Angle::from_radians(seen.state.center.yaw_rad as f32),
        )
    }))
    .with_class_ids(boxes.iter().map(|seen| seer(seen, focus).id()))
    .with_labels(boxes.iter().map(|seen| format!("by {}", seen.seen_by.0)))
    .with_show_labels(false)
    .with_fill_mode(rerun::FillMode::MajorWireframe)
    .with_radii([rerun::Radius::new_ui_points(2.0)])
}

fn projected_boxes(
    frame: &FocusFrame,
    calibration: &Calibration,
    focus: StationId,
) -> rerun::LineStrips2D {
    let (lines, classes): (Vec<_>, Vec<_>) = frame
        .boxes
        .iter()
        .flat_map(|seen| {
            let class = seer(seen, focus).id();
            project_box(&seen.state, frame.pose, calibration)
                .into_iter()
                .map(move |line| (line, class))
        })
        .unzip();
    rerun::LineStrips2D::new(lines)
        .with_class_ids(classes)
        .with_radii([rerun::Radius::new_ui_points(1.5)])
}

/// Who saw a track lately.
fn track_class(track: &Track, focus: StationId, time_s: f64) -> Class {
    let mut fresh = track
        .sightings
        .iter()
        .filter(|sighting| time_s - sighting.measured_s <= FRESH_S);
    let own = fresh.clone().any(|sighting| sighting.station == focus);
    let others = fresh.any(|sighting| sighting.station != focus);
    match (own, others) {
        (true, true) => Class::SeenByBoth,
        (true, false) => Class::SeenByItself,
        (false, _) => Class::SeenByOthers,
    }
}

/// For each track its outline on the ground and the way it makes in one second.
fn track_outlines(tracks: &[Track], focus: StationId, time_s: f64) -> rerun::LineStrips3D {
    const HEIGHT_M: f32 = 0.1;
    let strips = tracks.iter().map(|track| {
        let corners = box_corners(&track.state);
        let center = track.state.center.position();
        let ahead = center + track.state.velocity_mps;
        let front = nalgebra::center(&corners[0], &corners[1]);
        [0, 1, 2, 3, 0]
            .map(|i| [corners[i].x as f32, corners[i].y as f32, HEIGHT_M])
            .into_iter()
            .chain([
                [front.x as f32, front.y as f32, HEIGHT_M],
                [ahead.x as f32, ahead.y as f32, HEIGHT_M],
            ])
            .collect::<Vec<_>>()
    });
    rerun::LineStrips3D::new(strips)
        .with_class_ids(
            tracks
                .iter()
                .map(|track| track_class(track, focus, time_s).id()),
        )
        .with_labels(tracks.iter().map(|track| format!("track {}", track.id)))
        .with_show_labels(false)
        .with_radii([rerun::Radius::new_ui_points(2.0)])
}

#[cfg(test)]
mod tests {
    use covista_world::{Se2Pose, Sighting};

    use super::*;

    #[test]
    fn a_track_tells_who_saw_it_lately() {
        let sighting = |station, measured_s| Sighting {
            station: StationId(station),
            measured_s,
        };
        let track = |sightings| Track {
            id: 1,
            station: None,
            state: ObjectState {
                center: Se2Pose::default(),
                velocity_mps: nalgebra::Vector2::zeros(),
                length_m: 4.0,
                width_m: 1.8,
                height_m: 1.5,
                class: covista_world::ObjectClass::Car,
            },
            time_s: 10.0,
            position_std_m: 0.2,
            velocity_std_mps: 0.2,
            confidence: 1.0,
            lane: None,
            action: None,
            announced_s: None,
            sightings,
        };
        let class = |sightings| track_class(&track(sightings), StationId(7), 10.0);
        assert_eq!(class(vec![sighting(7, 9.5)]), Class::SeenByItself);
        assert_eq!(class(vec![sighting(2, 9.5)]), Class::SeenByOthers);
        assert_eq!(
            class(vec![sighting(2, 9.5), sighting(7, 10.0)]),
            Class::SeenByBoth
        );
        assert_eq!(
            class(vec![sighting(2, 9.5), sighting(7, 3.0)]),
            Class::SeenByOthers
        );
    }
}
