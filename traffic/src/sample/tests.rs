use std::collections::HashMap;

use covista_world::ObjectClass;
use nalgebra::{Point3, Vector2};

use super::*;
use crate::{ConvexPart, Footprint, MarkStyle};

fn scenes(seed: u64, count: u64) -> impl Iterator<Item = (u64, SampledScene)> {
    (0..count).map(move |index| (index, sample_scene(seed, index)))
}

fn ground_m(scene: &Scene, vertex: &Point3<f64>) -> f64 {
    scene.terrain.height_m(vertex.xy().coords)
}

/// Whether a part reaches into the space of vehicles above the ground: not a step, not overhead.
fn is_an_obstacle(scene: &Scene, part: &ConvexPart) -> bool {
    let above = |vertex| ground_m(scene, vertex);
    let heights = || part.vertices.iter().map(|v| v.z - above(v));
    heights().fold(f64::MAX, f64::min) < 2.3 && heights().fold(f64::MIN, f64::max) > 0.3
}

#[test]
fn the_same_index_gives_the_same_scene_and_another_another() {
    let text = |index| format!("{:?}", sample_scene(7, index));
    for index in 0..4 {
        assert_eq!(text(index), text(index));
        assert_ne!(text(index), text(index + 1));
    }
    assert_ne!(format!("{:?}", sample_scene(8, 3)), text(3));
}

#[test]
fn vehicles_never_overlap_and_the_ego_is_there() {
    for (index, SampledScene { scene, ego, kind }) in scenes(1, 150) {
        let prints: Vec<_> = scene
            .vehicles
            .iter()
            .map(|vehicle| Footprint::new(vehicle.state.pose, vehicle.dimensions(), 0.0))
            .collect();
        for (i, one) in prints.iter().enumerate() {
            let overlapped = prints[..i].iter().any(|other| one.overlaps(other));
            assert!(!overlapped, "{index}");
        }
        let bounds = match kind {
            SceneKind::Freeway => 4..=45,
            SceneKind::Street => 1..=60,
        };
        assert!(bounds.contains(&prints.len()), "{index}: {}", prints.len());
        assert_eq!(scene.vehicles.iter().filter(|v| v.id == ego).count(), 1);
    }
}

/// Whether a line parts a vehicle from a convex part, seen from above.
fn are_apart(vehicle: &SceneVehicle, part: &ConvexPart) -> bool {
    let (pose, size) = (vehicle.state.pose, vehicle.dimensions());
    let rear_m = -size.rear_overhang_m;
    let ends_m = [rear_m, rear_m + size.length_m];
    let corners = ends_m.map(|x| [-0.5, 0.5].map(|y| Vector2::new(x, y * size.width_m)));
    let corners = corners.as_flattened();
    let vertices = part.vertices.iter();
    let local: Vec<_> = vertices
        .map(|vertex| pose.inverse_transform(vertex.xy().coords))
        .collect();
    let parts = |axis: Vector2<f64>| {
        let range = |points: &[Vector2<f64>]| {
            let along = points.iter().map(|point| axis.dot(point));
            along.fold((f64::MAX, f64::MIN), |(low, high), x| {
                (low.min(x), high.max(x))
            })
        };
        let (own, other) = (range(corners), range(&local));
        own.1 < other.0 || other.1 < own.0
    };
    let edges = || local.iter().flat_map(|a| local.iter().map(move |b| b - a));
    parts(Vector2::x())
        || parts(Vector2::y())
        || edges().any(|edge| parts(Vector2::new(-edge.y, edge.x)))
}

#[test]
fn no_scenery_stands_on_driven_lanes_or_through_vehicles() {
    for (index, SampledScene { scene, kind, .. }) in scenes(2, 60) {
        let driven_m = match kind {
            SceneKind::Freeway => scene.road.mark_offset_m(0),
            SceneKind::Street => scene.road.mark_offset_m(1),
        };
        let parts = scene.scenery.iter().flat_map(|body| &body.parts);
        for part in parts.filter(|part| is_an_obstacle(&scene, part)) {
            for vertex in part
                .vertices
                .iter()
                .filter(|v| v.z - ground_m(&scene, v) < 2.3)
            {
                let d_m = scene.road.to_frenet(vertex.xy().coords).d_m;
                assert!(d_m.abs() > driven_m + 0.1, "scene {index}: d = {d_m}");
            }
            for vehicle in &scene.vehicles {
                let apart = are_apart(vehicle, part);
                assert!(apart, "scene {index}: through {:?}", vehicle.id);
            }
        }
    }
}

#[test]
fn every_body_touches_the_ground() {
    for (index, SampledScene { scene, .. }) in scenes(3, 60) {
        for body in scene.scenery.iter() {
            let lowest_m = body
                .parts
                .iter()
                .flat_map(|part| &part.vertices)
                .map(|vertex| vertex.z - ground_m(&scene, vertex))
                .fold(f64::MAX, f64::min);
            // Sidewalks are up to 0.15 m, rails hang on posts.
            assert!(lowest_m < 0.16, "scene {index}: {lowest_m}");
        }
    }
}

#[test]
fn parts_are_finite_solid_and_not_too_many() {
    let mut counts = Vec::new();
    for (index, SampledScene { scene, .. }) in scenes(4, 60) {
        let mut count = 0;
        for part in scene.scenery.iter().flat_map(|body| &body.parts) {
            count += 1;
            assert!(
                part.vertices.iter().all(|v| v.coords.amax() < 1e4),
                "{index}"
            );
            let first = part.vertices[0];
            let span = |axis: usize| {
                let of = |vertex: &Point3<f64>| (vertex - first)[axis].abs();
                part.vertices.iter().map(of).fold(0.0, f64::max)
            };
            assert!((0..3).all(|axis| span(axis) > 1e-3), "{index}");
        }
        counts.push(count);
    }
    let most = counts.iter().max().copied().unwrap_or_default();
    assert!(most < 3500, "{most} {counts:?}");
}

#[test]
fn the_mix_is_what_it_should_be() {
    let scenes: Vec<_> = scenes(3, 300).map(|(_, sample)| sample).collect();
    let share = |of: &dyn Fn(&SampledScene) -> bool| {
        scenes.iter().filter(|sample| of(sample)).count() as f64 / scenes.len() as f64
    };
    let within = |of: &dyn Fn(&SampledScene) -> bool, expected: f64, what: &str| {
        let found = share(of);
        assert!((found - expected).abs() < 0.1, "{what}: {found}");
    };
    within(&|s| s.kind == SceneKind::Freeway, 0.55, "freeways");
    within(&|s| s.scene.terrain.is_flat(), 1.0 / 3.0, "flat");
    within(&|s| s.scene.road.sharpest_per_m() > 1e-6, 0.5, "bends");
    within(&|s| s.scene.look.wetness > 0.0, 0.12, "wet");
    within(
        &|s| s.kind == SceneKind::Freeway && s.scene.markings.lanes_beyond != [0, 0],
        0.27,
        "wide carriageways",
    );
    within(
        &|s| s.scene.markings.styles == [MarkStyle::None; 4],
        0.25,
        "unmarked",
    );
    let mut models = HashMap::new();
    for vehicle in scenes.iter().flat_map(|sample| &sample.scene.vehicles) {
        *models.entry(vehicle.model).or_insert(0.0) += 1.0;
    }
    let all: f64 = models.values().sum();
    let large = models
        .iter()
        .filter(|(model, _)| model.class() == ObjectClass::Truck);
    let large = large.map(|(_, count)| count).sum::<f64>() / all;
    // 9 in a hundred of the European mix, 14 of the American.
    assert!((0.06..0.16).contains(&large), "{large}");
    let mean = all / scenes.len() as f64;
    assert!((15.0..45.0).contains(&mean), "{mean}");
}

#[test]
fn the_ego_is_in_the_middle_of_the_labelled_lanes_where_there_are_lanes_beyond() {
    for (index, SampledScene { scene, kind, .. }) in scenes(5, 150) {
        let d_m = scene
            .road
            .to_frenet(scene.vehicles[0].state.pose.position())
            .d_m;
        let lane = scene.road.lane_at(d_m).map(covista_world::LaneIndex::get);
        let fits = match (kind, scene.markings.lanes_beyond) {
            (SceneKind::Street, _) => matches!(lane, Some(1 | 2)),
            (_, [0, 0]) => lane.is_some(),
            (_, [0, _]) => matches!(lane, Some(0 | 1)),
            (_, [_, 0]) => matches!(lane, Some(1 | 2)),
            _ => lane == Some(1),
        };
        assert!(fits, "{index}: {lane:?} {:?}", scene.markings.lanes_beyond);
    }
}
