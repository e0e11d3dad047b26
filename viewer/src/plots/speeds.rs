use std::path::Path;

use plotters::prelude::*;

use super::{
    Area, DrawError, INK, Key, LEGEND_PX, MARGIN_PX, PALE, RunSeries, X_LABELS_PX, Y_LABELS_PX,
    colors, draw_legend, draw_png, font, titled, vehicle_keys,
};
use crate::{VehicleKind, ViewerError};

const WIDTH_PX: u32 = 1600;
const PANEL_PX: u32 = 480;

/// Draws speed over time of all moving vehicles, one panel for each run, 1600 pixels wide.
///
/// # Errors
/// When the picture can't be drawn or written.
pub fn plot_speeds(path: &Path, runs: &[RunSeries]) -> Result<(), ViewerError> {
    let size = [WIDTH_PX, PANEL_PX * runs.len().max(1) as u32];
    draw_png(path, size, |area| draw(area, runs))
}

fn draw<'a>(area: &Area<'a>, runs: &[RunSeries]) -> Result<(), DrawError<'a>> {
    let samples = || {
        let vehicles = runs.iter().flat_map(|run| &run.vehicles);
        vehicles.flat_map(|vehicle| &vehicle.samples)
    };
    let end_s = samples().fold(1.0, |max: f64, sample| max.max(sample.time_s));
    let top_mps = samples().fold(1.0, |max: f64, sample| max.max(sample.speed_mps)) * 1.08;
    let (panels, legend) = area.split_horizontally(WIDTH_PX - LEGEND_PX);
    for (run, panel) in runs.iter().zip(panels.split_evenly((runs.len().max(1), 1))) {
        draw_panel(&titled(&panel, &run.title)?, run, end_s, top_mps)?;
    }
    let mut keys = runs.first().map(vehicle_keys).unwrap_or_default();
    keys.push((Key::Triangle(INK), "lane change begins".to_owned()));
    draw_legend(&legend, &keys)
}

fn draw_panel<'a>(
    panel: &Area<'a>,
    run: &RunSeries,
    end_s: f64,
    top_mps: f64,
) -> Result<(), DrawError<'a>> {
    let mut chart = ChartBuilder::on(panel)
        .margin(MARGIN_PX)
        .x_label_area_size(X_LABELS_PX)
        .y_label_area_size(Y_LABELS_PX)
        .build_cartesian_2d(0.0..end_s, 0.0..top_mps)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .bold_line_style(PALE)
        .light_line_style(TRANSPARENT)
        .axis_style(INK)
        .x_desc("time in s")
        .y_desc("speed in m/s")
        .y_labels(6)
        .x_label_formatter(&|time_s| format!("{time_s:.0}"))
        .y_label_formatter(&|speed_mps| format!("{speed_mps:.0}"))
        .label_style(font(18))
        .axis_desc_style(font(20))
        .draw()?;
    for (vehicle, color) in run.vehicles.iter().zip(colors(run)) {
        let points = vehicle
            .samples
            .iter()
            .map(|sample| (sample.time_s, sample.speed_mps));
        match vehicle.info.kind {
            VehicleKind::Obstacle => continue,
            VehicleKind::Human => {
                chart.draw_series(DashedLineSeries::new(points, 8, 5, color.stroke_width(2)))?;
            }
            VehicleKind::Cav => {
                chart.draw_series(LineSeries::new(points, color.stroke_width(3)))?;
            }
        }
        chart.draw_series(vehicle.lane_change_starts().map(|sample| {
            TriangleMarker::new((sample.time_s, sample.speed_mps), 10, color.filled())
        }))?;
    }
    Ok(())
}
