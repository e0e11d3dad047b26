use covista_traffic::Terrain;
use covista_world::{FrenetPoint, Road};
use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use crate::pavement::GroundPatch;
use crate::pixel_rays::PixelRays;

/// Pixels across and down in the coarsest cells; powers of two.
pub(crate) const TILE_PX: [usize; 2] = [16, 8];
const HORIZON_M: f64 = 3000.0;
/// Deviation in pixels up to which a cell is interpolated.
const TOLERANCE_PX: f64 = 0.2;
/// Over a cell longer than this no guess leads to all its Frenet coordinates.
const HINT_REACH_M: f64 = 60.0;
/// Distance over which the slope of the ground is taken.
const SLOPE_OVER_M: f64 = 0.05;

/// The ground behind the pixels of an image, in road coordinates.
///
/// On a plane the reciprocal of the depth is affine in (u, v), and so are, times this, the
/// coordinates along and across a straight road. Hence the picture is cut into cells, each is
/// interpolated between its corners, and halved where its middle shows that this would be wrong:
/// at crests and horizons, in bends far away, where the nearest point of the road jumps.
pub(crate) struct GroundView<'a> {
    rays: PixelRays,
    terrain: &'a Terrain,
    road: &'a Road,
    /// Metres across that a pixel takes up at a depth of one metre.
    pixel_angle: f64,
    columns: usize,
    nodes: Vec<Option<Node>>,
}

/// The ground behind the pixels of one tile, row by row; `None` where there is none.
pub(crate) type GroundTile = [[Option<Ground>; TILE_PX[0]]; TILE_PX[1]];

/// What one pixel sees of the ground.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ground {
    /// Along the optical axis.
    pub(crate) depth_m: f64,
    pub(crate) patch: GroundPatch,
}

/// A point of the ground that the ray through (u, v) meets.
#[derive(Debug, Clone, Copy)]
struct Node {
    nearness: f64,
    position: Vector2<f64>,
    frenet: FrenetPoint,
}

/// A rectangle of pixels and the ground at its four corners: those of the upper edge, from the
/// left, then those of the lower one.
struct Cell {
    u: usize,
    v: usize,
    size_px: [usize; 2],
    corners: [Option<Node>; 4],
}

impl<'a> GroundView<'a> {
    pub(crate) fn new(
        rays: PixelRays,
        terrain: &'a Terrain,
        road: &'a Road,
        size_px: [usize; 2],
        focal_px: f64,
    ) -> Self {
        let [columns, rows] = [0, 1].map(|axis| size_px[axis].div_ceil(TILE_PX[axis]) + 1);
        let mut view = Self {
            rays,
            terrain,
            road,
            pixel_angle: 1.0 / focal_px,
            columns,
            nodes: Vec::new(),
        };
        view.nodes = (0..rows * columns)
            .into_par_iter()
            .with_min_len(columns)
            .map(|index| {
                let (u, v) = (index % columns * TILE_PX[0], index / columns * TILE_PX[1]);
                view.node(u as f64, v as f64, None)
            })
            .collect();
        view
    }

    /// The ground behind the tile in this column and row of tiles.
    pub(crate) fn tile(&self, column: usize, row: usize) -> GroundTile {
        let corner = row * self.columns + column;
        let node = |index: usize| self.nodes.get(index).copied().flatten();
        let cell = Cell {
            u: column * TILE_PX[0],
            v: row * TILE_PX[1],
            size_px: TILE_PX,
            corners: [0, 1, self.columns, self.columns + 1].map(|step| node(corner + step)),
        };
        let mut tile = [[None; TILE_PX[0]]; TILE_PX[1]];
        self.fill(&cell, &mut tile);
        tile
    }

    fn fill(&self, cell: &Cell, tile: &mut GroundTile) {
        let [width, height] = cell.size_px;
        let hint_m = cell.hint_m();
        let (u, v) = (cell.u as f64, cell.v as f64);
        if width == 1 {
            *cell.pixel(tile, 0, 0) = self.exact(u, v, hint_m);
            return;
        }
        let at = |column: usize, row: usize| self.node(u + column as f64, v + row as f64, hint_m);
        let [a, b, c, d] = cell.corners;
        // Of a single row only the upper edge is drawn.
        let (x, y) = (width / 2, height / 2);
        let drawn = if height == 1 {
            &cell.corners[..2]
        } else {
            &cell.corners[..]
        };
        let middle = at(x, y);
        match (Sheet::new(cell), middle) {
            (_, None) if drawn.iter().all(Option::is_none) => {}
            (Some(sheet), Some(middle))
                if sheet.meets(x as f64, y as f64, &middle, self.pixel_angle) =>
            {
                sheet.draw(cell, &self.rays, tile);
            }
            _ if height > 1 => {
                let (left, right) = (at(0, y), at(width, y));
                for (row, corners) in [(0, [a, b, left, right]), (y, [left, right, c, d])] {
                    self.fill(&cell.part(0, row, [width, y], corners), tile);
                }
            }
            _ => {
                let below = at(x, 1);
                for (column, corners) in [(0, [a, middle, c, below]), (x, [middle, b, below, d])] {
                    self.fill(&cell.part(column, 0, [x, 1], corners), tile);
                }
            }
        }
    }

    fn node(&self, u: f64, v: f64, hint_m: Option<f64>) -> Option<Node> {
        let ray = self.rays.ray(u, v);
        let length = ray.norm();
        let distance_m = self
            .terrain
            .meet(&self.rays.eye, &(ray / length), HORIZON_M)?;
        let depth_m = (distance_m / length).max(1e-3);
        let position = (self.rays.eye + ray * depth_m).xy().coords;
        Some(Node {
            nearness: 1.0 / depth_m,
            position,
            frenet: match hint_m {
                Some(s_m) => self.road.to_frenet_near(position, s_m),
                None => self.road.to_frenet(position),
            },
        })
    }

    /// The pixel by itself; its footprint is that on the tangent plane.
    fn exact(&self, u: f64, v: f64, hint_m: Option<f64>) -> Option<Ground> {
        let node = self.node(u, v, hint_m)?;
        let depth_m = 1.0 / node.nearness;
        let height_m = |x: f64, y: f64| self.terrain.height_m(node.position + Vector2::new(x, y));
        let here_m = height_m(0.0, 0.0);
        let up = Vector3::new(
            here_m - height_m(SLOPE_OVER_M, 0.0),
            here_m - height_m(0.0, SLOPE_OVER_M),
            SLOPE_OVER_M,
        );
        let ray = self.rays.ray(u, v);
        let facing = up.dot(&ray).min(-1e-4 * SLOPE_OVER_M);
        let forward = self.road.reference(node.frenet.s_m).0.forward();
        let [right, down] = self.rays.steps().map(|step| {
            let moved = ((step - ray * (up.dot(&step) / facing)) * depth_m).xy();
            Vector2::new(forward.dot(&moved), forward.perp(&moved))
        });
        Some(Ground {
            depth_m,
            patch: GroundPatch {
                position: node.position,
                s_m: node.frenet.s_m,
                d_m: node.frenet.d_m,
                spread_s_m: norm(right.x, down.x),
                spread_d_m: norm(right.y, down.y),
            },
        })
    }
}

impl Cell {
    fn part(
        &self,
        column: usize,
        row: usize,
        size_px: [usize; 2],
        corners: [Option<Node>; 4],
    ) -> Self {
        Self {
            u: self.u + column,
            v: self.v + row,
            size_px,
            corners,
        }
    }

    fn pixel<'t>(
        &self,
        tile: &'t mut GroundTile,
        column: usize,
        row: usize,
    ) -> &'t mut Option<Ground> {
        &mut tile[self.v % TILE_PX[1] + row][self.u % TILE_PX[0] + column]
    }

    /// Where about along the road the cell lies, unless it is too long to say or the nearest point
    /// of the road jumps within it.
    fn hint_m(&self) -> Option<f64> {
        let [Some(a), Some(b), Some(c), Some(d)] = self.corners else {
            return None;
        };
        let steady = |p: Node, q: Node| {
            let along = Vector2::new(p.frenet.s_m - q.frenet.s_m, p.frenet.d_m - q.frenet.d_m);
            along.norm_squared() <= 9.0 * (p.position - q.position).norm_squared()
                && along.x.abs() < HINT_REACH_M
        };
        (steady(a, d) && steady(b, c) && steady(a, b))
            .then(|| (a.frenet.s_m + b.frenet.s_m + c.frenet.s_m + d.frenet.s_m) / 4.0)
    }
}

/// Nearness and, times it, the coordinates along and across the road; bilinear over a cell.
struct Sheet {
    from_s_m: f64,
    corner: Vector3<f64>,
    per_column: Vector3<f64>,
    per_row: Vector3<f64>,
    twist: Vector3<f64>,
}

impl Sheet {
    fn new(cell: &Cell) -> Option<Self> {
        let [Some(a), Some(b), Some(c), Some(d)] = cell.corners else {
            return None;
        };
        // Counted from nearby, so that differences keep their digits.
        let from_s_m = a.frenet.s_m;
        let [a, b, c, d] = [a, b, c, d].map(|node| {
            Vector3::new(1.0, node.frenet.s_m - from_s_m, node.frenet.d_m) * node.nearness
        });
        let size_px = Vector2::from(cell.size_px.map(|size| size as f64));
        Some(Self {
            from_s_m,
            corner: a,
            per_column: (b - a) / size_px.x,
            per_row: (c - a) / size_px.y,
            twist: (d - c - b + a) / (size_px.x * size_px.y),
        })
    }

    /// Depth, coordinates along and across, and how the last two change per column and per row.
    fn at(&self, column: f64, row: f64) -> [f64; 7] {
        let per_column = self.per_column + self.twist * row;
        let per_row = self.per_row + self.twist * column;
        let value = self.corner + self.per_row * row + per_column * column;
        let depth_m = 1.0 / value.x;
        let (s_m, d_m) = (value.y * depth_m, value.z * depth_m);
        let change = |along: f64, at: f64, nearness: f64| (along - at * nearness) * depth_m;
        [
            depth_m,
            self.from_s_m + s_m,
            d_m,
            change(per_column.y, s_m, per_column.x),
            change(per_column.z, d_m, per_column.x),
            change(per_row.y, s_m, per_row.x),
            change(per_row.z, d_m, per_row.x),
        ]
    }

    /// Whether the true ground at a pixel is, to a fraction of one, where it would be drawn.
    fn meets(&self, column: f64, row: f64, truth: &Node, pixel_angle: f64) -> bool {
        let [depth_m, s_m, d_m, s_right, _, s_down, _] = self.at(column, row);
        let nearness_step = norm(self.per_column.x, self.per_row.x);
        (truth.frenet.d_m - d_m).abs() < TOLERANCE_PX * pixel_angle * depth_m
            && (truth.frenet.s_m - s_m).abs() < TOLERANCE_PX * norm(s_right, s_down)
            && (truth.nearness - 1.0 / depth_m).abs() < TOLERANCE_PX * nearness_step
    }

    fn draw(&self, cell: &Cell, rays: &PixelRays, tile: &mut GroundTile) {
        for row in 0..cell.size_px[1] {
            for column in 0..cell.size_px[0] {
                let [depth_m, s_m, d_m, s_right, d_right, s_down, d_down] =
                    self.at(column as f64, row as f64);
                let (u, v) = ((cell.u + column) as f64, (cell.v + row) as f64);
                *cell.pixel(tile, column, row) = Some(Ground {
                    depth_m,
                    patch: GroundPatch {
                        position: rays.point(u, v, depth_m).xy().coords,
                        s_m,
                        d_m,
                        spread_s_m: norm(s_right, s_down),
                        spread_d_m: norm(d_right, d_down),
                    },
                });
            }
        }
    }
}

/// `f64::hypot` guards against overflow, which takes most of its time.
fn norm(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}
