//! The lane network's logits to pixels: the expected cell in each row, or none.

use covista_world::{MARK_COUNT, ROW_ANCHORS};

/// For each mark its u in pixels at each row anchor, where it is seen.
pub type MarkPixels = [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT];

/// Marks as the network finds them, and how sure it is of each place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundMarks {
    /// Where they are seen.
    pub pixels: MarkPixels,
    /// Standard deviation, in pixels, of the cells that the network deems likely; 0 where the mark
    /// is not seen.
    pub spread_px: [[f32; ROW_ANCHORS.len()]; MARK_COUNT],
}

impl From<MarkPixels> for FoundMarks {
    /// Marks without any doubt.
    fn from(pixels: MarkPixels) -> Self {
        Self {
            pixels,
            spread_px: Default::default(),
        }
    }
}

/// For each mark the pixels (u, v) at which it is seen, from the top.
pub type MarkPoints = [Vec<[f64; 2]>; MARK_COUNT];

/// The places of marks in the picture.
pub fn mark_points(pixels: &MarkPixels) -> MarkPoints {
    std::array::from_fn(|mark| {
        let rows = pixels[mark].iter().zip(&ROW_ANCHORS);
        rows.filter_map(|(u, row)| Some([f64::from((*u)?), f64::from(row.0)]))
            .collect()
    })
}

/// Cells on each side of the likeliest one that share in a mark's place.
const WINDOW_CELLS: usize = 4;

/// How likely a mark is in the rows where it is seen, at least, as part of how likely it is in its
/// surest row.
const SEEN_FROM: f64 = 0.4;

/// A mark in one row.
struct Place {
    /// Probability of all cells together.
    likely: f64,
    u_px: f32,
    spread_px: f32,
}

/// Decodes logits [`grid_cells` + 1, row anchors, marks], the last cell being "none".
///
/// A mark exists if in its surest row its cells together are likelier than "none". There it is seen,
/// and in all rows where it is at least 0.4 times as likely: in doubt whether a mark exists at all its
/// rows are in doubt together. Its u is
/// `(E + 0.5) * image_width_px / grid_cells` with the expectation E of the cell's index over the
/// softmax of the four cells on each side of the likeliest cell; its spread is the root mean
/// square distance from there over the softmax of all cells.
pub fn decode(logits: &[f32], grid_cells: usize, image_width_px: u32) -> FoundMarks {
    let cell_px = f64::from(image_width_px) / grid_cells as f64;
    let place = |mark: usize, row: usize| {
        let logit =
            |cell: usize| f64::from(logits[(cell * ROW_ANCHORS.len() + row) * MARK_COUNT + mark]);
        let (best, largest) = (0..grid_cells)
            .map(|cell| (cell, logit(cell)))
            .reduce(|best, next| if next.1 > best.1 { next } else { best })?;
        let weight = |cell: usize| (logit(cell) - largest).exp();
        let from_best = |cell: usize| cell as f64 - best as f64;
        let all = Moments::of((0..grid_cells).map(|cell| (weight(cell), from_best(cell))));
        let window = best.saturating_sub(WINDOW_CELLS)..(best + WINDOW_CELLS + 1).min(grid_cells);
        let near = Moments::of(window.map(|cell| (weight(cell), from_best(cell))));
        let mean = near.first / near.weight;
        let place = Place {
            likely: all.weight / (all.weight + weight(grid_cells)),
            u_px: ((best as f64 + mean + 0.5) * cell_px) as f32,
            spread_px: (all.square_about(mean).sqrt() * cell_px) as f32,
        };
        // Neither is where the network's output is not finite.
        (place.likely.is_finite() && place.u_px.is_finite()).then_some(place)
    };
    let found: [[Option<Place>; ROW_ANCHORS.len()]; MARK_COUNT] = std::array::from_fn(|mark| {
        let places: [_; ROW_ANCHORS.len()] = std::array::from_fn(|row| place(mark, row));
        let likely = places.iter().flatten().map(|place: &Place| place.likely);
        let surest = likely.fold(0.0, f64::max);
        let seen = |place: &Place| surest > 0.5 && place.likely > SEEN_FROM * surest;
        places.map(|place| place.filter(seen))
    });
    FoundMarks {
        pixels: std::array::from_fn(|mark| {
            std::array::from_fn(|row| found[mark][row].as_ref().map(|place| place.u_px))
        }),
        spread_px: std::array::from_fn(|mark| {
            std::array::from_fn(|row| {
                found[mark][row]
                    .as_ref()
                    .map_or(0.0, |place| place.spread_px)
            })
        }),
    }
}

/// Sums over weighted places: of the weights, and of them times the places and their squares.
#[derive(Default)]
struct Moments {
    weight: f64,
    first: f64,
    second: f64,
}

impl Moments {
    fn of(weighted: impl Iterator<Item = (f64, f64)>) -> Self {
        weighted.fold(Self::default(), |sums, (weight, place)| Self {
            weight: sums.weight + weight,
            first: sums.first + weight * place,
            second: sums.second + weight * place * place,
        })
    }

    /// Mean square distance from `place`.
    fn square_about(&self, place: f64) -> f64 {
        let sum = self.second - 2.0 * place * self.first + place * place * self.weight;
        (sum / self.weight).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: usize = 100;

    fn logits(value: impl Fn(usize, usize, usize) -> f32) -> Vec<f32> {
        (0..=CELLS)
            .flat_map(|cell| (0..28).flat_map(move |row| (0..4).map(move |mark| (cell, row, mark))))
            .map(|(cell, row, mark)| value(cell, row, mark))
            .collect()
    }

    #[test]
    fn two_cells_of_odds_three_to_one_give_their_mean() {
        let logits = logits(|cell, row, mark| match (cell, row, mark) {
            (40, 3, 2) => 50.0 + 3f32.ln(),
            (41, 3, 2) => 50.0,
            (CELLS, _, _) => 10.0,
            _ => -50.0,
        });
        let FoundMarks { pixels, spread_px } = decode(&logits, CELLS, 1242);
        let u = pixels[2][3].expect("seen");
        assert!((f64::from(u) - (40.25 + 0.5) * 12.42).abs() < 1e-3, "{u}");
        let spread = f64::from(spread_px[2][3]);
        assert!((spread - 12.42 * (3.0_f64 / 16.0).sqrt()).abs() < 1e-3);
        assert!(spread_px[2][4].abs() < 1e-9);
        assert_eq!(pixels.iter().flatten().flatten().count(), 1);
    }

    #[test]
    fn a_mark_is_seen_where_its_cells_together_outweigh_none_and_far_cells_do_not_pull_it() {
        // Three cells of e^0 in one place and one far away against "none" of e^1, then of e^1.5.
        let place = |none: f32| {
            let logits = logits(|cell, _, _| match cell {
                30 => 0.1,
                29 | 31 | 80 => 0.0,
                CELLS => none,
                _ => -50.0,
            });
            decode(&logits, CELLS, 1242).pixels[0][0]
        };
        let u = place(1.0).expect("seen");
        assert!((f64::from(u) - 30.5 * 12.42).abs() < 1e-3, "{u}");
        assert_eq!(place(1.5), None);
    }

    #[test]
    fn a_mark_is_seen_in_its_surest_row_and_where_it_is_at_least_0_4_times_as_likely() {
        // One cell against "none", of probability `least + row * step`.
        let rows_seen = |least: f64, step: f64| {
            let logits = logits(|cell, row, mark| match (cell, mark) {
                (50, 1) => {
                    let likely = least + row as f64 * step;
                    (likely / (1.0 - likely)).ln() as f32
                }
                (CELLS, _) => 0.0,
                _ => -50.0,
            });
            let pixels = decode(&logits, CELLS, 1242).pixels;
            pixels.map(|mark| mark.iter().flatten().count())
        };
        // Up to 0.94, so from 0.376 on, in row 9.
        assert_eq!(rows_seen(0.13, 0.03), [0, 19, 0, 0]);
        // Up to 0.545, so from 0.218 on, in row 11.
        assert_eq!(rows_seen(0.005, 0.02), [0, 17, 0, 0]);
        // Up to 0.49.
        assert_eq!(rows_seen(0.22, 0.01), [0, 0, 0, 0]);
    }

    #[test]
    fn what_is_not_finite_is_not_seen() {
        let pixels = decode(&logits(|_, _, _| f32::NAN), CELLS, 1242).pixels;
        assert!(pixels.iter().flatten().all(Option::is_none));
        let pixels = decode(
            &logits(|cell, _, _| if cell == 7 { f32::INFINITY } else { 0.0 }),
            CELLS,
            1242,
        )
        .pixels;
        assert!(pixels.iter().flatten().all(Option::is_none));
    }
}
