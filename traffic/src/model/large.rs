use super::shapes::{
    HEADLAMP, PAINT, PLATE, TAIL_LAMP, block, hull, mirrors, pair, side_windows, wheels,
};
use covista_world::VehicleDimensions;

use crate::{ConvexPart, Material};

pub(super) fn van(size: VehicleDimensions) -> Vec<ConvexPart> {
    let mut parts = vec![
        // Cab and cargo space in one.
        hull(
            PAINT,
            &[
                [-1.13, 0.45, 0.95],
                [-1.13, 1.30, 0.98],
                [-1.08, 2.25, 0.88],
                [-0.95, 2.30, 0.80],
                [2.30, 2.28, 0.82],
                [2.45, 2.22, 0.88],
                [3.35, 1.25, 0.95],
                [3.35, 0.70, 0.98],
                [3.35, 0.32, 0.90],
                [-1.00, 0.32, 0.94],
            ],
        ),
        // Bonnet.
        hull(
            PAINT,
            &[
                [3.15, 1.24, 0.93],
                [3.20, 0.70, 0.98],
                [4.02, 1.02, 0.82],
                [4.18, 0.75, 0.80],
                [4.18, 0.42, 0.80],
                [3.95, 0.30, 0.88],
                [3.20, 0.30, 0.90],
            ],
        ),
        // Windscreen, a little proud of the coated hull.
        hull(
            Material::Glass,
            &[
                [3.31, 1.32, 0.88],
                [3.20, 1.32, 0.88],
                [2.57, 2.12, 0.80],
                [2.46, 2.10, 0.80],
            ],
        ),
        block(
            Material::Rubber,
            [-1.15, -1.00],
            [-0.92, 0.92],
            [0.36, 0.56],
        ),
        block(Material::Rubber, [4.00, 4.25], [-0.80, 0.80], [0.30, 0.58]),
        block(PLATE, [-1.15, -1.10], [-0.26, 0.26], [0.80, 0.91]),
        block(PLATE, [4.24, 4.25], [-0.26, 0.26], [0.40, 0.51]),
    ];
    parts.extend(pair(
        Material::Glass,
        [-1.15, -1.08],
        [0.12, 0.74],
        [1.45, 1.98],
    ));
    parts.extend(pair(TAIL_LAMP, [-1.15, -1.04], [0.82, 0.97], [0.95, 1.40]));
    parts.extend(pair(HEADLAMP, [3.90, 4.20], [0.48, 0.80], [0.80, 0.98]));
    parts.extend(side_windows(
        [[2.00, 1.35], [3.15, 1.35], [2.45, 1.98], [2.00, 1.98]],
        [0.985, 0.92],
    ));
    parts.extend(mirrors(2.95, 1.35, 0.94, 1.00));
    parts.extend(wheels(size, 0.35, 0.23));
    parts
}

pub(super) fn truck(size: VehicleDimensions) -> Vec<ConvexPart> {
    let mut parts = vec![
        // Cargo box.
        block(PAINT, [-1.96, 3.45], [-1.20, 1.20], [0.95, 3.00]),
        // Frame and underrun bar.
        block(Material::Metal, [-1.90, 4.60], [-0.45, 0.45], [0.55, 0.95]),
        block(Material::Metal, [-2.00, -1.88], [-1.10, 1.10], [0.45, 0.62]),
        // Cab.
        hull(
            PAINT,
            &[
                [3.62, 0.50, 1.08],
                [3.62, 2.40, 1.02],
                [4.90, 2.42, 0.98],
                [5.20, 1.35, 1.08],
                [5.38, 1.20, 1.06],
                [5.46, 0.90, 1.02],
                [5.46, 0.45, 1.02],
            ],
        ),
        hull(
            Material::Glass,
            &[
                [5.36, 1.32, 0.98],
                [5.22, 1.32, 0.98],
                [5.03, 2.20, 0.92],
                [4.88, 2.20, 0.92],
            ],
        ),
        block(Material::Rubber, [5.20, 5.50], [-1.08, 1.08], [0.40, 0.68]),
        block(PLATE, [-2.00, -1.95], [-0.26, 0.26], [0.66, 0.77]),
        block(PLATE, [5.49, 5.50], [-0.26, 0.26], [0.46, 0.57]),
    ];
    parts.extend(pair(TAIL_LAMP, [-1.99, -1.90], [0.75, 1.12], [0.66, 0.84]));
    parts.extend(pair(HEADLAMP, [5.38, 5.49], [0.62, 0.98], [0.72, 0.90]));
    parts.extend(side_windows(
        [[4.05, 1.40], [5.05, 1.40], [4.90, 2.15], [4.05, 2.15]],
        [1.085, 1.04],
    ));
    parts.extend(mirrors(5.05, 1.60, 1.06, 1.20));
    parts.extend(wheels(size, 0.45, 0.28));
    parts
}
