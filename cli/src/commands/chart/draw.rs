//! Drawing a figure, as SVG or as pixels.

use super::{
    figure::{Figure, Look, Series, plain},
    scale::Ruler,
};
use crate::png_file;
use anyhow::{Context as _, anyhow};
use plotters::{
    coord::{Shift, ranged1d::Ranged as _},
    element::DashedPathElement,
    prelude::*,
    style::{
        FontStyle, register_font,
        text_anchor::{HPos, Pos, VPos},
    },
};
use std::sync::OnceLock;

/// Of the chart itself; the legend comes below.
const SIZE: [u32; 2] = [640, 430];
/// Height of a line of the legend.
const LINE: u32 = 24;
/// Dots of a bitmap for each of an SVG.
const DENSE: u32 = 2;
/// Letters of a legend's entry, at most two entries beside each other.
const SHORT: usize = 34;

/// Told apart by all kinds of colour vision (Okabe & Ito 2008), dark enough on white.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(0, 0, 0),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];
/// Corners of marks, other than circles.
const SHAPES: [&[(f64, f64)]; 7] = [
    &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
    &[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)],
    &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
    &[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)],
    &[(-0.4, -1.2), (0.4, -1.2), (0.4, 1.2), (-0.4, 1.2)],
    &[(-1.2, -0.4), (1.2, -0.4), (1.2, 0.4), (-1.2, 0.4)],
    &[(-1.1, -1.1), (1.1, -1.1), (-1.1, 1.1), (1.1, 1.1)],
];

type Area<DB> = DrawingArea<DB, Shift>;

/// The figure as an SVG document.
pub(super) fn svg(figure: &Figure) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size(figure)).into_drawing_area();
        draw(&area, figure, 1)?;
    }
    // The backend's own title, for those who hear the page; figures never hold markup.
    Ok(plain(&text).replacen("<svg ", "<svg role=\"img\" ", 1))
}

/// The figure as a PNG file's bytes.
pub(super) fn png(figure: &Figure) -> anyhow::Result<Vec<u8>> {
    let (width, height) = size(figure);
    let (width, height) = (width * DENSE, height * DENSE);
    let mut rgb = vec![255; width as usize * height as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut rgb, (width, height)).into_drawing_area();
        draw(&area, figure, DENSE as i32)?;
    }
    let mut bytes = Vec::new();
    png_file::write(&mut bytes, &rgb, [width, height])?;
    Ok(bytes)
}

fn size(figure: &Figure) -> (u32, u32) {
    let entries = legend(figure);
    let lines: usize = entries.iter().map(Vec::len).sum::<usize>().min(entries.len());
    (SIZE[0], SIZE[1] + LINE * lines as u32 + 6)
}

/// Series with names, in lines of one or two.
fn legend(figure: &Figure) -> Vec<Vec<&Series>> {
    let mut lines: Vec<Vec<&Series>> = Vec::new();
    for series in figure.series.iter().filter(|series| !series.name.is_empty()) {
        let short = |series: &Series| series.name.chars().count() <= SHORT;
        match lines.last_mut() {
            Some(line) if line.len() == 1 && short(line[0]) && short(series) => line.push(series),
            _ => lines.push(vec![series]),
        }
    }
    lines
}

fn font() -> anyhow::Result<()> {
    static DONE: OnceLock<bool> = OnceLock::new();
    let bytes = include_bytes!("../../../assets/charts.ttf");
    let done = DONE.get_or_init(|| register_font("sans-serif", FontStyle::Normal, bytes).is_ok());
    done.then_some(()).context("the charts' font cannot be read: this program was built wrong")
}

/// What plotters reports; its errors borrow from the picture.
fn undrawn(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot draw: {error}")
}

fn draw<DB: DrawingBackend>(root: &Area<DB>, figure: &Figure, k: i32) -> anyhow::Result<()> {
    font()?;
    root.fill(&WHITE).map_err(undrawn)?;
    let (above, below) = root.split_vertically(SIZE[1] as i32 * k);
    let numbers =
        |of: fn(&super::figure::Mark) -> f64| figure.series.iter().flat_map(|series| &series.marks).map(of);
    let x = Ruler::over(&figure.x.scale, numbers(|mark| mark.x));
    let y = Ruler::over(&figure.y.scale, numbers(|mark| mark.y));
    let names = matches!(figure.y.scale, super::figure::Scale::Names(_));
    let mut chart = ChartBuilder::on(&above)
        .margin(10 * k)
        .margin_right(24 * k)
        .caption(&figure.title, ("sans-serif", 19 * k))
        .x_label_area_size(48 * k)
        .y_label_area_size(if names { 190 } else { 74 } * k)
        .build_cartesian_2d(x.clone(), y.clone())
        .map_err(undrawn)?;
    chart
        .configure_mesh()
        .x_desc(&figure.x.label)
        .y_desc(&figure.y.label)
        .x_labels(8)
        .y_labels(if names { 40 } else { 8 })
        .label_style(("sans-serif", 15 * k))
        .axis_desc_style(("sans-serif", 16 * k))
        .bold_line_style(RGBColor(215, 215, 215))
        .light_line_style(TRANSPARENT)
        .draw()
        .map_err(undrawn)?;
    let plot = chart.plotting_area();
    let at = |x: f64, y: f64| plot.map_coordinate(&(x, y));
    if let Some(zero) = x.zero() {
        let ends = [y.range().start, y.range().end].map(|y| at(zero, y));
        let dots = DashedPathElement::new(ends, 2 * k, 3 * k, BLACK.stroke_width(k as u32));
        above.draw(&dots).map_err(undrawn)?;
    }
    // Nothing is written over a mark either.
    let all = figure.series.iter().flat_map(|series| &series.marks).map(|mark| at(mark.x, mark.y));
    let mut taken: Vec<Place> = all.map(|(x, y)| [x - 6 * k, y - 6 * k, x + 6 * k, y + 6 * k]).collect();
    for series in &figure.series {
        let points: Vec<_> = series.marks.iter().map(|mark| at(mark.x, mark.y)).collect();
        line(&above, series, &points, k)?;
        for (mark, &point) in series.marks.iter().zip(&points) {
            let (left, _) = at(x.start(), mark.y);
            if series.look == Look::Bars {
                let half = 13 * k;
                let bar = [(left, point.1 - half), (point.0, point.1 + half)];
                let style = colour(series).filled();
                above.draw(&Rectangle::new(bar, style)).map_err(undrawn)?;
            } else {
                shape(&above, series, point, k)?;
            }
            label(&above, &mark.label, point, left, k, series.look == Look::Bars, &mut taken)?;
        }
    }
    for (row, entries) in legend(figure).into_iter().enumerate() {
        let width = SIZE[0] as i32 * k / if entries.len() == 2 { 2 } else { 1 };
        for (column, series) in entries.into_iter().enumerate() {
            let middle = row as i32 * LINE as i32 * k + LINE as i32 * k / 2;
            let left = column as i32 * width + 24 * k;
            line(&below, series, &[(left - 14 * k, middle), (left + 14 * k, middle)], k)?;
            shape(&below, series, (left, middle), k)?;
            let style =
                ("sans-serif", 15 * k).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
            below.draw(&Text::new(series.name.clone(), (left + 20 * k, middle), style)).map_err(undrawn)?;
        }
    }
    root.present().map_err(undrawn)
}

fn colour(series: &Series) -> RGBColor {
    COLOURS[series.kind % COLOURS.len()]
}

/// The line through the points of a series, if it has one.
fn line<DB: DrawingBackend>(
    area: &Area<DB>,
    series: &Series,
    points: &[(i32, i32)],
    k: i32,
) -> anyhow::Result<()> {
    let points = points.to_vec();
    match (series.look, series.hollow) {
        (Look::Marks | Look::Bars | Look::Ring, _) => Ok(()),
        (Look::Line, false) => {
            area.draw(&PathElement::new(points, colour(series).stroke_width(2 * k as u32)))
        }
        (Look::Line, true) => {
            let style = colour(series).stroke_width(2 * k as u32);
            area.draw(&DashedPathElement::new(points, 7 * k, 4 * k, style))
        }
        (Look::Dashed, _) => {
            let style = colour(series).stroke_width(k as u32);
            area.draw(&DashedPathElement::new(points, 4 * k, 4 * k, style))
        }
    }
    .map_err(undrawn)
}

fn shape<DB: DrawingBackend>(
    area: &Area<DB>,
    series: &Series,
    (x, y): (i32, i32),
    k: i32,
) -> anyhow::Result<()> {
    let style = colour(series).filled();
    match series.look {
        Look::Dashed => return Ok(()),
        Look::Ring => {
            let ring = colour(series).stroke_width(2 * k as u32);
            return area.draw(&Circle::new((x, y), 10 * k, ring)).map_err(undrawn);
        }
        Look::Bars => {
            let square = [(x - 6 * k, y - 6 * k), (x + 6 * k, y + 6 * k)];
            return area.draw(&Rectangle::new(square, style)).map_err(undrawn);
        }
        Look::Marks | Look::Line => {}
    }
    // Outlines by two fillings: strokes of bitmaps leave gaps at corners.
    let inside = if series.hollow { 3 } else { 6 };
    for (radius, style) in [(6, style), (inside, if series.hollow { WHITE.filled() } else { style })] {
        let size = f64::from(radius * k);
        match (series.kind % (SHAPES.len() + 1)).checked_sub(1) {
            None => area.draw(&Circle::new((x, y), radius * k, style)),
            Some(at) => {
                let place = |&(dx, dy): &(f64, f64)| (x + (dx * size) as i32, y + (dy * size) as i32);
                area.draw(&Polygon::new(SHAPES[at].iter().map(place).collect::<Vec<_>>(), style))
            }
        }
        .map_err(undrawn)?;
    }
    Ok(())
}

/// Where words are: left, top, right and bottom.
type Place = [i32; 4];

/// Words beside a point: to its right if there is room and nothing is in the way, else to its left, above, below, or
/// beside and above or below; not left of `least`, where the axis is.
fn label<DB: DrawingBackend>(
    area: &Area<DB>,
    text: &str,
    (x, y): (i32, i32),
    least: i32,
    k: i32,
    inside: bool,
    taken: &mut Vec<Place>,
) -> anyhow::Result<()> {
    if text.is_empty() {
        return Ok(());
    }
    let style = ("sans-serif", 13 * k).into_font();
    let (width, height) =
        area.estimate_text_size(text, &style.clone().into_text_style(area)).map_err(undrawn)?;
    let (width, height) = (width as i32, height as i32);
    let place = |left: i32, middle: i32| [left, middle - height / 2, left + width, middle + height / 2];
    let beside = [x + 9 * k, x - 9 * k - width].map(|left| place(left, y));
    let over = [y - 16 * k, y + 16 * k].map(|middle| place(x - width / 2, middle));
    let corners = [y - 14 * k, y + 14 * k]
        .map(|middle| [x + 5 * k, x - 5 * k - width].map(|left| place(left, middle)))
        .concat();
    let fits = |at: &&Place| at[0] >= least && at[2] <= SIZE[0] as i32 * k;
    let is_free = |at: &&Place| !taken.iter().any(|other| meet(at, other));
    let all = || beside.iter().chain(&over).chain(&corners).filter(fits);
    let at = *all().find(is_free).or_else(|| all().next()).unwrap_or(&beside[1]);
    taken.push(at);
    let colour = if at[0] < x && inside { WHITE } else { BLACK };
    let style = style.color(&colour).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(text.to_owned(), (at[0], (at[1] + at[3]) / 2), style)).map_err(undrawn)
}

/// Whether two places overlap.
fn meet(a: &Place, b: &Place) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::{
        super::figure::{Axis, Grid, Scale},
        *,
    };

    fn figure() -> Figure {
        let mut series = vec![
            Series::new("CPU, exact <&>", Look::Line, 0, false),
            Series::new("GPU, exact", Look::Marks, 1, true),
            Series::new("CPU, other", Look::Marks, 2, false),
        ];
        series[0].mark(1.0, 2.0, "here");
        series[0].mark(100.0, 4.0, "");
        series[1].mark(0.0, 3.0, "");
        series[2].mark(9.0, 1.0, "");
        Figure {
            file: "f".to_owned(),
            title: "A & B".to_owned(),
            say: String::new(),
            x: Axis::new("failures per million", Scale::LogZero),
            y: Axis::new("Mray/s", Scale::Linear),
            series,
            grid: Grid::default(),
        }
    }

    /// Where the words are that a drawing begins with `start`.
    fn places_of(svg: &str, start: &str) -> Vec<(String, String)> {
        let texts = svg.split("<text ").filter(|text| text.contains(start));
        let number =
            |text: &str, name: &str| text.split(name).nth(1).unwrap().split('"').next().unwrap().to_owned();
        texts.map(|text| (number(text, "x=\""), number(text, "y=\""))).collect()
    }

    #[test]
    fn words_at_one_point_are_written_apart() {
        let mut figure = figure();
        for name in ["word one", "word two", "word three", "word four"] {
            figure.series[2].mark(9.0, 3.5, name);
        }
        let places = places_of(&svg(&figure).unwrap(), "\nword ");
        assert_eq!(places.len(), 4, "{places:?}");
        for (i, place) in places.iter().enumerate() {
            assert!(!places[..i].contains(place), "{places:?}");
        }
    }

    #[test]
    fn words_leave_marks_and_the_axis_free() {
        let place = |y_of_the_other: f64| {
            let mut figure = figure();
            figure.x.scale = Scale::Linear;
            figure.series[2].mark(0.0, 3.5, "word at the axis");
            figure.series[2].mark(8.0, y_of_the_other, "");
            let places = places_of(&svg(&figure).unwrap(), "\nword at");
            let [(x, y)] = &places[..] else { panic!("{places:?}") };
            [x, y].map(|text| text.parse::<i32>().unwrap())
        };
        let (free, beside) = (place(1.5), place(3.5));
        // Another mark is where the words were, and to the left and above is the axis.
        assert!((free[0] - 5..=free[0]).contains(&beside[0]), "{free:?} {beside:?}");
        assert_ne!(free[1], beside[1]);
    }

    #[test]
    fn both_forms_are_drawn() {
        let svg = svg(&figure()).unwrap();
        assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"), "{svg}");
        for part in ["A &amp; B", "CPU, exact &lt;&amp;&gt;", "Mray/s", "failures per million", "here"] {
            assert!(svg.contains(part), "{part}: {svg}");
        }
        let bytes = png(&figure()).unwrap();
        let mut image = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        assert_eq!(image.info().width, SIZE[0] * DENSE);
        let mut rgb = vec![0; image.output_buffer_size().unwrap()];
        image.next_frame(&mut rgb).unwrap();
        // The marks' colours, and the white around.
        for expected in [COLOURS[0], COLOURS[1], COLOURS[2], WHITE] {
            assert!(rgb.chunks(3).any(|p| p == [expected.0, expected.1, expected.2]), "{expected:?}");
        }
    }

    #[test]
    fn letters_of_many_languages_are_drawn() {
        let drawn = |title: &str| png(&Figure { title: title.to_owned(), ..figure() }).unwrap();
        let [none, e] = [drawn("x\u{f0000}"), drawn("xe")];
        for letter in ["ä", "Ø", "ł", "ő", "Ω", "ж", "é", "ß"] {
            let picture = drawn(&format!("x{letter}"));
            assert!(picture != none && picture != e, "{letter}");
        }
        assert!(drawn("x") != none, "what the font lacks is a box");
    }

    #[test]
    fn names_of_any_file_are_drawn() {
        let title = "a\u{1}\u{1b}[2J\u{ffff}.ply".to_owned();
        let svg = svg(&Figure { title, ..figure() }).unwrap();
        roxmltree::Document::parse(&svg).unwrap();
        assert!(svg.contains("a\u{fffd}\u{fffd}[2J\u{fffd}.ply"), "{svg}");
    }

    #[test]
    fn nothing_measured_is_drawn_too() {
        let empty = Figure { series: Vec::new(), ..figure() };
        assert!(svg(&empty).is_ok() && png(&empty).is_ok());
    }
}
