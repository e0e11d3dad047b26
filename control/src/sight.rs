use covista_world::{FrenetPoint, LANE_COUNT, LaneIndex, Road, Se2Pose};

use crate::{Neighbour, SafetySettings};

/// How far along the road each lane is confirmed free by the vehicle's own line of sight.
///
/// It is kept as road s, so it stays true between two sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightLine {
    clear_s_m: [f64; LANE_COUNT as usize],
    open_s_m: [f64; LANE_COUNT as usize],
    /// When the open sight was seen.
    seen_s: [f64; LANE_COUNT as usize],
}

impl SightLine {
    /// Every lane is free up to road s `clear_s_m` (lane 0 first), seen at `time_s`.
    pub fn new(clear_s_m: [f64; LANE_COUNT as usize], time_s: f64) -> Self {
        Self {
            clear_s_m,
            open_s_m: clear_s_m,
            seen_s: [time_s; LANE_COUNT as usize],
        }
    }

    /// The same, with the free sight that ends at any vehicle, tracked or not.
    pub fn with_open(self, open_s_m: [f64; LANE_COUNT as usize]) -> Self {
        Self { open_s_m, ..self }
    }

    /// Road s up to which `lane` is confirmed free, or hidden only behind tracked vehicles in it.
    pub fn clear_s_m(&self, lane: LaneIndex) -> f64 {
        self.clear_s_m[usize::from(lane.get())]
    }

    /// Road s up to which `lane` is confirmed free.
    pub fn open_s_m(&self, lane: LaneIndex) -> f64 {
        self.open_s_m[usize::from(lane.get())]
    }

    /// Takes a new sweep over. A stretch that was seen free and is now hidden, say by a truck in
    /// the next lane, counts as free for a while; what only a tracked vehicle hid does not.
    pub fn update(&mut self, newer: &Self, time_s: f64, settings: &SafetySettings) {
        for (lane, &open) in newer.open_s_m.iter().enumerate() {
            let forgotten = time_s - self.seen_s[lane] > settings.sight_memory_s;
            if open >= self.open_s_m[lane] || forgotten {
                self.open_s_m[lane] = open;
                self.seen_s[lane] = time_s;
            }
            self.clear_s_m[lane] = newer.clear_s_m[lane].max(self.open_s_m[lane]);
        }
    }

    pub(crate) fn is_usable(&self) -> bool {
        let ends = self.clear_s_m.iter().chain(&self.open_s_m);
        ends.into_iter().all(|end| !end.is_nan())
    }
}

/// Spacing of the points looked at along a lane.
const STEP_M: f64 = 1.0;
/// From where on ahead of the sensor the lane is looked at: before it is the own body.
const FIRST_M: f64 = 4.0;
/// Half the width that has to be seen free.
const HALF_WIDTH_M: f64 = 0.9;
/// How much farther than the free range a point counts as seen.
const MARGIN_M: f64 = 1.0;

/// Road s up to which `lane` ahead is seen free.
///
/// `lidar` is the sensor's pose in the world, and `free_range_m` the range in metres up to which
/// nothing blocks the view at an azimuth in its frame. A point is seen free when the lane's middle
/// and both sides are, or are hidden only behind a tracked vehicle in this lane: whatever stands
/// there is behind that vehicle, towards which there is a row of its own.
pub fn clear_until_m(
    road: &Road,
    lane: LaneIndex,
    lidar: Se2Pose,
    free_range_m: &dyn Fn(f64) -> f64,
    neighbours: &[Neighbour],
    settings: &SafetySettings,
) -> f64 {
    let from_m = road.to_frenet(lidar.position()).s_m;
    let center_m = road.lane_center_m(lane);
    let is_seen = |s_m: f64, d_m: f64| {
        let local = lidar.inverse_transform(road.from_frenet(FrenetPoint { s_m, d_m }));
        let (range_m, azimuth_rad) = (local.norm(), local.y.atan2(local.x));
        let free_m = free_range_m(azimuth_rad);
        if free_m.is_nan() {
            return false;
        }
        if free_m + MARGIN_M >= range_m {
            return true;
        }
        let blocker = road.to_frenet_near(lidar.transform(local * (free_m / range_m)), s_m);
        neighbours
            .iter()
            .any(|neighbour| neighbour.lanes.contains(lane) && is_at(neighbour, blocker))
    };
    let count = ((settings.sight_range_m - FIRST_M) / STEP_M)
        .floor()
        .max(0.0) as usize;
    let seen = (0..=count)
        .map(|i| from_m + FIRST_M + STEP_M * i as f64)
        .take_while(|&s_m| {
            [0.0, -HALF_WIDTH_M, HALF_WIDTH_M]
                .iter()
                .all(|offset| is_seen(s_m, center_m + offset))
        })
        .last();
    seen.unwrap_or(from_m)
}

fn is_at(neighbour: &Neighbour, point: FrenetPoint) -> bool {
    let along = neighbour.s_rear_m - MARGIN_M..=neighbour.s_front_m + MARGIN_M;
    let across = neighbour.d_right_m - MARGIN_M..=neighbour.d_left_m + MARGIN_M;
    along.contains(&point.s_m) && across.contains(&point.d_m)
}

#[cfg(test)]
mod tests {
    use covista_world::RoadSegment;

    use super::*;

    fn road() -> Road {
        let segment = RoadSegment::Straight { length_m: 300.0 };
        Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road")
    }

    #[test]
    fn sight_ends_at_an_unknown_obstacle_and_at_the_range() {
        let (road, settings) = (road(), SafetySettings::default());
        let lane = LaneIndex::new(1).expect("a lane");
        let lidar = Se2Pose::new(20.0, 0.0, 0.0);
        let open = clear_until_m(&road, lane, lidar, &|_| 120.0, &[], &settings);
        assert!((open - 85.0).abs() < 1e-9, "{open}");
        let wall = clear_until_m(&road, lane, lidar, &|a| 30.2 / a.cos(), &[], &settings);
        assert!((wall - 51.0).abs() < 1e-6, "{wall}");
        let nothing = clear_until_m(&road, lane, lidar, &|_| f64::NAN, &[], &settings);
        assert!((nothing - 20.0).abs() < 1e-9);
    }

    #[test]
    fn what_was_seen_free_stays_so_for_a_while() {
        let settings = SafetySettings::default();
        let mut sight = SightLine::new([80.0; 3], 0.0);
        let short = SightLine::new([40.0; 3], 0.0);
        sight.update(&short, 0.5, &settings);
        assert!((sight.clear_s_m(LaneIndex::LEFTMOST) - 80.0).abs() < 1e-12);
        sight.update(&short, 1.5, &settings);
        assert!((sight.clear_s_m(LaneIndex::LEFTMOST) - 40.0).abs() < 1e-12);
    }
}
