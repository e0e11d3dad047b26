use std::ops::Range;
use std::path::Path;

use covista_world::{MARK_COUNT, Road};
use plotters::prelude::*;

use super::{
    Area, DrawError, INK, Key, LEGEND_PX, MARGIN_PX, PALE, RunSeries, TITLE_PX, VehicleSeries,
    X_LABELS_PX, Y_LABELS_PX, colors, draw_legend, draw_png, font, rgb, titled, vehicle_keys,
};
use crate::hull::convex_hull_faces;
use crate::palette;
use crate::scene::{offset_curve, stations};
use crate::{SceneryPart, VehicleKind, ViewerError};

const WIDTH_PX: u32 = 1800;
/// Road shown around what happens, in metres.
const SURROUNDINGS_M: f64 = 35.0;
const SCENERY: RGBColor = RGBColor(120, 120, 120);
const ASPHALT: RGBColor = RGBColor(238, 238, 236);
const LANE_LINE: RGBColor = RGBColor(200, 200, 200);

/// A scene wider than this, as height over width, has its panels one below the other.
const WIDE_BELOW: f64 = 0.7;

type Point = (f64, f64);

/// Draws the paths of all vehicles from above, one panel for each run, 1800 pixels wide, around
/// the obstacles and the places where lane changes began.
///
/// # Errors
/// When the picture can't be drawn or written.
pub fn plot_trajectories(
    path: &Path,
    road: &Road,
    scenery: &[SceneryPart],
    runs: &[RunSeries],
) -> Result<(), ViewerError> {
    let window = Window::around(runs);
    let (rows, columns) = if window.aspect() < WIDE_BELOW {
        (runs.len().max(1), 1)
    } else {
        (1, runs.len().max(1))
    };
    let panel_width_px = (WIDTH_PX - LEGEND_PX) / columns as u32;
    let plot_width_px = panel_width_px - Y_LABELS_PX - 2 * MARGIN_PX;
    let plot_height_px = (window.aspect() * f64::from(plot_width_px)).clamp(300.0, 1200.0);
    let window = window.with_aspect(plot_height_px / f64::from(plot_width_px));
    let height_px = plot_height_px as u32 + TITLE_PX + X_LABELS_PX + 2 * MARGIN_PX;
    draw_png(path, [WIDTH_PX, rows as u32 * height_px], |area| {
        let (panels, legend) = area.split_horizontally(WIDTH_PX - LEGEND_PX);
        for (run, panel) in runs.iter().zip(panels.split_evenly((rows, columns))) {
            let backdrop = Backdrop { road, scenery };
            draw_panel(&titled(&panel, &run.title)?, &window, &backdrop, run)?;
        }
        draw_legend(&legend, &keys(runs))
    })
}

fn keys(runs: &[RunSeries]) -> Vec<(Key, String)> {
    let mut keys = runs.first().map(vehicle_keys).unwrap_or_default();
    keys.extend([
        (Key::Triangle(INK), "lane change begins".to_owned()),
        (Key::Dot(INK), "end of the run".to_owned()),
        (Key::Block(rgb(palette::BLACK)), "stationary".to_owned()),
        (Key::Block(SCENERY), "walls, buildings".to_owned()),
    ]);
    keys
}

/// The part of the plane that is shown, in metres.
struct Window {
    x_m: Range<f64>,
    y_m: Range<f64>,
}

impl Window {
    /// Holds obstacles and beginnings of lane changes; without any, all paths.
    fn around(runs: &[RunSeries]) -> Self {
        let vehicles = || runs.iter().flat_map(|run| &run.vehicles);
        let events = vehicles().flat_map(|vehicle| {
            let obstacle = vehicle
                .samples
                .iter()
                .take(usize::from(vehicle.info.kind == VehicleKind::Obstacle));
            obstacle.chain(vehicle.lane_change_starts())
        });
        let mut points: Vec<_> = events.map(|sample| sample.pose.position()).collect();
        if points.is_empty() {
            let samples = vehicles().flat_map(|vehicle| &vehicle.samples);
            points = samples.map(|sample| sample.pose.position()).collect();
        }
        let range = |axis: usize| {
            let values = points.iter().map(|point| point[axis]);
            let low = values.clone().fold(f64::INFINITY, f64::min);
            let high = values.fold(f64::NEG_INFINITY, f64::max);
            if low <= high {
                low - SURROUNDINGS_M..high + SURROUNDINGS_M
            } else {
                -SURROUNDINGS_M..SURROUNDINGS_M
            }
        };
        Self {
            x_m: range(0),
            y_m: range(1),
        }
    }

    /// Height over width.
    fn aspect(&self) -> f64 {
        (self.y_m.end - self.y_m.start) / (self.x_m.end - self.x_m.start)
    }

    /// Widened to the given height over width, so that a metre is the same on both axes.
    fn with_aspect(self, aspect: f64) -> Self {
        let widened = |range: Range<f64>, factor: f64| {
            let (middle, half) = (
                (range.start + range.end) / 2.0,
                (range.end - range.start) / 2.0 * factor,
            );
            middle - half..middle + half
        };
        let missing = aspect / self.aspect();
        Self {
            x_m: widened(self.x_m, (1.0 / missing).max(1.0)),
            y_m: widened(self.y_m, missing.max(1.0)),
        }
    }

    fn holds(&self, &(x, y): &Point) -> bool {
        self.x_m.contains(&x) && self.y_m.contains(&y)
    }

    /// The pieces of a finely sampled line that lie within.
    fn visible(&self, line: impl IntoIterator<Item = Point>) -> Vec<Vec<Point>> {
        let mut pieces = vec![Vec::new()];
        for point in line {
            match pieces.last_mut() {
                Some(piece) if self.holds(&point) => piece.push(point),
                Some(piece) if !piece.is_empty() => pieces.push(Vec::new()),
                _ => {}
            }
        }
        pieces
    }

    /// A convex polygon cut at the borders (Sutherland and Hodgman).
    fn cut(&self, mut polygon: Vec<Point>) -> Vec<Point> {
        let (x, y) = (&self.x_m, &self.y_m);
        let borders = [
            (1.0, 0.0, x.start),
            (-1.0, 0.0, -x.end),
            (0.0, 1.0, y.start),
            (0.0, -1.0, -y.end),
        ];
        for (nx, ny, offset) in borders {
            let inside = |&(x, y): &Point| nx * x + ny * y - offset;
            polygon = (0..polygon.len())
                .flat_map(|i| {
                    let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                    let (da, db) = (inside(&a), inside(&b));
                    let crossing = (da * db < 0.0).then(|| {
                        let t = da / (da - db);
                        (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1))
                    });
                    [(da >= 0.0).then_some(a), crossing].into_iter().flatten()
                })
                .collect();
        }
        polygon
    }
}

struct Backdrop<'a> {
    road: &'a Road,
    scenery: &'a [SceneryPart],
}

impl Backdrop<'_> {
    fn curve(&self, d_m: f64) -> Vec<Point> {
        offset_curve(self.road, &stations(self.road), d_m)
            .iter()
            .map(|point| (point.x, point.y))
            .collect()
    }

    /// Quadrilaterals of asphalt.
    fn surface(&self) -> Vec<Vec<Point>> {
        let left = self.curve(self.road.mark_offset_m(0));
        let right = self.curve(self.road.mark_offset_m(MARK_COUNT - 1));
        (1..left.len())
            .map(|i| vec![left[i - 1], right[i - 1], right[i], left[i]])
            .collect()
    }

    /// Outlines from above.
    fn walls(&self) -> Vec<Vec<Point>> {
        let faces = self
            .scenery
            .iter()
            .flat_map(|part| convex_hull_faces(&part.vertices_m));
        faces
            .map(|face| {
                face.corners
                    .iter()
                    .map(|corner| (corner.x, corner.y))
                    .collect()
            })
            .collect()
    }
}

fn draw_panel<'a>(
    panel: &Area<'a>,
    window: &Window,
    backdrop: &Backdrop,
    run: &RunSeries,
) -> Result<(), DrawError<'a>> {
    let mut chart = ChartBuilder::on(panel)
        .margin(MARGIN_PX)
        .x_label_area_size(X_LABELS_PX)
        .y_label_area_size(Y_LABELS_PX)
        .build_cartesian_2d(window.x_m.clone(), window.y_m.clone())?;
    chart
        .configure_mesh()
        .disable_mesh()
        .axis_style(INK)
        .bold_line_style(PALE)
        .x_desc("x in m")
        .y_desc("y in m")
        .x_labels(6)
        .y_labels(6)
        .x_label_formatter(&|x_m| format!("{x_m:.0}"))
        .y_label_formatter(&|y_m| format!("{y_m:.0}"))
        .label_style(font(18))
        .axis_desc_style(font(20))
        .draw()?;
    let polygon =
        |corners: Vec<Point>, color: RGBColor| Polygon::new(window.cut(corners), color.filled());
    let line = |piece: Vec<Point>, color: RGBColor, width| {
        PathElement::new(piece, color.stroke_width(width))
    };
    chart.draw_series(
        backdrop
            .surface()
            .into_iter()
            .map(|quad| polygon(quad, ASPHALT)),
    )?;
    for mark in 0..MARK_COUNT {
        let is_edge = mark == 0 || mark == MARK_COUNT - 1;
        let color = if is_edge { INK } else { LANE_LINE };
        let pieces = window.visible(backdrop.curve(backdrop.road.mark_offset_m(mark)));
        chart.draw_series(pieces.into_iter().map(|piece| line(piece, color, 1)))?;
    }
    chart.draw_series(
        backdrop
            .walls()
            .into_iter()
            .map(|wall| polygon(wall, SCENERY)),
    )?;
    for (vehicle, color) in run.vehicles.iter().zip(colors(run)) {
        let path: Vec<Point> = vehicle
            .samples
            .iter()
            .map(|sample| (sample.pose.x_m, sample.pose.y_m))
            .collect();
        match vehicle.info.kind {
            VehicleKind::Obstacle => {
                chart.draw_series(outline(vehicle).map(|corners| polygon(corners, color)))?;
                continue;
            }
            VehicleKind::Human => {
                for piece in window.visible(path.iter().copied()) {
                    let style = color.stroke_width(2);
                    chart.draw_series(DashedLineSeries::new(piece, 8, 5, style))?;
                }
            }
            VehicleKind::Cav => {
                let pieces = window.visible(path.iter().copied());
                chart.draw_series(pieces.into_iter().map(|piece| line(piece, color, 3)))?;
            }
        }
        let end = path.last().copied().filter(|point| window.holds(point));
        chart.draw_series(end.map(|point| Circle::new(point, 6, color.filled())))?;
        chart.draw_series(
            vehicle
                .lane_change_starts()
                .map(|sample| (sample.pose.x_m, sample.pose.y_m))
                .map(|point| TriangleMarker::new(point, 10, color.filled())),
        )?;
    }
    Ok(())
}

/// The body of a vehicle that stands still, from above.
fn outline(vehicle: &VehicleSeries) -> Option<Vec<Point>> {
    let pose = vehicle.samples.first()?.pose;
    let corners = vehicle.info.dimensions.corners_from_axle();
    Some(
        corners
            .iter()
            .map(|corner| pose.transform(*corner))
            .map(|corner| (corner.x, corner.y))
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_is_cut_at_the_window() {
        let window = Window {
            x_m: 0.0..10.0,
            y_m: 0.0..10.0,
        };
        let cut = window.cut(vec![(-5.0, 2.0), (5.0, 2.0), (5.0, 4.0), (-5.0, 4.0)]);
        let area: f64 = (0..cut.len())
            .map(|i| {
                let (a, b) = (cut[i], cut[(i + 1) % cut.len()]);
                0.5 * (a.0 * b.1 - b.0 * a.1)
            })
            .sum();
        assert!((area - 10.0).abs() < 1e-9, "{cut:?}");
        assert!(
            window
                .cut(vec![(20.0, 0.0), (21.0, 0.0), (20.0, 1.0)])
                .is_empty()
        );
    }

    #[test]
    fn a_metre_is_the_same_on_both_axes() {
        let window = Window {
            x_m: 0.0..100.0,
            y_m: 0.0..20.0,
        };
        let fitted = window.with_aspect(0.5);
        assert!((fitted.aspect() - 0.5).abs() < 1e-12);
        assert!((fitted.y_m.start + 15.0).abs() < 1e-12);
    }
}
