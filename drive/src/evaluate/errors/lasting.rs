//! How long errors last, from frames that follow each other.

use std::collections::BTreeMap;

use covista_sensors::Lasting;
use covista_traffic::VehicleId;

use super::fit::{box_errors, is_flipped};
use super::{ErrorFrame, ErrorFrames, FoundBox, Sample};

/// Frames farther apart do not follow each other.
const NEXT_S: f64 = 0.65;
/// A false box stands where the frame before had one, if it is nearer than this.
const SAME_PLACE_M: f64 = 1.5;
/// Errors that last longer than the tracks of a scenario can't be told from constant ones.
const LONGEST_S: f64 = 20.0;
/// Below this a correlation is none.
const LEAST_CORRELATION: f64 = 0.02;

/// A value of one vehicle, seen by one ego at one time.
struct Value {
    ego: VehicleId,
    vehicle: VehicleId,
    time_s: f64,
    group: [u8; 2],
    value: f64,
}

/// Mean lasting times, from the correlation of frames that follow each other in `closed_loop`:
/// of what visibility and distance do not explain.
pub(super) fn lasting(closed_loop: &ErrorFrames) -> Lasting {
    let (samples, false_boxes) = closed_loop.sorted();
    let time_s = |of: &dyn Fn(&Sample) -> Option<f64>| {
        let values = samples.iter().filter_map(|sample| value_of(sample, of));
        lasting_s(&centred(values.collect(), |_, value, mean| value - mean))
    };
    let of_box = |of: &dyn Fn(&Sample) -> Option<f64>| {
        let values = samples.iter().filter_map(|sample| value_of(sample, of));
        lasting_s(&centred(values.collect(), |below, _, _| below - 0.5))
    };
    let errors = |sample: &Sample| Some(box_errors(&sample.truth.truth, &sample.found?.detection));
    // The height above the ground and the body's height say little of a box seen from above.
    let box_s = [0, 1, 3, 4, 6].map(|of: usize| of_box(&|sample| Some(errors(sample)?[of])));
    Lasting {
        found_s: time_s(&|sample| Some(f64::from(sample.found.is_some()))),
        box_s: box_s.iter().sum::<f64>() / box_s.len() as f64,
        flip_s: time_s(&|sample| {
            let found = &sample.found?.detection;
            Some(f64::from(is_flipped(&sample.truth.truth, found)))
        }),
        lane_s: time_s(&|sample| {
            let lane = sample.truth.lane?;
            Some(f64::from(sample.found?.lane == Some(lane)))
        }),
        false_box_s: false_box_s(&closed_loop.frames, &false_boxes),
    }
}

/// Pearson's correlation of pairs with mean zero; 0 where nothing varies.
pub(super) fn residual_correlation(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let [mut product, mut first, mut second] = [0.0; 3];
    for (a, b) in pairs {
        product += a * b;
        first += a * a;
        second += b * b;
    }
    if first > 0.0 && second > 0.0 {
        product / (first * second).sqrt()
    } else {
        0.0
    }
}

fn value_of(sample: &Sample<'_>, of: &dyn Fn(&Sample<'_>) -> Option<f64>) -> Option<Value> {
    let visibility = sample.truth.visibility;
    let distance_m = sample.truth.truth.center_m.xy().norm();
    let level =
        |value: f64, limits: [f64; 2]| limits.iter().filter(|&&limit| value > limit).count();
    Some(Value {
        ego: sample.frame.ego,
        vehicle: sample.truth.id,
        time_s: sample.frame.time_s,
        group: [
            level(visibility, [0.35, 0.7]) as u8,
            level(distance_m, [20.0, 40.0]) as u8,
        ],
        value: of(sample)?,
    })
}

/// The values less what their group explains: `residual` is given the share of the group that lies
/// below, the value and the group's mean.
fn centred(mut values: Vec<Value>, residual: impl Fn(f64, f64, f64) -> f64) -> Vec<Value> {
    values.sort_by(|a, b| a.group.cmp(&b.group).then(a.value.total_cmp(&b.value)));
    for group in values.chunk_by_mut(|a, b| a.group == b.group) {
        let count = group.len() as f64;
        let mean = group.iter().map(|value| value.value).sum::<f64>() / count;
        for (index, value) in group.iter_mut().enumerate() {
            value.value = residual((index as f64 + 0.5) / count, value.value, mean);
        }
    }
    values
}

/// The time after which the autocorrelation of a process of first order has fallen to 1/e.
fn lasting_s(values: &[Value]) -> f64 {
    let mut tracks: BTreeMap<(VehicleId, VehicleId), Vec<&Value>> = BTreeMap::new();
    for value in values {
        tracks
            .entry((value.ego, value.vehicle))
            .or_default()
            .push(value);
    }
    let (mut pairs, mut gaps_s) = (Vec::new(), 0.0);
    for track in tracks.values_mut() {
        track.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        for next in track.windows(2) {
            let gap_s = next[1].time_s - next[0].time_s;
            if gap_s < NEXT_S {
                pairs.push((next[0].value, next[1].value));
                gaps_s += gap_s;
            }
        }
    }
    let gap_s = gaps_s / pairs.len().max(1) as f64;
    decay_s(gap_s, residual_correlation(pairs.into_iter()))
}

fn decay_s(gap_s: f64, correlation: f64) -> f64 {
    if correlation < LEAST_CORRELATION {
        return 0.0;
    }
    (gap_s / correlation.min(1.0).ln().abs()).min(LONGEST_S)
}

/// From the share of false boxes that stand where the same ego's frame before had one.
fn false_box_s(frames: &[ErrorFrame], false_boxes: &[(&ErrorFrame, &FoundBox)]) -> f64 {
    let (mut again, mut all, mut gaps_s) = (0, 0, 0.0);
    let places = |frame: &ErrorFrame| {
        let of_frame = false_boxes
            .iter()
            .filter(|(of, _)| std::ptr::eq(*of, frame));
        let places =
            of_frame.map(|(_, found)| frame.lidar.transform(found.detection.center_m.xy()));
        places.collect::<Vec<_>>()
    };
    for next in frames.windows(2) {
        let [before, after] = [&next[0], &next[1]];
        let gap_s = after.time_s - before.time_s;
        if before.ego != after.ego || !(0.0..NEXT_S).contains(&gap_s) {
            continue;
        }
        let later = places(after);
        for place in places(before) {
            all += 1;
            gaps_s += gap_s;
            let is_near = |other: &nalgebra::Vector2<f64>| (other - place).norm() < SAME_PLACE_M;
            again += usize::from(later.iter().any(is_near));
        }
    }
    let count = f64::from(all.max(1));
    decay_s(gaps_s / count, again as f64 / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_a_process_of_first_order_is_found() {
        // A value that is drawn anew with probability 1/2 at each step of 0.4 s.
        let mut state = 1_u64;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let mut values = Vec::new();
        for vehicle in 0..400 {
            let mut value = draw();
            for step in 0..40 {
                if draw() < 0.5 {
                    value = draw();
                }
                values.push(Value {
                    ego: VehicleId(0),
                    vehicle: VehicleId(vehicle),
                    time_s: 0.4 * f64::from(step),
                    group: [0, (vehicle % 3) as u8],
                    value: value + f64::from(vehicle % 3),
                });
            }
        }
        let expected = 0.4 / 2.0_f64.ln();
        let ranks = centred(values, |below, _, _| below - 0.5);
        assert!((lasting_s(&ranks) - expected).abs() < 0.05);
    }

    #[test]
    fn what_never_changes_lasts_longest_and_noise_does_not_last() {
        assert!((decay_s(0.4, 1.0) - LONGEST_S).abs() < 1e-9);
        assert!(decay_s(0.4, -0.3).abs() < 1e-9);
        assert!((residual_correlation([(1.0, 2.0), (-1.0, -2.0)].into_iter()) - 1.0).abs() < 1e-12);
        assert!(residual_correlation(std::iter::empty()).abs() < 1e-12);
    }
}
