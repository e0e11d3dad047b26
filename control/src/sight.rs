use covista_world::{FrenetPoint, LANE_COUNT, LaneIndex, Road, Se2Pose};

use crate::{Neighbour, SafetySettings};

/// How far along the road each lane is confirmed free by the vehicle's own line of sight.
///
/// It is kept as road s, so it stays true between two sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightLine {
    clear_s_m: [f64; LANE_COUNT as usize],
    open_s_m: [f64; LANE_COUNT as usize],
    /// Whether the open sight ends at something in the lane.
    is_blocked: [bool; LANE_COUNT as usize],
    /// When the open sight was seen.
    seen_s: [f64; LANE_COUNT as usize],
}

impl SightLine {
    /// Every lane is free up to road s `clear_s_m` (lane 0 first), seen at `time_s`.
    pub fn new(clear_s_m: [f64; LANE_COUNT as usize], time_s: f64) -> Self {
        Self {
            clear_s_m,
            open_s_m: clear_s_m,
            is_blocked: [false; LANE_COUNT as usize],
            seen_s: [time_s; LANE_COUNT as usize],
        }
    }

    /// The same, with the free sight that ends at any vehicle, tracked or not.
    pub fn with_open(self, open_s_m: [f64; LANE_COUNT as usize]) -> Self {
        Self { open_s_m, ..self }
    }

    /// The same, with the lanes in which the open sight ends at something in the lane itself.
    pub fn with_blocked(self, is_blocked: [bool; LANE_COUNT as usize]) -> Self {
        Self { is_blocked, ..self }
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
    /// the next lane, counts as free for a while; what only a tracked vehicle hid does not, nor
    /// what lies behind something in the lane itself.
    pub fn update(&mut self, newer: &Self, time_s: f64, settings: &SafetySettings) {
        for (lane, &open) in newer.open_s_m.iter().enumerate() {
            let forgotten = time_s - self.seen_s[lane] > settings.sight_memory_s;
            if open >= self.open_s_m[lane] || forgotten || newer.is_blocked[lane] {
                self.open_s_m[lane] = open;
                self.is_blocked[lane] = newer.is_blocked[lane];
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
/// Spacing of the points looked at across a lane, at the most.
const ACROSS_M: f64 = 0.5;
/// How much farther than the free range a point counts as seen.
const MARGIN_M: f64 = 1.0;

/// How far a lane ahead is seen free.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clear {
    /// Road s up to which it is.
    pub until_s_m: f64,
    /// Whether it ends at something in the lane itself.
    pub is_blocked: bool,
}

/// How far `lane` ahead is seen free.
///
/// `lidar` is the sensor's pose in the world, and `free_range_m` the range in metres up to which
/// nothing blocks the view at an azimuth in its frame. The lane is seen free at some road s when
/// all of its width is, but for what a body may reach over its lines, or is hidden only behind a
/// tracked vehicle in this lane: whatever stands there is behind that vehicle, towards which there
/// is a row of its own.
pub fn clear_until_m(
    road: &Road,
    lane: LaneIndex,
    lidar: Se2Pose,
    free_range_m: &dyn Fn(f64) -> f64,
    neighbours: &[Neighbour],
    settings: &SafetySettings,
) -> Clear {
    let from_m = road.to_frenet(lidar.position()).s_m;
    let (right_m, left_m) = road.lane_bounds_m(lane);
    let (right_m, left_m) = (
        right_m + settings.lane_entry_m,
        left_m - settings.lane_entry_m,
    );
    let strips = ((left_m - right_m) / ACROSS_M).ceil().max(1.0);
    let look = |s_m: f64, d_m: f64| {
        let local = lidar.inverse_transform(road.from_frenet(FrenetPoint { s_m, d_m }));
        let (range_m, azimuth_rad) = (local.norm(), local.y.atan2(local.x));
        let free_m = free_range_m(azimuth_rad);
        if free_m + MARGIN_M >= range_m {
            return Look::Free;
        }
        if free_m.is_nan() {
            return Look::Hidden;
        }
        let blocker = road.to_frenet_near(lidar.transform(local * (free_m / range_m)), s_m);
        let is_tracked = neighbours
            .iter()
            .any(|neighbour| neighbour.lanes.contains(lane) && is_at(neighbour, blocker));
        if is_tracked {
            Look::Free
        } else if (right_m..=left_m).contains(&blocker.d_m) {
            Look::Blocked
        } else {
            Look::Hidden
        }
    };
    let count = ((settings.sight_range_m - FIRST_M) / STEP_M)
        .floor()
        .max(0.0) as usize;
    let mut clear = Clear {
        until_s_m: from_m,
        is_blocked: false,
    };
    for i in 0..=count {
        let s_m = from_m + FIRST_M + STEP_M * i as f64;
        let worst = (0..=strips as usize)
            .map(|k| look(s_m, right_m + (left_m - right_m) * k as f64 / strips))
            .max();
        if worst > Some(Look::Free) {
            clear.is_blocked = worst == Some(Look::Blocked);
            break;
        }
        clear.until_s_m = s_m;
    }
    clear
}

/// What is seen at a point, the worst last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Look {
    Free,
    Hidden,
    Blocked,
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
        let clear = |free_range_m: &dyn Fn(f64) -> f64| {
            clear_until_m(&road, lane, lidar, free_range_m, &[], &settings)
        };
        let open = clear(&|_| 120.0);
        assert!(
            (open.until_s_m - 85.0).abs() < 1e-9 && !open.is_blocked,
            "{open:?}"
        );
        let wall = clear(&|azimuth| 30.2 / azimuth.cos());
        assert!(
            (wall.until_s_m - 51.0).abs() < 1e-6 && wall.is_blocked,
            "{wall:?}"
        );
        let nothing = clear(&|_| f64::NAN);
        assert!((nothing.until_s_m - 20.0).abs() < 1e-9 && !nothing.is_blocked);
    }

    #[test]
    fn a_body_that_reaches_into_the_lane_ends_the_sight_and_one_beside_does_not() {
        let (road, settings) = (road(), SafetySettings::default());
        let lane = LaneIndex::new(1).expect("a lane");
        let lidar = Se2Pose::new(20.0, 0.0, 0.0);
        // The flat side of a body at x = 60, from offset `from_m` to the left.
        let side = |from_m: f64| {
            move |azimuth: f64| {
                let across_m = 40.0 * azimuth.tan();
                let is_hit = azimuth.abs() < 1.0 && (from_m..from_m + 2.0).contains(&across_m);
                if is_hit { 40.0 / azimuth.cos() } else { 120.0 }
            }
        };
        let inside = clear_until_m(&road, lane, lidar, &side(1.5), &[], &settings);
        assert!(
            inside.is_blocked && (59.0..=61.0).contains(&inside.until_s_m),
            "{inside:?}"
        );
        let outside = clear_until_m(&road, lane, lidar, &side(2.3), &[], &settings);
        assert!((outside.until_s_m - 85.0).abs() < 1e-9, "{outside:?}");
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

    #[test]
    fn what_stands_in_the_lane_is_not_forgotten() {
        let settings = SafetySettings::default();
        let mut sight = SightLine::new([80.0; 3], 0.0);
        let blocked = SightLine::new([40.0; 3], 0.0).with_blocked([true; 3]);
        sight.update(&blocked, 0.1, &settings);
        assert!((sight.open_s_m(LaneIndex::LEFTMOST) - 40.0).abs() < 1e-12);
        assert!((sight.clear_s_m(LaneIndex::LEFTMOST) - 40.0).abs() < 1e-12);
    }
}
