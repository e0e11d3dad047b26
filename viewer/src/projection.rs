use covista_world::{Calibration, ObjectState, Se2Pose};
use nalgebra::{Point3, Vector3};

/// Pairs of corners that an edge of a box joins, in the order of [`box_corners`].
const EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [1, 2],
    [2, 3],
    [3, 0],
    [4, 5],
    [5, 6],
    [6, 7],
    [7, 4],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

/// Nothing nearer to the camera than this is drawn, in metres.
const NEAR_M: f64 = 0.5;

/// Corners in the world frame: the bottom's front left, front right, rear right, rear left, then
/// the top's.
pub fn box_corners(state: &ObjectState) -> [Point3<f64>; 8] {
    let (x, y) = (state.length_m / 2.0, state.width_m / 2.0);
    std::array::from_fn(|i| {
        let [dx, dy] = [[x, y], [x, -y], [-x, -y], [-x, y]][i % 4];
        let ground = state.center.transform(nalgebra::Vector2::new(dx, dy));
        Point3::new(ground.x, ground.y, if i < 4 { 0.0 } else { state.height_m })
    })
}

/// The edges of a box as lines (u, v) in pixels, cut at the borders of the image.
pub fn project_box(
    state: &ObjectState,
    vehicle: Se2Pose,
    calibration: &Calibration,
) -> Vec<[[f32; 2]; 2]> {
    let camera_from_world =
        calibration.vehicle_from_camera.inverse() * vehicle.to_isometry().inverse();
    let corners = box_corners(state).map(|corner| camera_from_world * corner);
    let frustum = frustum(calibration);
    EDGES
        .iter()
        .filter_map(|&[a, b]| clip(corners[a], corners[b], &frustum))
        .filter_map(|[a, b]| {
            let pixel = |point| {
                calibration
                    .intrinsics
                    .project(&point)
                    .map(|uv| uv.map(|value| value as f32))
            };
            Some([pixel(a)?, pixel(b)?])
        })
        .collect()
}

/// Half-spaces n . p >= d of the camera frame that hold what the image shows.
fn frustum(calibration: &Calibration) -> [(Vector3<f64>, f64); 5] {
    let camera = &calibration.intrinsics;
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    [
        (Vector3::z(), NEAR_M),
        (Vector3::new(camera.fx_px, 0.0, camera.cx_px), 0.0),
        (Vector3::new(-camera.fx_px, 0.0, width - camera.cx_px), 0.0),
        (Vector3::new(0.0, camera.fy_px, camera.cy_px), 0.0),
        (Vector3::new(0.0, -camera.fy_px, height - camera.cy_px), 0.0),
    ]
}

fn clip(
    mut a: Point3<f64>,
    mut b: Point3<f64>,
    half_spaces: &[(Vector3<f64>, f64)],
) -> Option<[Point3<f64>; 2]> {
    for (normal, offset) in half_spaces {
        let (inside_a, inside_b) = (
            normal.dot(&a.coords) - offset,
            normal.dot(&b.coords) - offset,
        );
        if inside_a < 0.0 && inside_b < 0.0 {
            return None;
        }
        let cut = a + (b - a) * (inside_a / (inside_a - inside_b));
        if inside_a < 0.0 {
            a = cut;
        } else if inside_b < 0.0 {
            b = cut;
        }
    }
    Some([a, b])
}

#[cfg(test)]
mod tests {
    use covista_world::ObjectClass;

    use super::*;

    fn car_at(x_m: f64, y_m: f64) -> ObjectState {
        ObjectState {
            center: Se2Pose::new(x_m, y_m, 0.0),
            velocity_mps: nalgebra::Vector2::zeros(),
            length_m: 4.0,
            width_m: 2.0,
            height_m: 1.5,
            class: ObjectClass::Car,
        }
    }

    #[test]
    fn a_box_ahead_projects_around_the_principal_point() {
        let calibration = Calibration::kitti();
        let lines = project_box(&car_at(20.0, 0.0), Se2Pose::default(), &calibration);
        assert_eq!(lines.len(), 12);
        let mean_u = lines.iter().flatten().map(|uv| uv[0]).sum::<f32>() / 24.0;
        assert!((mean_u - 609.5593).abs() < 1e-2, "{mean_u}");
    }

    #[test]
    fn what_is_behind_is_not_drawn_and_what_sticks_out_is_cut() {
        let calibration = Calibration::kitti();
        let vehicle = Se2Pose::default();
        assert!(project_box(&car_at(-20.0, 0.0), vehicle, &calibration).is_empty());
        for beside in [car_at(3.0, 2.5), car_at(6.0, -4.0), car_at(10.0, 8.0)] {
            for [u, v] in project_box(&beside, vehicle, &calibration)
                .into_iter()
                .flatten()
            {
                assert!((-0.01..=1242.01).contains(&u) && (-0.01..=375.01).contains(&v));
            }
        }
    }
}
