//! Charts as SVG, which takes the page's colours.

use std::fmt::{Display, Write as _};
use std::ops::Range;

use nalgebra::Point3;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::error::{Error, Result};

/// Size of a chart, px, before the page fits it into its card.
const SIZE: (u32, u32) = (440, 270);
const SPACE_SIZE: (u32, u32) = (440, 360);
/// plotters divides it by 1.24.
const FONT_SIZE: u32 = 16;
/// Most labels of an axis.
const LABELS: usize = 6;
/// Colours by their name in the style sheet. A chart holds those of the light page; [`colour_rules`] does the rest.
const QUIET: RGBColor = RGBColor(0x5a, 0x60, 0x75);
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
        for mark in marks {
            match mark {
                Mark::Bars { edges, heights } => {
                    let bars = edges.windows(2).zip(heights);
                    let bars = bars.map(|(side, &height)| Rectangle::new([(side[0], 0.0), (side[1], height)], bar()));
                    chart.draw_series(bars).map(|_| ())
                }
                Mark::Line(points, colour) => {
                    chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2))).map(|_| ())
                }
                Mark::Dots(points, colour) => {
                    let dots = points.iter().map(|&point| Circle::new(point, 4, colour.filled()));
                    chart.draw_series(dots).map(|_| ())
                }
            }
            .map_err(refused)?;
        }
        Ok(())
    })
}

/// Bars are a little lighter than lines, so that what is on them stands out.
fn bar() -> ShapeStyle {
    ACCENT.mix(0.65).filled()
}

/// Two paths in the world frame (m, z up), with their shadows on the ground.
///
/// # Errors
/// [`Error::Format`] where it cannot be drawn.
pub fn space(truth: &[Point3<f64>], found: &[Point3<f64>]) -> Result<String> {
    let points = || truth.iter().chain(found);
    let middle: [f64; 3] = std::array::from_fn(|axis| {
        let low = points().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
        let high = points().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
        (low + high) / 2.0
    });
    // One scale for all axes.
    let half = points().flat_map(|point| (0..3).map(move |axis| (point[axis] - middle[axis]).abs()));
    let half = half.fold(0.1, f64::max) * 1.05;
    let around = |value: f64| value - half..value + half;
    let ground = middle[2] - half;
    // plotters has y up and z towards the viewer.
    let place = |point: &Point3<f64>| (point.x, point.z, -point.y);
    drawn(SPACE_SIZE, |root| {
        let mut chart = ChartBuilder::on(root)
            .margin(4)
            .build_cartesian_3d(around(middle[0]), around(middle[2]), around(-middle[1]))
            .map_err(refused)?;
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
        for (path, colour) in [(truth, TRUTH), (found, FOUND)] {
            let shadow = path.iter().map(|point| (point.x, ground, -point.y));
            chart.draw_series(LineSeries::new(shadow, colour.mix(0.3).stroke_width(2))).map_err(refused)?;
        }
        for (path, colour) in [(truth, TRUTH), (found, FOUND)] {
            chart.draw_series(LineSeries::new(path.iter().map(place), colour.stroke_width(2))).map_err(refused)?;
        }
        Ok(())
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
