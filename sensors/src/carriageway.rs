use covista_traffic::{MarkStyle, Scene, SceneLook};
use covista_world::MARK_COUNT;

use crate::noise::uniform;

/// Where the marks and the edges of the ego's carriageway lie: the same to camera and LIDAR.
///
/// Offsets are from the road's reference line to the left.
pub(crate) struct Carriageway {
    /// Style of each mark, a lane's width apart, from the left.
    pub(crate) styles: Vec<MarkStyle>,
    /// Offset of the leftmost mark.
    pub(crate) leftmost_m: f64,
    pub(crate) lane_width_m: f64,
    pub(crate) paint_width_m: f64,
    pub(crate) dash_m: f64,
    pub(crate) dash_period_m: f64,
    /// Where along the road a dash begins.
    pub(crate) dash_offset_m: f64,
    /// Offsets of the left and the right edge of the pavement.
    pub(crate) edges_m: [f64; 2],
}

impl Carriageway {
    pub(crate) fn new(scene: &Scene) -> Self {
        let (road, markings) = (&scene.road, &scene.markings);
        let lane_width_m = road.lane_width_m();
        let [left, right] = markings.lanes_beyond.map(usize::from);
        let last = left + MARK_COUNT + right - 1;
        let style = |index: usize| match index.checked_sub(left) {
            Some(own) if own < MARK_COUNT => markings.styles[own],
            _ if index == 0 || index == last => MarkStyle::Solid,
            _ => MarkStyle::Dashed,
        };
        let leftmost_m = road.mark_offset_m(0) + left as f64 * lane_width_m;
        let rightmost_m = leftmost_m - last as f64 * lane_width_m;
        let [left_shoulder_m, right_shoulder_m] = markings.shoulders_m;
        let dash_period_m = markings.dash_period_m.max(0.1);
        Self {
            styles: (0..=last).map(style).collect(),
            leftmost_m,
            lane_width_m,
            paint_width_m: markings.paint_width_m.clamp(0.0, lane_width_m),
            dash_m: markings.dash_m.clamp(0.0, dash_period_m),
            dash_period_m,
            dash_offset_m: dash_period_m * f64::from(uniform(texture_seed(&scene.look), 4, 7919)),
            edges_m: [
                leftmost_m + left_shoulder_m.max(0.0),
                rightmost_m - right_shoulder_m.max(0.0),
            ],
        }
    }

    /// Number of lanes, those beyond the road's own included.
    pub(crate) fn lane_count(&self) -> usize {
        self.styles.len() - 1
    }

    /// Offset of a mark's middle.
    pub(crate) fn mark_m(&self, mark: usize) -> f64 {
        self.leftmost_m - mark as f64 * self.lane_width_m
    }

    /// The middles of the lines of a mark in this style, from its own to the left: a double one's
    /// are as far apart as they are wide.
    pub(crate) fn lines_m(&self, style: MarkStyle) -> impl Iterator<Item = f64> + use<> {
        let width_m = self.paint_width_m;
        let lines: &[f64] = match style {
            MarkStyle::None => &[],
            MarkStyle::Solid | MarkStyle::Dashed => &[0.0],
            MarkStyle::Double => &[-1.0, 1.0],
        };
        lines.iter().map(move |line| line * width_m)
    }
}

/// The seed of all textures of the ground.
pub(crate) fn texture_seed(look: &SceneLook) -> u32 {
    (look.texture_seed ^ (look.texture_seed >> 32)) as u32
}
