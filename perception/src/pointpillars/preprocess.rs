//! The sweep to pillars: the points of each cell of a grid on the ground.

use covista_world::PointCloud;

use crate::card::PointPillarsSpec;

/// The pillars of a sweep, in the order of their cells.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct Pillars {
    /// `iy * nx + ix` of each pillar, ascending.
    pub cells: Vec<u32>,
    /// End of each pillar's points in `points`.
    pub ends: Vec<u32>,
    /// x, y, z in metres in the LIDAR frame, reflectance; pillar by pillar.
    pub points: Vec<[f32; 4]>,
    /// x, y of each pillar's centre, metres, LIDAR frame.
    pub centers_m: Vec<[f32; 2]>,
    /// Mean x, y, z of each pillar's points, metres, LIDAR frame.
    pub means_m: Vec<[f32; 3]>,
}

/// One of [`Pillars`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pillar<'a> {
    /// `iy * nx + ix`.
    pub cell: u32,
    /// x, y, z in metres in the LIDAR frame, reflectance; at least one.
    pub points: &'a [[f32; 4]],
    /// x, y of the centre, metres, LIDAR frame.
    pub center_m: [f32; 2],
    /// Mean x, y, z of the points, metres, LIDAR frame.
    pub mean_m: [f32; 3],
}

impl Pillars {
    /// One pillar after the other.
    pub fn iter(&self) -> impl Iterator<Item = Pillar<'_>> {
        let mut rest = self.points.as_slice();
        let mut start = 0;
        let places = self.centers_m.iter().zip(&self.means_m);
        let pillars = self.cells.iter().zip(&self.ends).zip(places);
        pillars.map(move |((&cell, &end), (&center_m, &mean_m))| {
            let points;
            (points, rest) = rest.split_at((end - start) as usize);
            start = end;
            Pillar {
                cell,
                points,
                center_m,
                mean_m,
            }
        })
    }
}

/// Sorts points into pillars; the order of the points in the sweep makes no difference to their
/// cells, points and means.
///
/// Where a pillar has too many points, those with the least hashes of their numbers stay, which has
/// no direction: they are spread like the sweep's. Of too many pillars those with the least hashes
/// of their cells stay, spread over the grid. `voxelize` in models/training gives the same bytes.
#[derive(Debug)]
pub struct PillarGrid {
    spec: PointPillarsSpec,
    nx: u32,
    ny: u32,
    /// Cell of each point of the sweep, `nx * ny` out of range.
    cells: Vec<u32>,
    /// A bit for each cell that holds a point.
    occupied: Vec<u64>,
    /// Points of each cell and out of range, 0 between frames; while they are sorted, where the next
    /// one goes.
    counts: Vec<u32>,
    pillars: Pillars,
}

impl PillarGrid {
    /// The grid of a detector.
    pub fn new(spec: &PointPillarsSpec) -> Self {
        let [nx, ny] = spec.grid();
        Self {
            spec: spec.clone(),
            nx: nx as u32,
            ny: ny as u32,
            cells: Vec::new(),
            occupied: vec![0; nx * ny / 64 + 1],
            counts: vec![0; nx * ny + 1],
            pillars: Pillars::default(),
        }
    }

    /// Least x, y, z and greatest x, y, z in metres in the LIDAR frame.
    pub fn range_m(&self) -> [f32; 6] {
        self.spec.range_m
    }

    /// The pillars of a sweep whose numbers are finite.
    pub fn apply(&mut self, sweep: &PointCloud) -> &Pillars {
        self.count(sweep);
        self.choose_pillars();
        self.sort_points(sweep);
        self.thin_out_points();
        self.describe();
        &self.pillars
    }

    /// Finds the cell of each point and counts the points of each cell.
    fn count(&mut self, sweep: &PointCloud) {
        self.cells.clear();
        let mut cells = std::mem::take(&mut self.cells);
        cells.extend(sweep.points.iter().map(|point| self.cell(point)));
        self.cells = cells;
        self.occupied.fill(0);
        for &cell in &self.cells {
            self.counts[cell as usize] += 1;
            self.occupied[cell as usize / 64] |= 1 << (cell % 64);
        }
    }

    /// The cell of a point, `nx * ny` out of range; without branches, which could not be predicted.
    fn cell(&self, point: &[f32; 4]) -> u32 {
        let [x0, y0, z0, x1, y1, z1] = self.spec.range_m;
        let [x, y, z, _] = *point;
        let index = |along: f32, low: f32, count: u32| {
            (((along - low) / self.spec.pillar_m) as i32).min(count as i32 - 1) as u32
        };
        let [ix, iy] = [index(x, x0, self.nx), index(y, y0, self.ny)];
        let inside = (x0 <= x) & (x < x1) & (y0 <= y) & (y < y1) & (z0 <= z) & (z < z1);
        let cell = iy.wrapping_mul(self.nx).wrapping_add(ix);
        if inside { cell } else { self.nx * self.ny }
    }

    /// The occupied cells, or as many of them as there may be; turns all counts into places: first
    /// come the points of these cells, then those of others, then those out of range.
    fn choose_pillars(&mut self) {
        let outside = self.nx * self.ny;
        let cells = &mut self.pillars.cells;
        cells.clear();
        for (word, bits) in self.occupied.iter().enumerate() {
            let mut bits = *bits;
            while bits != 0 {
                cells.push(64 * word as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
        cells.pop_if(|last| *last == outside);
        let kept = cells.len().min(self.spec.max_pillars);
        if kept < cells.len() {
            cells.select_nth_unstable_by_key(kept, |cell| cell_hash(*cell));
            cells[..kept].sort_unstable();
        }
        let mut end = 0;
        for &cell in cells.iter().chain([&outside]) {
            let start = end;
            end += std::mem::replace(&mut self.counts[cell as usize], start);
        }
        self.pillars.points.resize(end as usize, [0.0; 4]);
    }

    /// Puts the points into their places and clears the counts for the next frame.
    fn sort_points(&mut self, sweep: &PointCloud) {
        for (point, &cell) in sweep.points.iter().zip(&self.cells) {
            let place = &mut self.counts[cell as usize];
            self.pillars.points[*place as usize] = *point;
            *place += 1;
        }
        let Pillars { cells, ends, .. } = &mut self.pillars;
        ends.clear();
        ends.extend(cells.iter().map(|cell| self.counts[*cell as usize]));
        for &cell in cells.iter() {
            self.counts[cell as usize] = 0;
        }
        self.counts[(self.nx * self.ny) as usize] = 0;
        cells.truncate(self.spec.max_pillars);
        ends.truncate(self.spec.max_pillars);
    }

    /// Leaves no pillar more points than there is room for.
    fn thin_out_points(&mut self) {
        let room = self.spec.max_points_per_pillar;
        let Pillars { points, ends, .. } = &mut self.pillars;
        let (mut start, mut kept) = (0, 0);
        for end in ends.iter_mut() {
            let of_pillar = start..*end as usize;
            start = of_pillar.end;
            let count = of_pillar.len().min(room);
            if of_pillar.len() > room {
                points[of_pillar.clone()].select_nth_unstable_by_key(room, point_key);
            }
            if kept < of_pillar.start {
                points.copy_within(of_pillar.start..of_pillar.start + count, kept);
            }
            kept += count;
            *end = kept as u32;
        }
        points.truncate(kept);
    }

    /// Fills in centres and means.
    fn describe(&mut self) {
        let Pillars {
            cells,
            ends,
            points,
            centers_m,
            means_m,
        } = &mut self.pillars;
        centers_m.clear();
        means_m.clear();
        let mut start = 0;
        for (&cell, &end) in cells.iter().zip(ends.iter()) {
            let index = [cell % self.nx, cell / self.nx];
            centers_m.push(std::array::from_fn(|axis| {
                self.spec.range_m[axis] + (index[axis] as f32 + 0.5) * self.spec.pillar_m
            }));
            means_m.push(mean(&points[start..end as usize]));
            start = end as usize;
        }
    }
}

/// The mean of x, y, z. What is added is rounded to 2^-36 m, so that the sum has no rounding error
/// and the order makes no difference.
fn mean(points: &[[f32; 4]]) -> [f32; 3] {
    const ROUNDER: f64 = 1.5 * (1u64 << (52 - 36)) as f64;
    let mut sum = [0.0; 3];
    for point in points {
        for axis in 0..3 {
            sum[axis] += (f64::from(point[axis]) + ROUNDER) - ROUNDER;
        }
    }
    sum.map(|sum| (sum / points.len() as f64) as f32)
}

/// A point's hash, and its bits where two have the same.
fn point_key(point: &[f32; 4]) -> (u32, [u32; 4]) {
    (point_hash(point), point.map(f32::to_bits))
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
fn cell_hash(cell: u32) -> u32 {
    scrambled(cell.wrapping_mul(0x9E37_79B1))
}

/// Brings the upper bits down to all others.
fn scrambled(mut hash: u32) -> u32 {
    hash ^= hash >> 15;
    hash = hash.wrapping_mul(0x2C1B_3C6D);
    hash ^ (hash >> 12)
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
    fn a_pillar_in_closed_form() {
        let pillars = pillars(&[
            [0.1, -0.3, -1.0, 0.2],
            [0.3, -0.1, -2.0, 0.4],
            [9.0, 0.0, 0.0, 0.5],
            [0.0, 0.0, 1.0, 0.5],
        ]);
        let [pillar] = pillars.iter().collect::<Vec<_>>()[..] else {
            panic!("one pillar, not {pillars:?}");
        };
        // x in [0, 0.5) is column 8, y in [-0.5, 0) row 3; the other two are out of range.
        assert_eq!(pillar.cell, 3 * 16 + 8);
        assert_eq!(
            pillar.points,
            [[0.1, -0.3, -1.0, 0.2], [0.3, -0.1, -2.0, 0.4]]
        );
        assert_eq!(
            pillar.center_m.map(f32::to_bits),
            [0.25f32, -0.25].map(f32::to_bits)
        );
        for (mean, expected) in pillar.mean_m.iter().zip([0.2, -0.2, -1.5]) {
            assert!((mean - expected).abs() < 1e-6, "{pillar:?}");
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
        let coords = pillars(&points).cells;
        assert_eq!(coords.len(), 40);
        assert!(coords.is_sorted());
        // All eight rows of 16 cells are in use; each keeps some.
        let is_used = |part: u32| coords.iter().any(|cell| cell / 16 == part);
        assert!((0..8).all(is_used), "{coords:?}");
        // One more pillar pushes out at most one.
        let fewer = pillars(&points[1..]).cells;
        let lost = fewer.iter().filter(|cell| !coords.contains(cell)).count();
        assert!(lost <= 1, "{lost}");
    }

    #[test]
    fn all_points_in_one_pillar_leave_as_many_as_there_is_room_for() {
        let points: Vec<_> = (0..2_000_000)
            .map(|i| [0.1, 0.1, -2.0 + 1e-6 * i as f32, 0.5])
            .collect();
        let pillars = pillars(&points);
        assert_eq!(pillars.cells, [4 * 16 + 8]);
        let heights: Vec<f32> = pillars.points.iter().map(|point| point[2]).collect();
        assert_eq!(heights.len(), 4);
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
        assert_eq!(found.cells.len(), 300);
        let expected: toml::Table = String::from_utf8(fixture("pillars.toml"))
            .expect("text")
            .parse()
            .expect("hashes");
        let coords = found
            .cells
            .iter()
            .flat_map(|&cell| i64::from(cell).to_le_bytes());
        let numbers = found.iter().map(|pillar| pillar.points.len() as i64);
        let numbers: Vec<u8> = numbers.flat_map(i64::to_le_bytes).collect();
        let (coords, mut points) = (coords.collect(), Vec::new());
        for pillar in found.iter() {
            // In the training they come in the order of their hashes.
            let mut of_pillar = pillar.points.to_vec();
            of_pillar.sort_by_key(point_key);
            let ([mx, my, mz], [cx, cy]) = (pillar.mean_m, pillar.center_m);
            for [x, y, z, reflectance] in of_pillar {
                let features = [x, y, z, reflectance, x - mx, y - my, z - mz, x - cx, y - cy];
                points.extend(features.into_iter().flat_map(f32::to_le_bytes));
            }
        }
        for (name, bytes) in [("coords", coords), ("numbers", numbers), ("points", points)] {
            assert_eq!(
                expected[&format!("{name}_sha256")].as_str(),
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
            let [mut found, mut again] = [pillars(&points), pillars(&shuffled)];
            for pillars in [&mut found, &mut again] {
                let mut start = 0;
                for &end in &pillars.ends {
                    pillars.points[start..end as usize].sort_by_key(point_key);
                    start = end as usize;
                }
            }
            prop_assert_eq!(found, again);
        }
    }
}
