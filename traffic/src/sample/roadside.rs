//! What stands beside a freeway.

use covista_world::Se2Pose;
use rand::Rng;

use super::site::Site;
use crate::{
    Material,
    scenery::{
        Stretch, avenue_tree, bridge, building, bush, gabled_house, gantry, guard_rail,
        jersey_barrier, lamp, railed_wall, sign, slab, tree, wall, wire_fence,
    },
};

const AHEAD_M: f64 = 150.0;
const BEHIND_M: f64 = 90.0;
/// Between the pavement and what is set down beside it.
const SETBACK_M: f64 = 0.4;

/// One side of the road: +1 the left one, free from this |d| on.
#[derive(Clone, Copy)]
pub(super) struct Verge {
    pub side: f64,
    pub free_m: f64,
}

/// The median between `inner_m` (its edges) and the opposite carriageway, paved up to `outer_m`.
pub(super) fn draw_median(
    rng: &mut impl Rng,
    site: &mut Site,
    ego_s_m: f64,
    inner_m: [f64; 2],
    outer_m: f64,
) {
    let road = site.road;
    let at = |d_m: f64| Stretch {
        from_m: ego_s_m - BEHIND_M,
        to_m: ego_s_m + AHEAD_M,
        d_m,
    };
    let pavement = [-0.1, 0.03];
    let width_m = outer_m - inner_m[1];
    let concrete = Material::Concrete;
    site.along(slab(road, at(inner_m[1]), pavement, width_m, concrete));
    let middle_m = (inner_m[0] + inner_m[1]) / 2.0;
    match rng.random_range(0..10) {
        0..4 => site.along(jersey_barrier(road, at(middle_m - 0.3))),
        4..6 => {
            site.along(guard_rail(road, at(inner_m[0] + 0.1)));
            site.along(guard_rail(road, at(inner_m[1] - 0.3)));
        }
        6..8 => site.along(railed_wall(road, at(middle_m - 0.2))),
        _ => {}
    }
    let room_m = inner_m[1] - inner_m[0];
    if room_m > 3.0 && rng.random_bool(0.6) {
        for _ in 0..rng.random_range(1..20) {
            let size_m = rng.random_range(0.8..(room_m - 1.0).min(4.0));
            let s_m = ego_s_m + rng.random_range(-BEHIND_M..AHEAD_M);
            let height_m = size_m * rng.random_range(0.5..1.0);
            let pose = road.pose_from_frenet(s_m, middle_m + rng.random_range(-0.5..0.5), 0.0);
            site.stand(pose, bush([1.2 * size_m, size_m, height_m], rng));
        }
    }
}

/// What lines the road on one side, and what stands behind that.
pub(super) fn draw_verge(rng: &mut impl Rng, site: &mut Site, ego_s_m: f64, verge: Verge) {
    let mut behind = verge;
    let pieces = if rng.random_bool(0.6) { 1 } else { 2 };
    let piece_m = (AHEAD_M + BEHIND_M) / f64::from(pieces);
    for piece in 0..pieces {
        let from_m = ego_s_m - BEHIND_M + piece_m * f64::from(piece);
        let outer_m = draw_edge(rng, site, verge, [from_m, from_m + piece_m]);
        behind.free_m = behind.free_m.max(outer_m);
    }
    draw_posts(rng, site, ego_s_m, verge);
    behind.free_m += 1.0;
    draw_background(rng, site, ego_s_m, behind);
    draw_bushes(rng, site, ego_s_m, behind);
}

/// What runs along the edge of the road; returns how far out it reaches.
fn draw_edge(rng: &mut impl Rng, site: &mut Site, verge: Verge, [from_m, to_m]: [f64; 2]) -> f64 {
    let (road, margin_m) = (site.road, (to_m - from_m) * 0.3);
    let (from_m, to_m) = (
        from_m + rng.random_range(0.0..margin_m),
        to_m - rng.random_range(0.0..margin_m),
    );
    // Close to the road more often than far from it.
    let setback_m = SETBACK_M + 7.0 * rng.random_range(0.0_f64..1.0).powi(2);
    let near_m = verge.free_m + setback_m.min(3.0);
    let far_m = verge.free_m + setback_m;
    let at = |out_m: f64| Stretch {
        from_m,
        to_m,
        d_m: verge.side * out_m,
    };
    match rng.random_range(0..20) {
        0..6 => {
            let thickness_m = rng.random_range(0.2..0.6);
            let height_m = rng.random_range(1.2..6.0);
            site.along(wall(road, at(far_m), height_m, thickness_m));
            far_m + thickness_m
        }
        6..9 => {
            site.along(jersey_barrier(road, at(near_m)));
            near_m + 0.6
        }
        9..13 => {
            site.along(guard_rail(road, at(near_m)));
            near_m + 0.3
        }
        13..16 => {
            let out_m = far_m + rng.random_range(1.0..6.0);
            site.along(wire_fence(road, at(out_m), rng.random_range(1.2..2.4)));
            verge.free_m
        }
        _ => verge.free_m,
    }
}

/// Lamps or masts at regular distances, and signs here and there.
fn draw_posts(rng: &mut impl Rng, site: &mut Site, ego_s_m: f64, verge: Verge) {
    let road = site.road;
    if rng.random_bool(0.5) {
        let spacing_m = rng.random_range(15.0..50.0);
        let d_m = verge.side * (verge.free_m + rng.random_range(0.5..4.0));
        let height_m = rng.random_range(2.0..11.0);
        let arm_m = if height_m > 6.0 { 2.0 } else { 0.3 };
        let to_road = -verge.side * std::f64::consts::FRAC_PI_2;
        let mut s_m = ego_s_m - BEHIND_M + rng.random_range(0.0..spacing_m);
        while s_m < ego_s_m + AHEAD_M {
            site.stand(
                road.pose_from_frenet(s_m, d_m, to_road),
                lamp(height_m, arm_m),
            );
            s_m += spacing_m;
        }
    }
    for _ in 0..rng.random_range(0..6) {
        let size_m = [rng.random_range(0.5..3.5), rng.random_range(0.5..2.2)];
        let s_m = ego_s_m + rng.random_range(-BEHIND_M..AHEAD_M);
        let d_m =
            verge.side * (verge.free_m + SETBACK_M + size_m[0] / 2.0 + rng.random_range(0.0..4.0));
        let turn = std::f64::consts::PI + rng.random_range(-0.2..0.2);
        let body = sign(rng.random_range(0.8..2.4), size_m, draw_sign_color(rng));
        site.stand(road.pose_from_frenet(s_m, d_m, turn), body);
    }
}

/// Buildings and trees behind what lines the road.
fn draw_background(rng: &mut impl Rng, site: &mut Site, ego_s_m: f64, verge: Verge) {
    let (road, side, free_m) = (site.road, verge.side, verge.free_m);
    let (buildings, trees) = (
        rng.random_range(0.0_f64..1.0).powi(2),
        rng.random_range(0.0..1.0),
    );
    let mut s_m = ego_s_m - BEHIND_M;
    while s_m < ego_s_m + AHEAD_M {
        let length_m = rng.random_range(8.0..28.0);
        let depth_m = rng.random_range(8.0..14.0);
        if rng.random_bool(buildings) {
            let d_m = free_m + depth_m / 2.0 + rng.random_range(0.0_f64..1.0).powi(2) * 25.0;
            let turn = rng.random_range(-0.15..0.15);
            let center = road.pose_from_frenet(s_m + length_m / 2.0, side * d_m, turn);
            let size = [length_m, depth_m, rng.random_range(3.5..16.0)];
            let color = draw_wall_color(rng);
            let body = if size[2] < 9.0 && rng.random_bool(0.6) {
                gabled_house(size, 0.35 * depth_m, 0.0, [color, draw_tile_color(rng)])
            } else {
                building(Se2Pose::default(), size, color)
            };
            site.stand(center, body);
        } else {
            for _ in 0..rng.random_range(0..=3) {
                if !rng.random_bool(trees) {
                    continue;
                }
                let height_m = rng.random_range(3.0..18.0);
                let crown_m = height_m * rng.random_range(0.2..0.35);
                let d_m = side * (free_m + 0.6 * crown_m + rng.random_range(0.0..20.0));
                let along_m = s_m + rng.random_range(0.0..length_m);
                let turn = rng.random_range(0.0..std::f64::consts::TAU);
                let pose = road.pose_from_frenet(along_m, d_m, turn);
                let body = if rng.random_bool(0.5) {
                    tree(nalgebra::Vector2::zeros(), height_m, crown_m, rng)
                } else {
                    let clear_m = height_m * rng.random_range(0.2..0.4);
                    avenue_tree(height_m, clear_m, 0.02 * height_m, rng)
                };
                site.stand(pose, body);
            }
        }
        s_m += length_m + rng.random_range(0.0..12.0);
    }
}

/// Bushes on the slope beside the road, the nearest at its edge.
fn draw_bushes(rng: &mut impl Rng, site: &mut Site, ego_s_m: f64, verge: Verge) {
    if rng.random_bool(0.35) {
        return;
    }
    for _ in 0..rng.random_range(3..40) {
        let size_m = rng.random_range(0.6..4.5);
        let out_m = verge.free_m + 0.6 * size_m + 25.0 * rng.random_range(0.0_f64..1.0).powi(2);
        let s_m = ego_s_m + rng.random_range(-BEHIND_M..AHEAD_M);
        let turn = rng.random_range(0.0..std::f64::consts::PI);
        let height_m = size_m * rng.random_range(0.4..0.9);
        let pose = site.road.pose_from_frenet(s_m, verge.side * out_m, turn);
        site.stand(pose, bush([size_m, 0.8 * size_m, height_m], rng));
    }
}

/// A sign gantry in one scene in six, a bridge in one in ten.
pub(super) fn draw_overhead(
    rng: &mut impl Rng,
    site: &mut Site,
    ego_s_m: f64,
    [right_m, left_m]: [f64; 2],
) {
    if rng.random_bool(1.0 / 6.0) {
        let s_m = ego_s_m + rng.random_range(25.0..AHEAD_M);
        let plates: Vec<_> = (0..rng.random_range(1..4))
            .map(|_| {
                let y_m = rng.random_range(right_m + 2.0..7.0);
                (y_m, rng.random_range(2.0..5.0), draw_sign_color(rng))
            })
            .collect();
        let legs_m = [left_m + 1.5, right_m - 1.5];
        let body = gantry(legs_m, rng.random_range(5.2..6.5), &plates);
        site.span(site.road.pose_from_frenet(s_m, 0.0, 0.0), body);
    }
    if rng.random_bool(0.1) {
        let s_m = ego_s_m + rng.random_range(30.0..AHEAD_M);
        let turn = rng.random_range(-0.3..0.3);
        let feet_m = [left_m + 5.0, right_m - 5.0];
        let body = bridge(
            feet_m,
            rng.random_range(5.2..7.0),
            rng.random_range(6.0..14.0),
        );
        site.span(site.road.pose_from_frenet(s_m, 0.0, turn), body);
    }
}

pub(super) fn draw_sign_color(rng: &mut impl Rng) -> [u8; 3] {
    const COLORS: [[u8; 3]; 6] = [
        [20, 110, 70],
        [30, 70, 150],
        [230, 230, 230],
        [230, 190, 30],
        [190, 30, 30],
        [120, 80, 40],
    ];
    COLORS[rng.random_range(0..COLORS.len())]
}

pub(super) fn draw_wall_color(rng: &mut impl Rng) -> [u8; 3] {
    let tone = rng.random_range(110..240_u8);
    [0, 12, 30].map(|fall| {
        let tint = rng.random_range(-14..=10);
        tone.saturating_sub(fall).saturating_add_signed(tint)
    })
}

pub(super) fn draw_tile_color(rng: &mut impl Rng) -> [u8; 3] {
    let tone = rng.random_range(60..150_u8);
    let red = rng.random_range(0..70_u8);
    [tone.saturating_add(red), tone, tone.saturating_sub(10)]
}
