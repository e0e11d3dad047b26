//! What runs along the road.

use covista_world::{FrenetPoint, Road};
use nalgebra::Point3;
use rand::Rng;

use super::solids::{block, frustum};
use crate::{Body, ConvexPart, Material};

/// Length of a piece of a wall or barrier: 2 cm of sagitta at a radius of 50 m.
const PIECE_M: f64 = 3.0;
const RAIL_POST_SPACING_M: f64 = 4.0;

/// A stretch along the road at a distance from its reference line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Where it starts, in metres along the reference line.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Offset d of the face that looks at the road, positive to the left.
    pub d_m: f64,
}

impl Stretch {
    /// Offset d of a point `out_m` behind the face, away from the road.
    fn behind(&self, out_m: f64) -> f64 {
        self.d_m + self.d_m.signum() * out_m
    }
}

/// A concrete wall along the road.
pub fn wall(road: &Road, stretch: Stretch, height_m: f64, thickness_m: f64) -> Body {
    slab(
        road,
        stretch,
        [0.0, height_m],
        thickness_m,
        Material::Concrete,
    )
}

/// A slab along the road: a band `width_m` wide between two heights.
pub fn slab(
    road: &Road,
    stretch: Stretch,
    [low_m, high_m]: [f64; 2],
    width_m: f64,
    material: Material,
) -> Body {
    let (near, far) = (stretch.d_m, stretch.behind(width_m));
    let profile = [[near, low_m], [far, low_m], [far, high_m], [near, high_m]];
    extrude(road, stretch, &profile, material)
}

/// A raised sidewalk with a bevelled curb.
pub fn sidewalk(road: &Road, stretch: Stretch, curb_m: f64, width_m: f64) -> Body {
    let profile = [
        [stretch.d_m, 0.0],
        [stretch.behind(width_m), 0.0],
        [stretch.behind(width_m), curb_m],
        [stretch.behind(0.02), curb_m],
    ];
    extrude(road, stretch, &profile, Material::Concrete)
}

/// A concrete barrier of New Jersey shape, 0.9 m high.
pub fn jersey_barrier(road: &Road, stretch: Stretch) -> Body {
    let profile = [
        [stretch.behind(0.0), 0.0],
        [stretch.behind(0.6), 0.0],
        [stretch.behind(0.38), 0.9],
        [stretch.behind(0.22), 0.9],
    ];
    extrude(road, stretch, &profile, Material::Concrete)
}

/// A steel guard rail on posts.
pub fn guard_rail(road: &Road, stretch: Stretch) -> Body {
    let mut body = slab(road, stretch, [0.45, 0.76], 0.08, Material::Metal);
    body.parts
        .extend(posts(road, stretch, 0.15, RAIL_POST_SPACING_M, |foot| {
            frustum(foot, [0.07; 2], [0.0, 0.74], 4, Material::Metal)
        }));
    body
}

/// A low concrete wall with a steel rail on posts above it.
pub fn railed_wall(road: &Road, stretch: Stretch) -> Body {
    let mut body = wall(road, stretch, 0.6, 0.4);
    let rail = Stretch {
        d_m: stretch.behind(0.1),
        ..stretch
    };
    let metal = Material::Metal;
    let parts = slab(road, rail, [0.75, 0.95], 0.2, metal).parts;
    body.parts.extend(parts);
    body.parts
        .extend(posts(road, stretch, 0.2, RAIL_POST_SPACING_M, |foot| {
            frustum(foot, [0.1; 2], [0.5, 0.8], 4, metal)
        }));
    body
}

/// A wire fence: posts, a top rail and a bottom one; the mesh is too thin to be seen.
pub fn wire_fence(road: &Road, stretch: Stretch, height_m: f64) -> Body {
    let rail = |z: f64| slab(road, stretch, [z - 0.05, z], 0.05, Material::Metal).parts;
    let mut parts = rail(height_m);
    parts.extend(rail(0.3));
    parts.extend(posts(road, stretch, 0.03, 3.0, |foot| {
        frustum(foot, [0.04; 2], [0.0, height_m], 4, Material::Metal)
    }));
    Body { parts }
}

/// A garden fence of upright boards on a rail.
pub fn picket_fence(road: &Road, stretch: Stretch, height_m: f64, color: [u8; 3]) -> Body {
    let wood = Material::Plaster(color);
    let rail_m = [0.7 * height_m, 0.8 * height_m];
    let mut body = slab(road, stretch, rail_m, 0.04, wood);
    let boards = posts(road, stretch, 0.0, 0.3, |foot| {
        frustum(foot, [0.09; 2], [0.0, height_m], 4, wood)
    });
    body.parts.extend(boards);
    body
}

/// A clipped hedge; pieces differ a little in height and depth.
pub fn hedge(
    road: &Road,
    stretch: Stretch,
    height_m: f64,
    thickness_m: f64,
    rng: &mut impl Rng,
) -> Body {
    let length_m = (stretch.to_m - stretch.from_m).max(0.0);
    let pieces = (length_m / 2.0).ceil() as u32;
    let parts = (0..pieces)
        .map(|piece| {
            let s_m = stretch.from_m + length_m * (f64::from(piece) + 0.5) / f64::from(pieces);
            let half_m = 0.55 * length_m / f64::from(pieces);
            let (thick_m, top_m) = (
                thickness_m * rng.random_range(0.85..1.0),
                height_m * rng.random_range(0.85..1.0),
            );
            let middle = road.pose_from_frenet(s_m, stretch.behind(thickness_m / 2.0), 0.0);
            let half_thick_m = thick_m / 2.0;
            let leaves = block(
                [-half_m, half_m],
                [-half_thick_m, half_thick_m],
                [0.0, top_m],
                Material::Foliage,
            );
            leaves.at(middle, 0.0)
        })
        .collect();
    Body { parts }
}

fn posts(
    road: &Road,
    stretch: Stretch,
    behind_m: f64,
    spacing_m: f64,
    post: impl Fn(nalgebra::Vector2<f64>) -> ConvexPart,
) -> impl Iterator<Item = ConvexPart> {
    let count = ((stretch.to_m - stretch.from_m) / spacing_m).max(0.0) as u32;
    (0..=count).map(move |index| {
        post(road.from_frenet(FrenetPoint {
            s_m: stretch.from_m + f64::from(index) * spacing_m,
            d_m: stretch.behind(behind_m),
        }))
    })
}

/// A convex profile of (d, z) drawn along the road, in convex pieces of a few metres.
fn extrude(road: &Road, stretch: Stretch, profile: &[[f64; 2]], material: Material) -> Body {
    let length_m = (stretch.to_m - stretch.from_m).max(0.0);
    let pieces = (length_m / PIECE_M).ceil() as u32;
    let section = |index: u32| {
        let s_m = stretch.from_m + length_m * f64::from(index) / f64::from(pieces);
        profile.iter().map(move |&[d_m, z]| {
            let foot = road.from_frenet(FrenetPoint { s_m, d_m });
            Point3::new(foot.x, foot.y, z)
        })
    };
    let parts = (0..pieces)
        .map(|index| ConvexPart {
            vertices: section(index).chain(section(index + 1)).collect(),
            material,
        })
        .collect();
    Body { parts }
}

#[cfg(test)]
mod tests {
    use covista_world::{RoadSegment, Se2Pose};

    use super::*;

    #[test]
    fn a_wall_keeps_its_offset_round_a_bend() {
        let arc = RoadSegment::Arc {
            length_m: 60.0,
            curvature_per_m: 0.02,
        };
        let road = Road::new(Se2Pose::default(), &[arc], 3.5).expect("a road");
        let stretch = Stretch {
            from_m: 10.0,
            to_m: 50.0,
            d_m: 6.0,
        };
        let body = wall(&road, stretch, 2.5, 0.3);
        assert_eq!(body.parts.len(), 14);
        for vertex in body.parts.iter().flat_map(|part| &part.vertices) {
            let point = road.to_frenet(vertex.xy().coords);
            assert!((point.d_m - 6.15).abs() < 0.15 + 1e-6, "{point:?}");
            assert!((9.99..50.01).contains(&point.s_m));
        }
    }
}
