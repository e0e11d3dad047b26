//! From measured errors to the parameters of the model.

use covista_sensors::{
    ErrorModel, ErrorSource, FalseBoxRate, FalseBoxes, LaneErrors, LaneShares, Lasting, Quantiles,
    VehicleErrors,
};
use covista_world::{Detection3d, ObjectClass, wrap_angle};
use std::f64::consts::FRAC_PI_2;

use super::lasting::{lasting, residual_correlation};
use super::{ErrorFrame, ErrorFrames, FoundBox, Sample};

/// Limits between rows; neighbours are put together until each has [`LEAST_FOUND`].
const VISIBILITY: [f64; 4] = [0.0, 0.35, 0.7, 1.0];
const DISTANCE_M: [f64; 4] = [0.0, 20.0, 40.0, 75.0];
const AHEAD_M: [f64; 8] = [-75.0, -30.0, -10.0, 0.0, 10.0, 25.0, 40.0, 75.0];
/// A row is fitted to at least this many vehicles found.
const LEAST_FOUND: usize = 25;
/// Parts of the range that have a rate of false boxes of their own.
const FALSE_DISTANCE_M: [f64; 4] = [0.0, 25.0, 45.0, 85.0];
const FALSE_BESIDE_M: [f64; 3] = [0.0, 6.0, 45.0];
/// Grid on which the parts' areas are counted.
const AREA_STEP_M: f64 = 0.2;

/// Why errors can't be fitted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the networks found only {found} {what} in these frames and the fit needs {needed}: give it more frames"
)]
pub struct FitError {
    what: &'static str,
    found: usize,
    needed: usize,
}

/// Fits the error model to what the networks found in `data`, and how long errors last to what
/// they found in `closed_loop`, frame after frame.
///
/// # Errors
/// When there are too few vehicles of a class, or no false box.
pub fn fit_errors(
    data: &ErrorFrames,
    closed_loop: &ErrorFrames,
    source: ErrorSource,
) -> Result<ErrorModel, FitError> {
    let (samples, false_boxes) = data.sorted();
    let mut vehicles = Vec::new();
    for class in [ObjectClass::Car, ObjectClass::Truck] {
        vehicles.extend(vehicle_rows(class, &samples)?);
    }
    let Lasting {
        found_s,
        box_s,
        flip_s,
        lane_s,
        false_box_s,
    } = lasting(closed_loop);
    Ok(ErrorModel {
        range_m: data.range_m.map(rounded),
        source,
        lasting: Lasting {
            found_s: rounded(found_s),
            box_s: rounded(box_s),
            flip_s: rounded(flip_s),
            lane_s: rounded(lane_s),
            false_box_s: rounded(false_box_s),
        },
        vehicles,
        lanes: lane_errors(&samples),
        false_boxes: false_box_rates(data, &false_boxes)?,
    })
}

/// The errors of a box: along and across the vehicle away from the LIDAR, up, length, width,
/// height, heading without regard to front and rear.
pub(super) fn box_errors(truth: &Detection3d, found: &Detection3d) -> [f64; 7] {
    let gap = found.center_m - truth.center_m;
    let (sin, cos) = truth.yaw_rad.sin_cos();
    let away = |x: f64, y: f64| {
        let sign = (x * truth.center_m.x + y * truth.center_m.y).signum();
        sign * (x * gap.x + y * gap.y)
    };
    let size = found.size_m - truth.size_m;
    let turned = wrap_angle(found.yaw_rad - truth.yaw_rad);
    let yaw = if is_flipped(truth, found) {
        wrap_angle(turned + std::f64::consts::PI)
    } else {
        turned
    };
    [
        away(cos, sin),
        away(-sin, cos),
        gap.z,
        size.x,
        size.y,
        size.z,
        yaw,
    ]
}

/// Whether a box points backwards.
pub(super) fn is_flipped(truth: &Detection3d, found: &Detection3d) -> bool {
    wrap_angle(found.yaw_rad - truth.yaw_rad).abs() > FRAC_PI_2
}

pub(super) fn share(count: usize, of: usize) -> f64 {
    count as f64 / of.max(1) as f64
}

fn vehicle_rows(
    class: ObjectClass,
    samples: &[Sample<'_>],
) -> Result<Vec<VehicleErrors>, FitError> {
    let of_class = samples
        .iter()
        .filter(|sample| sample.truth.truth.class == class);
    let found = |samples: &[Sample]| samples.iter().filter(|s| s.found.is_some()).count();
    let levels = rows_of(&VISIBILITY, of_class.copied(), found, |sample| {
        sample.truth.visibility
    });
    let mut rows = Vec::new();
    for (visibility, level) in levels {
        let by_distance = rows_of(&DISTANCE_M, level.into_iter(), found, |sample| {
            sample.truth.truth.center_m.xy().norm()
        });
        for (distance_m, samples) in by_distance {
            rows.push(vehicle_row(class, visibility, distance_m, &samples)?);
        }
    }
    Ok(rows)
}

fn vehicle_row(
    class: ObjectClass,
    visibility: [f64; 2],
    distance_m: [f64; 2],
    samples: &[Sample<'_>],
) -> Result<VehicleErrors, FitError> {
    let pairs: Vec<(&Detection3d, &Detection3d)> = samples
        .iter()
        .filter_map(|sample| Some((&sample.truth.truth, &sample.found?.detection)))
        .collect();
    let too_few = FitError {
        what: match class {
            ObjectClass::Car => "cars",
            ObjectClass::Truck => "trucks, vans and buses",
        },
        found: pairs.len(),
        needed: LEAST_FOUND,
    };
    if pairs.len() < LEAST_FOUND {
        return Err(too_few);
    }
    let count = |of: &dyn Fn(&Detection3d, &Detection3d) -> bool| {
        let counted = pairs.iter().filter(|(truth, found)| of(truth, found));
        rounded(share(counted.count(), pairs.len()))
    };
    let errors = |of: usize| {
        let errors = pairs
            .iter()
            .map(|(truth, found)| box_errors(truth, found)[of]);
        quantiles(errors).ok_or_else(|| too_few.clone())
    };
    Ok(VehicleErrors {
        class,
        visibility,
        distance_m,
        vehicles: samples.len(),
        found: pairs.len(),
        recall: rounded(share(pairs.len(), samples.len())),
        flipped: count(&is_flipped),
        other_class: count(&|truth, found| truth.class != found.class),
        along_m: errors(0)?,
        across_m: errors(1)?,
        up_m: errors(2)?,
        length_m: errors(3)?,
        width_m: errors(4)?,
        height_m: errors(5)?,
        yaw_rad: errors(6)?,
        score: quantiles(pairs.iter().map(|(_, found)| found.score))
            .ok_or_else(|| too_few.clone())?,
    })
}

fn lane_errors(samples: &[Sample<'_>]) -> LaneErrors {
    let (in_lane, beside): (Vec<Sample>, Vec<Sample>) = samples
        .iter()
        .filter(|sample| sample.found.is_some())
        .partition(|sample| sample.truth.lane.is_some());
    let given = |sample: &Sample| sample.found.and_then(|found| found.lane);
    let unplaced = |samples: &[Sample]| samples.iter().filter(|s| given(s).is_none()).count();
    let is_right = |sample: &Sample| given(sample) == sample.truth.lane;
    let rows = rows_of(&AHEAD_M, in_lane.into_iter(), <[Sample]>::len, |sample| {
        sample.truth.truth.center_m.x
    });
    // Vehicles of one frame, less what their place ahead explains.
    let mut residuals: Vec<(*const ErrorFrame, f64)> = Vec::new();
    let ahead = rows.iter().map(|(ahead_m, samples)| {
        let right = share(
            samples.iter().filter(|s| is_right(s)).count(),
            samples.len(),
        );
        let residual = |s: &Sample| (std::ptr::from_ref(s.frame), f64::from(is_right(s)) - right);
        residuals.extend(samples.iter().map(residual));
        LaneShares {
            ahead_m: *ahead_m,
            vehicles: samples.len(),
            right: rounded(right),
            none: rounded(share(unplaced(samples), samples.len())),
        }
    });
    let ahead = ahead.collect();
    residuals.sort_by_key(|(frame, _)| *frame);
    let pairs = residuals.chunk_by(|a, b| a.0 == b.0).flat_map(|frame| {
        let others = move |i: usize| {
            frame[i + 1..]
                .iter()
                .map(move |other| (frame[i].1, other.1))
        };
        (0..frame.len()).flat_map(others)
    });
    LaneErrors {
        shared: rounded(residual_correlation(pairs).clamp(0.0, 1.0)),
        beside: beside.len(),
        beside_none: rounded(share(unplaced(&beside), beside.len())),
        ahead,
    }
}

fn false_box_rates(
    data: &ErrorFrames,
    found: &[(&ErrorFrame, &FoundBox)],
) -> Result<FalseBoxes, FitError> {
    let [least_x, least_y, most_x, most_y] = data.range_m;
    let steps = |least: f64, most: f64| ((most - least) / AREA_STEP_M).round() as usize;
    let grid: Vec<(f64, f64)> = (0..steps(least_x, most_x))
        .flat_map(|i| (0..steps(least_y, most_y)).map(move |j| (i, j)))
        .map(|(i, j)| {
            let at = |least: f64, step: usize| least + (step as f64 + 0.5) * AREA_STEP_M;
            (at(least_x, i), at(least_y, j))
        })
        .collect();
    let mut places = Vec::new();
    for distance_m in FALSE_DISTANCE_M.windows(2) {
        for beside_m in FALSE_BESIDE_M.windows(2) {
            let is_in = |x: f64, y: f64| {
                (distance_m[0]..distance_m[1]).contains(&x.hypot(y))
                    && (beside_m[0]..beside_m[1]).contains(&y.abs())
            };
            let cells = grid.iter().filter(|(x, y)| is_in(*x, *y)).count();
            let boxes = found
                .iter()
                .map(|(_, found)| found.detection.center_m)
                .filter(|center| is_in(center.x, center.y));
            if cells > 0 {
                places.push(FalseBoxRate {
                    distance_m: [distance_m[0], distance_m[1]],
                    beside_m: [beside_m[0], beside_m[1]],
                    area_m2: rounded(cells as f64 * AREA_STEP_M * AREA_STEP_M),
                    per_frame: rounded(share(boxes.count(), data.frames.len())),
                });
            }
        }
    }
    let trucks = found
        .iter()
        .filter(|(_, found)| found.detection.class == ObjectClass::Truck);
    let values = |of: &dyn Fn(&Detection3d) -> f64| {
        quantiles(found.iter().map(|(_, found)| of(&found.detection))).ok_or(FitError {
            what: "false boxes",
            found: 0,
            needed: 1,
        })
    };
    Ok(FalseBoxes {
        boxes: found.len(),
        trucks: rounded(share(trucks.count(), found.len())),
        length_m: values(&|found| found.size_m.x)?,
        width_m: values(&|found| found.size_m.y)?,
        height_m: values(&|found| found.size_m.z)?,
        center_z_m: values(&|found| found.center_m.z)?,
        yaw_rad: values(&|found| found.yaw_rad)?,
        score: values(&|found| found.score)?,
        places,
    })
}

/// Samples by the value of `of`, in intervals between `limits`, of which neighbours are put
/// together until `size` of each is at least [`LEAST_FOUND`].
pub(super) fn rows_of<'a>(
    limits: &[f64],
    samples: impl Iterator<Item = Sample<'a>>,
    size: impl Fn(&[Sample<'a>]) -> usize,
    of: impl Fn(&Sample<'a>) -> f64,
) -> Vec<([f64; 2], Vec<Sample<'a>>)> {
    let mut bins: Vec<([f64; 2], Vec<Sample>)> = limits
        .windows(2)
        .map(|limits| ([limits[0], limits[1]], Vec::new()))
        .collect();
    for sample in samples {
        let value = of(&sample);
        let last = bins.len() - 1;
        let index = bins.iter().position(|(limits, _)| value <= limits[1]);
        bins[index.unwrap_or(last)].1.push(sample);
    }
    let mut rows: Vec<([f64; 2], Vec<Sample>)> = Vec::new();
    for (limits, samples) in bins {
        match rows.last_mut() {
            Some((before, few)) if size(few) < LEAST_FOUND => {
                before[1] = limits[1];
                few.extend(samples);
            }
            _ => rows.push((limits, samples)),
        }
    }
    if let [.., (before, many), (limits, few)] = rows.as_mut_slice()
        && size(few) < LEAST_FOUND
    {
        before[1] = limits[1];
        many.append(few);
        rows.pop();
    }
    rows
}

fn quantiles(values: impl Iterator<Item = f64>) -> Option<Quantiles> {
    Quantiles::of(values.collect()).map(|Quantiles(values)| Quantiles(values.map(rounded)))
}

/// To a tenth of a thousandth, as it is written.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
