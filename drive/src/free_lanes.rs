use covista_control::{Clear, Neighbour, SafetySettings, SightLine, clear_until_m};
use covista_world::{Calibration, FreeSpace, LANE_COUNT, LaneIndex, Road, Se2Pose};

/// How far each lane is seen free from `pose`, by the free space of a sweep: at all, and but for
/// what the `neighbours` in the lane itself hide.
pub(crate) fn seen_free(
    free_space: &FreeSpace,
    pose: Se2Pose,
    calibration: &Calibration,
    neighbours: &[Neighbour],
    road: &Road,
    time_s: f64,
    safety: &SafetySettings,
) -> SightLine {
    let mount = calibration.vehicle_from_lidar.translation.vector;
    let lidar = pose.compose(Se2Pose::new(mount.x, mount.y, 0.0));
    let free_range_m = |azimuth_rad: f64| free_space.free_range_m(azimuth_rad);
    let free_behind = |tracked: &[Neighbour]| {
        let mut lanes = [Clear::default(); LANE_COUNT as usize];
        for lane in LaneIndex::all() {
            lanes[usize::from(lane.get())] =
                clear_until_m(road, lane, lidar, &free_range_m, tracked, safety);
        }
        lanes
    };
    let (clear, open) = (free_behind(neighbours), free_behind(&[]));
    SightLine::new(clear.map(|clear| clear.until_s_m), time_s)
        .with_open(open.map(|clear| clear.until_s_m))
        .with_blocked(open.map(|clear| clear.is_blocked))
}
