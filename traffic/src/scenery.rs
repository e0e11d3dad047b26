use covista_world::{FrenetPoint, Road, Se2Pose};
use nalgebra::{Point3, Vector2};
use rand::Rng;

use crate::{Body, ConvexPart, Material};

/// Length of a piece of a wall or barrier: 2 cm of sagitta at a radius of 50 m.
const PIECE_M: f64 = 3.0;
const POST_SPACING_M: f64 = 4.0;
const STOREY_M: f64 = 3.2;
const BARK: Material = Material::Plaster([92, 76, 60]);

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
    /// +1 to the left of the road, -1 to the right: away from the road.
    fn outwards(&self) -> f64 {
        self.d_m.signum()
    }
}

/// A concrete wall along the road.
pub fn wall(road: &Road, stretch: Stretch, height_m: f64, thickness_m: f64) -> Body {
    let (near, far) = (stretch.d_m, stretch.d_m + stretch.outwards() * thickness_m);
    let profile = [[near, 0.0], [far, 0.0], [far, height_m], [near, height_m]];
    extrude(road, stretch, &profile, Material::Concrete)
}

/// A concrete barrier of New Jersey shape, 0.9 m high.
pub fn jersey_barrier(road: &Road, stretch: Stretch) -> Body {
    let at = |inwards: f64| stretch.d_m + stretch.outwards() * inwards;
    let profile = [
        [at(0.0), 0.0],
        [at(0.6), 0.0],
        [at(0.38), 0.9],
        [at(0.22), 0.9],
    ];
    extrude(road, stretch, &profile, Material::Concrete)
}

/// A steel guard rail on posts.
pub fn guard_rail(road: &Road, stretch: Stretch) -> Body {
    let (near, far) = (stretch.d_m, stretch.d_m + stretch.outwards() * 0.08);
    let rail = [[near, 0.45], [far, 0.45], [far, 0.76], [near, 0.76]];
    let mut body = extrude(road, stretch, &rail, Material::Metal);
    let posts = ((stretch.to_m - stretch.from_m) / POST_SPACING_M).max(0.0) as u32;
    body.parts.extend((0..=posts).map(|post| {
        let foot = road.from_frenet(FrenetPoint {
            s_m: stretch.from_m + f64::from(post) * POST_SPACING_M,
            d_m: far + stretch.outwards() * 0.07,
        });
        prism(foot, 0.07, [0.0, 0.74], 4, Material::Metal)
    }));
    body
}

/// A metal pole: a lamp post or a sign's mast.
pub fn pole(road: &Road, foot: FrenetPoint, height_m: f64, radius_m: f64) -> Body {
    let part = prism(
        road.from_frenet(foot),
        radius_m,
        [0.0, height_m],
        8,
        Material::Metal,
    );
    Body { parts: vec![part] }
}

/// A building of `size_m` (along its heading, across it, up) with a row of windows per storey.
pub fn building(center: Se2Pose, size_m: [f64; 3], color: [u8; 3]) -> Body {
    let [length, width, height] = size_m;
    let mut parts = vec![oriented_block(
        center,
        [length, width],
        [0.0, height],
        Material::Plaster(color),
    )];
    let storeys = (height / STOREY_M).clamp(0.0, 8.0) as u32;
    parts.extend((0..storeys).map(|storey| {
        let sill = f64::from(storey) * STOREY_M + 1.0;
        let size = [length + 0.06, width + 0.06];
        oriented_block(center, size, [sill, sill + 1.3], Material::Glass)
    }));
    Body { parts }
}

/// A tree: a trunk and one irregular crown.
pub fn tree(foot: Vector2<f64>, height_m: f64, crown_radius_m: f64, rng: &mut impl Rng) -> Body {
    let clear_m = height_m * rng.random_range(0.2..0.4);
    let trunk = prism(foot, 0.03 * height_m, [0.0, clear_m + 0.3], 6, BARK);
    let (middle, half) = ((height_m + clear_m) / 2.0, (height_m - clear_m) / 2.0);
    let rings = [(-0.75_f64, 6), (-0.15, 8), (0.45, 7), (0.9, 4)];
    let mut crown = Vec::new();
    for (level, count) in rings {
        let ring_radius_m = crown_radius_m * (1.0 - level * level).sqrt();
        for corner in 0..count {
            let angle = std::f64::consts::TAU * (f64::from(corner) + rng.random_range(0.0..0.6))
                / f64::from(count);
            let reach = ring_radius_m * rng.random_range(0.8..1.1);
            let (sin, cos) = angle.sin_cos();
            crown.push(Point3::new(
                foot.x + reach * cos,
                foot.y + reach * sin,
                middle + half * (level + rng.random_range(-0.1..0.1)),
            ));
        }
    }
    let crown = ConvexPart {
        vertices: crown,
        material: Material::Foliage,
    };
    Body {
        parts: vec![trunk, crown],
    }
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

fn prism(
    foot: Vector2<f64>,
    radius_m: f64,
    z: [f64; 2],
    sides: u32,
    material: Material,
) -> ConvexPart {
    let vertices = (0..sides)
        .flat_map(|side| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(side) / f64::from(sides)).sin_cos();
            z.map(|z| Point3::new(foot.x + radius_m * cos, foot.y + radius_m * sin, z))
        })
        .collect();
    ConvexPart { vertices, material }
}

fn oriented_block(
    center: Se2Pose,
    [length, width]: [f64; 2],
    z: [f64; 2],
    material: Material,
) -> ConvexPart {
    let vertices = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
        .into_iter()
        .flat_map(|(x, y)| {
            let corner = center.transform(Vector2::new(x * length / 2.0, y * width / 2.0));
            z.map(|z| Point3::new(corner.x, corner.y, z))
        })
        .collect();
    ConvexPart { vertices, material }
}

#[cfg(test)]
mod tests {
    use covista_world::RoadSegment;

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
