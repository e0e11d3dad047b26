//! Pictures of runs side by side.

use std::path::Path;
use std::sync::Once;

use covista_world::Se2Pose;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::palette::{self, Rgb};
use crate::{VehicleInfo, VehicleKind, ViewerError};

mod curves;
mod frontier;
mod speeds;
mod trajectories;

pub use curves::{Curve, CurvePanel, plot_curves};
pub use frontier::{FrontierPanel, FrontierPoint, FrontierSeries, plot_frontier};
pub use speeds::plot_speeds;
pub use trajectories::plot_trajectories;

/// One run of a scenario.
#[derive(Debug, Clone)]
pub struct RunSeries {
    /// What stands above its panel, such as `Sharing on`.
    pub title: String,
    /// Its vehicles, in the same order in every run so that they get the same colours.
    pub vehicles: Vec<VehicleSeries>,
}

/// A vehicle over a run.
#[derive(Debug, Clone)]
pub struct VehicleSeries {
    /// Which vehicle.
    pub info: VehicleInfo,
    /// Its states in order of time.
    pub samples: Vec<VehicleSample>,
    /// When its lane changes began, in seconds.
    pub lane_change_starts_s: Vec<f64>,
}

/// A vehicle at one time.
#[derive(Debug, Clone, Copy)]
pub struct VehicleSample {
    /// Time since the run began, in seconds.
    pub time_s: f64,
    /// Pose of the rear axle in the world.
    pub pose: Se2Pose,
    /// Speed in m/s.
    pub speed_mps: f64,
}

impl VehicleSeries {
    /// The samples at which lane changes began.
    fn lane_change_starts(&self) -> impl Iterator<Item = &VehicleSample> {
        self.lane_change_starts_s.iter().filter_map(|&start_s| {
            self.samples.iter().min_by(|a, b| {
                (a.time_s - start_s)
                    .abs()
                    .total_cmp(&(b.time_s - start_s).abs())
            })
        })
    }
}

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
type DrawError<'a> = DrawingAreaErrorKind<<BitMapBackend<'a> as DrawingBackend>::ErrorType>;

const FONT: &str = "DejaVu Sans";
const TITLE_PX: u32 = 44;
const LEGEND_PX: u32 = 260;
const MARGIN_PX: u32 = 14;
const X_LABELS_PX: u32 = 58;
const Y_LABELS_PX: u32 = 76;
const INK: RGBColor = RGBColor(40, 40, 40);
const PALE: RGBColor = RGBColor(225, 225, 225);

/// Draws a picture in memory and writes it whole or not at all.
fn draw_png(
    path: &Path,
    [width, height]: [u32; 2],
    draw: impl for<'a> FnOnce(&Area<'a>) -> Result<(), DrawError<'a>>,
) -> Result<(), ViewerError> {
    register_fonts();
    let mut pixels = vec![255; 3 * width as usize * height as usize];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present())
            .map_err(|error| ViewerError::plot(path, error))?;
    }
    let mut png = Vec::new();
    image::ImageEncoder::write_image(
        image::codecs::png::PngEncoder::new(&mut png),
        &pixels,
        width,
        height,
        image::ExtendedColorType::Rgb8,
    )
    .map_err(|error| ViewerError::plot(path, error))?;
    let partial = path.with_extension("png.part");
    std::fs::write(&partial, png)
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(|source| {
            std::fs::remove_file(&partial).ok();
            ViewerError::Write {
                path: path.to_owned(),
                source,
            }
        })
}

fn register_fonts() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        for (style, bytes) in [
            (FontStyle::Normal, dejavu::sans::regular()),
            (FontStyle::Bold, dejavu::sans::bold()),
        ] {
            // A font that can't be read shows as the error of the first text that is drawn.
            plotters::style::register_font(FONT, style, bytes).ok();
        }
    });
}

fn rgb([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

fn font(size_px: u32) -> TextStyle<'static> {
    (FONT, size_px).into_font().color(&INK)
}

/// The colour of each vehicle of a run: CAVs differ, human drivers are grey.
fn colors(run: &RunSeries) -> Vec<RGBColor> {
    let mut cavs = 0..;
    run.vehicles
        .iter()
        .map(|vehicle| {
            rgb(match vehicle.info.kind {
                VehicleKind::Cav => palette::series_color(cavs.next().unwrap_or(0)),
                VehicleKind::Human => palette::GREY,
                VehicleKind::Obstacle => palette::BLACK,
            })
        })
        .collect()
}

/// Writes a panel's title and returns what is left of it.
fn titled<'a>(panel: &Area<'a>, title: &str) -> Result<Area<'a>, DrawError<'a>> {
    let (strip, rest) = panel.split_vertically(TITLE_PX);
    strip.draw(&Text::new(
        title.to_owned(),
        ((Y_LABELS_PX + MARGIN_PX) as i32, TITLE_PX as i32 - 6),
        (FONT, 24, FontStyle::Bold)
            .into_font()
            .color(&INK)
            .pos(Pos::new(HPos::Left, VPos::Bottom)),
    ))?;
    Ok(rest)
}

/// What a line of the legend shows before its text.
enum Key {
    Line(RGBColor),
    Dashes(RGBColor),
    Triangle(RGBColor),
    Dot(RGBColor),
    Block(RGBColor),
}

/// The legend's lines for the vehicles of a run.
fn vehicle_keys(run: &RunSeries) -> Vec<(Key, String)> {
    let mut keys: Vec<_> = run
        .vehicles
        .iter()
        .zip(colors(run))
        .filter(|(vehicle, _)| vehicle.info.kind == VehicleKind::Cav)
        .map(|(vehicle, color)| (Key::Line(color), vehicle.info.label.clone()))
        .collect();
    let has_humans = run
        .vehicles
        .iter()
        .any(|vehicle| vehicle.info.kind == VehicleKind::Human);
    if has_humans {
        keys.push((Key::Dashes(rgb(palette::GREY)), "human driver".to_owned()));
    }
    keys
}

fn draw_legend<'a>(area: &Area<'a>, keys: &[(Key, String)]) -> Result<(), DrawError<'a>> {
    const ROW_PX: i32 = 32;
    for (row, (key, text)) in (0..).zip(keys) {
        let y = TITLE_PX as i32 + MARGIN_PX as i32 + 10 + row * ROW_PX;
        let line = |from: i32, to: i32, color: &RGBColor| {
            PathElement::new([(from, y), (to, y)], color.stroke_width(4))
        };
        match key {
            Key::Line(color) => area.draw(&line(8, 48, color))?,
            Key::Dashes(color) => {
                area.draw(&line(8, 24, color))?;
                area.draw(&line(32, 48, color))?;
            }
            Key::Triangle(color) => area.draw(&TriangleMarker::new((28, y), 9, color.filled()))?,
            Key::Dot(color) => area.draw(&Circle::new((28, y), 7, color.filled()))?,
            Key::Block(color) => {
                area.draw(&Rectangle::new([(12, y - 8), (44, y + 8)], color.filled()))?;
            }
        }
        let style = font(20).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(text.clone(), (60, y), style))?;
    }
    Ok(())
}
