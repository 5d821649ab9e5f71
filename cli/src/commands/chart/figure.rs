//! A figure as plain data: what is drawn, what is told, and the numbers behind it.

/// How numbers lie along an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Scale {
    /// From 0 on.
    Linear,
    /// By powers of ten.
    Log,
    /// By powers of ten, and 0, which has a line of its own at the low end.
    LogZero,
    /// One place for each name.
    Names(Vec<String>),
}

/// One of the two axes.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    /// What it shows, and the unit.
    pub label: String,
    pub scale: Scale,
}

impl Axis {
    pub(super) fn new(label: &str, scale: Scale) -> Self {
        Self { label: label.to_owned(), scale }
    }
}

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// Marks.
    Marks,
    /// Marks, joined by a line.
    Line,
    /// A thin dashed line alone.
    Dashed,
    /// Bars from the left.
    Bars,
    /// A large ring around what was marked already.
    Ring,
}

/// One point.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mark {
    pub x: f64,
    pub y: f64,
    /// Written beside it.
    pub label: String,
}

/// Points of one kind.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub name: String,
    pub look: Look,
    /// Colour and shape.
    pub kind: usize,
    /// Shapes and lines: empty and dashed, as opposed to full.
    pub hollow: bool,
    pub marks: Vec<Mark>,
}

impl Series {
    pub(super) fn new(name: impl Into<String>, look: Look, kind: usize, hollow: bool) -> Self {
        Self { name: name.into(), look, kind, hollow, marks: Vec::new() }
    }

    pub(super) fn mark(&mut self, x: f64, y: f64, label: &str) {
        if x.is_finite() && y.is_finite() {
            self.marks.push(Mark { x, y, label: label.to_owned() });
        }
    }
}

/// Titles and rows of cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Grid {
    pub titles: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Grid {
    pub(super) fn new(titles: &[&str]) -> Self {
        Self { titles: titles.iter().map(|&title| title.to_owned()).collect(), rows: Vec::new() }
    }

    /// Comma-separated, as RFC 4180 has it.
    pub(super) fn csv(&self) -> String {
        let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
        for row in std::iter::once(&self.titles).chain(&self.rows) {
            writer.write_record(row).expect("memory takes it all");
        }
        String::from_utf8(writer.into_inner().expect("memory takes it all")).expect("of strings")
    }
}

/// A chart.
#[derive(Clone, Debug)]
pub(super) struct Figure {
    /// Name of its files, without an ending.
    pub file: String,
    pub title: String,
    /// One sentence: what there is to see.
    pub say: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// All numbers.
    pub grid: Grid,
}

/// Most letters of a scene's name in the names of files, which have 255 bytes at most.
const SLUG: usize = 100;

/// A scene's name in the names of files; of a long path its end.
pub(super) fn slug(scene: &str) -> String {
    let slug = scene.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
    slug[slug.len().saturating_sub(SLUG)..].to_owned()
}

/// Text without characters that XML has no place for, or that move a terminal's cursor: names of files may hold them.
pub(super) fn plain(text: &str) -> String {
    let is_strange = |c: char| c.is_control() && c != '\n' || matches!(c, '\u{fffe}' | '\u{ffff}');
    text.replace(is_strange, "\u{fffd}")
}

/// The points that no other beats in both, by rising x: small x and large y are good.
pub(super) fn front(points: impl Iterator<Item = Mark>) -> Vec<Mark> {
    let mut points: Vec<Mark> = points.collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(b.y.total_cmp(&a.y)));
    let mut best = f64::NEG_INFINITY;
    points.retain(|point| {
        let better = point.y > best;
        best = best.max(point.y);
        better
    });
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_keeps_what_is_not_beaten() {
        let mark = |x, y| Mark { x, y, label: String::new() };
        let points = [mark(3.0, 5.0), mark(1.0, 2.0), mark(2.0, 1.0), mark(3.0, 4.0), mark(1.0, 1.0)];
        assert_eq!(front(points.into_iter()), [mark(1.0, 2.0), mark(3.0, 5.0)]);
        assert!(front(std::iter::empty()).is_empty());
    }

    #[test]
    fn names_of_files_are_short() {
        assert_eq!(slug("teapot:2"), "teapot-2");
        assert_eq!(slug(&format!("/{}/\u{e4}.ply", "d".repeat(300))), format!("{}---ply", "d".repeat(94)));
    }

    #[test]
    fn csv_quotes_what_needs_it() {
        let mut grid = Grid::new(&["a", "b"]);
        grid.rows.push(vec!["1,000".to_owned(), "say \"so\"".to_owned()]);
        assert_eq!(grid.csv(), "a,b\n\"1,000\",\"say \"\"so\"\"\"\n");
    }
}
