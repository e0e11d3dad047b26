//! Pillars to the network's canvas: the features of each pillar in its cell, 0 elsewhere.
//!
//! A point has nine features: x, y, z, reflectance, its offset from the mean of the pillar's points
//! (x, y, z) and from the pillar's centre (x, y). A channel of the pillar is
//! `relu(max over its points of weight . features + shift)`.
//!
//! The features are linear in four numbers of the point, dx and dy from the centre, z and
//! reflectance, and in five of the pillar, which come out of the maximum. So a point costs four
//! multiplications a channel, of small numbers.

use serde::Deserialize;

use super::preprocess::{Pillar, Pillars};

/// Features of a point.
const FEATURES: usize = 9;
/// Channels that are computed together, so that they fit vector registers.
const LANES: usize = 8;

type Lanes = [f32; LANES];

/// The part of a detector before its graph: `weight` [channels, 9] and `shift` of as many numbers.
#[derive(Debug)]
pub struct PillarFeatures {
    channels: usize,
    blocks: Vec<Block>,
    /// The cells that the last pillars were painted into.
    painted: Vec<u32>,
}

/// The weights of [`LANES`] channels.
#[derive(Debug, Default)]
struct Block {
    /// Of dx, dy, z and reflectance.
    point: [Lanes; 4],
    /// Of the centre (x, y) and of the mean (x and y less the centre, z).
    pillar: [Lanes; 5],
    shift: Lanes,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    weight: Vec<[f32; FEATURES]>,
    shift: Vec<f32>,
}

impl PillarFeatures {
    /// Reads the TOML text in a detector's metadata.
    ///
    /// # Errors
    /// Says in one line what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let table: Table = toml::from_str(text).map_err(|error| error.message().to_owned())?;
        if table.weight.is_empty() || table.weight.len() != table.shift.len() {
            return Err("weight and shift differ in length or are empty".into());
        }
        let mut numbers = table.weight.iter().flatten().chain(&table.shift);
        if !numbers.all(|number| number.is_finite()) {
            return Err("a number is not finite".into());
        }
        let blocks = table.weight.chunks(LANES).zip(table.shift.chunks(LANES));
        Ok(Self {
            channels: table.weight.len(),
            blocks: blocks.map(|(w, shift)| Block::new(w, shift)).collect(),
            painted: Vec::new(),
        })
    }

    /// Channels of a pillar.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Paints the pillars into `canvas`, [channels, cells], and takes the last ones away; else it
    /// is left as it is.
    pub fn paint(&mut self, pillars: &Pillars, canvas: &mut [f32]) {
        let cells = canvas.len() / self.channels;
        for (block, planes) in self.blocks.iter().zip(canvas.chunks_mut(LANES * cells)) {
            // In the order of the cells, so that each part of a plane comes into the cache once.
            let mut painted = self.painted.iter().peekable();
            for pillar in pillars.iter() {
                while let Some(&cell) = painted.next_if(|cell| **cell < pillar.cell) {
                    put(planes, cells, cell, &[0.0; LANES]);
                }
                put(planes, cells, pillar.cell, &block.features(&pillar));
                painted.next_if_eq(&&pillar.cell);
            }
            for &cell in painted {
                put(planes, cells, cell, &[0.0; LANES]);
            }
        }
        self.painted.clone_from(&pillars.cells);
    }
}

/// Writes one cell of up to [`LANES`] planes.
fn put(planes: &mut [f32], cells: usize, cell: u32, values: &Lanes) {
    for (lane, value) in values.iter().enumerate() {
        if let Some(place) = planes.get_mut(lane * cells + cell as usize) {
            *place = *value;
        }
    }
}

impl Block {
    /// From the rows of up to [`LANES`] channels; the others stay 0.
    fn new(weight: &[[f32; FEATURES]], shift: &[f32]) -> Self {
        let mut block = Self::default();
        for (lane, (row, shift)) in weight.iter().zip(shift).enumerate() {
            let [x, y, z, reflectance, mean_x, mean_y, mean_z, dx, dy] = *row;
            let point = [x + mean_x + dx, y + mean_y + dy, z + mean_z, reflectance];
            let pillar = [x, y, -mean_x, -mean_y, -mean_z];
            for (lanes, value) in block.point.iter_mut().zip(point) {
                lanes[lane] = value;
            }
            for (lanes, value) in block.pillar.iter_mut().zip(pillar) {
                lanes[lane] = value;
            }
            block.shift[lane] = *shift;
        }
        block
    }

    /// The features of a pillar. The order of its points makes no difference.
    fn features(&self, pillar: &Pillar<'_>) -> Lanes {
        let [x0, y0] = pillar.center_m;
        let [wx, wy, wz, wr] = &self.point;
        let mut highest = [f32::NEG_INFINITY; LANES];
        for &[x, y, z, reflectance] in pillar.points {
            let (dx, dy) = (x - x0, y - y0);
            for lane in 0..LANES {
                let level =
                    (wx[lane] * dx + wy[lane] * dy) + (wz[lane] * z + wr[lane] * reflectance);
                highest[lane] = if level > highest[lane] {
                    level
                } else {
                    highest[lane]
                };
            }
        }
        let [x, y, z] = pillar.mean_m;
        let mut features = [0.0; LANES];
        for (weights, value) in self.pillar.iter().zip([x0, y0, x - x0, y - y0, z]) {
            for lane in 0..LANES {
                features[lane] += weights[lane] * value;
            }
        }
        std::array::from_fn(|lane| {
            let level = highest[lane] + features[lane] + self.shift[lane];
            if level > 0.0 { level } else { 0.0 }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::PointPillarsSpec;
    use crate::pointpillars::preprocess::PillarGrid;
    use covista_world::PointCloud;
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

    fn features(weight: &[[f32; FEATURES]], shift: &[f32]) -> PillarFeatures {
        let text = format!("weight = {weight:?}\nshift = {shift:?}\n");
        PillarFeatures::parse(&text).expect("weights")
    }

    /// The nine features of each point times its weights, as they are defined.
    fn defined(pillar: &Pillar<'_>, weight: &[f32; FEATURES], shift: f32) -> f32 {
        let [cx, cy] = pillar.center_m.map(f64::from);
        let [mx, my, mz] = pillar.mean_m.map(f64::from);
        let levels = pillar.points.iter().map(|point| {
            let [x, y, z, r] = point.map(f64::from);
            let features = [x, y, z, r, x - mx, y - my, z - mz, x - cx, y - cy];
            let products = features.iter().zip(weight);
            products.map(|(a, b)| a * f64::from(*b)).sum::<f64>()
        });
        (levels.fold(f64::NEG_INFINITY, f64::max) + f64::from(shift)).max(0.0) as f32
    }

    #[test]
    fn weights_that_make_no_sense_are_refused_in_one_line() {
        let row = "[1, 0, 0, 0, 0, 0, 0, 0, 0.5]";
        for (text, part) in [
            (String::new(), "weight"),
            (format!("weight = [{row}]"), "shift"),
            (format!("weight = [{row}]\nshift = [1, 2]"), "length"),
            ("weight = []\nshift = []".into(), "empty"),
            ("weight = [[1, 2]]\nshift = [1]".into(), "array of length 9"),
            (format!("weight = [{row}]\nshift = [nan]"), "finite"),
            (format!("weight = [{row}]\nshift = [1e39]"), "finite"),
            (format!("weight = [{row}]\nshift = [1]\nscale = 1"), "scale"),
        ] {
            let error = PillarFeatures::parse(&text).expect_err("refused");
            assert!(error.contains(part) && !error.contains('\n'), "{error}");
        }
    }

    proptest! {
        #[test]
        fn the_canvas_is_what_the_definition_says_frame_after_frame(
            channels in 1usize..20,
            numbers in prop::collection::vec(-2f32..2.0, 200),
            sweeps in prop::collection::vec(
                prop::collection::vec([-5f32..5.0, -3f32..3.0, -1f32..0.0, 0f32..1.0], 0..200), 1..4),
        ) {
            let weight: Vec<_> = numbers.as_chunks::<FEATURES>().0[..channels].to_vec();
            let shift = &numbers[180..180 + channels];
            let mut features = features(&weight, shift);
            let mut grid = grid();
            let cells = 16 * 8;
            let mut canvas = vec![0.0; channels * cells];
            for points in sweeps {
                let pillars = grid.apply(&PointCloud { points });
                features.paint(pillars, &mut canvas);
                let mut expected = vec![0.0; canvas.len()];
                for pillar in pillars.iter() {
                    for (channel, (row, shift)) in weight.iter().zip(shift).enumerate() {
                        expected[channel * cells + pillar.cell as usize] = defined(&pillar, row, *shift);
                    }
                }
                for (found, expected) in canvas.iter().zip(&expected) {
                    prop_assert!((found - expected).abs() < 2e-5, "{found} {expected}");
                }
            }
        }
    }
}
