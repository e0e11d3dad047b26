use std::f64::consts::{FRAC_PI_2, PI, TAU};

use rand::Rng;

use super::{roadside::draw_sign_color, site::Site, street::Side};
use crate::scenery::{
    Stretch, avenue_tree, bicycle, container, cyclist, dustbin, hydrant, lamp, motorcycle, person,
    sidewalk, sign,
};

const REACH_M: [f64; 2] = [-70.0, 110.0];

/// The raised sidewalk of one side and all that stands and walks on it.
pub(super) fn draw(rng: &mut impl Rng, site: &mut Site, ego_s_m: f64, side: &Side) {
    let stretch = Stretch {
        from_m: ego_s_m + REACH_M[0],
        to_m: ego_s_m + REACH_M[1],
        d_m: side.side * side.curb_m,
    };
    site.along(sidewalk(
        site.road,
        stretch,
        side.curb_height_m,
        side.sidewalk_m,
    ));
    let mut walk = Walk {
        site,
        ego_s_m,
        side,
    };
    walk.draw_trees(rng);
    walk.draw_masts(rng);
    walk.draw_things(rng);
    walk.draw_people(rng);
}

struct Walk<'a, 'b> {
    site: &'a mut Site<'b>,
    ego_s_m: f64,
    side: &'a Side,
}

impl Walk<'_, '_> {
    /// Sets a body down on the sidewalk, `in_m` behind the curb, turned from the road's heading.
    fn stand(&mut self, s_m: f64, in_m: f64, turn_rad: f64, body: crate::Body) {
        let d_m = self.side.side * (self.side.curb_m + in_m);
        let pose = self.site.road.pose_from_frenet(s_m, d_m, turn_rad);
        let on_curb = in_m > 0.0 && in_m < self.side.sidewalk_m;
        let curb_m = if on_curb {
            self.side.curb_height_m
        } else {
            0.0
        };
        self.site.raise(pose, body, curb_m);
    }

    fn anywhere_m(&self, rng: &mut impl Rng) -> f64 {
        self.ego_s_m + rng.random_range(REACH_M[0]..REACH_M[1])
    }

    /// Towards the road from this side, as a turn from its heading.
    fn to_road(&self) -> f64 {
        -self.side.side * FRAC_PI_2
    }

    /// A row of trees between the curb and the plots, their crowns over the road.
    fn draw_trees(&mut self, rng: &mut impl Rng) {
        if !rng.random_bool(0.4) {
            return;
        }
        let spacing_m = rng.random_range(6.0..18.0);
        let in_m = rng.random_range(0.5..0.8 * self.side.sidewalk_m.max(1.0));
        let mut s_m = self.ego_s_m + REACH_M[0] + rng.random_range(0.0..spacing_m);
        let trunk_m = rng.random_range(0.08..0.4);
        while s_m < self.ego_s_m + REACH_M[1] {
            let height_m = trunk_m * 20.0 + rng.random_range(3.5..8.0);
            let clear_m = rng.random_range(2.3..4.5_f64).min(0.5 * height_m);
            let body = avenue_tree(height_m, clear_m, trunk_m, rng);
            let turn = self.to_road() + rng.random_range(-0.8..0.8);
            self.stand(s_m, in_m, turn, body);
            s_m += spacing_m * rng.random_range(0.7..1.4);
        }
    }

    /// Lamps and traffic signs.
    fn draw_masts(&mut self, rng: &mut impl Rng) {
        if rng.random_bool(0.6) {
            let (spacing_m, height_m) = (rng.random_range(18.0..40.0), rng.random_range(4.0..9.0));
            let mut s_m = self.ego_s_m + REACH_M[0] + rng.random_range(0.0..spacing_m);
            while s_m < self.ego_s_m + REACH_M[1] {
                self.stand(s_m, 0.4, self.to_road(), lamp(height_m, 0.2 * height_m));
                s_m += spacing_m;
            }
        }
        for _ in 0..rng.random_range(0..8) {
            let size_m = rng.random_range(0.4..0.9);
            let plate = [size_m, size_m * rng.random_range(0.7..1.6)];
            let clear_m = rng.random_range(1.6..2.4);
            let turn = if rng.random_bool(0.6) { PI } else { 0.0 } + rng.random_range(-0.4..0.4);
            let (s_m, color) = (self.anywhere_m(rng), draw_sign_color(rng));
            self.stand(s_m, 0.5, turn, sign(clear_m, plate, color));
        }
    }

    /// Dustbins, hydrants, bicycles, rows of motorcycles, skips.
    fn draw_things(&mut self, rng: &mut impl Rng) {
        let width_m = self.side.sidewalk_m;
        for _ in 0..rng.random_range(0..10) {
            let (s_m, kind) = (self.anywhere_m(rng), rng.random_range(0..10));
            let in_m = rng.random_range(0.3..width_m);
            let color = draw_sign_color(rng).map(|channel| channel / 2);
            match kind {
                0..3 => {
                    let bins = rng.random_range(1..=4);
                    for bin in 0..bins {
                        let turn = self.to_road() + rng.random_range(-0.3..0.3);
                        let body = dustbin(rng.random_range(0.85..1.25), color);
                        self.stand(s_m + 0.75 * f64::from(bin), in_m, turn, body);
                    }
                }
                3 => {
                    self.stand(s_m, 0.5, 0.0, hydrant(color));
                }
                4..6 => {
                    let turn = rng.random_range(0.0..TAU);
                    for place in 0..rng.random_range(1..=5) {
                        let along_m = s_m + 0.6 * f64::from(place);
                        self.stand(along_m, 0.5 * width_m, turn, bicycle(color));
                    }
                }
                6..9 => {
                    let turn = self.to_road() + rng.random_range(-0.6..0.6);
                    for place in 0..rng.random_range(1..=5) {
                        let (along_m, paint) = (s_m + 1.1 * f64::from(place), draw_sign_color(rng));
                        let body = motorcycle(paint, rng);
                        self.stand(along_m, 0.5 * width_m, turn, body);
                    }
                }
                _ => {
                    let size_m = [
                        rng.random_range(1.5..6.0),
                        rng.random_range(1.0..2.3),
                        rng.random_range(0.9..2.5),
                    ];
                    let in_m = 0.5 * size_m[1] + rng.random_range(-2.0..0.5);
                    self.stand(s_m, in_m, 0.0, container(size_m, color));
                }
            }
        }
    }

    /// People alone and in groups, on the sidewalk and between the cars, and some on bicycles.
    fn draw_people(&mut self, rng: &mut impl Rng) {
        let groups = (10.0 * rng.random_range(0.0_f64..1.0).powi(2)) as u32;
        for _ in 0..groups {
            let s_m = self.anywhere_m(rng);
            let in_m = rng.random_range(-1.0..self.side.sidewalk_m);
            if rng.random_bool(0.15) {
                let turn = if rng.random_bool(0.5) { PI } else { 0.0 };
                self.stand(s_m, in_m, turn, cyclist(rng));
                continue;
            }
            let walking = rng.random_bool(0.6);
            let heading = if walking {
                PI * f64::from(rng.random_range(0..2))
            } else {
                rng.random_range(0.0..TAU)
            };
            for member in 0..rng.random_range(1..=3) {
                let child = rng.random_bool(0.12);
                let height_m = if child {
                    rng.random_range(1.0..1.4)
                } else {
                    rng.random_range(1.5..1.95)
                };
                let stride = if walking {
                    rng.random_range(0.4..1.0)
                } else {
                    0.0
                };
                let body = person(height_m, stride, rng);
                let turn = heading + rng.random_range(-0.4..0.4);
                let apart_m = 0.65 * f64::from(member);
                self.stand(
                    s_m + rng.random_range(-0.2..0.2),
                    in_m + apart_m,
                    turn,
                    body,
                );
            }
        }
    }
}
