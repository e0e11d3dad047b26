use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use covista_world::ObjectClass;
use nalgebra::Vector3;

use super::*;

fn at(x_m: f64, score: f64) -> Detection3d {
    Detection3d {
        center_m: Vector3::new(x_m, 0.0, 0.0),
        size_m: Vector3::new(4.0, 2.0, 1.5),
        yaw_rad: 0.0,
        class: ObjectClass::Car,
        score,
    }
}

fn label(x_m: f64) -> LabelledBox {
    LabelledBox {
        shape: at(x_m, 1.0),
        is_neighbour: false,
        height_px: 50.0,
        occluded: 0,
        truncated: 0.0,
    }
}

fn found(x_m: f64, score: f64) -> FoundBox {
    FoundBox {
        shape: at(x_m, score),
        is_of_class: true,
        height_px: 50.0,
    }
}

fn precision(frames: &[BenchmarkFrame], difficulty: Difficulty) -> Option<KittiPrecision> {
    KittiPrecision::over(frames, difficulty, Overlap::Volume, 0.7)
}

/// 80 frames of one label, the first `hits` of which are found, with `wrong` boxes in the last one
/// of the score `wrong_score`.
fn frames(hits: usize, wrong: usize, wrong_score: f64) -> Vec<BenchmarkFrame> {
    let frame = |index: usize| {
        let hit = (index < hits).then(|| found(0.1, 0.9 - 0.01 * index as f64));
        let apart = |i: usize| found(50.0 + 10.0 * i as f64, wrong_score);
        let beside = (0..wrong).filter(|_| index == 79).map(apart);
        BenchmarkFrame::new(vec![label(0.0)], hit.into_iter().chain(beside).collect())
    };
    (0..80).map(frame).collect()
}

#[test]
fn closed_forms() {
    let near = |frames: &[BenchmarkFrame], r11: f64, r40: f64| {
        let of = precision(frames, Difficulty::Easy).expect("labels");
        assert_eq!(of.boxes, 80);
        assert!(
            (of.r11 - r11).abs() < 1e-12 && (of.r40 - r40).abs() < 1e-12,
            "{of:?}"
        );
    };
    near(&frames(80, 0, 0.5), 1.0, 1.0);
    near(&frames(0, 5, 0.5), 0.0, 0.0);
    // Half of them: precise up to sample 20 of 0 .. 40.
    near(&frames(40, 0, 0.5), 6.0 / 11.0, 20.0 / 40.0);
    // Ten surer ones that are wrong: 80 of 90 in the end, which is the best there is.
    near(&frames(80, 10, 0.99), 8.0 / 9.0, 8.0 / 9.0);
    // Less sure than any that is right: they are never looked at.
    near(&frames(80, 10, 0.01), 1.0, 1.0);
    assert_eq!(precision(&[], Difficulty::Easy), None);
}

#[test]
fn labels_count_by_height_occlusion_and_truncation() {
    let counted = |change: &dyn Fn(&mut LabelledBox)| {
        let mut changed = label(0.0);
        change(&mut changed);
        let frames = [BenchmarkFrame::new(vec![changed], vec![found(0.0, 0.9)])];
        Difficulty::ALL.map(|difficulty| precision(&frames, difficulty).is_some())
    };
    assert_eq!(counted(&|_| ()), [true, true, true]);
    assert_eq!(
        counted(&|label| label.height_px = 40.0),
        [false, true, true]
    );
    assert_eq!(counted(&|label| label.height_px = 25.0), [false; 3]);
    assert_eq!(counted(&|label| label.occluded = 1), [false, true, true]);
    assert_eq!(counted(&|label| label.occluded = 2), [false, false, true]);
    assert_eq!(counted(&|label| label.occluded = 3), [false; 3]);
    assert_eq!(counted(&|label| label.truncated = 0.3), [false, true, true]);
    assert_eq!(
        counted(&|label| label.truncated = 0.4),
        [false, false, true]
    );
    assert_eq!(counted(&|label| label.is_neighbour = true), [false; 3]);
}

#[test]
fn boxes_on_ignored_labels_low_ones_and_those_of_other_classes_are_not_wrong() {
    let van = LabelledBox {
        is_neighbour: true,
        ..label(20.0)
    };
    let with = |extra: FoundBox| {
        let mut all = frames(80, 0, 0.5);
        all[79] = BenchmarkFrame::new(vec![van, label(0.0)], vec![extra, found(0.1, 0.05)]);
        precision(&all, Difficulty::Easy).expect("labels").r40
    };
    assert!((with(found(20.0, 0.99)) - 1.0).abs() < 1e-12);
    let low = FoundBox {
        height_px: 39.0,
        ..found(60.0, 0.99)
    };
    assert!((with(low) - 1.0).abs() < 1e-12);
    let truck = FoundBox {
        is_of_class: false,
        ..found(60.0, 0.99)
    };
    assert!((with(truck) - 1.0).abs() < 1e-12);
    assert!((with(found(60.0, 0.99)) - 80.0 / 81.0).abs() < 1e-12);
}

#[test]
fn the_footprint_may_fit_where_the_volume_does_not() {
    let mut all = frames(80, 0, 0.5);
    for frame in &mut all {
        let mut lifted = frame.found.clone();
        lifted[0].shape.center_m.z = 0.5;
        *frame = BenchmarkFrame::new(frame.labelled.clone(), lifted);
    }
    let by = |overlap, min_iou| {
        let of = KittiPrecision::over(&all, Difficulty::Hard, overlap, min_iou);
        of.expect("labels").r40
    };
    assert!((by(Overlap::Ground, 0.7) - 1.0).abs() < 1e-12);
    assert!(by(Overlap::Volume, 0.7).abs() < 1e-12);
    // A third of the height off: (3.9 * 2 * 1) / (24 - 7.8) = 0.48.
    assert!(by(Overlap::Volume, 0.5).abs() < 1e-12);
    assert!((by(Overlap::Volume, 0.48) - 1.0).abs() < 1e-12);
}

/// The box of KITTI's columns from the height on, turned from the camera's axes (x right, y down,
/// z forward) to x forward, y left, z up.
fn upright(columns: &[f64], class: ObjectClass, score: f64) -> Detection3d {
    let [height, width, length, x, y, z, rotation_y] = columns[..7] else {
        panic!("{columns:?}");
    };
    Detection3d {
        center_m: Vector3::new(z, -x, height / 2.0 - y),
        size_m: Vector3::new(length, width, height),
        yaw_rad: -rotation_y - FRAC_PI_2,
        class,
        score,
    }
}

#[test]
fn figures_are_those_of_an_independent_evaluation() {
    let fixture = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases");
        std::fs::read_to_string(path.join(name)).expect("a fixture")
    };
    let mut frames: Vec<(Vec<LabelledBox>, Vec<FoundBox>)> = Vec::new();
    for line in fixture("kitti_case.txt").lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let index: usize = words[0].parse().expect("a frame");
        frames.resize_with(frames.len().max(index + 1), Default::default);
        let columns: Vec<f64> = words[2..]
            .iter()
            .map(|word| word.parse().expect("a number"))
            .collect();
        let (is_car, height_px) = (words[1] == "Car", columns[6] - columns[4]);
        match columns.get(14) {
            Some(score) => frames[index].1.push(FoundBox {
                shape: upright(&columns[7..], ObjectClass::Car, *score),
                is_of_class: is_car,
                height_px,
            }),
            None if is_car || words[1] == "Van" => frames[index].0.push(LabelledBox {
                shape: upright(&columns[7..], ObjectClass::Car, 1.0),
                is_neighbour: !is_car,
                height_px,
                occluded: columns[1] as u8,
                truncated: columns[0],
            }),
            None => (),
        }
    }
    let frames: Vec<BenchmarkFrame> = frames
        .into_iter()
        .map(|(labelled, found)| BenchmarkFrame::new(labelled, found))
        .collect();
    let expected: toml::Table = fixture("kitti_case.toml").parse().expect("figures");
    let mut compared = 0;
    for (view, overlap) in [("bev", Overlap::Ground), ("3d", Overlap::Volume)] {
        for (suffix, min_iou) in [("", 0.7), ("_iou50", 0.5)] {
            for (name, difficulty) in ["easy", "moderate", "hard"].iter().zip(Difficulty::ALL) {
                let of = KittiPrecision::over(&frames, difficulty, overlap, min_iou);
                let of = of.expect("labels");
                for (samples, value) in [(11, of.r11), (40, of.r40)] {
                    let key = format!("ap_{view}_car_{name}_r{samples}{suffix}");
                    let expected = expected[&key].as_float().expect("a number");
                    assert!((100.0 * value - expected).abs() < 1e-6, "{key}: {value}");
                    compared += 1;
                }
            }
        }
    }
    assert_eq!(compared, expected.len());
}
