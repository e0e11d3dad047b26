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
/// A pillar's points come in the order of a hash of their numbers, which has no direction: too many
/// are cut off there, and the kept ones are spread like the sweep's. Of too many pillars those with
/// the least hashes of their cells stay, spread over the grid. `voxelize` in models/training gives
/// the same bytes.
#[derive(Debug)]
pub struct PillarGrid {
    spec: PointPillarsSpec,
    nx: usize,
    ny: usize,
    /// Start of each pillar's points in `points`, and the end of the last.
    starts: Vec<u32>,
    /// Cell of each point of the sweep, or `OUTSIDE`.
    cells: Vec<u32>,
    points: Vec<HashedPoint>,
    pillars: Pillars,
}

/// A point with [`point_hash`] of it.
#[derive(Debug, Clone, Copy, Default)]
struct HashedPoint {
    hash: u32,
    point: [f32; 4],
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
        let cells = self.kept_cells();
        let room = self.spec.max_points_per_pillar;
        let stride = room * FEATURES;
        self.pillars.coords.clear();
        self.pillars.features.clear();
        self.pillars.features.resize(cells.len() * stride, 0.0);
        for (&cell, features) in cells
            .iter()
            .zip(self.pillars.features.chunks_exact_mut(stride))
        {
            self.pillars.coords.push(cell as i64);
            let [start, end] = [self.starts[cell], self.starts[cell + 1]].map(|at| at as usize);
            let points = first_by_hash(&mut self.points[start..end], room);
            let center = [cell % self.nx, cell / self.nx];
            let center: [f32; 2] = std::array::from_fn(|axis| {
                self.spec.range_m[axis] + (center[axis] as f32 + 0.5) * self.spec.pillar_m
            });
            describe(points, center, features);
        }
        &self.pillars
    }

    /// The cells of the pillars, ascending.
    fn kept_cells(&self) -> Vec<usize> {
        let is_occupied = |cell: &usize| self.starts[*cell] < self.starts[cell + 1];
        let mut cells: Vec<usize> = (0..self.nx * self.ny).filter(is_occupied).collect();
        if cells.len() > self.spec.max_pillars {
            cells.select_nth_unstable_by_key(self.spec.max_pillars, |cell| cell_hash(*cell));
            cells.truncate(self.spec.max_pillars);
            cells.sort_unstable();
        }
        cells
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
        self.points.resize(end as usize, HashedPoint::default());
        for (point, &cell) in sweep.points.iter().zip(&self.cells) {
            if cell != OUTSIDE {
                let start = &mut self.starts[cell as usize];
                *start -= 1;
                self.points[*start as usize] = HashedPoint {
                    hash: point_hash(point),
                    point: *point,
                };
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

/// The `room` first of the points by their hashes, then by their bits, in that order.
fn first_by_hash(points: &mut [HashedPoint], room: usize) -> &[HashedPoint] {
    let key = |of: &HashedPoint| (of.hash, of.point.map(f32::to_bits));
    if points.len() > room {
        points.select_nth_unstable_by_key(room, key);
    }
    let kept = points.len().min(room);
    points[..kept].sort_unstable_by_key(key);
    &points[..kept]
}

/// A hash of the bits of x, y, z and the reflectance.
fn point_hash(point: &[f32; 4]) -> u32 {
    const FACTORS: [u32; 4] = [0x9E37_79B1, 0x85EB_CA77, 0xC2B2_AE3D, 0x27D4_EB2F];
    let mixed = point.iter().zip(FACTORS);
    scrambled(mixed.fold(0, |hash, (value, factor)| {
        hash ^ value.to_bits().wrapping_mul(factor)
    }))
}

/// A hash of a cell's index; no two cells have the same.
fn cell_hash(cell: usize) -> u32 {
    scrambled((cell as u32).wrapping_mul(0x9E37_79B1))
}

/// Brings the upper bits down to all others.
fn scrambled(mut hash: u32) -> u32 {
    hash ^= hash >> 15;
    hash = hash.wrapping_mul(0x2C1B_3C6D);
    hash ^ (hash >> 12)
}

/// Fills the features of one pillar from its points, no more than there is room for.
fn describe(points: &[HashedPoint], center: [f32; 2], features: &mut [f32]) {
    let mean: [f32; 3] = std::array::from_fn(|axis| {
        let sum: f64 = points.iter().map(|of| f64::from(of.point[axis])).sum();
        (sum / points.len() as f64) as f32
    });
    for (HashedPoint { point, .. }, features) in
        points.iter().zip(features.chunks_exact_mut(FEATURES))
    {
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
        assert!(coords.is_sorted());
        // All eight rows of 16 cells are in use; each keeps some.
        let is_used = |part: i64| coords.iter().any(|cell| cell / 16 == part);
        assert!((0..8).all(is_used), "{coords:?}");
        // One more pillar pushes out at most one.
        let fewer = pillars(&points[1..]).coords;
        let lost = fewer.iter().filter(|cell| !coords.contains(cell)).count();
        assert!(lost <= 1, "{lost}");
    }

    #[test]
    fn all_points_in_one_pillar_leave_as_many_as_there_is_room_for() {
        let points: Vec<_> = (0..2_000_000)
            .map(|i| [0.1, 0.1, -2.0 + 1e-6 * i as f32, 0.5])
            .collect();
        let pillars = pillars(&points);
        assert_eq!(pillars.coords, [4 * 16 + 8]);
        let heights: Vec<f32> = pillars
            .features
            .chunks(FEATURES)
            .map(|row| row[2])
            .collect();
        assert!(
            heights.iter().all(|z| (-2.0..0.0).contains(z)),
            "{heights:?}"
        );
        // Spread over the height, not its first ones.
        assert!(heights.iter().any(|z| *z > -1.5), "{heights:?}");
    }

    #[test]
    fn pillars_are_those_of_the_training() {
        let fixture = |name: &str| {
            let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases");
            std::fs::read(folder.join(name)).expect("a fixture")
        };
        let cloud = fixture("pillars_cloud.bin");
        let (values, _) = cloud.as_chunks::<4>();
        let (points, _) = values.as_chunks::<4>();
        let sweep = PointCloud {
            points: points
                .iter()
                .map(|point| point.map(f32::from_le_bytes))
                .collect(),
        };
        let mut grid = PillarGrid::new(&PointPillarsSpec {
            range_m: [-69.12, -12.8, -3.0, 69.12, 12.8, 1.0],
            pillar_m: 0.16,
            max_pillars: 300,
            max_points_per_pillar: 32,
            ..grid().spec
        });
        let found = grid.apply(&sweep);
        assert_eq!(found.coords.len(), 300);
        let expected: toml::Table = String::from_utf8(fixture("pillars.toml"))
            .expect("text")
            .parse()
            .expect("hashes");
        let coords: Vec<u8> = found
            .coords
            .iter()
            .flat_map(|cell| cell.to_le_bytes())
            .collect();
        let features: Vec<u8> = found
            .features
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        for (name, bytes) in [("coords_sha256", coords), ("features_sha256", features)] {
            assert_eq!(
                expected[name].as_str(),
                Some(&*crate::runtime::hex_sha256(&bytes)),
                "{name}"
            );
        }
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
