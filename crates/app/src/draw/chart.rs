//! Charts of a few series, as SVG and as pixels with the program's own letters.

use std::convert::Infallible;
use std::fmt::Debug;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind};

use super::canvas::{Canvas, TEXT_HEIGHT};
use crate::input::RgbFrame;

/// Size of a chart, pixels.
const SIZE: (u32, u32) = (1200, 640);
/// Room for the numbers beside the axes, pixels.
const LABELS: [u32; 2] = [96, 56];
/// Width of a line, pixels.
const LINE: u32 = 2;
/// Colours of the series in turn, told apart by people who see no red or no green, too `[Okabe2008]`.
const COLORS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

fn stroke(color: RGBColor, width: u32) -> ShapeStyle {
    ShapeStyle { color: color.to_rgba(), filled: true, stroke_width: width }
}

/// How the values of a chart are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marks {
    /// A line through them.
    Lines,
    /// A bar for each, one unit of x wide.
    Bars,
}

/// Values over x, which counts from a first whole number on.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend; none is shown when empty.
    pub name: String,
    /// One value for each x.
    pub values: Vec<f64>,
}

/// A chart of values over whole numbers.
#[derive(Clone, Debug)]
pub struct Chart {
    /// What stands above it: what the values are, and their unit.
    pub title: String,
    /// What x counts.
    pub x_label: String,
    /// The first x.
    pub first_x: u32,
    /// How values are shown.
    pub marks: Marks,
    /// The values.
    pub series: Vec<Series>,
}

impl Chart {
    /// The chart as an SVG document.
    pub fn to_svg(&self) -> String {
        let mut text = String::new();
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        self.draw(&root).expect("a string takes any text");
        drop(root);
        text
    }

    /// The chart as pixels.
    pub fn to_frame(&self) -> RgbFrame {
        let mut canvas = Canvas::filled(SIZE.0, SIZE.1, [255; 3]);
        let root = Pixels(&mut canvas).into_drawing_area();
        self.draw(&root).expect("a canvas takes any pixel");
        drop(root);
        canvas.into_frame()
    }

    /// From zero, or the least value where it is less, to a little above the largest.
    fn y_range(&self) -> Range<f64> {
        let values =
            || self.series.iter().flat_map(|series| series.values.iter().copied()).filter(|v| v.is_finite());
        let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
        low..if high > low { low + 1.08 * (high - low) } else { low + 1.0 }
    }

    /// The corner where a legend covers the fewest values; the upper right one among equals.
    fn legend_position(&self) -> SeriesLabelPosition {
        /// Parts of the width and height that a legend takes, about.
        const LEGEND: [f64; 2] = [0.2, 0.3];
        let y_range = self.y_range();
        let covered = |[from_left, from_top]: [bool; 2]| {
            let near = |part: f64, from_zero: bool| if from_zero { part } else { 1.0 - part };
            let covered_of = |series: &Series| {
                let last = (series.values.len().max(2) - 1) as f64;
                let right = (0..).map(|index| f64::from(index) / last);
                let down = series.values.iter().map(|y| (y_range.end - y) / (y_range.end - y_range.start));
                right
                    .zip(down)
                    .filter(|&(x, y)| near(x, from_left) < LEGEND[0] && near(y, from_top) < LEGEND[1])
                    .count()
            };
            self.series.iter().map(covered_of).sum::<usize>()
        };
        [
            (SeriesLabelPosition::UpperRight, [false, true]),
            (SeriesLabelPosition::UpperLeft, [true, true]),
            (SeriesLabelPosition::LowerRight, [false, false]),
            (SeriesLabelPosition::LowerLeft, [true, false]),
        ]
        .into_iter()
        .min_by_key(|(_, corner)| covered(*corner))
        .map_or(SeriesLabelPosition::UpperRight, |(position, _)| position)
    }

    fn draw<B: DrawingBackend>(
        &self,
        root: &DrawingArea<B, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>>
    where
        B::ErrorType: Debug,
    {
        root.fill(&WHITE)?;
        let letters = ("monospace", TEXT_HEIGHT).into_font();
        let first = f64::from(self.first_x);
        let count = self.series.iter().map(|series| series.values.len()).max().unwrap_or(0).max(1) as f64;
        // Bars stand about their x.
        let (x_range, ticks) = match self.marks {
            Marks::Lines => (first..first + (count - 1.0).max(1.0), 10),
            Marks::Bars => (first - 0.5..first + count - 0.5, count as usize),
        };
        let mut chart = ChartBuilder::on(root)
            .margin(16)
            .caption(&self.title, letters.clone())
            .x_label_area_size(LABELS[1])
            .y_label_area_size(LABELS[0])
            .build_cartesian_2d(x_range, self.y_range())?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(225, 225, 225))
            .x_desc(&self.x_label)
            .x_labels(ticks.min(30))
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_labels(6)
            .label_style(letters.clone())
            .axis_desc_style(letters.clone())
            .draw()?;
        for (series, color) in self.series.iter().zip(COLORS.into_iter().cycle()) {
            let points = (0..).map(|index| first + f64::from(index)).zip(series.values.iter().copied());
            let drawn = match self.marks {
                Marks::Lines => chart.draw_series(LineSeries::new(points, stroke(color, LINE)))?,
                Marks::Bars => chart.draw_series(
                    points.map(|(x, y)| Rectangle::new([(x - 0.4, 0.0), (x + 0.4, y)], color.filled())),
                )?,
            };
            if !series.name.is_empty() {
                drawn
                    .label(&series.name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], stroke(color, 2 * LINE)));
            }
        }
        if self.series.iter().any(|series| !series.name.is_empty()) {
            chart
                .configure_series_labels()
                .position(self.legend_position())
                .background_style(WHITE.mix(0.85))
                .border_style(RGBColor(180, 180, 180))
                .legend_area_size(32)
                .margin(8)
                .label_font(letters)
                .draw()?;
        }
        root.present()
    }
}

/// A canvas as `plotters` sees it. Its only letters are those of the program, [`TEXT_HEIGHT`] high: no system font is asked.
struct Pixels<'a>(&'a mut Canvas);

fn rgb(color: BackendColor) -> [u8; 3] {
    let (red, green, blue) = color.rgb;
    [red, green, blue]
}

/// The middle of a pixel.
fn middle((x, y): BackendCoord) -> [f32; 2] {
    [x as f32 + 0.5, y as f32 + 0.5]
}

impl DrawingBackend for Pixels<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        (self.0.width(), self.0.height())
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Infallible>> {
        Ok(())
    }

    fn draw_pixel(
        &mut self,
        at: BackendCoord,
        color: BackendColor,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        self.0.blend(i64::from(at.0), i64::from(at.1), rgb(color), color.alpha as f32);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        if style.color().alpha > 0.0 {
            self.0.line(middle(from), middle(to), style.stroke_width() as f32, rgb(style.color()));
        }
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        let points: Vec<BackendCoord> = path.into_iter().collect();
        points.windows(2).try_for_each(|ends| self.draw_line(ends[0], ends[1], style))
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        _: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        Ok((Canvas::text_width(text), TEXT_HEIGHT))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        at: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Infallible>> {
        let (width, height) = (i64::from(Canvas::text_width(text)), i64::from(TEXT_HEIGHT));
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => width / 2,
            HPos::Right => width,
        };
        let above = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => height / 2,
            VPos::Bottom => height,
        };
        self.0.text(i64::from(at.0) - left, i64::from(at.1) - above, text, rgb(style.color()));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(marks: Marks) -> Chart {
        let series = |name: &str, scale: f64| Series {
            name: name.into(),
            values: (0..50).map(|i| scale * f64::from(i)).collect(),
        };
        Chart {
            title: "a title".into(),
            x_label: "frame".into(),
            first_x: 0,
            marks,
            series: vec![series("one", 0.5), series("two", 1.0)],
        }
    }

    /// Pixels nearly of a colour.
    fn count(frame: &RgbFrame, color: RGBColor) -> usize {
        let is_near = |pixel: &[u8]| {
            pixel.iter().zip([color.0, color.1, color.2]).all(|(value, wanted)| value.abs_diff(wanted) < 16)
        };
        frame.pixels.chunks_exact(3).filter(|pixel| is_near(pixel)).count()
    }

    #[test]
    fn both_forms_show_every_series_and_the_words() {
        let svg = chart(Marks::Lines).to_svg();
        for part in ["<svg", "a title", "frame", "one", "two", "#0072B2", "#D55E00"] {
            assert!(svg.contains(part), "{part} is missing:\n{svg}");
        }
        let lines = chart(Marks::Lines).to_frame();
        // A line across the chart, as thick as it is; and letters.
        for color in &COLORS[..2] {
            assert!(count(&lines, *color) > SIZE.0 as usize, "{} pixels", count(&lines, *color));
        }
        assert!(count(&lines, BLACK) > 200);
        assert_eq!(count(&lines, COLORS[2]), 0, "there is no third series");
        assert!(count(&chart(Marks::Bars).to_frame(), COLORS[1]) > 20 * count(&lines, COLORS[1]));
    }

    #[test]
    fn the_highest_value_is_drawn_where_the_scale_says() {
        // Full scale is 1.08 of the highest value, 100: nothing of a flat line at 100 is in the lower nine tenths.
        let flat = Chart {
            series: vec![Series { name: String::new(), values: vec![100.0; 9] }],
            ..chart(Marks::Lines)
        };
        let frame = flat.to_frame();
        let rows: Vec<usize> = (0..frame.height as usize)
            .filter(|row| {
                let pixel = 3 * (row * frame.width as usize + frame.width as usize / 2);
                frame.pixels[pixel..pixel + 3] == [COLORS[0].0, COLORS[0].1, COLORS[0].2]
            })
            .collect();
        assert!(!rows.is_empty() && rows.iter().all(|row| *row < SIZE.1 as usize / 5), "{rows:?}");
    }

    #[test]
    fn the_legend_leaves_values_uncovered() {
        let position = |values: Vec<f64>| {
            let series = vec![Series { name: "a".into(), values }];
            Chart { series, ..chart(Marks::Lines) }.legend_position()
        };
        let (rising, high) = ((0..20).map(f64::from).collect(), vec![9.0; 20]);
        assert!(matches!(position(rising), SeriesLabelPosition::UpperLeft));
        assert!(matches!(position(high), SeriesLabelPosition::LowerRight));
        assert!(matches!(position(vec![9.0, 5.0, 1.0, 0.0, 0.0]), SeriesLabelPosition::UpperRight));
    }

    #[test]
    fn nothing_and_not_numbers_make_an_empty_chart() {
        for series in [vec![], vec![Series { name: "a".into(), values: vec![f64::NAN, f64::INFINITY] }]] {
            let empty = Chart { series, ..chart(Marks::Lines) };
            assert_eq!(empty.y_range(), 0.0..1.0);
            assert!(empty.to_svg().contains("a title"));
        }
    }
}
