use covista_world::{Calibration, CameraIntrinsics};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::{CameraSettings, Motion};

/// Share of frames that KITTI's own rig takes.
const KITTI_SHARE: f64 = 0.3;

/// What carries the sensors, and how they are set: drawn for each frame of a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The camera, and where both sensors sit.
    pub calibration: Calibration,
    /// How the camera turns light into a picture.
    pub camera: CameraSettings,
    /// Whether the scene moves while the LIDAR turns.
    pub lidar_motion: Motion,
    /// Which specimen of the LIDAR.
    pub lidar_specimen: u64,
}

/// The rig of frame `index` in the data set `seed`, reproducible from these two alone; its
/// distributions are in docs/randomisation.md.
pub fn sample_rig(seed: u64, index: u64) -> Rig {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    let lidar_motion = match rng.random_range(0..3) {
        0 => Motion::Frozen,
        1 => Motion::Rolling,
        _ => Motion::Undone,
    };
    let lidar_specimen = rng.random();
    let calibration = if rng.random_bool(KITTI_SHARE) {
        Calibration::kitti()
    } else {
        draw_calibration(&mut rng)
    };
    Rig {
        calibration,
        camera: CameraSettings::draw(&mut rng),
        lidar_motion,
        lidar_specimen,
    }
}

/// A LIDAR on the roof and a camera behind the windscreen or on the roof, both a little tilted.
fn draw_calibration(rng: &mut impl Rng) -> Calibration {
    let kitti = Calibration::kitti();
    let lidar_up_m = rng.random_range(-0.08..0.08);
    let lidar_tilt = tilt(rng, [0.4, 0.4, 0.5]);
    let camera_up_m = rng.random_range(-0.55..0.15);
    let camera_ahead_m = rng.random_range(-0.2..0.4);
    let camera_tilt = tilt(rng, [0.7, 1.5, 1.5]);
    Calibration {
        intrinsics: draw_intrinsics(rng),
        vehicle_from_lidar: moved(
            &kitti.vehicle_from_lidar,
            [0.0, 0.0, lidar_up_m],
            lidar_tilt,
        ),
        vehicle_from_camera: moved(
            &kitti.vehicle_from_camera,
            [camera_ahead_m, 0.0, camera_up_m],
            camera_tilt,
        ),
    }
}

/// Focal lengths from KITTI's wide view to a narrow windscreen camera's; the horizon stays in the
/// upper half of the picture.
fn draw_intrinsics(rng: &mut impl Rng) -> CameraIntrinsics {
    let kitti = CameraIntrinsics::KITTI;
    let focal_px = 650.0 * (1400.0_f64 / 650.0).powf(rng.random_range(0.0..1.0));
    CameraIntrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: kitti.cx_px + rng.random_range(-30.0..30.0),
        cy_px: kitti.cy_px + rng.random_range(-30.0..30.0),
        ..kitti
    }
}

/// A rotation about x, y and z (roll, pitch, yaw) of these standard deviations in degrees.
fn tilt(rng: &mut impl Rng, deviations_deg: [f64; 3]) -> UnitQuaternion<f64> {
    let [roll, pitch, yaw] = deviations_deg.map(|deviation_deg| {
        let draw: f64 = StandardNormal.sample(rng);
        (draw.clamp(-2.5, 2.5) * deviation_deg).to_radians()
    });
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// A mounting moved by `offset_m` and turned by `tilt`, both in the vehicle frame.
fn moved(
    mounting: &Isometry3<f64>,
    offset_m: [f64; 3],
    tilt: UnitQuaternion<f64>,
) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(mounting.translation.vector + Vector3::from(offset_m)),
        tilt * mounting.rotation,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigs_are_reproducible_varied_and_usable() {
        assert_eq!(sample_rig(3, 7), sample_rig(3, 7));
        let rigs: Vec<_> = (0..400).map(|index| sample_rig(3, index)).collect();
        let kitti = rigs
            .iter()
            .filter(|rig| rig.calibration == Calibration::kitti());
        assert!((80..160).contains(&kitti.count()));
        for rig in &rigs {
            let camera = rig.calibration.vehicle_from_camera;
            let forward = camera * Vector3::z();
            assert!(forward.x > 0.99 && (0.9..1.9).contains(&camera.translation.z));
            let up = rig.calibration.vehicle_from_lidar * Vector3::z();
            assert!(up.z > 0.99, "{up}");
        }
    }
}
