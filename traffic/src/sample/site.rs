use covista_world::{Road, Se2Pose};
use nalgebra::Vector2;

use crate::{Body, ConvexPart, SceneVehicle, Terrain};

/// What hangs higher than this is in nobody's way.
const HEADROOM_M: f64 = 2.6;
/// What is lower than this can be driven over or parked on.
const STEP_M: f64 = 0.2;
const CLEARANCE_M: f64 = 0.15;

/// The ground beside a road, on which scenery is set down out of the way of vehicles.
pub(super) struct Site<'a> {
    pub road: &'a Road,
    pub terrain: &'a Terrain,
    /// Offsets d (right, left) between which nothing may stand.
    pub driven_m: [f64; 2],
    pub vehicles: &'a [SceneVehicle],
    pub bodies: Vec<Body>,
}

impl Site<'_> {
    /// Lays down what runs along the road: every vertex is lifted by the ground below it, and
    /// pieces that are in the way are left out.
    pub fn along(&mut self, body: Body) {
        let mut parts = body.parts;
        for vertex in parts.iter_mut().flat_map(|part| &mut part.vertices) {
            vertex.z += self.terrain.height_m(vertex.xy().coords);
        }
        parts.retain(|part| !self.obstructs(part));
        if !parts.is_empty() {
            self.bodies.push(Body { parts });
        }
    }

    /// Sets a body down at a pose, on the lowest ground below its foot, unless it is in the way.
    pub fn stand(&mut self, pose: Se2Pose, body: Body) {
        self.raise(pose, body, 0.0);
    }

    /// As [`Site::stand`], on a sidewalk `curb_m` above the ground.
    pub fn raise(&mut self, pose: Se2Pose, body: Body, curb_m: f64) {
        let body = body.at(pose, curb_m);
        let ground_m = body
            .parts
            .iter()
            .flat_map(|part| &part.vertices)
            .filter(|vertex| vertex.z < curb_m + 0.3)
            .map(|vertex| self.terrain.height_m(vertex.xy().coords))
            .fold(self.terrain.height_m(pose.position()), f64::min);
        self.keep(body.at(Se2Pose::default(), ground_m));
    }

    /// Sets a body that spans the road at a pose on the road, at the height of the ground there.
    pub fn span(&mut self, pose: Se2Pose, body: Body) {
        let ground_m = self.terrain.height_m(pose.position());
        self.keep(body.at(pose, ground_m));
    }

    fn keep(&mut self, body: Body) {
        if !body.parts.iter().any(|part| self.obstructs(part)) {
            self.bodies.push(body);
        }
    }

    /// Whether a part, in its place, is in the way of vehicles or on the driven lanes.
    fn obstructs(&self, part: &ConvexPart) -> bool {
        let heights_m = || {
            let vertices = part.vertices.iter();
            vertices.map(|vertex| vertex.z - self.terrain.height_m(vertex.xy().coords))
        };
        if heights_m().fold(f64::MAX, f64::min) > HEADROOM_M {
            return false;
        }
        let mut outline: Vec<Vector2<f64>> = Vec::with_capacity(part.vertices.len());
        for vertex in &part.vertices {
            let point = vertex.xy().coords;
            if outline.iter().all(|other| (other - point).amax() > 1e-6) {
                outline.push(point);
            }
        }
        let center = outline.iter().sum::<Vector2<f64>>() / outline.len().max(1) as f64;
        let radius_m = outline
            .iter()
            .map(|point| (point - center).norm())
            .fold(0.0, f64::max);
        let is_step = heights_m().fold(f64::MIN, f64::max) < STEP_M;
        self.is_on_driven_lanes(&outline, center, radius_m)
            || (!is_step
                && self
                    .vehicles
                    .iter()
                    .any(|vehicle| is_in_the_way_of(vehicle, &outline, center, radius_m)))
    }

    fn is_on_driven_lanes(
        &self,
        outline: &[Vector2<f64>],
        center: Vector2<f64>,
        radius_m: f64,
    ) -> bool {
        let [right_m, left_m] = self.driven_m;
        let middle = self.road.to_frenet(center);
        let outside_m = |d_m: f64| (d_m - left_m).max(right_m - d_m);
        if outside_m(middle.d_m) > radius_m + CLEARANCE_M {
            return false;
        }
        let is_on = |point: Vector2<f64>| {
            let at = self.road.to_frenet_near(point, middle.s_m);
            outside_m(at.d_m) < CLEARANCE_M
        };
        let between = outline
            .iter()
            .enumerate()
            .flat_map(|(i, a)| outline[..i].iter().map(move |b| (a + b) / 2.0));
        is_on(center)
            || outline.iter().copied().any(is_on)
            || (radius_m > 3.0 && { between }.any(is_on))
    }
}

/// Whether the outline's box along the vehicle's axes meets the vehicle.
fn is_in_the_way_of(
    vehicle: &SceneVehicle,
    outline: &[Vector2<f64>],
    center: Vector2<f64>,
    radius_m: f64,
) -> bool {
    let (pose, size) = (vehicle.state.pose, vehicle.dimensions());
    if (pose.position() - center).norm() > radius_m + size.length_m {
        return false;
    }
    let mut low = Vector2::repeat(f64::MAX);
    let mut high = Vector2::repeat(f64::MIN);
    for point in outline {
        let local = pose.inverse_transform(*point);
        (low, high) = (low.inf(&local), high.sup(&local));
    }
    let half_m = size.width_m / 2.0 + CLEARANCE_M;
    let rear_m = -size.rear_overhang_m - CLEARANCE_M;
    low.x < rear_m + size.length_m + 2.0 * CLEARANCE_M
        && high.x > rear_m
        && low.y < half_m
        && high.y > -half_m
}
