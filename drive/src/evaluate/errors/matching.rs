use covista_sensors::SeenVehicle;

use super::FoundBox;

/// How far beyond the true footprint the centre of a box may lie that shows the vehicle.
const BEYOND_M: f64 = 1.0;

/// For each vehicle the box that shows it, and the boxes that show none: of the pairs in which the
/// centre found lies in the true footprint or a little beyond, nearest first, each once.
pub(super) fn matched<'a>(
    truth: &[SeenVehicle],
    found: &'a [FoundBox],
) -> (Vec<Option<&'a FoundBox>>, Vec<&'a FoundBox>) {
    let mut pairs = Vec::new();
    for (vehicle, seen) in truth.iter().enumerate() {
        for (index, found) in found.iter().enumerate() {
            let gap = found.detection.center_m - seen.truth.center_m;
            let (sin, cos) = seen.truth.yaw_rad.sin_cos();
            let along = cos * gap.x + sin * gap.y;
            let across = cos * gap.y - sin * gap.x;
            if along.abs() <= seen.truth.size_m.x / 2.0 + BEYOND_M
                && across.abs() <= seen.truth.size_m.y / 2.0 + BEYOND_M
            {
                pairs.push((gap.xy().norm(), vehicle, index));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut of_vehicle = vec![None; truth.len()];
    let mut is_taken = vec![false; found.len()];
    for (_, vehicle, index) in pairs {
        if of_vehicle[vehicle].is_none() && !is_taken[index] {
            of_vehicle[vehicle] = Some(&found[index]);
            is_taken[index] = true;
        }
    }
    let unmatched = found
        .iter()
        .zip(is_taken)
        .filter(|(_, is_taken)| !is_taken)
        .map(|(found, _)| found);
    (of_vehicle, unmatched.collect())
}

#[cfg(test)]
mod tests {
    use covista_traffic::VehicleId;
    use covista_world::{Detection3d, ObjectClass};
    use nalgebra::Vector3;

    use super::*;

    fn at(x_m: f64, y_m: f64, yaw_rad: f64) -> Detection3d {
        Detection3d {
            center_m: Vector3::new(x_m, y_m, -0.9),
            size_m: Vector3::new(4.0, 2.0, 1.5),
            yaw_rad,
            class: ObjectClass::Car,
            score: 0.5,
        }
    }

    #[test]
    fn the_nearest_pairs_are_taken_first_and_each_box_once() {
        let truth = [(10.0, 0.0), (10.0, 2.8), (40.0, 0.0)].map(|(x, y)| SeenVehicle {
            id: VehicleId(1),
            truth: at(x, y, 0.0),
            lane: None,
            visibility: 1.0,
        });
        let found = [(10.0, 1.7), (10.2, 0.1), (43.1, 0.0)].map(|(x, y)| FoundBox {
            detection: at(x, y, 0.0),
            lane: None,
        });
        let (of_vehicle, unmatched) = matched(&truth, &found);
        assert_eq!(of_vehicle, [Some(&found[1]), Some(&found[0]), None]);
        assert_eq!(unmatched, [&found[2]]);
        // The footprint turns with the vehicle.
        let turned = [SeenVehicle {
            truth: at(40.0, 0.0, 0.1),
            ..truth[0]
        }];
        let ahead = |x: f64, y: f64| {
            let found = [FoundBox {
                detection: at(x, y, 0.0),
                lane: None,
            }];
            matched(&turned, &found).0[0].is_some()
        };
        assert!(ahead(42.9, 0.3) && !ahead(40.2, 2.2) && !ahead(43.2, 0.3));
    }
}
