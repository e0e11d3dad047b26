use std::ops::Range;

use nalgebra::{Point3, Vector3};

use crate::RayScene;

/// No shadow is longer.
const REACH_M: f32 = 80.0;
/// By how much the extents of a part reach beyond it, against rounding.
const MARGIN_M: f32 = 0.01;
const SMALLEST_CELL_M: f32 = 1.0;
const MOST_CELLS: f32 = 65_536.0;

/// What stands between a point and the sun.
///
/// All rays to the sun are parallel: seen along them each is a point of a plane. The plane is cut
/// into square cells, each with the parts that it shows.
pub(crate) struct Sunlight<'a> {
    rays: &'a RayScene,
    sun: Vector3<f32>,
    /// Two directions across the sun's, and that.
    axes: [Vector3<f32>; 3],
    extents: Vec<Extent>,
    corner: [f32; 2],
    cells_per_m: f32,
    size: [usize; 2],
    /// Where the list of each cell begins, and where the last one ends.
    starts: Vec<u32>,
    parts: Vec<u32>,
}

/// Least and greatest coordinates along the axes.
type Extent = [[f32; 2]; 3];

impl<'a> Sunlight<'a> {
    pub(crate) fn new(rays: &'a RayScene, sun: &Vector3<f32>) -> Self {
        let right = sun.cross(&Vector3::ith(sun.iamin(), 1.0)).normalize();
        let axes = [right, sun.cross(&right), *sun];
        let extent = |vertices: &[Point3<f32>]| {
            axes.map(|axis| {
                let along = vertices.iter().map(|vertex| axis.dot(&vertex.coords));
                along.fold([f32::MAX, f32::MIN], |[low, high], at| {
                    [low.min(at - MARGIN_M), high.max(at + MARGIN_M)]
                })
            })
        };
        let extents: Vec<_> = rays.solids().map(|solid| extent(solid.vertices)).collect();
        let bounds = [0, 1].map(|axis| {
            extents
                .iter()
                .map(|extent| extent[axis])
                .fold([f32::MAX, f32::MIN], |[low, high], [from, to]| {
                    [low.min(from), high.max(to)]
                })
        });
        let size_m = bounds.map(|[low, high]| (high - low).max(0.0));
        let cell_m = (size_m[0] * size_m[1] / MOST_CELLS)
            .sqrt()
            .max(SMALLEST_CELL_M);
        let mut sunlight = Self {
            rays,
            sun: *sun,
            axes,
            extents: Vec::new(),
            corner: bounds.map(|[low, _]| low),
            cells_per_m: 1.0 / cell_m,
            size: size_m.map(|size_m| (size_m / cell_m) as usize + 1),
            starts: Vec::new(),
            parts: Vec::new(),
        };
        sunlight.fill(&extents);
        sunlight.extents = extents;
        sunlight
    }

    /// Sorts the parts into the cells.
    fn fill(&mut self, extents: &[Extent]) {
        let cells = self.size[0] * self.size[1];
        let mut ends = vec![0; cells + 1];
        for extent in extents {
            self.cells(extent).for_each(|cell| ends[cell] += 1);
        }
        let mut sum = 0;
        for end in &mut ends {
            sum += *end;
            *end = sum;
        }
        self.parts = vec![0; sum as usize];
        // From the last part on, so that the lists end up in the order of the parts.
        for (part, extent) in extents.iter().enumerate().rev() {
            for cell in self.cells(extent) {
                ends[cell] -= 1;
                self.parts[ends[cell] as usize] = part as u32;
            }
        }
        self.starts = ends;
    }

    /// The cells that an extent reaches.
    fn cells(&self, extent: &Extent) -> impl Iterator<Item = usize> + use<> {
        let [columns, rows] = [0, 1].map(|axis| self.cell_range(axis, extent[axis]));
        let width = self.size[0];
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    fn cell_range(&self, axis: usize, [from, to]: [f32; 2]) -> Range<usize> {
        let cell = |at: f32| ((at - self.corner[axis]) * self.cells_per_m) as usize;
        cell(from)..(cell(to) + 1).min(self.size[axis])
    }

    /// Whether a part of the scene keeps the sun off a point.
    pub(crate) fn is_shaded(&self, point: &Point3<f32>) -> bool {
        let at = self.axes.map(|axis| axis.dot(&point.coords));
        let [column, row] = [0, 1].map(|axis| (at[axis] - self.corner[axis]) * self.cells_per_m);
        let [columns, rows] = self.size;
        if column < 0.0 || row < 0.0 || column >= columns as f32 || row >= rows as f32 {
            return false;
        }
        let cell = row as usize * columns + column as usize;
        let parts = self.starts[cell] as usize..self.starts[cell + 1] as usize;
        self.parts[parts].iter().any(|&part| {
            let [across, down, along] = &self.extents[part as usize];
            across[0] <= at[0]
                && at[0] <= across[1]
                && down[0] <= at[1]
                && at[1] <= down[1]
                && at[2] <= along[1]
                && at[2] + REACH_M >= along[0]
                && self.rays.is_met(part, point, &self.sun, REACH_M)
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn shade_is_where_a_ray_to_the_sun_is_blocked() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut shaded = 0;
        for index in 0..4 {
            let sampled = covista_traffic::sample_scene(11, index);
            let rays = RayScene::new(&sampled.scene);
            let sun = Vector3::new(
                rng.random_range(-1.0..1.0),
                rng.random_range(-1.0..1.0),
                0.4,
            )
            .normalize();
            let sunlight = Sunlight::new(&rays, &sun);
            let corners: Vec<_> = rays.solids().flat_map(|solid| solid.vertices).collect();
            for _ in 0..2000 {
                let about = corners[rng.random_range(0..corners.len())];
                let mut near = || rng.random_range(-3.0..3.0);
                let point = about + Vector3::new(near(), near(), near());
                let expected = rays.occluded(&point, &sun, REACH_M, None);
                assert_eq!(sunlight.is_shaded(&point), expected, "{point}");
                shaded += u32::from(expected);
            }
        }
        assert!((800..7200).contains(&shaded), "{shaded}");
    }

    #[test]
    fn nothing_shades_an_empty_scene() {
        let mut scene = crate::testing::empty_road();
        scene.vehicles.clear();
        let rays = RayScene::new(&scene);
        let sunlight = Sunlight::new(&rays, &Vector3::z());
        assert!(!sunlight.is_shaded(&Point3::origin()));
    }
}
