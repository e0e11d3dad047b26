/// How a lane mark is painted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MarkStyle {
    /// Not painted; where one would be it still divides lanes.
    None,
    /// An unbroken line.
    #[default]
    Solid,
    /// Dashes of [`RoadMarkings::dash_m`] every [`RoadMarkings::dash_period_m`].
    Dashed,
    /// Two unbroken lines side by side.
    Double,
}

/// Colour of lane paint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PaintColor {
    /// White.
    #[default]
    White,
    /// Yellow.
    Yellow,
}

/// The paint of a road: its four marks from the left edge line to the right one, and the lanes and
/// the pavement beyond these that belong to the same carriageway.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadMarkings {
    /// Style of each mark, from the left.
    pub styles: [MarkStyle; 4],
    /// Colour of each mark, from the left.
    pub colors: [PaintColor; 4],
    /// Width of a line in metres.
    pub paint_width_m: f64,
    /// Length of a dash in metres.
    pub dash_m: f64,
    /// From one dash to the next in metres.
    pub dash_period_m: f64,
    /// Lanes beyond mark 0 and beyond mark 3, as wide as the road's own; dashes part them.
    pub lanes_beyond: [u8; 2],
    /// Width of the pavement beyond the outermost marks, left and right, in metres.
    pub shoulders_m: [f64; 2],
}

impl Default for RoadMarkings {
    /// Solid edge lines, dashes of 3 m every 12 m.
    fn default() -> Self {
        Self {
            styles: [
                MarkStyle::Solid,
                MarkStyle::Dashed,
                MarkStyle::Dashed,
                MarkStyle::Solid,
            ],
            colors: [PaintColor::White; 4],
            paint_width_m: 0.15,
            dash_m: 3.0,
            dash_period_m: 12.0,
            lanes_beyond: [0, 0],
            shoulders_m: [2.0, 2.0],
        }
    }
}
