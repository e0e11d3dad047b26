use covista_traffic::Material;
use nalgebra::{Point3, Vector3};

use crate::ground::{Ground, GroundView, TILE_PX};
use crate::noise::octaves;
use crate::pixel_rays::PixelRays;
use crate::solids::{Face, Fragment, Layers, RowBuffer, Solids};
use crate::{ObjectRef, Viewpoint};

const LEAVES_SEED: u32 = 0x1EAF;
/// Wavelengths in metres and weights of the gaps between leaves.
const LEAF_BANDS: [(f64, f32); 3] = [(0.9, 0.5), (0.35, 0.4), (0.12, 0.3)];

/// What the pixels of an image show.
pub(crate) struct Sight<'a> {
    pub(crate) rays: PixelRays,
    ground: GroundView<'a>,
    solids: Solids,
    width: usize,
    height: usize,
}

/// What one pixel shows.
#[derive(Clone, Copy)]
pub(crate) enum Seen<'s> {
    Sky,
    Ground(Ground),
    /// A vehicle or scenery at a depth along the optical axis.
    Solid(&'s Face, f32),
}

impl Seen<'_> {
    /// Depth along the optical axis; infinite in the sky.
    pub(crate) fn depth_m(&self) -> f32 {
        match self {
            Self::Sky => f32::INFINITY,
            Self::Ground(ground) => ground.depth_m as f32,
            Self::Solid(_, depth_m) => *depth_m,
        }
    }
}

/// Neighbouring pixels of one row, from `column` to the right.
pub(crate) struct Run<'s> {
    pub(crate) row: usize,
    pub(crate) column: usize,
    pub(crate) seen: [Seen<'s>; TILE_PX[0]],
    pub(crate) len: usize,
}

impl<'a> Sight<'a> {
    /// Rows that are looked at together.
    pub(crate) const BAND_ROWS: usize = TILE_PX[1];

    pub(crate) fn new(view: &Viewpoint<'a>) -> Self {
        let intrinsics = &view.calibration.intrinsics;
        let world_from_camera = view.world_from_camera();
        let rays = PixelRays::new(intrinsics, &world_from_camera);
        let (width, height) = (intrinsics.width_px as usize, intrinsics.height_px as usize);
        let own = ObjectRef::Vehicle(view.ego.id);
        let others = view.rays.solids().filter(|solid| solid.part.object != own);
        Self {
            rays,
            ground: GroundView::new(
                rays,
                &view.scene.terrain,
                &view.scene.road,
                [width, height],
                intrinsics.fx_px,
            ),
            solids: Solids::new(others, intrinsics, &world_from_camera, &rays),
            width,
            height,
        }
    }

    /// Looks at one band of rows, run by run.
    pub(crate) fn look(&self, band: usize, mut show: impl FnMut(&Run)) {
        let first_row = band * Self::BAND_ROWS;
        let rows = Self::BAND_ROWS.min(self.height - first_row);
        let layers = self.solid_rows(first_row, rows);
        for tile in 0..self.width.div_ceil(TILE_PX[0]) {
            let column = tile * TILE_PX[0];
            let len = TILE_PX[0].min(self.width - column);
            let ground = self.ground.tile(tile, band);
            for row in 0..rows {
                let layers = &layers[row * self.width + column..][..len];
                let mut run = Run {
                    row: first_row + row,
                    column,
                    seen: [Seen::Sky; TILE_PX[0]],
                    len,
                };
                for (i, layers) in layers.iter().enumerate() {
                    let (u, v) = ((column + i) as f64, run.row as f64);
                    run.seen[i] = self.pixel(u, v, layers, ground[row][i]);
                }
                show(&run);
            }
        }
    }

    fn solid_rows(&self, first_row: usize, rows: usize) -> Vec<Layers> {
        let mut layers = vec![[Fragment::NOTHING; 2]; rows * self.width];
        let mut buffer = RowBuffer::new(self.width);
        let candidates = self
            .solids
            .between(first_row as f64, (first_row + rows - 1) as f64);
        for (row, line) in layers.chunks_exact_mut(self.width).enumerate() {
            let v = (first_row + row) as f64;
            self.solids.draw(&candidates, v, line, &mut buffer);
        }
        layers
    }

    fn pixel(&self, u: f64, v: f64, layers: &Layers, ground: Option<Ground>) -> Seen<'_> {
        let behind = ground.map_or(0.0, |ground| (1.0 / ground.depth_m) as f32);
        let seen = ground.map_or(Seen::Sky, Seen::Ground);
        let [nearest, next] = *layers;
        if nearest.nearness <= behind {
            return seen;
        }
        let solid =
            |fragment: Fragment| Seen::Solid(self.solids.face(fragment), 1.0 / fragment.nearness);
        if self.is_gap(u, v, nearest) {
            if next.nearness > behind {
                solid(next)
            } else {
                seen
            }
        } else {
            solid(nearest)
        }
    }

    /// Whether one looks between leaves here.
    fn is_gap(&self, u: f64, v: f64, fragment: Fragment) -> bool {
        let face = self.solids.face(fragment);
        if face.material != Material::Foliage {
            return false;
        }
        let ray = self.rays.ray(u, v);
        let point = self.rays.eye + ray * f64::from(1.0 / fragment.nearness);
        is_leaf_gap(&point, &face.normal, &ray.cast::<f32>().normalize())
    }
}

/// Whether one looks between the leaves here, as one does most at the rim of a crown.
fn is_leaf_gap(p: &Point3<f64>, normal: &Vector3<f32>, direction: &Vector3<f32>) -> bool {
    let (across, up) = (p.x + 0.7 * p.y, p.z - 0.4 * p.y);
    let thickness = octaves(LEAVES_SEED, across, up, 0.01, &LEAF_BANDS);
    thickness > 0.9 * normal.dot(direction).abs() - 0.15
}
