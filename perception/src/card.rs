//! The model card: what an ONNX file is, what goes in and out of it and how it was made.

use std::path::{Path, PathBuf};

use covista_world::{MARK_COUNT, ObjectClass, ROW_ANCHORS};
use serde::Deserialize;

/// Why a model card can't be used; each message is one line.
#[derive(Debug, thiserror::Error)]
pub enum CardError {
    /// The file can't be read.
    #[error(
        "there is no model card {path} ({source}): name the folder with the models, or train them \
         with models/training"
    )]
    Unreadable {
        /// The card.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is no model card.
    #[error("{path} is not a model card ({reason}): correct the card")]
    Malformed {
        /// The card.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
}

/// A model card, `models/<id>.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelCard {
    /// The model's name, and the card's file name without its extension.
    pub id: String,
    /// The ONNX file.
    pub file: PathBuf,
    /// SHA-256 of the ONNX file, in lower-case hexadecimal.
    pub sha256: String,
    /// SPDX expression.
    pub license: String,
    /// Day of the training, ISO 8601.
    pub date: String,
    /// One or two sentences.
    pub description: String,
    /// What the network takes, in order.
    pub inputs: Vec<TensorSpec>,
    /// What the network gives, in order.
    pub outputs: Vec<TensorSpec>,
    /// The kind of network with its pre- and postprocessing.
    pub network: Network,
    /// Commands, seeds, frames and steps of the training, free-form.
    pub training: toml::Table,
    /// Measured quality and the commands that measure it, free-form.
    pub metrics: toml::Table,
    /// What the network costs, where the card says so.
    pub cost: Option<Cost>,
}

/// What a network costs, whatever runs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Of the ONNX graph, for one frame.
    pub multiply_accumulates: u64,
    /// Weights of the whole file, a detector's pillar features included.
    pub parameters: u64,
    /// Those of them that are not 0.
    pub nonzero_parameters: u64,
}

/// The kinds of network, with what surrounds them.
#[derive(Debug, Clone, PartialEq)]
pub enum Network {
    /// Row-anchor lane network.
    Ufld(UfldSpec),
    /// 3D detector.
    PointPillars(PointPillarsSpec),
}

/// A tensor at the border of a network.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TensorSpec {
    /// Its name in the ONNX file.
    pub name: String,
    /// `float32` or `int64`.
    pub dtype: String,
    /// Its axes.
    pub shape: Vec<Dimension>,
}

/// The length of an axis.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum Dimension {
    /// Always the same.
    Fixed(i64),
    /// Different from run to run; its symbol.
    Dynamic(String),
}

/// Pre- and postprocessing of the lane network.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UfldSpec {
    /// Mean of r, g, b in [0, 1].
    pub mean: [f32; 3],
    /// Standard deviation of r, g, b in [0, 1].
    pub std: [f32; 3],
    /// Rows of the camera's image at which marks are looked for.
    pub row_anchors: Vec<u32>,
    /// Cells across the image.
    pub grid_cells: usize,
    /// Width of the camera's image, in pixels.
    pub image_width_px: u32,
    /// Height of the camera's image, in pixels.
    pub image_height_px: u32,
}

/// Pre- and postprocessing of the detector.
#[derive(Debug, Clone, PartialEq)]
pub struct PointPillarsSpec {
    /// x0, y0, z0, x1, y1, z1 of the range in the LIDAR frame, in metres.
    pub range_m: [f32; 6],
    /// Side of a pillar, in metres.
    pub pillar_m: f32,
    /// Pillars beyond these are thinned out.
    pub max_pillars: usize,
    /// Points of a pillar beyond these are thinned out.
    pub max_points_per_pillar: usize,
    /// Boxes below this confidence are dropped.
    pub score_threshold: f64,
    /// A box is dropped when its BEV IoU with a better one is above this.
    pub nms_iou: f64,
    /// The anchors of each cell; each stands at yaw 0 and at pi/2.
    pub anchors: Vec<AnchorSpec>,
}

/// An anchor of the detector.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorSpec {
    /// What it stands for.
    pub class: ObjectClass,
    /// Length, width, height in metres.
    pub size_m: [f64; 3],
    /// z of its centre in the LIDAR frame, in metres.
    pub center_z_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CardFile {
    id: String,
    kind: Kind,
    file: String,
    sha256: String,
    license: String,
    date: String,
    description: String,
    inputs: Vec<TensorSpec>,
    outputs: Vec<TensorSpec>,
    preprocess: toml::Table,
    #[serde(default)]
    anchors: Vec<AnchorSpec>,
    training: toml::Table,
    metrics: toml::Table,
    cost: Option<Cost>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Ufld,
    PointPillars,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PillarsFile {
    range_m: [f32; 6],
    pillar_m: f32,
    max_pillars: usize,
    max_points_per_pillar: usize,
    score_threshold: f64,
    nms_iou: f64,
}

impl ModelCard {
    /// Reads a card; `file` is taken relative to the card's folder.
    ///
    /// # Errors
    /// The card is missing, is not TOML, has an unknown field or contradicts itself.
    pub fn load(path: &Path) -> Result<Self, CardError> {
        let text = std::fs::read_to_string(path).map_err(|source| CardError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&text, path.parent().unwrap_or(Path::new(""))).map_err(|reason| {
            CardError::Malformed {
                path: path.to_owned(),
                reason: crate::runtime::one_line(&reason),
            }
        })
    }

    fn parse(text: &str, folder: &Path) -> Result<Self, String> {
        let card: CardFile = toml::from_str(text).map_err(|error| error.to_string())?;
        let preprocess = |error: toml::de::Error| format!("in [preprocess]: {}", error.message());
        let network = match card.kind {
            Kind::Ufld => {
                let spec: UfldSpec = card.preprocess.try_into().map_err(preprocess)?;
                spec.check()?;
                Network::Ufld(spec)
            }
            Kind::PointPillars => {
                let file: PillarsFile = card.preprocess.try_into().map_err(preprocess)?;
                let spec = PointPillarsSpec {
                    range_m: file.range_m,
                    pillar_m: file.pillar_m,
                    max_pillars: file.max_pillars,
                    max_points_per_pillar: file.max_points_per_pillar,
                    score_threshold: file.score_threshold,
                    nms_iou: file.nms_iou,
                    anchors: card.anchors,
                };
                spec.check()?;
                Network::PointPillars(spec)
            }
        };
        Ok(Self {
            id: card.id,
            file: folder.join(card.file),
            sha256: card.sha256,
            license: card.license,
            date: card.date,
            description: card.description,
            inputs: card.inputs,
            outputs: card.outputs,
            network,
            training: card.training,
            metrics: card.metrics,
            cost: card.cost,
        })
    }
}

impl UfldSpec {
    fn check(&self) -> Result<(), String> {
        if !self
            .row_anchors
            .iter()
            .eq(ROW_ANCHORS.iter().map(|row| &row.0))
        {
            return Err("row_anchors must be 100, 110 .. 370".into());
        }
        if self.grid_cells == 0 || self.image_width_px == 0 || self.image_height_px == 0 {
            return Err("grid_cells and the image's size must not be 0".into());
        }
        if !self.std.iter().all(|std| *std > 0.0) {
            return Err("std must be positive".into());
        }
        Ok(())
    }

    /// Shape of the network's output: cells and "none", row anchors, marks.
    pub(crate) fn output_shape(&self) -> [usize; 3] {
        [self.grid_cells + 1, ROW_ANCHORS.len(), MARK_COUNT]
    }
}

impl PointPillarsSpec {
    fn check(&self) -> Result<(), String> {
        let [x0, y0, z0, x1, y1, z1] = self.range_m;
        let ordered = x0 < x1 && y0 < y1 && z0 < z1;
        let [nx, ny] = self.grid();
        let sized = self.pillar_m > 0.0;
        if !ordered || !sized || nx == 0 || ny == 0 || nx * ny > 1 << 24 {
            return Err("range_m and pillar_m make no grid".into());
        }
        if self.max_pillars == 0 || self.max_points_per_pillar == 0 || self.anchors.is_empty() {
            return Err("max_pillars, max_points_per_pillar and anchors must not be empty".into());
        }
        let sizes = self.anchors.iter().flat_map(|anchor| anchor.size_m);
        if !sizes.into_iter().all(|size| size > 0.0) {
            return Err("an anchor's size_m must be positive".into());
        }
        if !(self.score_threshold > 0.0 && self.score_threshold < 1.0) {
            return Err("score_threshold must lie between 0 and 1".into());
        }
        Ok(())
    }

    /// Pillars along x and y.
    pub fn grid(&self) -> [usize; 2] {
        let [x0, y0, _, x1, y1, _] = self.range_m;
        [x1 - x0, y1 - y0].map(|side| (side / self.pillar_m).round() as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fixture(id: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/fixtures/{id}.toml"))
    }

    fn parse(id: &str, from: &str, to: &str) -> Result<ModelCard, String> {
        let text = std::fs::read_to_string(fixture(id)).unwrap();
        assert!(text.contains(from), "{from}");
        ModelCard::parse(&text.replacen(from, to, 1), Path::new("models"))
    }

    #[test]
    fn a_card_says_what_surrounds_the_network() {
        let card = ModelCard::load(&fixture("pointpillars")).unwrap();
        assert!(card.file.ends_with("tests/fixtures/pointpillars.onnx"));
        assert_eq!(card.inputs[0].shape[2], Dimension::Fixed(160));
        let Network::PointPillars(spec) = card.network else {
            panic!("not a detector");
        };
        assert_eq!(spec.grid(), [864, 160]);
        assert_eq!(spec.anchors[1].class, ObjectClass::Truck);
    }

    #[test]
    fn a_card_may_say_what_the_network_costs() {
        let with = |cost: &str| {
            parse(
                "ufld-resnet18",
                "[metrics]\n",
                &format!("[metrics]\n{cost}"),
            )
        };
        assert_eq!(with("").unwrap().cost, None);
        let cost = "[cost]\nmultiply_accumulates = 12\nparameters = 7\nnonzero_parameters = 5\n";
        let expected = Cost {
            multiply_accumulates: 12,
            parameters: 7,
            nonzero_parameters: 5,
        };
        assert_eq!(with(cost).unwrap().cost, Some(expected));
        let unknown = with(&cost.replace("nonzero_", "non_zero_")).unwrap_err();
        assert!(unknown.contains("non_zero_parameters"), "{unknown}");
    }

    #[test]
    fn errors_are_one_line_and_say_what_and_where() {
        let missing = ModelCard::load(Path::new("nowhere/x.toml"))
            .unwrap_err()
            .to_string();
        assert!(
            missing.starts_with("there is no model card nowhere/x.toml"),
            "{missing}"
        );
        let unknown = parse("ufld-resnet18", "grid_cells", "griding_num").unwrap_err();
        assert!(
            unknown.contains("[preprocess]") && unknown.contains("griding_num"),
            "{unknown}"
        );
        let unknown = parse("ufld-resnet18", "license", "licence").unwrap_err();
        assert!(unknown.contains("licence"), "{unknown}");
        let rows = parse("ufld-resnet18", "100, 110,", "110,").unwrap_err();
        assert!(rows.contains("row_anchors"), "{rows}");
        let grid = parse("pointpillars", "pillar_m = 0.16", "pillar_m = -0.16").unwrap_err();
        assert!(grid.contains("pillar_m"), "{grid}");
    }
}
