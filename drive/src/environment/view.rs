use covista_control::SafetySettings;
use covista_traffic::RingVehicle;
use covista_world::{LANE_COUNT, LaneIndex, Road};

/// How far before its middle a box begins to show.
const HALF_BODY_M: f64 = 2.0;

/// A body in road coordinates, as somebody on the road sees it: the corners of its box, counted
/// along the road from the eye and across from the reference line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    pub corners: [[f64; 2]; 4],
    pub s_range_m: [f64; 2],
    pub d_range_m: [f64; 2],
}

impl Shape {
    /// A box of this length and width round (s, d), turned by psi against the road. On the gentle
    /// curves of a loop the road is taken for straight between eye and body.
    pub fn new([s_m, d_m]: [f64; 2], psi_rad: f64, length_m: f64, width_m: f64) -> Self {
        let (sin, cos) = psi_rad.sin_cos();
        let (x, y) = (length_m / 2.0, width_m / 2.0);
        let corners = [(x, y), (x, -y), (-x, -y), (-x, y)]
            .map(|(x, y)| [s_m + x * cos - y * sin, d_m + x * sin + y * cos]);
        let range = |axis: usize| {
            corners
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |range, corner| {
                    [range[0].min(corner[axis]), range[1].max(corner[axis])]
                })
        };
        Self {
            corners,
            s_range_m: range(0),
            d_range_m: range(1),
        }
    }

    /// The body of a vehicle of a ring, where it has driven to.
    pub fn of(vehicle: &RingVehicle) -> Self {
        let (frenet, dimensions) = (vehicle.frenet(), vehicle.dimensions());
        let (sin, cos) = frenet.psi_rad.sin_cos();
        let center_m = dimensions.center_ahead_of_axle_m();
        let center = [frenet.s_m + center_m * cos, frenet.d_m + center_m * sin];
        Self::new(
            center,
            frenet.psi_rad,
            dimensions.length_m,
            dimensions.width_m,
        )
    }

    /// The same body `by_m` farther along the road.
    pub fn farther(self, by_m: f64) -> Self {
        Self {
            corners: self.corners.map(|[s_m, d_m]| [s_m + by_m, d_m]),
            s_range_m: self.s_range_m.map(|s_m| s_m + by_m),
            ..self
        }
    }

    /// Whether the way from `eye` to `point` passes through the box that holds it.
    fn hides(&self, eye: [f64; 2], point: [f64; 2]) -> bool {
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (axis, range) in [self.s_range_m, self.d_range_m].into_iter().enumerate() {
            let way = point[axis] - eye[axis];
            let (a, b) = ((range[0] - eye[axis]) / way, (range[1] - eye[axis]) / way);
            if way.abs() < 1e-9 {
                if eye[axis] < range[0] || eye[axis] > range[1] {
                    return false;
                }
            } else {
                (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
            }
        }
        from < to
    }

    /// The middle of the body.
    pub fn middle(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.corners.iter().map(|corner| corner[axis]).sum::<f64>() / 4.0)
    }

    fn is_in(&self, [right_m, left_m]: [f64; 2]) -> bool {
        self.d_range_m[0] < left_m && self.d_range_m[1] > right_m
    }
}

/// Whether body `index` is seen from `eye`: its middle or a corner, past all the others.
pub(super) fn is_seen(eye: [f64; 2], bodies: &[Shape], index: usize) -> bool {
    let body = &bodies[index];
    let points = body.corners.into_iter().chain([body.middle()]);
    points
        .into_iter()
        .any(|point| is_past(eye, bodies, index, point))
}

/// Share of the outline of body `index` that is seen from `eye` past all the others: of corners and
/// middles of the sides, a little inside, as the sensors' truth has it.
pub(super) fn visible_share(eye: [f64; 2], bodies: &[Shape], index: usize) -> f64 {
    let (middle, corners) = (bodies[index].middle(), bodies[index].corners);
    let inside =
        |point: [f64; 2]| [0, 1].map(|axis| middle[axis] + 0.9 * (point[axis] - middle[axis]));
    let sides = [0, 1, 2, 3].map(|side: usize| {
        let (one, other) = (corners[side], corners[(side + 1) % 4]);
        [0, 1].map(|axis| (one[axis] + other[axis]) / 2.0)
    });
    let outline = corners.into_iter().chain(sides).map(inside);
    outline
        .filter(|&point| is_past(eye, bodies, index, point))
        .count() as f64
        / 8.0
}

/// Whether a box about `point` begins to show from `eye`: whether no body stands before it.
pub(super) fn is_open(eye: [f64; 2], bodies: &[Shape], point: [f64; 2]) -> bool {
    let way = [point[0] - eye[0], point[1] - eye[1]];
    let length_m = way[0].hypot(way[1]);
    let share = (1.0 - HALF_BODY_M / length_m).max(0.0);
    let shows = [0, 1].map(|axis| eye[axis] + share * way[axis]);
    !bodies.iter().any(|body| body.hides(eye, shows))
}

/// Whether `point` of body `index` is seen past all the others.
fn is_past(eye: [f64; 2], bodies: &[Shape], index: usize, point: [f64; 2]) -> bool {
    let past = |(other, shape): (usize, &Shape)| other == index || !shape.hides(eye, point);
    bodies.iter().enumerate().all(past)
}

/// Distances from the eye up to which a lane ahead is seen free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FreeLane {
    /// But for what only known vehicles in the lane itself hide.
    pub clear_m: f64,
    /// At all.
    pub open_m: f64,
    /// Whether it ends at something in the lane itself.
    pub is_blocked: bool,
}

/// How far each lane ahead is seen free from `eye`, past `bodies`.
///
/// Behind a body the road is hidden between the lines from the eye through its outermost corners;
/// a lane is free up to where the first of them meets one of its edges. What a body in the lane
/// hides behind it counts as clear where `knows` says so of the lane and the body.
pub(super) fn free_lanes(
    road: &Road,
    eye: [f64; 2],
    bodies: &[Shape],
    safety: &SafetySettings,
    knows: impl Fn(LaneIndex, &Shape) -> bool,
) -> [FreeLane; LANE_COUNT as usize] {
    let mut lanes = [FreeLane {
        clear_m: safety.sight_range_m,
        open_m: safety.sight_range_m,
        is_blocked: false,
    }; LANE_COUNT as usize];
    for (lane, free) in LaneIndex::all().zip(&mut lanes) {
        let (right_m, left_m) = road.lane_bounds_m(lane);
        let strip = [right_m + safety.lane_entry_m, left_m - safety.lane_entry_m];
        for body in bodies.iter().filter(|body| body.s_range_m[1] > eye[0]) {
            let shadow_m = shadow_m(eye, body, strip);
            if body.is_in(strip) {
                let begins_m = (body.s_range_m[0] - eye[0]).max(0.0);
                if begins_m < free.open_m {
                    (free.open_m, free.is_blocked) = (begins_m, true);
                }
                if begins_m < free.clear_m && !knows(lane, body) {
                    free.clear_m = begins_m;
                }
            } else {
                if shadow_m < free.open_m {
                    (free.open_m, free.is_blocked) = (shadow_m, false);
                }
                free.clear_m = free.clear_m.min(shadow_m);
            }
        }
        free.clear_m = free.clear_m.max(free.open_m);
    }
    lanes
}

/// Where the shadow of `body` first falls on a strip beside it.
fn shadow_m(eye: [f64; 2], body: &Shape, strip: [f64; 2]) -> f64 {
    let lines = body
        .corners
        .iter()
        .flat_map(|corner| strip.map(|edge_m| (corner, edge_m)));
    lines
        .filter_map(|([s_m, d_m], edge_m)| {
            let (ahead_m, across_m) = (s_m - eye[0], d_m - eye[1]);
            let times = (edge_m - eye[1]) / across_m;
            (ahead_m > 0.0 && times >= 1.0).then_some(ahead_m * times)
        })
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car(s_m: f64, d_m: f64) -> Shape {
        Shape::new([s_m, d_m], 0.0, 4.0, 2.0)
    }

    #[test]
    fn what_stands_behind_another_is_hidden() {
        let bodies = [
            car(20.0, 0.0),
            car(40.0, 0.0),
            car(40.0, 3.5),
            car(-20.0, 0.0),
        ];
        let seen: Vec<bool> = (0..4).map(|i| is_seen([0.0, 0.0], &bodies, i)).collect();
        assert_eq!(seen, [true, false, true, true]);
    }

    #[test]
    fn a_lane_is_free_up_to_what_is_in_it_and_to_the_shadow_of_what_is_beside_it() {
        let road = covista_world::Road::new(
            covista_world::Se2Pose::default(),
            &[covista_world::RoadSegment::Straight { length_m: 500.0 }],
            3.5,
        )
        .expect("a road");
        let safety = SafetySettings::default();
        let [left, middle, right] =
            free_lanes(&road, [0.0, 0.0], &[car(20.0, 0.0)], &safety, |_, _| true);
        assert!(middle.is_blocked && (middle.open_m - 18.0).abs() < 1e-9);
        assert!((middle.clear_m - safety.sight_range_m).abs() < 1e-9);
        // Through the near corner at (18, 1), to the inner edge at 1.75 + 0.2.
        for lane in [left, right] {
            assert!(
                !lane.is_blocked && (lane.open_m - 18.0 * 1.95).abs() < 1e-9,
                "{lane:?}"
            );
            assert!((lane.clear_m - lane.open_m).abs() < 1e-12);
        }
    }
}
