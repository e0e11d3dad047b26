use covista_world::Se2Pose;

use super::solids::{block, centered_block, roof};
use crate::{Body, Material};

const STOREY_M: f64 = 3.2;

/// A building of `size_m` (along its heading, across it, up) with a row of windows per storey.
pub fn building(center: Se2Pose, size_m: [f64; 3], color: [u8; 3]) -> Body {
    flat_roofed(size_m, color).at(center, 0.0)
}

fn flat_roofed([length, width, height]: [f64; 3], color: [u8; 3]) -> Body {
    let mut parts = vec![centered_block(
        [length, width],
        [0.0, height],
        Material::Plaster(color),
    )];
    let storeys = (height / STOREY_M).clamp(0.0, 8.0) as u32;
    parts.extend((0..storeys).map(|storey| {
        let sill = f64::from(storey) * STOREY_M + 1.0;
        let size = [length + 0.06, width + 0.06];
        centered_block(size, [sill, sill + 1.3], Material::Glass)
    }));
    Body { parts }
}

/// A house with a pitched roof of `roof_m`, windows apart from one another, a door step and a
/// chimney. `hip_m` above 0 bevels the roof's ends.
pub fn gabled_house(
    size_m: [f64; 3],
    roof_m: f64,
    hip_m: f64,
    [wall, tiles]: [[u8; 3]; 2],
) -> Body {
    let [length, width, eaves] = size_m;
    let mut parts = vec![
        centered_block([length, width], [0.0, eaves], Material::Plaster(wall)),
        roof(
            [length + 0.8, width + 0.8],
            [eaves - 0.1, eaves + roof_m],
            hip_m,
            Material::Plaster(tiles),
        ),
    ];
    let chimney = [0.2 * length, 0.2 * length + 0.6];
    let chimney_top = eaves + roof_m + 0.5;
    parts.push(block(
        chimney,
        [0.1, 0.7],
        [eaves, chimney_top],
        Material::Plaster([120, 70, 60]),
    ));
    let columns = (length / 3.0).max(1.0) as u32;
    for storey in 0..(eaves / STOREY_M).clamp(1.0, 4.0) as u32 {
        let sill = f64::from(storey) * STOREY_M + 1.0;
        parts.extend((0..columns).map(|column| {
            let x = length * ((f64::from(column) + 0.5) / f64::from(columns) - 0.5);
            let (half_w, half_d) = (0.55, width / 2.0 + 0.03);
            block(
                [x - half_w, x + half_w],
                [-half_d, half_d],
                [sill, sill + 1.35],
                Material::Glass,
            )
        }));
    }
    parts.push(block(
        [-1.0, 0.6],
        [-width / 2.0 - 1.0, width / 2.0 + 1.0],
        [0.0, 0.35],
        Material::Concrete,
    ));
    Body { parts }
}

/// A garden shed or a garage with a shallow roof.
pub fn shed([length, width, height]: [f64; 3], color: [u8; 3]) -> Body {
    Body {
        parts: vec![
            centered_block([length, width], [0.0, height], Material::Plaster(color)),
            roof(
                [length + 0.3, width + 0.3],
                [height, height + 0.25 * width],
                0.0,
                Material::Plaster([90, 70, 62]),
            ),
        ],
    }
}
