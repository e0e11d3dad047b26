use covista_traffic::{Traffic, VehicleId, VehicleKind};
use covista_world::{BicycleState, FrenetPose, LaneIndex, Road, STEP_S, VehicleDimensions};
use nalgebra::Vector2;

/// One vehicle as it truly is, along the road.
#[derive(Debug, Clone, Copy)]
pub struct TrueVehicle {
    /// Its name.
    pub id: VehicleId,
    /// CAV, human or obstacle.
    pub kind: VehicleKind,
    /// Its dimensions.
    pub dimensions: VehicleDimensions,
    /// Rear axle, along the road.
    pub frenet: FrenetPose,
    /// Rearmost and foremost point of the body along the road, in metres.
    pub s_range_m: [f64; 2],
    /// Rightmost and leftmost point of the body across the road, in metres.
    pub d_range_m: [f64; 2],
    /// Centre of the body in the world.
    pub center: Vector2<f64>,
    /// Velocity in the world in m/s.
    pub velocity: Vector2<f64>,
    /// Speed in m/s.
    pub speed_mps: f64,
    /// The lane that holds the body's centre.
    pub lane: Option<LaneIndex>,
}

impl TrueVehicle {
    /// All vehicles of `traffic`, in its order.
    pub fn all(traffic: &Traffic) -> Vec<Self> {
        let road = traffic.road();
        traffic
            .vehicles()
            .iter()
            .map(|vehicle| {
                let dimensions = vehicle.dimensions();
                let s_m = vehicle.frenet.s_m;
                Self::new(
                    vehicle.id,
                    vehicle.kind,
                    dimensions,
                    vehicle.state,
                    s_m,
                    road,
                )
            })
            .collect()
    }

    /// A vehicle with its rear axle at `state`, some metres from `s_hint_m` along the road.
    pub fn new(
        id: VehicleId,
        kind: VehicleKind,
        dimensions: VehicleDimensions,
        state: BicycleState,
        s_hint_m: f64,
        road: &Road,
    ) -> Self {
        let BicycleState { pose, speed_mps } = state;
        let frenet = road.to_frenet_pose_near(pose, s_hint_m);
        let corners = dimensions
            .corners_from_axle()
            .map(|corner| road.to_frenet_near(pose.transform(corner), frenet.s_m));
        let center = dimensions.center_pose(pose).position();
        Self {
            id,
            kind,
            dimensions,
            frenet,
            s_range_m: range(corners.iter().map(|corner| corner.s_m)),
            d_range_m: range(corners.iter().map(|corner| corner.d_m)),
            center,
            velocity: pose.forward() * speed_mps,
            speed_mps,
            lane: road.lane_at(road.to_frenet_near(center, frenet.s_m).d_m),
        }
    }

    /// The lanes that the body reaches into by more than `entry_m`.
    pub fn lanes(&self, road: &Road, entry_m: f64) -> Lanes {
        let [right_m, left_m] = self.d_range_m;
        let occupied = LaneIndex::all().filter(|lane| {
            let (lane_right_m, lane_left_m) = road.lane_bounds_m(*lane);
            right_m < lane_left_m - entry_m && left_m > lane_right_m + entry_m
        });
        occupied.collect()
    }

    /// Speed along the road in m/s.
    pub fn along_mps(&self) -> f64 {
        self.speed_mps * self.frenet.psi_rad.cos()
    }

    /// Whether `other` is ahead: by the bodies' middles along the road.
    pub fn is_behind(&self, other: &Self) -> bool {
        other.middle_s_m() > self.middle_s_m()
    }

    /// The body's middle along the road.
    pub(crate) fn middle_s_m(&self) -> f64 {
        0.5 * (self.s_range_m[0] + self.s_range_m[1])
    }

    /// From the body's centre to its corners.
    pub(crate) fn half_diagonal_m(&self) -> f64 {
        0.5 * self.dimensions.length_m.hypot(self.dimensions.width_m)
    }

    /// Bumper-to-bumper gap to `ahead` in metres, along the one of `lanes` in which it is least;
    /// infinite without a lane.
    pub fn gap_to_m(&self, ahead: &Self, lanes: Lanes, road: &Road) -> f64 {
        shortest_m([self.s_range_m[1], ahead.s_range_m[0]], lanes, road)
    }
}

/// Length of the road from one s to another, along the one of `lanes` in which it is least; infinite
/// without a lane.
pub(crate) fn shortest_m([from_m, to_m]: [f64; 2], lanes: Lanes, road: &Road) -> f64 {
    // A line at offset d is shorter by d times the angle that the road turns by.
    let turned_rad = road.turn_rad(from_m, to_m);
    lanes
        .iter()
        .map(|lane| to_m - from_m - road.lane_center_m(lane) * turned_rad)
        .fold(f64::INFINITY, f64::min)
}

/// Some of the lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lanes(u8);

impl Lanes {
    fn bit(lane: LaneIndex) -> u8 {
        1 << lane.get()
    }

    /// Only `lane`.
    pub fn only(lane: LaneIndex) -> Self {
        Self(Self::bit(lane))
    }

    /// Whether it is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether `lane` is one of them.
    pub fn contains(self, lane: LaneIndex) -> bool {
        self.0 & Self::bit(lane) != 0
    }

    /// These and `lane`.
    pub fn with(self, lane: LaneIndex) -> Self {
        Self(self.0 | Self::bit(lane))
    }

    /// Those that are in `other` too.
    pub fn shared_with(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Those that are not in `other`.
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Each of them, from left to right.
    pub fn iter(self) -> impl Iterator<Item = LaneIndex> {
        LaneIndex::all().filter(move |lane| self.contains(*lane))
    }
}

impl FromIterator<LaneIndex> for Lanes {
    fn from_iter<T: IntoIterator<Item = LaneIndex>>(lanes: T) -> Self {
        Self(
            lanes
                .into_iter()
                .fold(0, |bits, lane| bits | Self::bit(lane)),
        )
    }
}

pub(crate) fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.min(value), high.max(value)]
    })
}

/// Distance in metres by which a gap still shrinks when the follower at `v_mps` brakes with
/// `brake_mps2` and the leader at `leader_mps` with `leader_brake_mps2`, both to standstill.
///
/// The supremum over all times, summed step by step: an oracle of its own, independent of the
/// closed forms in `covista_control` and in the monitor.
pub fn closing_distance_m(
    v_mps: f64,
    leader_mps: f64,
    brake_mps2: f64,
    leader_brake_mps2: f64,
) -> f64 {
    let (mut own, mut leader) = (v_mps, leader_mps);
    let (mut closed, mut most) = (0.0_f64, 0.0_f64);
    while own > 0.0 {
        closed += (own - leader) * STEP_S;
        most = most.max(closed);
        own -= brake_mps2 * STEP_S;
        leader = (leader - leader_brake_mps2 * STEP_S).max(0.0);
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_distance_is_the_difference_of_the_stopping_distances() {
        let sum = closing_distance_m(20.0, 10.0, 8.0, 8.0);
        assert!((sum - (400.0 - 100.0) / 16.0).abs() < 0.2, "{sum}");
        assert!(closing_distance_m(10.0, 20.0, 8.0, 8.0).abs() < 1e-12);
    }

    #[test]
    fn the_supremum_can_lie_before_either_stops() {
        // The follower brakes harder: it closes while it is the faster one, and only then.
        let sum = closing_distance_m(20.0, 18.0, 8.0, 2.0);
        assert!((sum - 4.0 / (2.0 * 6.0)).abs() < 0.05, "{sum}");
    }
}
