//! Error against time, as SVG and PNG.

use std::error::Error;
use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, RgbImage};
use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, LogCoord, WithKeyPoints};
use plotters::prelude::*;

use crate::Outcome;
use crate::common::figure::COLOURS;
use crate::settings::{Axis, Setting};
use crate::summary::{Point, curve, front, settings};
use crate::table::{Column, Row, write_whole};

type Area<DB> = DrawingArea<DB, Shift>;

/// Two panels with one legend.
struct Figure {
    title: String,
    panels: Vec<Panel>,
    labels: Vec<String>,
}

struct Panel {
    title: &'static str,
    x: &'static str,
    y: &'static str,
    /// One for each label.
    curves: Vec<Vec<Point>>,
    front: bool,
}

const SIZE: (u32, u32) = (1360, 560);
const LEGEND: u32 = 300;
/// Bitmaps are drawn larger and averaged, so that lines and letters are smooth.
const OVERSAMPLING: u32 = 3;

/// The figures of a scene: `SCENE.svg` against the scene without blur, all settings, with the
/// Pareto front; `SCENE-noise.svg` against the converged blurred scene, the settings that converge
/// to the same. Each as PNG too.
pub fn scene(folder: &Path, scene: &str, rows: &[Row], base: &Setting) -> Outcome<()> {
    let mut all = settings(rows, scene);
    all.sort_by_key(|s| *s != base);
    let same: Vec<&Setting> = all
        .iter()
        .copied()
        .filter(|s| s.same_limit(base) && s.axis(base) != Some(Axis::Cutoff))
        .collect();
    let figure = |of: &str, settings: &[&Setting], errors: [Column; 2], front: bool| {
        let panel = |title, x, y, time, error| Panel {
            title,
            x,
            y,
            curves: settings
                .iter()
                .map(|s| curve(rows, scene, s, time, error))
                .collect(),
            front,
        };
        Figure {
            title: format!("{scene}: error against {of}"),
            panels: vec![
                panel(
                    "image",
                    "time of a forward pass, s",
                    "RMSE, radiance clipped to [0, 1]",
                    Column::Forward,
                    errors[0],
                ),
                panel(
                    "gradient",
                    "time of a forward and backward pass, s",
                    "relative L2 error",
                    Column::ForwardBackward,
                    errors[1],
                ),
            ],
            labels: settings.iter().map(|s| s.label(base)).collect(),
        }
    };
    let errors = [Column::UnblurredRmse, Column::UnblurredGradient];
    let unblurred = figure("the scene without blur", &all, errors, true);
    unblurred.write(&folder.join(scene))?;
    let errors = [Column::BlurredRmse, Column::BlurredGradient];
    let noise = figure("the converged blurred scene (noise)", &same, errors, false);
    noise.write(&folder.join(format!("{scene}-noise")))
}

impl Figure {
    /// As `.svg` and `.png`.
    fn write(&self, path: &Path) -> Outcome<()> {
        let mut text = String::new();
        self.draw(
            &SVGBackend::with_string(&mut text, SIZE).into_drawing_area(),
            1,
        )?;
        write_whole(&path.with_extension("svg"), text.as_bytes())?;
        png(&path.with_extension("png"), SIZE, |area, scale| {
            self.draw(area, scale)
        })
    }

    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Outcome<()>
    where
        DB::ErrorType: 'static,
    {
        area.fill(&WHITE)?;
        let area = area.margin(8 * scale, 0, 0, 0);
        let area = area.titled(&self.title, ("sans-serif", 18 * scale))?;
        let (panels, legend) = area.split_horizontally((SIZE.0 - LEGEND) * scale);
        for (panel, area) in self
            .panels
            .iter()
            .zip(panels.split_evenly((1, self.panels.len())))
        {
            panel.draw(&area, scale)?;
        }
        self.legend(&legend, scale)?;
        area.present()?;
        Ok(())
    }

    fn legend<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Outcome<()>
    where
        DB::ErrorType: 'static,
    {
        let s = scale as i32;
        let font = ("sans-serif", 13 * scale).into_font();
        let (left, mut y) = (8 * s, 34 * s);
        for (i, label) in self.labels.iter().enumerate() {
            let line = [(left, y), (left + 26 * s, y)];
            let width = if i == 0 { 3 * scale } else { scale };
            area.draw(&PathElement::new(line, colour(i).stroke_width(width)))?;
            area.draw(&(EmptyElement::at((left + 13 * s, y)) + marker(i, s)))?;
            for (k, part) in wrapped(label, 32).iter().enumerate() {
                let at = (left + 34 * s, y - 7 * s + 16 * s * k as i32);
                area.draw(&Text::new(part.clone(), at, font.clone()))?;
                y += 16 * s * i32::from(k > 0);
            }
            y += 20 * s;
        }
        if self.panels.iter().any(|p| p.front) {
            let line = [(left, y), (left + 26 * s, y)];
            area.draw(&PathElement::new(line, front_style(scale)))?;
            area.draw(&Circle::new(
                (left + 13 * s, y),
                7 * s,
                BLACK.stroke_width(scale),
            ))?;
            let text = "Pareto front: none faster and better";
            area.draw(&Text::new(text, (left + 34 * s, y - 7 * s), font))?;
        }
        Ok(())
    }
}

impl Panel {
    fn draw<DB: DrawingBackend>(&self, area: &Area<DB>, scale: u32) -> Outcome<()>
    where
        DB::ErrorType: 'static,
    {
        let s = scale as i32;
        let shown = |p: &&Point| p.0 > 0.0 && p.1 > 0.0 && p.1.is_finite();
        let points: Vec<Point> = self
            .curves
            .iter()
            .flatten()
            .filter(shown)
            .copied()
            .collect();
        if points.is_empty() {
            return Ok(());
        }
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, ("sans-serif", 15 * scale))
            .margin(10 * scale)
            .x_label_area_size(44 * scale)
            .y_label_area_size(60 * scale)
            .build_cartesian_2d(
                axis(points.iter().map(|p| p.0)),
                axis(points.iter().map(|p| p.1)),
            )?;
        chart
            .configure_mesh()
            .x_desc(self.x)
            .y_desc(self.y)
            .x_label_formatter(&number)
            .y_label_formatter(&number)
            .axis_desc_style(("sans-serif", 14 * scale))
            .label_style(("sans-serif", 12 * scale))
            .light_line_style(RGBColor(240, 240, 240).stroke_width(scale))
            .bold_line_style(RGBColor(215, 215, 215).stroke_width(scale))
            .axis_style(BLACK.stroke_width(scale))
            .draw()?;
        if self.front {
            let front = front(&points);
            let rings = front
                .iter()
                .map(|&p| Circle::new(p, 7 * s, BLACK.stroke_width(scale)));
            chart.draw_series(LineSeries::new(front.iter().copied(), front_style(scale)))?;
            chart.draw_series(rings)?;
        }
        for (i, curve) in self.curves.iter().enumerate() {
            let mut curve: Vec<Point> = curve.iter().filter(shown).copied().collect();
            curve.sort_by(|a, b| a.0.total_cmp(&b.0));
            // The first is the base.
            let style = colour(i).stroke_width(if i == 0 { 3 * scale } else { scale });
            chart.draw_series(LineSeries::new(curve.iter().copied(), style))?;
            let markers = curve.iter().map(|&p| EmptyElement::at(p) + marker(i, s));
            chart.draw_series(markers)?;
        }
        Ok(())
    }
}

fn colour(i: usize) -> RGBColor {
    COLOURS[i % COLOURS.len()]
}

fn front_style(scale: u32) -> ShapeStyle {
    BLACK.mix(0.25).stroke_width(5 * scale)
}

/// The marker of a curve about (0, 0), in screen pixels: another shape for each round of colours.
fn marker(i: usize, scale: i32) -> Polygon<(i32, i32)> {
    let (corners, radius) = [(20, 3.6), (3, 5.2), (4, 4.8)][i / COLOURS.len() % 3];
    let corner = |k: i32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(corners)).sin_cos();
        let at = |v: f64| (v * radius * f64::from(scale)).round() as i32;
        (at(sin), -at(cos))
    };
    Polygon::new((0..corners).map(corner).collect::<Vec<_>>(), colour(i))
}

fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().expect("it begins with one");
        if !line.is_empty() && line.chars().count() + word.chars().count() >= width {
            lines.push(word.to_owned());
        } else {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

/// Logarithmic, with some room and over a factor of 10 at least. Numbers at 1, 2 and 5 of each
/// decade, at the decades alone where there are many.
fn axis(values: impl Iterator<Item = f64> + Clone) -> WithKeyPoints<LogCoord<f64>> {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    let room = (10.0 * low / high).sqrt().max(1.4);
    let (low, high) = (low / room, high * room);
    let at = |digits: &[f64]| -> Vec<f64> {
        let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
        decades
            .flat_map(|k| digits.iter().map(move |d| d * 10f64.powi(k)))
            .filter(|v| (low..=high).contains(v))
            .collect()
    };
    let digits: &[f64] = if high / low < 300.0 {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    (low..high)
        .log_scale()
        .with_key_points(at(digits))
        .with_light_points(at(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]))
}

fn number(v: &f64) -> String {
    if (0.001..1e4).contains(v) {
        format!("{}", (v * 1e6).round() / 1e6)
    } else {
        format!("{v:.0e}")
    }
}

/// Draws in a bitmap, larger by the number that the function is given, and writes it.
pub fn png(
    path: &Path,
    (width, height): (u32, u32),
    draw: impl FnOnce(&Area<BitMapBackend>, u32) -> Result<(), Box<dyn Error>>,
) -> Outcome<()> {
    const N: u32 = OVERSAMPLING;
    let (w, h) = (width * N, height * N);
    let mut large = vec![0u8; (3 * w * h) as usize];
    draw(
        &BitMapBackend::with_buffer(&mut large, (w, h)).into_drawing_area(),
        N,
    )?;
    let small = RgbImage::from_fn(width, height, |x, y| {
        let channel = |c: u32| {
            let at = |i: u32, j: u32| large[(3 * ((y * N + j) * w + x * N + i) + c) as usize];
            let all = (0..N * N).map(|k| u32::from(at(k % N, k / N)));
            (all.sum::<u32>() / (N * N)) as u8
        };
        image::Rgb([channel(0), channel(1), channel(2)])
    });
    let mut bytes = Cursor::new(Vec::new());
    small.write_to(&mut bytes, ImageFormat::Png)?;
    write_whole(path, bytes.get_ref())
}
