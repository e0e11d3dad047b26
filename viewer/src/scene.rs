use covista_world::{FrenetPoint, MARK_COUNT, Road};
use nalgebra::Vector2;
use rerun::RecordingStream;

use crate::hull::convex_hull_faces;
use crate::objects::Class;
use crate::{SceneRecord, SceneryPart};

/// How far the road is drawn beyond its ends, in metres.
const RUN_OUT_M: f64 = 60.0;
/// Distance between the points that a curve is drawn with, in metres.
const SPACING_M: f64 = 2.0;
/// Paved width beyond the edge lines, in metres.
const SHOULDER_M: f64 = 0.5;
/// Length of a painted stroke and period of the lane lines, in metres.
const DASH_M: [f64; 2] = [4.0, 12.0];
const ASPHALT: [u8; 3] = [58, 60, 64];
const PAINT: [u8; 3] = [230, 230, 225];

/// Logs what does not change: axes, classes, road, scenery, description.
pub fn log_scene(
    stream: &RecordingStream,
    scene: &SceneRecord,
) -> rerun::RecordingStreamResult<()> {
    stream.log_static("world", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    stream.log_static("world", &Class::annotation_context())?;
    stream.log_static("world/road/surface", &road_surface(&scene.road))?;
    stream.log_static("world/road/marks", &road_marks(&scene.road))?;
    stream.log_static("world/scenery", &scenery_mesh(&scene.scenery))?;
    stream.log_static(
        "description",
        &rerun::TextDocument::from_markdown(format!(
            "# {} ({})\n\n{}\n\n{}",
            scene.scenario,
            scene.run,
            scene.description,
            Class::legend()
        )),
    )
}

/// Stations along the reference line, `RUN_OUT_M` beyond both ends, about `SPACING_M` apart.
pub fn stations(road: &Road) -> Vec<f64> {
    spaced(-RUN_OUT_M, road.length_m() + RUN_OUT_M)
}

/// The curve at offset `d_m` over `stations`, in the world frame.
pub fn offset_curve(road: &Road, stations: &[f64], d_m: f64) -> Vec<Vector2<f64>> {
    stations
        .iter()
        .map(|&s_m| road.from_frenet(FrenetPoint { s_m, d_m }))
        .collect()
}

fn spaced(from: f64, to: f64) -> Vec<f64> {
    let count = ((to - from) / SPACING_M).ceil().max(1.0);
    (0..=count as usize)
        .map(|i| from + (to - from) * i as f64 / count)
        .collect()
}

fn at_height(curve: &[Vector2<f64>], z_m: f32) -> Vec<[f32; 3]> {
    curve
        .iter()
        .map(|point| [point.x as f32, point.y as f32, z_m])
        .collect()
}

fn road_surface(road: &Road) -> rerun::Mesh3D {
    let stations = stations(road);
    let edge = |d_m| at_height(&offset_curve(road, &stations, d_m), -0.03);
    let left = edge(road.mark_offset_m(0) + SHOULDER_M);
    let right = edge(road.mark_offset_m(MARK_COUNT - 1) - SHOULDER_M);
    let vertices: Vec<_> = left
        .iter()
        .zip(&right)
        .flat_map(|(l, r)| [*l, *r])
        .collect();
    let triangles: Vec<_> = (0..stations.len().saturating_sub(1) as u32)
        .flat_map(|i| {
            [
                [2 * i, 2 * i + 1, 2 * i + 2],
                [2 * i + 2, 2 * i + 1, 2 * i + 3],
            ]
        })
        .collect();
    let colors = vec![rerun::Color::from(ASPHALT); vertices.len()];
    rerun::Mesh3D::new(vertices)
        .with_triangle_indices(triangles)
        .with_vertex_colors(colors)
}

fn road_marks(road: &Road) -> rerun::LineStrips3D {
    let solid = [0, MARK_COUNT - 1].map(|mark| {
        at_height(
            &offset_curve(road, &stations(road), road.mark_offset_m(mark)),
            0.0,
        )
    });
    let [stroke_m, period_m] = DASH_M;
    let dash_count = (road.length_m() + 2.0 * RUN_OUT_M) / period_m;
    let dashes = (1..MARK_COUNT - 1).flat_map(|mark| {
        (0..dash_count as usize).map(move |i| {
            let from = i as f64 * period_m - RUN_OUT_M;
            let stroke = spaced(from, from + stroke_m);
            at_height(&offset_curve(road, &stroke, road.mark_offset_m(mark)), 0.0)
        })
    });
    rerun::LineStrips3D::new(solid.into_iter().chain(dashes))
        .with_colors([rerun::Color::from(PAINT)])
        .with_radii([0.07])
}

/// One mesh of all parts, flat-shaded.
fn scenery_mesh(parts: &[SceneryPart]) -> rerun::Mesh3D {
    let (mut vertices, mut normals) = (Vec::new(), Vec::new());
    let (mut colors, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        for face in convex_hull_faces(&part.vertices_m) {
            let first = vertices.len() as u32;
            for corner in &face.corners {
                vertices.push([corner.x as f32, corner.y as f32, corner.z as f32]);
                normals.push([
                    face.normal.x as f32,
                    face.normal.y as f32,
                    face.normal.z as f32,
                ]);
                colors.push(rerun::Color::from(part.color));
            }
            let count = face.corners.len() as u32;
            triangles.extend((1..count - 1).map(|i| [first, first + i, first + i + 1]));
        }
    }
    rerun::Mesh3D::new(vertices)
        .with_vertex_normals(normals)
        .with_vertex_colors(colors)
        .with_triangle_indices(triangles)
}
