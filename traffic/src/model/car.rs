use covista_world::VehicleDimensions;

use super::shapes::{HEADLAMP, PAINT, PLATE, TAIL_LAMP, block, pair, wheels};
use super::solid::{Plane, Solid};
use crate::{ConvexPart, Material};

const UPHOLSTERY: Material = Material::Cloth([46, 46, 50]);
/// The coat lies this far below lamps, plates and the outer dimensions.
const COAT_DEPTH_M: f64 = 0.004;
/// A pane lies this far below the pillars.
const PANE_DEPTH_M: f64 = 0.01;
const PANE_THICKNESS_M: f64 = 0.03;
const DOOR_THICKNESS_M: f64 = 0.14;
const PLATE_M: [f64; 2] = [0.52, 0.11];

/// A car as its three-view drawing has it, from a handful of points.
///
/// Points of the side view are (metres behind the nose, height) in front of the roof and (metres
/// ahead of the tail, height) behind it.
#[derive(Debug)]
pub(super) struct CarShape {
    pub(super) clearance_m: f64,
    pub(super) wheel_radius_m: f64,
    /// Heights between which the front bumper stands upright, then where the bonnet begins, where
    /// it meets the windscreen and where the windscreen meets the roof.
    pub(super) bumper_m: [f64; 2],
    pub(super) bonnet_edge: [f64; 2],
    pub(super) cowl: [f64; 2],
    pub(super) screen_top: [f64; 2],
    /// Where the roof meets the rear window, that the boot, and the boot the tail; then heights
    /// between which the tail stands upright.
    pub(super) roof_end: [f64; 2],
    pub(super) window_base: [f64; 2],
    pub(super) boot_edge: [f64; 2],
    pub(super) tail_m: [f64; 2],
    /// Heights of lamps.
    pub(super) headlamp_m: [f64; 2],
    pub(super) tail_lamp_m: [f64; 2],
    /// How much further in the sides of the roof are than those of the doors.
    pub(super) tumblehome_m: f64,
    /// Thickness of the rearmost pillars along the car.
    pub(super) rear_pillar_m: f64,
    /// The other pillars, the backs of the front seats and those of the benches behind them,
    /// metres behind the front axle.
    pub(super) posts_m: &'static [f64],
    pub(super) seats_m: f64,
    pub(super) benches_m: &'static [f64],
}

/// A shape in the vehicle frame.
struct Drawing<'a> {
    shape: &'a CarShape,
    size: VehicleDimensions,
    nose_m: f64,
    tail_m: f64,
    half_m: f64,
    /// Height of the wheel arches.
    arch_m: f64,
    /// Height of the lower edge of the side windows.
    belt_m: f64,
    /// Ahead of this and behind that the body is closed up to the belt.
    cabin_m: [f64; 2],
    screen: [[f64; 2]; 2],
    rear_window: [[f64; 2]; 2],
}

impl CarShape {
    pub(super) fn parts(&self, size: VehicleDimensions) -> Vec<ConvexPart> {
        let drawing = Drawing::new(self, size);
        let mut parts = drawing.body();
        parts.extend(drawing.greenhouse());
        parts.extend(drawing.interior());
        parts.extend(drawing.fittings());
        parts.extend(wheels(size, self.wheel_radius_m, 0.6 * self.wheel_radius_m));
        parts
    }
}

impl<'a> Drawing<'a> {
    fn new(shape: &'a CarShape, size: VehicleDimensions) -> Self {
        let tail_m = -size.rear_overhang_m;
        let nose_m = size.length_m + tail_m;
        let behind_nose = |[x, z]: [f64; 2]| [nose_m - x, z];
        let ahead_of_tail = |[x, z]: [f64; 2]| [tail_m + x, z];
        let screen = [shape.screen_top, shape.cowl].map(behind_nose);
        let rear_window = [shape.window_base, shape.roof_end].map(ahead_of_tail);
        Self {
            shape,
            size,
            nose_m,
            tail_m,
            half_m: size.width_m / 2.0,
            arch_m: 2.0 * shape.wheel_radius_m + 0.03,
            belt_m: shape.cowl[1].max(shape.window_base[1]),
            cabin_m: [rear_window[0][0].max(0.0) + 0.08, screen[1][0]],
            screen,
            rear_window,
        }
    }

    /// Everything below the windows, without arches.
    fn outline(&self) -> Solid {
        let Self {
            shape,
            nose_m,
            tail_m,
            half_m,
            ..
        } = *self;
        let clearance_m = shape.clearance_m;
        // Upright ends are squarer.
        let front_m = (nose_m - self.size.wheelbase_m).min(0.9).min(shape.cowl[0]);
        let rear_m = (-tail_m).min(0.9).min(6.0 * shape.window_base[0]);
        Solid::default()
            .side_view(&[
                [tail_m + 0.12, clearance_m],
                [tail_m, shape.tail_m[0]],
                [tail_m, shape.tail_m[1]],
                [tail_m + shape.boot_edge[0], shape.boot_edge[1]],
                self.rear_window[0],
                self.screen[1],
                [nose_m - shape.bonnet_edge[0], shape.bonnet_edge[1]],
                [nose_m, shape.bumper_m[1]],
                [nose_m, shape.bumper_m[0]],
                [nose_m - 0.10, clearance_m],
                [tail_m + 0.12, clearance_m],
            ])
            .plan_view(&[
                [tail_m, 0.62 * half_m],
                [tail_m + 0.13 * rear_m, 0.86 * half_m],
                [tail_m + 0.45 * rear_m, 0.965 * half_m],
                [tail_m + 1.10 * rear_m, half_m],
                [nose_m - 1.15 * front_m, half_m],
                [nose_m - 0.56 * front_m, 0.95 * half_m],
                [nose_m - 0.21 * front_m, 0.80 * half_m],
                [nose_m, 0.45 * half_m],
            ])
            .section_view(&[
                [half_m - 0.05, self.belt_m],
                [half_m, self.arch_m],
                [half_m - 0.05, clearance_m],
            ])
    }

    /// Nose, sills and tail between the wheels; above them bonnet, doors and boot.
    fn body(&self) -> Vec<ConvexPart> {
        let coat = self.outline().inset(COAT_DEPTH_M);
        let low = coat.clone().z([0.0, self.arch_m]);
        let high = coat.z([self.arch_m, self.size.height_m]);
        let [rear_m, front_m] = self.cabin_m;
        let door_m = [self.half_m - DOOR_THICKNESS_M, self.half_m];
        let wheelbase_m = self.size.wheelbase_m;
        let painted = [
            low.clone().cut([self.arch_edge(wheelbase_m, 1.0)]),
            low.clone()
                .cut([self.arch_edge(0.0, 1.0), self.arch_edge(wheelbase_m, -1.0)]),
            low.cut([self.arch_edge(0.0, -1.0)]),
            high.clone().x([front_m, self.nose_m]),
            high.clone().x([rear_m, front_m]).y(door_m),
            high.clone().x([rear_m, front_m]).y(mirrored(door_m)),
            high.x([self.tail_m, rear_m]),
        ];
        let inner_m = self.half_m - 0.28;
        let mut parts: Vec<_> = painted.iter().map(|solid| solid.part(PAINT)).collect();
        parts.push(block(
            Material::Rubber,
            [self.tail_m + 0.35, self.nose_m - 0.40],
            [-inner_m, inner_m],
            [self.shape.clearance_m + 0.02, self.arch_m + 0.02],
        ));
        parts
    }

    /// The edge of the arch over the axle at `axle_m`, on the side of `sign`: a slanted line that
    /// clears the wheel.
    fn arch_edge(&self, axle_m: f64, sign: f64) -> Plane {
        let radius_m = self.shape.wheel_radius_m + 0.03;
        let low = [axle_m + sign * 1.12 * radius_m, self.shape.clearance_m];
        let high = [axle_m + sign * 0.70 * radius_m, self.arch_m];
        Plane::side(if sign > 0.0 { [low, high] } else { [high, low] })
    }

    /// Roof, pillars and panes.
    fn greenhouse(&self) -> Vec<ConvexPart> {
        let Self { shape, half_m, .. } = *self;
        let height_m = self.size.height_m;
        let [screen_top, cowl] = self.screen;
        let [base, roof_end] = self.rear_window;
        let peak = [0.55 * screen_top[0] + 0.45 * roof_end[0], height_m];
        let roof_half_m = half_m - shape.tumblehome_m;
        let flank = [
            [roof_half_m, height_m - 0.07],
            [half_m - 0.055, self.belt_m - 0.02],
        ];
        let house = Solid::default()
            .side_view(&[base, roof_end, peak, screen_top, cowl, base])
            .plan_view(&[[base[0], 0.85 * half_m], [base[0] + 0.40, 0.95 * half_m]])
            .plan_view(&[[cowl[0] - 0.50, 0.96 * half_m], [cowl[0], 0.88 * half_m]])
            .section_view(&[[roof_half_m - 0.20, height_m], flank[0], flank[1]]);
        let eaves_m = screen_top[1].min(roof_end[1]) - 0.05;
        let below = house.clone().z([0.0, eaves_m]);
        let glass = house.inset(PANE_DEPTH_M).z([0.0, eaves_m]);
        let left = Plane::section(flank);
        let (screen, rear) = (Plane::side(self.screen), Plane::side(self.rear_window));
        let pane = |plane| glass.clone().within(PANE_DEPTH_M + PANE_THICKNESS_M, plane);
        let mut parts = vec![house.z([eaves_m, height_m]).part(PAINT)];
        parts.extend(
            [left, left.mirrored(), screen, rear].map(|plane| pane(plane).part(Material::Glass)),
        );
        for flank in [left, left.mirrored()] {
            let side = below.clone().within(0.16, flank);
            parts.push(side.clone().within(0.10, screen).part(PAINT));
            parts.push(side.clone().within(shape.rear_pillar_m, rear).part(PAINT));
            parts.extend(shape.posts_m.iter().map(|post_m| {
                let x = self.size.wheelbase_m - post_m;
                let post = below.clone().within(0.05, flank);
                post.x([x - 0.05, x + 0.05]).part(PAINT)
            }));
        }
        parts
    }

    /// Dashboard and backs of seats.
    fn interior(&self) -> Vec<ConvexPart> {
        let front_m = self.cabin_m[1];
        let inner_m = self.half_m - DOOR_THICKNESS_M;
        let floor_m = self.arch_m;
        let dash_m = self.shape.cowl[1] - 0.03;
        let mut parts = vec![block(
            UPHOLSTERY,
            [front_m - 0.45, front_m],
            [-inner_m, inner_m],
            [floor_m, dash_m],
        )];
        let z = [floor_m, self.belt_m + 0.16];
        let along = |back_m: f64| {
            let x = self.size.wheelbase_m - back_m;
            [x - 0.14, x]
        };
        let x = along(self.shape.seats_m);
        parts.extend(pair(UPHOLSTERY, x, [0.12, 0.80 * inner_m], z));
        parts.extend(self.shape.benches_m.iter().map(|&bench_m| {
            let half_m = 0.84 * inner_m;
            block(UPHOLSTERY, along(bench_m), [-half_m, half_m], z)
        }));
        parts
    }

    /// Lamps, number plates and mirrors.
    fn fittings(&self) -> Vec<ConvexPart> {
        let Self {
            shape,
            nose_m,
            tail_m,
            half_m,
            ..
        } = *self;
        let outline = self.outline();
        let lamp_m = [0.62 * half_m, 0.98 * half_m];
        let [plate_width_m, plate_height_m] = PLATE_M;
        let plate_m = [-plate_width_m / 2.0, plate_width_m / 2.0];
        let below = |top_m: f64| [top_m - plate_height_m, top_m];
        let mut parts = vec![
            outline
                .clone()
                .x([nose_m - 0.03, nose_m])
                .y(plate_m)
                .z(below(shape.bumper_m[1] - 0.02))
                .part(PLATE),
            outline
                .clone()
                .x([tail_m, tail_m + 0.03])
                .y(plate_m)
                .z(below(shape.tail_m[1] - 0.02))
                .part(PLATE),
        ];
        for side_m in [lamp_m, mirrored(lamp_m)] {
            let lamp = outline.clone().y(side_m);
            let front = lamp.clone().x([nose_m - 0.40, nose_m]);
            parts.push(front.z(shape.headlamp_m).part(HEADLAMP));
            let rear = lamp.x([tail_m, tail_m + 0.16]);
            parts.push(rear.z(shape.tail_lamp_m).part(TAIL_LAMP));
        }
        let mirror_m = self.cabin_m[1] - 0.42;
        parts.extend(pair(
            PAINT,
            [mirror_m, mirror_m + 0.10],
            [half_m - 0.14, half_m],
            [self.belt_m + 0.01, self.belt_m + 0.14],
        ));
        parts
    }
}

fn mirrored([low, high]: [f64; 2]) -> [f64; 2] {
    [-high, -low]
}
