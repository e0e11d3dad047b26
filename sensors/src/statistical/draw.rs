use std::f64::consts::PI;

use covista_traffic::VehicleId;
use covista_world::{Detection3d, LaneIndex, ObjectClass, Road, Se2Pose, wrap_angle};
use nalgebra::{Vector2, Vector3};

use super::renewal::{key, lasting_uniform, mix, uniform};
use super::table::{ErrorModel, FalseBoxRate, FalseBoxes, LaneShares, VehicleErrors};

/// A vehicle, and how much of it is in line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenVehicle {
    /// The vehicle.
    pub id: VehicleId,
    /// Its true box in the LIDAR frame; the score is 1.
    pub truth: Detection3d,
    /// The lane that its centre is in.
    pub lane: Option<LaneIndex>,
    /// Share of the body in line of sight of the LIDAR, in [0, 1]; at 0 it is never found.
    pub visibility: f64,
}

/// Who looks, when and from where.
#[derive(Debug, Clone, Copy)]
pub struct Observer<'a> {
    /// Seed of all draws.
    pub seed: u64,
    /// The vehicle that carries the sensors.
    pub ego: VehicleId,
    /// Time in seconds.
    pub time_s: f64,
    /// The LIDAR in the world.
    pub lidar: Se2Pose,
    /// The road that false boxes may stand on, where it is known.
    pub road: Option<&'a Road>,
}

/// A box as the networks might have found it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnBox {
    /// The vehicle that it shows; `None` for a false box.
    pub of: Option<VehicleId>,
    /// The box in the LIDAR frame.
    pub detection: Detection3d,
    /// The lane that fusion gives it.
    pub lane: Option<LaneIndex>,
}

/// What is drawn; each has random numbers of its own.
#[derive(Clone, Copy)]
enum Draw {
    Found,
    Along,
    Across,
    Up,
    Length,
    Width,
    Height,
    Yaw,
    Flipped,
    OtherClass,
    LaneTogether,
    Lane,
    LaneSide,
}

/// Side of the squares of ground each of which may hold one false box.
const CELL_M: f64 = 5.0;
/// No false box stands nearer than this to the middle of a vehicle, the own one included.
const APART_M: f64 = 3.5;
/// No box is smaller.
const LEAST_SIZE_M: f64 = 0.3;

impl ErrorModel {
    /// What the networks would find of `seen`, the surest first: each vehicle found or missed, its
    /// box and lane with errors, and false boxes.
    ///
    /// A draw depends on the seed, the time and the two vehicles alone, or for a false box on its
    /// place in the world: neither on what else is seen nor on any order.
    pub fn draw(&self, seen: &[SeenVehicle], from: &Observer) -> Vec<DrawnBox> {
        let found = seen
            .iter()
            .filter_map(|vehicle| self.vehicle(vehicle, from));
        let is_apart = |drawn: &DrawnBox| {
            let place = drawn.detection.center_m.xy();
            let mut taken = seen.iter().map(|vehicle| vehicle.truth.center_m.xy());
            place.norm() > APART_M && taken.all(|taken| (taken - place).norm() > APART_M)
        };
        let mut drawn: Vec<DrawnBox> = found
            .chain(self.false_boxes(from).filter(is_apart))
            .collect();
        drawn.sort_by(|a, b| b.detection.score.total_cmp(&a.detection.score));
        drawn
    }

    fn vehicle(&self, seen: &SeenVehicle, from: &Observer) -> Option<DrawnBox> {
        let truth = &seen.truth;
        let row = self.row(seen)?;
        let lasting = &self.lasting;
        let draw = |what: Draw, lasting_s: f64| {
            let pair = (u64::from(from.ego.0) << 32) | u64::from(seen.id.0);
            let key = key(&[from.seed, pair, what as u64]);
            lasting_uniform(key, from.time_s, lasting_s)
        };
        // A vehicle that is only just found has the least score.
        let chance = draw(Draw::Found, lasting.found_s) / row.recall;
        if seen.visibility <= 0.0 || chance.is_nan() || chance >= 1.0 {
            return None;
        }
        let error = |what| draw(what, lasting.box_s);
        let (sin, cos) = truth.yaw_rad.sin_cos();
        let away = |axis: Vector3<f64>| axis * axis.dot(&truth.center_m).signum();
        let center_m = truth.center_m
            + away(Vector3::new(cos, sin, 0.0)) * row.along_m.at(error(Draw::Along))
            + away(Vector3::new(-sin, cos, 0.0)) * row.across_m.at(error(Draw::Across))
            + Vector3::z() * row.up_m.at(error(Draw::Up));
        let size_error = Vector3::new(
            row.length_m.at(error(Draw::Length)),
            row.width_m.at(error(Draw::Width)),
            row.height_m.at(error(Draw::Height)),
        );
        let is_flipped = draw(Draw::Flipped, lasting.flip_s) < row.flipped;
        let is_other = draw(Draw::OtherClass, lasting.flip_s) < row.other_class;
        let yaw_error = row.yaw_rad.at(error(Draw::Yaw)) + if is_flipped { PI } else { 0.0 };
        let together = draw(Draw::LaneTogether, lasting.lane_s) < self.lanes.shared.sqrt();
        let lane_draw = if together {
            let key = key(&[from.seed, u64::from(from.ego.0), Draw::Lane as u64]);
            lasting_uniform(key, from.time_s, lasting.lane_s)
        } else {
            draw(Draw::Lane, lasting.lane_s)
        };
        let side = draw(Draw::LaneSide, lasting.lane_s);
        Some(DrawnBox {
            of: Some(seen.id),
            detection: Detection3d {
                center_m,
                size_m: (truth.size_m + size_error).sup(&Vector3::repeat(LEAST_SIZE_M)),
                yaw_rad: wrap_angle(truth.yaw_rad + yaw_error),
                class: if is_other {
                    other(truth.class)
                } else {
                    truth.class
                },
                score: row.score.at(1.0 - chance),
            },
            lane: self.lane(seen.lane, &truth.center_m, [lane_draw, side]),
        })
    }

    /// The row for a vehicle: the one that holds it, else the nearest.
    fn row(&self, seen: &SeenVehicle) -> Option<&VehicleErrors> {
        let distance_m = seen.truth.center_m.xy().norm();
        let beyond = |row: &&VehicleErrors| {
            // A tenth of visibility weighs as much as ten metres.
            100.0 * outside(row.visibility, seen.visibility) + outside(row.distance_m, distance_m)
        };
        let of_class = self
            .vehicles
            .iter()
            .filter(|row| row.class == seen.truth.class);
        of_class.min_by(|a, b| beyond(a).total_cmp(&beyond(b)))
    }

    /// The lane given to a box at a place of the LIDAR frame that truly is in `lane`.
    fn lane(
        &self,
        lane: Option<LaneIndex>,
        center_m: &Vector3<f64>,
        [draw, side]: [f64; 2],
    ) -> Option<LaneIndex> {
        let Some(lane) = lane else {
            let nearest = if center_m.y > 0.0 {
                LaneIndex::LEFTMOST
            } else {
                LaneIndex::RIGHTMOST
            };
            return (draw >= self.lanes.beside_none).then_some(nearest);
        };
        let beyond = |row: &&LaneShares| outside(row.ahead_m, center_m.x);
        let rows = self.lanes.ahead.iter();
        let row = rows.min_by(|a, b| beyond(a).total_cmp(&beyond(b)))?;
        if draw < row.right {
            Some(lane)
        } else if draw < row.right + row.none {
            None
        } else if side < 0.5 {
            lane.left().or(lane.right())
        } else {
            lane.right().or(lane.left())
        }
    }

    /// False boxes: each square of the ground holds one place, where one appears for a while, seen
    /// by this vehicle, as often as there are false boxes in that part of its range.
    fn false_boxes<'a>(&'a self, from: &'a Observer) -> impl Iterator<Item = DrawnBox> + 'a {
        let [least_x, least_y, most_x, most_y] = self.range_m;
        let corners = [
            Vector2::new(least_x, least_y),
            Vector2::new(least_x, most_y),
            Vector2::new(most_x, least_y),
            Vector2::new(most_x, most_y),
        ];
        let cells = corners.map(|corner| from.lidar.transform(corner) / CELL_M);
        let span = |axis: usize| {
            let ends = cells.iter().map(|cell| cell[axis]);
            let least = ends.clone().fold(f64::INFINITY, f64::min).floor();
            let most = ends.fold(f64::NEG_INFINITY, f64::max).ceil();
            least as i64..most as i64
        };
        let columns = span(0);
        let rows = span(1);
        columns
            .flat_map(move |column| rows.clone().map(move |row| [column, row]))
            .filter_map(move |cell| self.false_box(cell, from))
    }

    fn false_box(&self, [column, row]: [i64; 2], from: &Observer) -> Option<DrawnBox> {
        let place = key(&[from.seed, column as u64, row as u64]);
        let number = |index: u64| uniform(mix(place.wrapping_add(index)));
        let world = CELL_M * Vector2::new(column as f64 + number(1), row as f64 + number(2));
        let center_m = from.lidar.inverse_transform(world);
        let FalseBoxRate {
            area_m2, per_frame, ..
        } = self.rate_at(center_m)?;
        let seldom = lasting_uniform(
            key(&[place, u64::from(from.ego.0)]),
            from.time_s,
            self.lasting.false_box_s,
        );
        if seldom >= per_frame / area_m2 * CELL_M * CELL_M {
            return None;
        }
        let FalseBoxes {
            trucks,
            length_m,
            width_m,
            height_m,
            center_z_m,
            yaw_rad,
            score,
            ..
        } = &self.false_boxes;
        let lane = from
            .road
            .and_then(|road| road.lane_at(road.to_frenet(world).d_m));
        let center_m = center_m.push(center_z_m.at(number(3)));
        Some(DrawnBox {
            of: None,
            detection: Detection3d {
                center_m,
                size_m: Vector3::new(
                    length_m.at(number(4)),
                    width_m.at(number(5)),
                    height_m.at(number(6)),
                ),
                yaw_rad: yaw_rad.at(number(7)),
                class: if number(8) < *trucks {
                    ObjectClass::Truck
                } else {
                    ObjectClass::Car
                },
                score: score.at(number(9)),
            },
            lane: self.lane(lane, &center_m, [number(10), number(11)]),
        })
    }

    /// How many false boxes there are about a place of the LIDAR frame.
    fn rate_at(&self, place_m: Vector2<f64>) -> Option<&FalseBoxRate> {
        let [least_x, least_y, most_x, most_y] = self.range_m;
        let is_in_range =
            (least_x..most_x).contains(&place_m.x) && (least_y..most_y).contains(&place_m.y);
        let holds = |[low, high]: [f64; 2], value: f64| (low..high).contains(&value);
        let mut places = self.false_boxes.places.iter();
        places.find(|row| {
            is_in_range
                && holds(row.distance_m, place_m.norm())
                && holds(row.beside_m, place_m.y.abs())
        })
    }
}

/// By how much a value lies outside of an interval.
fn outside([low, high]: [f64; 2], value: f64) -> f64 {
    (low - value).max(value - high).max(0.0)
}

fn other(class: ObjectClass) -> ObjectClass {
    match class {
        ObjectClass::Car => ObjectClass::Truck,
        ObjectClass::Truck => ObjectClass::Car,
    }
}

#[cfg(test)]
mod tests;
