use covista_world::{FrenetPoint, Road, Se2Pose};
use nalgebra::Vector2;
use rand::Rng;

use crate::{
    Body,
    scenery::{Stretch, building, guard_rail, jersey_barrier, pole, tree, wall},
};

const AHEAD_M: f64 = 150.0;
const BEHIND_M: f64 = 90.0;
/// Nothing that is set down beside the road comes closer to its edge line than this.
const CLEARANCE_M: f64 = 1.0;

/// Walls, barriers, poles, buildings and trees on both sides of the road around `ego_s_m`.
pub(super) fn draw(rng: &mut impl Rng, road: &Road, ego_s_m: f64) -> Vec<Body> {
    let mut bodies = Vec::new();
    for side in [1.0, -1.0] {
        let mut free_from_m = road.mark_offset_m(0) + CLEARANCE_M;
        let pieces = if rng.random_bool(0.6) { 1 } else { 2 };
        let piece_m = (AHEAD_M + BEHIND_M) / f64::from(pieces);
        for piece in 0..pieces {
            let from_m = ego_s_m - BEHIND_M + piece_m * f64::from(piece);
            let outer_m = draw_edge(rng, road, side, [from_m, from_m + piece_m], &mut bodies);
            free_from_m = free_from_m.max(outer_m);
        }
        draw_poles(rng, road, side, ego_s_m, &mut bodies);
        draw_background(rng, road, side, ego_s_m, free_from_m + 1.0, &mut bodies);
    }
    bodies
}

/// What runs along the edge of the road; returns how far out it reaches.
fn draw_edge(
    rng: &mut impl Rng,
    road: &Road,
    side: f64,
    [from_m, to_m]: [f64; 2],
    bodies: &mut Vec<Body>,
) -> f64 {
    let edge_m = road.mark_offset_m(0);
    let margin_m = (to_m - from_m) * 0.3;
    let stretch = |setback_m: f64, from_m: f64, to_m: f64| Stretch {
        from_m,
        to_m,
        d_m: side * (edge_m + setback_m),
    };
    let from_m = from_m + rng.random_range(0.0..margin_m);
    let to_m = to_m - rng.random_range(0.0..margin_m);
    match rng.random_range(0..10) {
        0..5 => {
            // Close to the road more often than far from it.
            let setback_m = 0.8 + 7.0 * rng.random_range(0.0_f64..1.0).powi(2);
            let thickness_m = rng.random_range(0.2..0.6);
            let height_m = rng.random_range(1.2..5.0);
            let stretch = stretch(setback_m, from_m, to_m);
            bodies.push(wall(road, stretch, height_m, thickness_m));
            edge_m + setback_m + thickness_m
        }
        5..7 => {
            let setback_m = rng.random_range(0.5..3.0);
            bodies.push(jersey_barrier(road, stretch(setback_m, from_m, to_m)));
            edge_m + setback_m + 0.6
        }
        7..9 => {
            let setback_m = rng.random_range(0.6..3.0);
            bodies.push(guard_rail(road, stretch(setback_m, from_m, to_m)));
            edge_m + setback_m + 0.3
        }
        _ => edge_m,
    }
}

fn draw_poles(rng: &mut impl Rng, road: &Road, side: f64, ego_s_m: f64, bodies: &mut Vec<Body>) {
    if rng.random_bool(0.5) {
        return;
    }
    let spacing_m = rng.random_range(15.0..50.0);
    let d_m = side * (road.mark_offset_m(0) + rng.random_range(1.0..5.0));
    let (height_m, radius_m) = (rng.random_range(2.0..9.0), rng.random_range(0.05..0.18));
    let mut s_m = ego_s_m - BEHIND_M + rng.random_range(0.0..spacing_m);
    while s_m < ego_s_m + AHEAD_M {
        let foot = FrenetPoint { s_m, d_m };
        if is_clear(road, road.from_frenet(foot), radius_m) {
            bodies.push(pole(road, foot, height_m, radius_m));
        }
        s_m += spacing_m;
    }
}

/// Buildings and trees behind what lines the road.
fn draw_background(
    rng: &mut impl Rng,
    road: &Road,
    side: f64,
    ego_s_m: f64,
    free_from_m: f64,
    bodies: &mut Vec<Body>,
) {
    let (buildings, trees) = (rng.random_range(0.0..1.0), rng.random_range(0.0..1.0));
    let mut s_m = ego_s_m - BEHIND_M;
    while s_m < ego_s_m + AHEAD_M {
        let length_m = rng.random_range(8.0..28.0);
        let depth_m = rng.random_range(8.0..14.0);
        if rng.random_bool(buildings) {
            let d_m = free_from_m + depth_m / 2.0 + rng.random_range(0.0_f64..1.0).powi(2) * 18.0;
            let turn = rng.random_range(-0.15..0.15);
            let center = road.pose_from_frenet(s_m + length_m / 2.0, side * d_m, turn);
            let size = [length_m, depth_m, rng.random_range(3.5..16.0)];
            let tone = rng.random_range(110..225_u8);
            let color = [0, 12, 30].map(|fall| {
                let tint = rng.random_range(-14..=10);
                tone.saturating_sub(fall).saturating_add_signed(tint)
            });
            if outline(center, size).all(|point| is_clear(road, point, 0.5)) {
                bodies.push(building(center, size, color));
            }
        } else if rng.random_bool(trees) {
            let height_m = rng.random_range(3.0..10.0);
            let crown_m = height_m * rng.random_range(0.2..0.35);
            let d_m = side * (free_from_m + crown_m + rng.random_range(0.0..15.0));
            let foot = road.from_frenet(FrenetPoint { s_m, d_m });
            if is_clear(road, foot, 1.2 * crown_m) {
                bodies.push(tree(foot, height_m, crown_m, rng));
            }
        }
        s_m += length_m + rng.random_range(0.0..12.0);
    }
}

/// Points along the outline of a building.
fn outline(center: Se2Pose, [length, width, _]: [f64; 3]) -> impl Iterator<Item = Vector2<f64>> {
    let steps = [-0.5, -0.25, 0.0, 0.25, 0.5];
    let along = steps.into_iter().flat_map(|x| [[x, -0.5], [x, 0.5]]);
    let across = steps.into_iter().flat_map(|y| [[-0.5, y], [0.5, y]]);
    along
        .chain(across)
        .map(move |[x, y]| center.transform(Vector2::new(x * length, y * width)))
}

fn is_clear(road: &Road, point: Vector2<f64>, radius_m: f64) -> bool {
    road.to_frenet(point).d_m.abs() - radius_m > road.mark_offset_m(0) + CLEARANCE_M - 0.5
}
