use super::shapes::{
    HEADLAMP, PAINT, PLATE, TAIL_LAMP, block, hull, mirrors, pair, pillars, wheels,
};
use crate::{ConvexPart, Material, VehicleModel};

pub(super) fn sedan() -> Vec<ConvexPart> {
    let mut parts = vec![
        // Lower hull: boot, belt line, bonnet, nose.
        hull(
            PAINT,
            &[
                [-1.08, 0.40, 0.76],
                [-1.06, 0.92, 0.74],
                [-0.95, 0.22, 0.84],
                [-0.80, 1.01, 0.76],
                [-0.30, 0.62, 0.89],
                [0.10, 1.00, 0.84],
                [2.05, 0.97, 0.84],
                [2.70, 0.62, 0.89],
                [3.25, 0.77, 0.76],
                [3.45, 0.22, 0.80],
                [3.58, 0.56, 0.66],
                [3.58, 0.40, 0.68],
            ],
        ),
        // Greenhouse: rear window, side windows, windscreen.
        hull(
            Material::Glass,
            &[
                [-0.60, 0.97, 0.74],
                [2.10, 0.95, 0.78],
                [0.15, 1.40, 0.59],
                [1.25, 1.40, 0.61],
            ],
        ),
        hull(
            PAINT,
            &[
                [0.05, 1.38, 0.60],
                [1.35, 1.37, 0.63],
                [0.20, 1.44, 0.52],
                [0.70, 1.45, 0.52],
                [1.15, 1.44, 0.54],
            ],
        ),
        // Seats and dashboard behind the glass.
        hull(
            Material::Rubber,
            &[
                [0.00, 0.92, 0.66],
                [1.75, 0.92, 0.66],
                [0.10, 1.20, 0.58],
                [1.15, 1.20, 0.58],
            ],
        ),
        // Bumpers.
        block(
            Material::Rubber,
            [-1.10, -0.98],
            [-0.74, 0.74],
            [0.24, 0.42],
        ),
        block(Material::Rubber, [3.42, 3.60], [-0.66, 0.66], [0.22, 0.40]),
        block(PLATE, [-1.10, -1.06], [-0.26, 0.26], [0.60, 0.71]),
        block(PLATE, [3.58, 3.60], [-0.26, 0.26], [0.42, 0.53]),
    ];
    parts.extend(pillars([[0.62, 0.98], [0.66, 1.39]], [0.80, 0.62], 0.09));
    parts.extend(pillars([[-0.52, 0.98], [0.14, 1.39]], [0.75, 0.60], 0.16));
    parts.extend(pair(TAIL_LAMP, [-1.09, -0.96], [0.44, 0.78], [0.70, 0.86]));
    parts.extend(pair(HEADLAMP, [3.30, 3.53], [0.40, 0.73], [0.56, 0.70]));
    parts.extend(mirrors(1.75, 0.98, 0.82, 0.90));
    parts.extend(wheels(VehicleModel::Sedan, 0.32, 0.21));
    parts
}

pub(super) fn suv() -> Vec<ConvexPart> {
    let mut parts = vec![
        hull(
            PAINT,
            &[
                [-0.98, 0.48, 0.82],
                [-0.96, 1.08, 0.84],
                [-0.86, 0.28, 0.88],
                [-0.30, 0.75, 0.93],
                [-0.60, 1.14, 0.86],
                [2.10, 1.12, 0.88],
                [2.80, 0.75, 0.93],
                [3.30, 0.98, 0.80],
                [3.42, 0.28, 0.84],
                [3.58, 0.78, 0.74],
                [3.58, 0.48, 0.76],
            ],
        ),
        hull(
            Material::Glass,
            &[
                [-0.94, 1.10, 0.78],
                [2.12, 1.10, 0.82],
                [-0.72, 1.62, 0.66],
                [1.40, 1.63, 0.68],
            ],
        ),
        hull(
            PAINT,
            &[
                [-0.82, 1.60, 0.67],
                [1.45, 1.60, 0.70],
                [-0.60, 1.68, 0.58],
                [0.50, 1.70, 0.60],
                [1.20, 1.68, 0.60],
            ],
        ),
        hull(
            Material::Rubber,
            &[
                [-0.50, 1.00, 0.72],
                [1.85, 1.00, 0.72],
                [-0.40, 1.38, 0.64],
                [1.20, 1.38, 0.64],
            ],
        ),
        block(
            Material::Rubber,
            [-1.00, -0.88],
            [-0.80, 0.80],
            [0.30, 0.52],
        ),
        block(Material::Rubber, [3.40, 3.60], [-0.72, 0.72], [0.28, 0.48]),
        block(PLATE, [-1.00, -0.96], [-0.26, 0.26], [0.80, 0.91]),
        block(PLATE, [3.58, 3.60], [-0.26, 0.26], [0.50, 0.61]),
    ];
    parts.extend(pillars([[0.55, 1.12], [0.58, 1.61]], [0.84, 0.69], 0.10));
    parts.extend(pillars([[-0.90, 1.12], [-0.70, 1.61]], [0.79, 0.67], 0.22));
    parts.extend(pair(TAIL_LAMP, [-0.99, -0.84], [0.62, 0.86], [0.86, 1.14]));
    parts.extend(pair(HEADLAMP, [3.34, 3.55], [0.44, 0.78], [0.76, 0.91]));
    parts.extend(mirrors(1.75, 1.12, 0.86, 0.94));
    parts.extend(wheels(VehicleModel::Suv, 0.36, 0.24));
    parts
}
