use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{
    Area, DrawError, INK, MARGIN_PX, PALE, X_LABELS_PX, Y_LABELS_PX, draw_png, font, rgb, titled,
};
use crate::{ViewerError, palette};

const WIDTH_PX: u32 = 1700;
const PANELS_PX: u32 = 640;
const LEGEND_ROW_PX: u32 = 34;
/// Accuracies nearer than this to each other fill a panel all the same, in percentage points.
const LEAST_SPAN: f64 = 4.0;

/// Accuracy against speed of one kind of network.
#[derive(Debug, Clone)]
pub struct FrontierPanel {
    /// What stands above it.
    pub title: String,
    /// What its accuracy is, with the unit.
    pub accuracy: String,
    /// What was measured.
    pub series: Vec<FrontierSeries>,
    /// What others have published, on other machines and data.
    pub published: Vec<FrontierPoint>,
}

/// Networks that are joined by a line, in this order.
#[derive(Debug, Clone)]
pub struct FrontierSeries {
    /// What ran them; it gives the colour.
    pub provider: String,
    /// The arithmetic; it gives the marker.
    pub precision: String,
    /// The networks.
    pub points: Vec<FrontierPoint>,
}

/// A network, or what is published of one.
#[derive(Debug, Clone)]
pub struct FrontierPoint {
    /// What is written beside it; may be empty.
    pub label: String,
    /// Speed in images/s, more than 0.
    pub img_per_s: f64,
    /// Accuracy in percent.
    pub accuracy: f64,
}

/// Draws accuracy against images/s on a logarithmic axis, the panels side by side, 1700 pixels
/// wide; `published` is said in the legend of what others published.
///
/// # Errors
/// When the picture can't be drawn or written.
pub fn plot_frontier(
    path: &Path,
    panels: &[FrontierPanel],
    published: &str,
) -> Result<(), ViewerError> {
    let keys = keys(panels, published);
    let height_px = PANELS_PX + LEGEND_ROW_PX * keys.len() as u32 + MARGIN_PX;
    draw_png(path, [WIDTH_PX, height_px], |area| {
        let (upper, legend) = area.split_vertically(PANELS_PX);
        let providers = providers(panels);
        for (panel, place) in panels
            .iter()
            .zip(upper.split_evenly((1, panels.len().max(1))))
        {
            draw_panel(&titled(&place, &panel.title)?, panel, &providers)?;
        }
        for (row, key) in (0..).zip(&keys) {
            draw_key(&legend, row, key)?;
        }
        Ok(())
    })
}

/// The providers in the order in which they get their colours.
fn providers(panels: &[FrontierPanel]) -> Vec<&str> {
    let mut providers = Vec::new();
    for series in panels.iter().flat_map(|panel| &panel.series) {
        if !providers.contains(&series.provider.as_str()) {
            providers.push(&series.provider);
        }
    }
    providers
}

/// Shapes that differ without their colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Marker {
    Circle,
    Triangle,
    Square,
    Star,
}

fn marker(precision: &str) -> Marker {
    match precision {
        "bf16" => Marker::Triangle,
        "int8" => Marker::Square,
        _ => Marker::Circle,
    }
}

fn color(provider: &str, providers: &[&str]) -> RGBColor {
    const COLORS: [palette::Rgb; 3] = [palette::BLUE, palette::VERMILLION, palette::GREEN];
    let index = providers.iter().position(|known| *known == provider);
    rgb(COLORS[index.unwrap_or(0) % COLORS.len()])
}

/// A line of the legend.
struct LegendKey {
    color: RGBColor,
    marker: Marker,
    text: String,
}

fn keys(panels: &[FrontierPanel], published: &str) -> Vec<LegendKey> {
    let providers = providers(panels);
    let mut keys: Vec<LegendKey> = Vec::new();
    for series in panels.iter().flat_map(|panel| &panel.series) {
        let text = format!("{}, {}", series.provider, series.precision);
        if keys.iter().all(|key| key.text != text) {
            keys.push(LegendKey {
                color: color(&series.provider, &providers),
                marker: marker(&series.precision),
                text,
            });
        }
    }
    if panels.iter().any(|panel| !panel.published.is_empty()) {
        keys.push(LegendKey {
            color: INK,
            marker: Marker::Star,
            text: published.to_owned(),
        });
    }
    keys
}

fn draw_key<'a>(area: &Area<'a>, row: i32, key: &LegendKey) -> Result<(), DrawError<'a>> {
    let (x, y) = (
        (Y_LABELS_PX + MARGIN_PX) as i32 + 12,
        row * LEGEND_ROW_PX as i32 + LEGEND_ROW_PX as i32 / 2,
    );
    draw_marker(area, (x, y), key.marker, key.color)?;
    let style = font(20).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(key.text.clone(), (x + 24, y), style))
}

fn draw_marker<'a>(
    area: &Area<'a>,
    (x, y): (i32, i32),
    marker: Marker,
    color: RGBColor,
) -> Result<(), DrawError<'a>> {
    match marker {
        Marker::Circle => area.draw(&Circle::new((x, y), 7, color.filled())),
        Marker::Triangle => area.draw(&TriangleMarker::new((x, y), 10, color.filled())),
        Marker::Square => {
            let corners = [(x - 6, y - 6), (x + 6, y + 6)];
            area.draw(&Rectangle::new(corners, color.filled()))
        }
        Marker::Star => area.draw(&Polygon::new(star((x, y)), color.filled())),
    }
}

/// The ten corners of a star.
fn star((x, y): (i32, i32)) -> Vec<(i32, i32)> {
    let corner = |index: i32| {
        let reach_px = if index % 2 == 0 { 13.0 } else { 5.5 };
        let (sin, cos) = (f64::from(index) * std::f64::consts::PI / 5.0).sin_cos();
        let moved = |by: f64| (reach_px * by).round() as i32;
        (x + moved(sin), y - moved(cos))
    };
    (0..10).map(corner).collect()
}

fn draw_panel<'a>(
    place: &Area<'a>,
    panel: &FrontierPanel,
    providers: &[&str],
) -> Result<(), DrawError<'a>> {
    let ([least_speed, most_speed], [low, high]) = spans(panel);
    let mut chart = ChartBuilder::on(place)
        .margin(MARGIN_PX)
        .x_label_area_size(X_LABELS_PX)
        .y_label_area_size(Y_LABELS_PX)
        .build_cartesian_2d((least_speed..most_speed).log_scale(), low..high)?;
    chart
        .configure_mesh()
        .bold_line_style(PALE)
        .light_line_style(TRANSPARENT)
        .axis_style(INK)
        .x_desc("images/s, end to end")
        .y_desc(&panel.accuracy)
        .x_labels(12)
        .y_labels(8)
        .x_label_formatter(&|img_per_s| format!("{img_per_s:.0}"))
        .y_label_formatter(&|accuracy| format!("{accuracy:.0}"))
        .label_style(font(18))
        .axis_desc_style(font(20))
        .draw()?;
    let position = |point: &FrontierPoint| (point.img_per_s, point.accuracy);
    let plot = chart.plotting_area().strip_coord_spec();
    let corner = plot.get_base_pixel();
    let pixel = |point: &FrontierPoint| {
        let (x, y) = chart.backend_coord(&position(point));
        (x - corner.0, y - corner.1)
    };
    let path = |points: &[FrontierPoint]| points.iter().map(pixel).collect::<Vec<_>>();
    for series in &panel.series {
        let color = color(&series.provider, providers);
        plot.draw(&PathElement::new(
            path(&series.points),
            color.stroke_width(2),
        ))?;
    }
    plot.draw(&PathElement::new(
        path(&panel.published),
        PALE.stroke_width(3),
    ))?;
    for series in &panel.series {
        let color = color(&series.provider, providers);
        for point in &series.points {
            draw_marker(&plot, pixel(point), marker(&series.precision), color)?;
        }
    }
    for point in &panel.published {
        draw_marker(&plot, pixel(point), Marker::Star, INK)?;
    }
    let measured = panel.series.iter().flat_map(|series| &series.points);
    for point in measured.chain(&panel.published) {
        let (x, y) = pixel(point);
        let style = font(17).pos(Pos::new(HPos::Center, VPos::Bottom));
        plot.draw(&Text::new(point.label.clone(), (x, y - 12), style))?;
    }
    Ok(())
}

/// What the axes of a panel reach over: speeds by a third beyond the slowest and the fastest,
/// accuracies a little beyond the worst and the best.
fn spans(panel: &FrontierPanel) -> ([f64; 2], [f64; 2]) {
    let measured = panel.series.iter().flat_map(|series| &series.points);
    let points: Vec<_> = measured.chain(&panel.published).collect();
    let span = |of: fn(&FrontierPoint) -> f64| {
        let values = points.iter().map(|point| of(point));
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        })
    };
    let [slowest, fastest] = span(|point| point.img_per_s);
    let [worst, best] = span(|point| point.accuracy);
    if points.is_empty() {
        return ([1.0, 100.0], [0.0, 100.0]);
    }
    let margin = 0.12 * (best - worst).max(LEAST_SPAN);
    let middle = (worst + best) / 2.0;
    let half = ((best - worst) / 2.0).max(LEAST_SPAN / 2.0) + margin;
    (
        [slowest / 1.4, fastest * 1.4],
        [middle - half, (middle + half).min(100.0)],
    )
}
