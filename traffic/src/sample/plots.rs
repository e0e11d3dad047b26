//! Front gardens, houses and yards along a street.

use covista_world::Se2Pose;
use nalgebra::Vector2;
use rand::Rng;

use super::{
    roadside::{draw_tile_color, draw_wall_color},
    site::Site,
    street::Side,
};
use crate::scenery::{
    Stretch, avenue_tree, building, bush, container, gabled_house, hedge, picket_fence, shed, tree,
    wall, wire_fence,
};

const REACH_M: [f64; 2] = [-70.0, 110.0];
const DRIVEWAY_M: f64 = 3.4;

/// What the plots of a side are like.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Quarter {
    /// Detached houses in gardens.
    Villas,
    /// Facades side by side at the sidewalk.
    Terrace,
    /// Grass, trees, hedges.
    Park,
    /// Yards with sheds and containers.
    Yards,
}

/// A piece of land along the street.
pub(super) struct Plot {
    quarter: Quarter,
    from_m: f64,
    to_m: f64,
    has_driveway: bool,
    /// Whether a car stands in its driveway.
    pub has_car: bool,
}

impl Plot {
    /// Where along the road the middle of the driveway is.
    pub fn driveway_m(&self) -> f64 {
        self.from_m + DRIVEWAY_M / 2.0
    }
}

/// The plots of one side.
pub(super) fn draw(rng: &mut impl Rng, ego_s_m: f64) -> Vec<Plot> {
    let main = draw_quarter(rng);
    let mut plots = Vec::new();
    let mut from_m = ego_s_m + REACH_M[0];
    while from_m < ego_s_m + REACH_M[1] {
        let quarter = if rng.random_bool(0.85) {
            main
        } else {
            draw_quarter(rng)
        };
        let has_driveway = quarter != Quarter::Park && rng.random_bool(0.35);
        let to_m = from_m + rng.random_range(11.0..26.0);
        plots.push(Plot {
            quarter,
            from_m,
            to_m,
            has_driveway,
            has_car: has_driveway && rng.random_bool(0.5),
        });
        from_m = to_m;
    }
    plots
}

fn draw_quarter(rng: &mut impl Rng) -> Quarter {
    match rng.random_range(0..20) {
        0..10 => Quarter::Villas,
        10..14 => Quarter::Terrace,
        14..17 => Quarter::Park,
        _ => Quarter::Yards,
    }
}

/// Fences, gardens and houses on the plots of one side.
pub(super) fn furnish(rng: &mut impl Rng, site: &mut Site, side: &Side, plots: &[Plot]) {
    let usual = rng.random_range(0..6);
    for plot in plots {
        let kind = if rng.random_bool(0.6) {
            usual
        } else {
            rng.random_range(0..6)
        };
        draw_front(rng, site, side, plot, kind);
        draw_house(rng, site, side, plot);
        draw_garden(rng, site, side, plot);
    }
}

/// What parts the plot from the sidewalk.
fn draw_front(rng: &mut impl Rng, site: &mut Site, side: &Side, plot: &Plot, kind: u32) {
    if plot.quarter == Quarter::Terrace {
        return;
    }
    let road = site.road;
    let gap_m = if plot.has_driveway { DRIVEWAY_M } else { 0.0 };
    let stretch = Stretch {
        from_m: plot.from_m + gap_m,
        to_m: plot.to_m - 0.1,
        d_m: side.side * (side.front_m() + rng.random_range(0.0..0.3)),
    };
    let behind = |by_m: f64| Stretch {
        d_m: stretch.d_m + side.side * by_m,
        ..stretch
    };
    match kind {
        0 => {
            let height_m = rng.random_range(0.4..1.6);
            site.along(wall(road, stretch, height_m, rng.random_range(0.15..0.4)));
        }
        1 => {
            let (height_m, depth_m) = (rng.random_range(0.7..2.4), rng.random_range(0.5..1.8));
            site.along(hedge(road, stretch, height_m, depth_m, rng));
        }
        2 => {
            let height_m = rng.random_range(0.8..1.4);
            site.along(picket_fence(road, stretch, height_m, draw_wall_color(rng)));
        }
        3 => {
            // A low wall, a fence on it, bushes behind.
            site.along(wall(road, stretch, rng.random_range(0.2..0.6), 0.25));
            site.along(wire_fence(road, behind(0.1), rng.random_range(0.9..1.6)));
            let (height_m, depth_m) = (rng.random_range(0.8..2.2), rng.random_range(0.5..1.5));
            site.along(hedge(road, behind(0.5), height_m, depth_m, rng));
        }
        4 => site.along(wire_fence(road, stretch, rng.random_range(0.8..2.2))),
        _ => {}
    }
}

/// The house and, at times, a garage or shed beside it; a row of trees in a park.
fn draw_house(rng: &mut impl Rng, site: &mut Site, side: &Side, plot: &Plot) {
    let road = site.road;
    let length_m = plot.to_m - plot.from_m;
    let middle_m = (plot.from_m + plot.to_m) / 2.0;
    let mut set_down = |s_m: f64, setback_m: f64, depth_m: f64, turn: f64, body: crate::Body| {
        let d_m = side.side * (side.front_m() + setback_m + depth_m / 2.0);
        site.stand(road.pose_from_frenet(s_m, d_m, turn), body);
    };
    let color = draw_wall_color(rng);
    match plot.quarter {
        Quarter::Villas => {
            let drive_m = if plot.has_driveway { DRIVEWAY_M } else { 0.0 };
            let size = [
                (length_m - drive_m - 1.5).min(rng.random_range(8.0..16.0)),
                rng.random_range(7.0..12.0),
                rng.random_range(3.0..8.0),
            ];
            let setback_m = rng.random_range(2.5..11.0);
            let hip_m = if rng.random_bool(0.4) {
                0.3 * size[0]
            } else {
                0.0
            };
            let roof_m = size[1] * rng.random_range(0.25..0.6);
            let body = gabled_house(size, roof_m, hip_m, [color, draw_tile_color(rng)]);
            let turn = rng.random_range(-0.05..0.05);
            set_down(middle_m + drive_m / 2.0, setback_m, size[1], turn, body);
            if plot.has_driveway && rng.random_bool(0.6) {
                let garage = shed([3.2, 6.0, 2.4], color);
                let turn = std::f64::consts::FRAC_PI_2;
                set_down(
                    plot.driveway_m(),
                    rng.random_range(6.0..12.0),
                    6.0,
                    turn,
                    garage,
                );
            }
        }
        Quarter::Terrace => {
            let drive_m = if plot.has_driveway { DRIVEWAY_M } else { 0.0 };
            let depth_m = rng.random_range(9.0..14.0);
            let size = [length_m - drive_m, depth_m, rng.random_range(6.0..19.0)];
            let body = if rng.random_bool(0.5) {
                building(Se2Pose::default(), size, color)
            } else {
                gabled_house(size, 0.4 * depth_m, 0.0, [color, draw_tile_color(rng)])
            };
            let setback_m = rng.random_range(0.2..0.8);
            set_down(
                middle_m + drive_m / 2.0,
                setback_m + 1.0,
                depth_m,
                0.0,
                body,
            );
        }
        Quarter::Park => {
            let size = [
                rng.random_range(15.0..30.0),
                12.0,
                rng.random_range(6.0..20.0),
            ];
            if rng.random_bool(0.3) {
                let body = building(Se2Pose::default(), size, color);
                let turn = rng.random_range(-0.3..0.3);
                set_down(middle_m, rng.random_range(25.0..45.0), size[1], turn, body);
            }
        }
        Quarter::Yards => {
            for _ in 0..rng.random_range(1..4) {
                let (s_m, turn) = (
                    rng.random_range(plot.from_m + DRIVEWAY_M..plot.to_m),
                    1.6 * f64::from(rng.random_range(0..2)) + rng.random_range(-0.1..0.1),
                );
                let size = [
                    rng.random_range(2.0..7.0),
                    rng.random_range(1.5..2.6),
                    rng.random_range(1.2..2.8),
                ];
                let body = if rng.random_bool(0.5) {
                    container(size, color)
                } else {
                    shed(size, color)
                };
                set_down(s_m, rng.random_range(1.5..8.0), size[0], turn, body);
            }
            let size = [length_m, 12.0, rng.random_range(4.0..10.0)];
            let body = building(Se2Pose::default(), size, color);
            set_down(middle_m, rng.random_range(9.0..16.0), size[1], 0.0, body);
        }
    }
}

/// Bushes, blocks of hedge and trees in front of and between the houses.
fn draw_garden(rng: &mut impl Rng, site: &mut Site, side: &Side, plot: &Plot) {
    let road = site.road;
    let plants = match plot.quarter {
        Quarter::Villas => rng.random_range(1..9),
        Quarter::Terrace => 0,
        Quarter::Park => rng.random_range(4..14),
        Quarter::Yards => rng.random_range(0..4),
    };
    let depth_m = match plot.quarter {
        Quarter::Park => 30.0,
        _ => 9.0,
    };
    let first_m = plot.from_m + if plot.has_driveway { DRIVEWAY_M } else { 0.0 };
    for _ in 0..plants {
        let s_m = rng.random_range(first_m..plot.to_m);
        let out_m = 0.8 + depth_m * rng.random_range(0.0_f64..1.0).powf(1.5);
        let turn = rng.random_range(0.0..std::f64::consts::TAU);
        let pose = road.pose_from_frenet(s_m, side.side * (side.front_m() + out_m), turn);
        let body = match rng.random_range(0..10) {
            0..4 => {
                let size: f64 = rng.random_range(0.6..4.5);
                let height_m = (size * rng.random_range(0.5..1.0)).min(2.8);
                bush([size, size * rng.random_range(0.5..1.0), height_m], rng)
            }
            4..8 => {
                let height_m = rng.random_range(2.5..10.0);
                let crown_m = height_m * rng.random_range(0.2..0.38);
                tree(Vector2::zeros(), height_m, crown_m, rng)
            }
            _ => {
                let height_m = rng.random_range(7.0..16.0);
                let clear_m = rng.random_range(2.3..4.5_f64).min(0.5 * height_m);
                avenue_tree(height_m, clear_m, 0.02 * height_m, rng)
            }
        };
        site.stand(pose, body);
    }
}
