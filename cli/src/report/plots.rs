//! Charts as SVG, which takes the page's colours.

use std::fmt::{Display, Write as _};
use std::ops::Range;

use gravisight::{Error, Result};
use nalgebra::Point3;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

/// Size of a chart, px, before the page fits it into its card.
const SIZE: (u32, u32) = (440, 270);
const SPACE_SIZE: (u32, u32) = (440, 360);
/// plotters divides it by 1.24.
const FONT_SIZE: u32 = 16;
/// Most labels of an axis.
const LABELS: usize = 6;
/// Colours by their name in the style sheet. A chart holds those of the light page; [`colour_rules`] does the rest.
pub const QUIET: RGBColor = RGBColor(0x5a, 0x60, 0x75);
const GRID: RGBColor = RGBColor(0xdd, 0xe0, 0xea);
pub const FOUND: RGBColor = RGBColor(0xe0, 0x16, 0x5f);
pub const TRUTH: RGBColor = RGBColor(0x12, 0x80, 0x5c);
pub const ACCENT: RGBColor = RGBColor(0x43, 0x38, 0xb8);
pub const OTHER: RGBColor = RGBColor(0xa3, 0x5c, 0x00);
const COLOURS: [(&str, RGBColor); 7] = [
    ("quiet", QUIET),
    ("line", GRID),
    // plotters' own, for the axes in space.
    ("line", BLACK),
    ("found", FOUND),
    ("truth", TRUTH),
    ("accent", ACCENT),
    ("other", OTHER),
];

/// A chart with two axes.
type Flat<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// One axis.
pub struct Axis {
    pub label: &'static str,
    pub range: Range<f64>,
    /// Whether the numbers along it are decimal logarithms of what is meant.
    pub log: bool,
}

/// What a chart shows.
pub enum Mark {
    /// Bars between neighbouring edges.
    Bars {
        edges: Vec<f64>,
        heights: Vec<f64>,
    },
    Line(Vec<(f64, f64)>, RGBColor),
    Dots(Vec<(f64, f64)>, RGBColor),
}

/// Rules that give the charts' colours the values that the page has for them.
pub fn colour_rules() -> String {
    let mut rules = String::new();
    for (name, RGBColor(red, green, blue)) in COLOURS {
        for attribute in ["fill", "stroke"] {
            let value = format!("#{red:02X}{green:02X}{blue:02X}");
            let _ = writeln!(rules, "svg [{attribute}=\"{value}\"] {{ {attribute}: var(--{name}) }}");
        }
    }
    rules
}

impl Axis {
    pub fn new(label: &'static str, range: Range<f64>) -> Self {
        Self { label, range, log: false }
    }

    /// An axis that holds `values`, with a little room.
    pub fn around(label: &'static str, values: impl Iterator<Item = f64> + Clone) -> Self {
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let high = values.fold(f64::NEG_INFINITY, f64::max);
        let room = ((high - low) * 0.05).max(1e-6);
        Self::new(label, low - room..high + room)
    }

    fn words(&self, value: f64) -> String {
        if self.log {
            let meant = 10_f64.powf(value);
            // Two digits that count.
            return number(meant, (1.0 - meant.log10().floor()).max(0.0) as usize);
        }
        number(value, digits(&self.range))
    }
}

/// A chart of `marks`, the first at the back.
///
/// # Errors
/// [`Error::Format`] where it cannot be drawn.
pub fn chart(x: &Axis, y: &Axis, marks: &[Mark]) -> Result<String> {
    drawn(SIZE, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(6)
            .margin_right(14)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(x.range.clone(), y.range.clone())
            .map_err(refused)?;
        let label = ("sans-serif", FONT_SIZE).into_font().color(&QUIET);
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID)
            .axis_style(GRID)
            .label_style(label)
            .x_labels(LABELS)
            .y_labels(LABELS)
            .x_label_formatter(&|value| x.words(*value))
            .y_label_formatter(&|value| y.words(*value))
            .x_desc(x.label)
            .y_desc(y.label)
            .draw()
            .map_err(refused)?;
        marks.iter().try_for_each(|mark| draw(mark, &mut chart))
    })
}

/// Draws one mark.
fn draw(mark: &Mark, chart: &mut Flat<'_>) -> Result<()> {
    match mark {
        Mark::Bars { edges, heights } => {
            let bars = edges.windows(2).zip(heights);
            let bars = bars.map(|(side, &height)| Rectangle::new([(side[0], 0.0), (side[1], height)], bar()));
            chart.draw_series(bars).map_err(refused)?;
        }
        Mark::Line(points, colour) => {
            chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2))).map_err(refused)?;
        }
        Mark::Dots(points, colour) => {
            let dots = points.iter().map(|&point| Circle::new(point, 4, colour.filled()));
            chart.draw_series(dots).map_err(refused)?;
        }
    }
    Ok(())
}

/// Bars are a little lighter than lines, so that what is on them stands out.
fn bar() -> ShapeStyle {
    ACCENT.mix(0.65).filled()
}

/// A path in the world frame (m, z up).
pub struct PlottedPath<'a> {
    pub points: &'a [Point3<f64>],
    pub colour: RGBColor,
    /// Whether it has a shadow on the ground.
    pub shadow: bool,
}

/// Paths in space.
///
/// # Errors
/// [`Error::Format`] where it cannot be drawn.
pub fn space(paths: &[PlottedPath<'_>]) -> Result<String> {
    let [x, y, z] = cube(paths);
    let ground = z.start;
    // plotters has y up and z towards the viewer.
    let away = -y.end..-y.start;
    drawn(SPACE_SIZE, |root| {
        let mut chart =
            ChartBuilder::on(root).margin(4).build_cartesian_3d(x.clone(), z.clone(), away.clone()).map_err(refused)?;
        chart.with_projection(|mut projection| {
            (projection.pitch, projection.yaw, projection.scale) = (0.3, 0.6, 0.8);
            projection.into_matrix()
        });
        chart
            .configure_axes()
            .axis_panel_style(TRANSPARENT)
            .light_grid_style(TRANSPARENT)
            .bold_grid_style(GRID)
            .label_style(("sans-serif", FONT_SIZE).into_font().color(&QUIET))
            .x_labels(4)
            .y_labels(4)
            .z_labels(4)
            .x_formatter(&|x| format!("x {}", number(*x, 1)))
            .y_formatter(&|z| format!("z {}", number(*z, 1)))
            .z_formatter(&|y| format!("y {}", number(-y, 1)))
            .draw()
            .map_err(refused)?;
        for PlottedPath { points, colour, .. } in paths.iter().filter(|path| path.shadow) {
            let shadow = points.iter().map(|point| (point.x, ground, -point.y));
            chart.draw_series(LineSeries::new(shadow, colour.mix(0.3).stroke_width(2))).map_err(refused)?;
        }
        for PlottedPath { points, colour, .. } in paths {
            let path = points.iter().map(|point| (point.x, point.z, -point.y));
            chart.draw_series(LineSeries::new(path, colour.stroke_width(2))).map_err(refused)?;
        }
        Ok(())
    })
}

/// The cube around paths: one scale for all axes.
fn cube(paths: &[PlottedPath<'_>]) -> [Range<f64>; 3] {
    let extent = |axis: usize| {
        let values = || paths.iter().flat_map(|path| path.points).map(|point| point[axis]);
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let half = (0..3).map(|axis| extent(axis).1 - extent(axis).0).fold(0.2, f64::max) * 0.525;
    std::array::from_fn(|axis| {
        let middle = (extent(axis).0 + extent(axis).1) / 2.0;
        middle - half..middle + half
    })
}

/// What `draw` draws, as an `svg` element.
fn drawn(size: (u32, u32), draw: impl Fn(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    draw(&root)?;
    root.present().map_err(refused)?;
    drop(root);
    Ok(svg)
}

fn refused(error: impl Display) -> Error {
    Error::format("chart")(error)
}

/// Decimal places that tell neighbouring labels of an axis apart.
fn digits(range: &Range<f64>) -> usize {
    let step = (range.end - range.start) / LABELS as f64;
    (1.0 - step.max(1e-9).log10().floor()).max(0.0) as usize
}

/// A number without zeros that say nothing.
fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".into() } else { short.replace('-', "−") }
}
