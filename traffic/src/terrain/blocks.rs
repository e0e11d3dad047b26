/// The cells of a grid in square blocks, each below a plane.
///
/// About the grid lie blocks without end, as the ground goes on there at the height of its rim.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    /// Blocks to a side of the grid, without those about it.
    pub(super) to_a_side: usize,
    /// Height at the grid's corner, rise per cell in x and in y.
    covers: Vec<[f64; 3]>,
}

impl Blocks {
    /// Cells to a side of a block.
    pub(super) const CELLS: usize = 4;

    pub(super) fn new(heights_m: &[f32], nodes_per_side: usize) -> Self {
        let to_a_side = (nodes_per_side - 1).div_ceil(Self::CELLS);
        let blocks = to_a_side + 2;
        // The first and the last node of a block; the same one where the block has no end.
        let span = |block: usize| {
            [block.saturating_sub(1), block.min(to_a_side)].map(|border| border * Self::CELLS)
        };
        let height_m = |column: usize, row: usize| {
            let [column, row] = [column, row].map(|node| node.min(nodes_per_side - 1));
            f64::from(heights_m[row * nodes_per_side + column])
        };
        let cover = |index: usize| {
            let [left, right] = span(index % blocks);
            let [low, high] = span(index / blocks);
            let east_m = height_m(right, low) + height_m(right, high);
            let west_m = height_m(left, low) + height_m(left, high);
            let north_m = height_m(left, high) + height_m(right, high);
            let south_m = height_m(left, low) + height_m(right, low);
            let per_x = 0.5 * (east_m - west_m) / (right - left).max(1) as f64;
            let per_y = 0.5 * (north_m - south_m) / (high - low).max(1) as f64;
            let highest_m = (low..=high)
                .flat_map(|row| (left..=right).map(move |column| (column, row)))
                .map(|(column, row)| {
                    height_m(column, row) - per_x * column as f64 - per_y * row as f64
                })
                .fold(f64::MIN, f64::max);
            [highest_m + MARGIN_M, per_x, per_y]
        };
        Self {
            to_a_side,
            covers: (0..blocks * blocks).map(cover).collect(),
        }
    }

    /// The plane above a block.
    pub(super) fn cover(&self, [column, row]: [usize; 2]) -> [f64; 3] {
        self.covers[row * (self.to_a_side + 2) + column]
    }
}

/// By how much the planes clear the ground, against rounding.
const MARGIN_M: f64 = 1e-6;
