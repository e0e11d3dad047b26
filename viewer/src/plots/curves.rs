use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{
    Area, DrawError, INK, MARGIN_PX, PALE, X_LABELS_PX, Y_LABELS_PX, draw_png, font, rgb, titled,
};
use crate::{ViewerError, palette};

const PANEL_WIDTH_PX: u32 = 800;
const PANEL_HEIGHT_PX: u32 = 560;
const LEGEND_ROW_PX: u32 = 34;
/// Curves of more points than this are drawn without markers, and their spread as a band.
const MOST_MARKERS: usize = 25;

/// Quantities over one axis.
#[derive(Debug, Clone)]
pub struct CurvePanel {
    /// What stands above it.
    pub title: String,
    /// The axis to the right, with its unit.
    pub x: String,
    /// The axis upwards, with its unit.
    pub y: String,
    /// Its curves; those of the same label have the same colour in all panels.
    pub curves: Vec<Curve>,
}

/// One quantity over one axis.
#[derive(Debug, Clone)]
pub struct Curve {
    /// What it is.
    pub label: String,
    /// Place, value and half height of the spread of each point, from left to right; points that
    /// are not finite are left out.
    pub points: Vec<[f64; 3]>,
}

impl Curve {
    fn finite(&self) -> impl Iterator<Item = [f64; 3]> {
        let is_finite = |point: &&[f64; 3]| point.iter().all(|value| value.is_finite());
        self.points.iter().filter(is_finite).copied()
    }
}

/// Draws curves with their spread, the panels side by side, 800 pixels wide each.
///
/// # Errors
/// When the picture can't be drawn or written.
pub fn plot_curves(path: &Path, panels: &[CurvePanel]) -> Result<(), ViewerError> {
    let labels = labels(panels);
    let count = panels.len().max(1);
    let height_px = PANEL_HEIGHT_PX + LEGEND_ROW_PX * labels.len() as u32 + MARGIN_PX;
    draw_png(path, [PANEL_WIDTH_PX * count as u32, height_px], |area| {
        let (upper, legend) = area.split_vertically(PANEL_HEIGHT_PX);
        for (panel, place) in panels.iter().zip(upper.split_evenly((1, count))) {
            draw_panel(&titled(&place, &panel.title)?, panel, &labels)?;
        }
        for (row, label) in (0..).zip(&labels) {
            draw_key(&legend, row, label)?;
        }
        Ok(())
    })
}

/// The labels in the order in which they get their colours.
fn labels(panels: &[CurvePanel]) -> Vec<&str> {
    let mut labels = Vec::new();
    for curve in panels.iter().flat_map(|panel| &panel.curves) {
        if !labels.contains(&curve.label.as_str()) {
            labels.push(curve.label.as_str());
        }
    }
    labels
}

fn draw_key<'a>(area: &Area<'a>, row: i32, label: &str) -> Result<(), DrawError<'a>> {
    let color = rgb(palette::series_color(row as usize));
    let (x, y) = (
        (Y_LABELS_PX + MARGIN_PX) as i32,
        row * LEGEND_ROW_PX as i32 + LEGEND_ROW_PX as i32 / 2,
    );
    area.draw(&PathElement::new(
        [(x, y), (x + 40, y)],
        color.stroke_width(4),
    ))?;
    let style = font(20).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(label.to_owned(), (x + 52, y), style))
}

fn draw_panel<'a>(
    place: &Area<'a>,
    panel: &CurvePanel,
    labels: &[&str],
) -> Result<(), DrawError<'a>> {
    let ([left, right], [low, high]) = spans(panel);
    let digits = |span: f64| {
        if span < 1.0 {
            2
        } else {
            usize::from(span < 10.0)
        }
    };
    let (x_digits, y_digits) = (digits(right - left), digits(high - low));
    let mut chart = ChartBuilder::on(place)
        .margin(MARGIN_PX)
        .x_label_area_size(X_LABELS_PX)
        .y_label_area_size(Y_LABELS_PX)
        .build_cartesian_2d(left..right, low..high)?;
    chart
        .configure_mesh()
        .bold_line_style(PALE)
        .light_line_style(TRANSPARENT)
        .axis_style(INK)
        .x_desc(&panel.x)
        .y_desc(&panel.y)
        .x_labels(10)
        .y_labels(8)
        .x_label_formatter(&|x| format!("{x:.x_digits$}"))
        .y_label_formatter(&|y| format!("{y:.y_digits$}"))
        .label_style(font(18))
        .axis_desc_style(font(20))
        .draw()?;
    for (curve, later) in panel
        .curves
        .iter()
        .zip((0..panel.curves.len() as u32).rev())
    {
        let index = labels.iter().position(|label| *label == curve.label);
        let color = rgb(palette::series_color(index.unwrap_or(0)));
        let points: Vec<_> = curve.finite().collect();
        let line = points.iter().map(|&[x, y, _]| (x, y));
        if points.len() > MOST_MARKERS {
            let upper = points.iter().map(|&[x, y, spread]| (x, y + spread));
            let lower = points.iter().rev().map(|&[x, y, spread]| (x, y - spread));
            let band: Vec<_> = upper.chain(lower).collect();
            chart.draw_series([Polygon::new(band, color.mix(0.18).filled())])?;
            chart.draw_series(LineSeries::new(line, color.stroke_width(2)))?;
            continue;
        }
        // Wider below, so that a curve shows beside one that coincides with it.
        let margin = 2 * later.min(4);
        chart.draw_series(LineSeries::new(
            line.clone(),
            color.stroke_width(3 + margin),
        ))?;
        chart.draw_series(line.map(|place| Circle::new(place, 5 + margin / 2, color.filled())))?;
        chart.draw_series(points.iter().map(|&[x, y, spread]| {
            PathElement::new([(x, y - spread), (x, y + spread)], color.stroke_width(2))
        }))?;
    }
    Ok(())
}

/// What the axes reach over: all points with their spread, and a little more.
fn spans(panel: &CurvePanel) -> ([f64; 2], [f64; 2]) {
    let mut x = [f64::INFINITY, f64::NEG_INFINITY];
    let mut y = x;
    for [place, value, spread] in panel.curves.iter().flat_map(Curve::finite) {
        x = [x[0].min(place), x[1].max(place)];
        y = [y[0].min(value - spread), y[1].max(value + spread)];
    }
    (widened(x), widened(y))
}

fn widened([low, high]: [f64; 2]) -> [f64; 2] {
    if low > high {
        return [0.0, 1.0];
    }
    // A single value gets an axis, too.
    let margin = if high - low > 1e-9 * high.abs().max(1.0) {
        0.06 * (high - low)
    } else {
        0.05 * high.abs().max(1.0)
    };
    [low - margin, high + margin]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(points: Vec<[f64; 3]>) -> CurvePanel {
        let curve = Curve {
            label: "ours".to_owned(),
            points,
        };
        CurvePanel {
            title: "Velocity".to_owned(),
            x: "CAV ratio".to_owned(),
            y: "mph".to_owned(),
            curves: vec![curve],
        }
    }

    #[test]
    fn axes_hold_every_point_with_its_spread() {
        let ([left, right], [low, high]) = spans(&panel(vec![
            [0.0, 60.0, 2.0],
            [1.0, 66.0, 1.0],
            [0.5, f64::NAN, 0.0],
            [0.5, 1e9, f64::INFINITY],
        ]));
        assert!(left < 0.0 && right > 1.0 && right < 1.2);
        assert!(low < 58.0 && low > 57.0 && high > 67.0 && high < 68.0);
        assert_eq!(spans(&panel(Vec::new())), ([0.0, 1.0], [0.0, 1.0]));
        let ([left, right], [low, high]) = spans(&panel(vec![[3.0, 0.0, 0.0]]));
        assert!(left < 3.0 && right > 3.0 && low < 0.0 && high > 0.0);
    }
}
