use covista_control::{SafetySettings, SightLine};
use covista_traffic::Ring;
use covista_world::{LaneIndex, Road};

use super::view::{Shape, free_lanes, is_seen, visible_share};

/// Who has whom in line of sight, as of the newest frame.
#[derive(Default)]
pub(super) struct Sights {
    views: Vec<View>,
    /// Whether a CAV sees a vehicle, row by row.
    sees: Vec<bool>,
    vehicles: usize,
    bodies: Vec<Shape>,
}

/// What stands about a CAV, each at the image nearest to it.
#[derive(Default)]
pub(super) struct View {
    eye: [f64; 2],
    /// Indices of the vehicles, and in how many laps from where they have driven to they stand.
    near: Vec<(usize, f64)>,
    shapes: Vec<Shape>,
}

/// A vehicle that a CAV sees.
pub(super) struct Seen<'a> {
    /// Its index.
    pub vehicle: usize,
    /// In how many laps from where it has driven to it is seen.
    pub laps: f64,
    /// Its body there.
    pub body: &'a Shape,
    /// Share of its outline in line of sight.
    pub visibility: f64,
}

impl Sights {
    /// A frame: the first `cavs` vehicles look.
    pub fn frame(&mut self, ring: &Ring, cavs: usize, safety: &SafetySettings) {
        let vehicles = ring.vehicles();
        self.vehicles = vehicles.len();
        self.bodies.clear();
        self.bodies.extend(vehicles.iter().map(Shape::of));
        self.views.resize_with(cavs, View::default);
        self.sees.clear();
        self.sees.resize(cavs * vehicles.len(), false);
        for (index, view) in self.views.iter_mut().enumerate() {
            view.take(index, ring, &self.bodies, safety.sight_range_m);
            for (place, &(other, _)) in view.near.iter().enumerate() {
                self.sees[index * vehicles.len() + other] = is_seen(view.eye, &view.shapes, place);
            }
        }
    }

    /// Whether CAV `index` sees vehicle `other`.
    pub fn sees(&self, index: usize, other: usize) -> bool {
        self.sees[index * self.vehicles + other]
    }

    /// Whom CAV `index` sees.
    pub fn seen(&self, index: usize) -> impl Iterator<Item = Seen<'_>> {
        let View { eye, near, shapes } = &self.views[index];
        let places = near.iter().enumerate();
        let seen = places.filter(move |(_, (vehicle, _))| self.sees(index, *vehicle));
        seen.map(move |(place, &(vehicle, laps))| Seen {
            vehicle,
            laps,
            body: &shapes[place],
            visibility: visible_share(*eye, shapes, place),
        })
    }

    /// The eye of CAV `index` and the bodies about it.
    pub fn about(&self, index: usize) -> ([f64; 2], &[Shape]) {
        let view = &self.views[index];
        (view.eye, &view.shapes)
    }

    /// How far CAV `index` sees each lane ahead, where `knows` tells whether it knows of a body
    /// that stands in a lane.
    pub fn free(
        &self,
        index: usize,
        time_s: f64,
        road: &Road,
        safety: &SafetySettings,
        knows: impl Fn(LaneIndex, &Shape) -> bool,
    ) -> SightLine {
        let View { eye, shapes, .. } = &self.views[index];
        let free = free_lanes(road, *eye, shapes, safety, knows);
        SightLine::new(free.map(|lane| eye[0] + lane.clear_m), time_s)
            .with_open(free.map(|lane| eye[0] + lane.open_m))
            .with_blocked(free.map(|lane| lane.is_blocked))
    }
}

impl View {
    fn take(&mut self, index: usize, ring: &Ring, bodies: &[Shape], range_m: f64) {
        let (vehicles, road) = (ring.vehicles(), ring.road());
        let own = &vehicles[index];
        let eye = [
            own.frenet().s_m + own.dimensions().center_ahead_of_axle_m(),
            own.frenet().d_m,
        ];
        self.eye = eye;
        self.near.clear();
        self.shapes.clear();
        for (other, body) in bodies.iter().enumerate() {
            let laps = road.laps_to(vehicles[other].frenet().s_m, eye[0]);
            let body = body.farther(laps * road.period_m());
            if other != index && (body.corners[0][0] - eye[0]).abs() < range_m {
                self.near.push((other, laps));
                self.shapes.push(body);
            }
        }
    }
}
