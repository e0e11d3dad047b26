//! The sweep to pillars: points of each cell of a grid on the ground, with their features.

use covista_world::PointCloud;

use crate::card::PointPillarsSpec;

/// x, y, z, reflectance, offsets from the mean of the pillar's points (x, y, z) and from the
/// pillar's centre (x, y).
pub const FEATURES: usize = 9;

/// The detector's input.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct Pillars {
    /// [pillars, points of a pillar, [`FEATURES`]], zero padded, LIDAR frame, metres.
    pub features: Vec<f32>,
    /// `iy * nx + ix` of each pillar, ascending.
    pub coords: Vec<i64>,
}

/// Sorts points into pillars; the order of the points in the sweep makes no difference.
///
/// Too many points in a pillar are thinned out by a hash of their coordinates, so that the kept
/// ones are spread like the sweep's; too many pillars are thinned out evenly over the grid.
#[derive(Debug)]
pub struct PillarGrid {
    spec: PointPillarsSpec,
    nx: usize,
    ny: usize,
    /// Start of each pillar's points in `points`, and the end of the last.
    starts: Vec<u32>,
    /// Cell of each point of the sweep, or `OUTSIDE`.
    cells: Vec<u32>,
    points: Vec<[f32; 4]>,
    pillars: Pillars,
}

const OUTSIDE: u32 = u32::MAX;

impl PillarGrid {
    /// The grid of a detector.
    pub fn new(spec: &PointPillarsSpec) -> Self {
        let [nx, ny] = spec.grid();
        Self {
            spec: spec.clone(),
            nx,
            ny,
            starts: vec![0; nx * ny + 1],
            cells: Vec::new(),
            points: Vec::new(),
            pillars: Pillars::default(),
        }
    }

    /// Least x, y, z and greatest x, y, z in metres in the LIDAR frame.
    pub fn range_m(&self) -> [f32; 6] {
        self.spec.range_m
    }

    /// The pillars of a sweep whose numbers are finite.
    pub fn apply(&mut self, sweep: &PointCloud) -> &Pillars {
        self.sort_into_cells(sweep);
        let occupied: Vec<usize> = (0..self.nx * self.ny)
            .filter(|&cell| self.starts[cell] < self.starts[cell + 1])
            .collect();
        let kept = occupied.len().min(self.spec.max_pillars);
        let stride = self.spec.max_points_per_pillar * FEATURES;
        self.pillars.coords.clear();
        self.pillars.features.clear();
        self.pillars.features.resize(kept * stride, 0.0);
        for (i, features) in self.pillars.features.chunks_exact_mut(stride).enumerate() {
            let cell = occupied[i * occupied.len() / kept];
            self.pillars.coords.push(cell as i64);
            let [start, end] = [self.starts[cell], self.starts[cell + 1]].map(|at| at as usize);
            let points = &mut self.points[start..end];
            points.sort_unstable_by_key(canonical_key);
            let center = [cell % self.nx, cell / self.nx];
            let center: [f32; 2] = std::array::from_fn(|axis| {
                self.spec.range_m[axis] + (center[axis] as f32 + 0.5) * self.spec.pillar_m
            });
            describe(points, center, features);
        }
        &self.pillars
    }

    /// Counting sort of the points in range by their cell.
    fn sort_into_cells(&mut self, sweep: &PointCloud) {
        self.cells.clear();
        self.starts.fill(0);
        for point in &sweep.points {
            let cell = self.cell(point);
            self.cells.push(cell);
            if cell != OUTSIDE {
                self.starts[cell as usize] += 1;
            }
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.points.resize(end as usize, [0.0; 4]);
        for (point, &cell) in sweep.points.iter().zip(&self.cells) {
            if cell != OUTSIDE {
                let start = &mut self.starts[cell as usize];
                *start -= 1;
                self.points[*start as usize] = *point;
            }
        }
    }

    fn cell(&self, point: &[f32; 4]) -> u32 {
        let low = &self.spec.range_m[..3];
        let high = &self.spec.range_m[3..];
        if !(0..3).all(|axis| low[axis] <= point[axis] && point[axis] < high[axis]) {
            return OUTSIDE;
        }
        let index = |axis: usize, count: usize| {
            (((point[axis] - low[axis]) / self.spec.pillar_m) as usize).min(count - 1)
        };
        (index(1, self.ny) * self.nx + index(0, self.nx)) as u32
    }
}

/// A hash of the point's coordinates, then the coordinates: a total order without a direction.
fn canonical_key(point: &[f32; 4]) -> (u32, [u32; 4]) {
    let bits = point.map(f32::to_bits);
    let hash = bits.iter().fold(0x811c_9dc5_u32, |hash, bits| {
        (hash ^ bits).wrapping_mul(0x9E37_79B1).rotate_left(15)
    });
    (hash, bits)
}

/// Fills the features of one pillar from its points, as many as there is room for.
fn describe(points: &[[f32; 4]], center: [f32; 2], features: &mut [f32]) {
    let room = features.len() / FEATURES;
    let points = &points[..points.len().min(room)];
    let mean: [f32; 3] = std::array::from_fn(|axis| {
        let sum: f64 = points.iter().map(|point| f64::from(point[axis])).sum();
        (sum / points.len() as f64) as f32
    });
    for (point, features) in points.iter().zip(features.chunks_exact_mut(FEATURES)) {
        let [x, y, z, _] = *point;
        features[..4].copy_from_slice(point);
        features[4..].copy_from_slice(&[
            x - mean[0],
            y - mean[1],
            z - mean[2],
            x - center[0],
            y - center[1],
        ]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid() -> PillarGrid {
        PillarGrid::new(&PointPillarsSpec {
            range_m: [-4.0, -2.0, -3.0, 4.0, 2.0, 1.0],
            pillar_m: 0.5,
            max_pillars: 40,
            max_points_per_pillar: 4,
            score_threshold: 0.5,
            nms_iou: 0.1,
            anchors: Vec::new(),
        })
    }

    fn pillars(points: &[[f32; 4]]) -> Pillars {
        let sweep = PointCloud {
            points: points.to_vec(),
        };
        grid().apply(&sweep).clone()
    }

    #[test]
    fn features_in_closed_form() {
        let pillars = pillars(&[
            [0.1, -0.3, -1.0, 0.2],
            [0.3, -0.1, -2.0, 0.4],
            [9.0, 0.0, 0.0, 0.5],
            [0.0, 0.0, 1.0, 0.5],
        ]);
        // x in [0, 0.5) is column 8, y in [-0.5, 0) row 3; the other two are out of range.
        assert_eq!(pillars.coords, [3 * 16 + 8]);
        let mut rows: Vec<_> = pillars
            .features
            .chunks(FEATURES)
            .map(<[f32]>::to_vec)
            .collect();
        assert!(
            rows.split_off(2)
                .iter()
                .flatten()
                .all(|value| value.to_bits() == 0)
        );
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let expected = [
            [0.1, -0.3, -1.0, 0.2, -0.1, -0.1, 0.5, -0.15, -0.05],
            [0.3, -0.1, -2.0, 0.4, 0.1, 0.1, -0.5, 0.05, 0.15],
        ];
        for (value, expected) in rows.iter().flatten().zip(expected.iter().flatten()) {
            assert!((value - expected).abs() < 1e-6, "{rows:?}");
        }
    }

    #[test]
    fn an_empty_sweep_makes_no_pillar() {
        assert_eq!(pillars(&[]), Pillars::default());
    }

    #[test]
    fn too_many_pillars_are_thinned_out_over_the_whole_grid() {
        let points: Vec<_> = (0..128)
            .map(|i| {
                [
                    (i % 16) as f32 * 0.5 - 3.9,
                    (i / 16) as f32 * 0.5 - 1.9,
                    0.0,
                    0.0,
                ]
            })
            .collect();
        let coords = pillars(&points).coords;
        assert_eq!(coords.len(), 40);
        assert!(
            coords
                .windows(2)
                .all(|pair| (2..=4).contains(&(pair[1] - pair[0])))
        );
    }

    proptest! {
        #[test]
        fn the_order_of_the_points_makes_no_difference(
            points in prop::collection::vec([-5f32..5.0, -3f32..3.0, -1f32..0.0, 0f32..1.0], 0..300),
            seed in any::<u64>(),
        ) {
            let mut shuffled = points.clone();
            let mut state = seed;
            for i in (1..shuffled.len()).rev() {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                shuffled.swap(i, (state >> 33) as usize % (i + 1));
            }
            // Bit for bit, so that the same sweep always gives the same detections.
            prop_assert_eq!(pillars(&points), pillars(&shuffled));
        }
    }
}
