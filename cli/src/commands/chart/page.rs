//! The page: all figures in one file that needs no other.

use super::figure::{Figure, Grid, plain};
use std::fmt::Write as _;

const STYLE: &str = "\
body{font:16px/1.5 sans-serif;max-width:46rem;margin:0 auto;padding:0 .8rem;color:#111;background:#fff}\
figure{margin:2rem 0}svg{width:100%;height:auto;display:block}figcaption{margin:.3rem 0}\
details{overflow-x:auto;font-size:.85rem}table{border-collapse:collapse;white-space:nowrap}\
td,th{padding:.1rem .6rem;text-align:right;border-bottom:1px solid #ddd}td:first-child,th:first-child{text-align:left}\
footer{border-top:1px solid #888;margin-top:2rem;font-size:.85rem;overflow-wrap:anywhere}";

/// Text as HTML.
fn text(text: &str) -> String {
    plain(text).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn table(grid: &Grid) -> String {
    let row = |cells: &[String], tag: &str| {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", text(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = grid.rows.iter().map(|cells| row(cells, "td")).collect();
    format!("<table>\n{}{rows}</table>", row(&grid.titles, "th"))
}

/// A page of figures, each with its SVG; `made` says how it was made, a line each.
pub(super) fn page(title: &str, figures: &[(Figure, String)], made: &[String]) -> String {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <title>{0}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{0}</h1>\n\
         <p>Full marks and lines are the CPU, hollow marks and dashes the GPU. Rays are those of a picture and a \
         bounce from each hit, unless said. Times are the best of some; moving rays is counted in totals only.</p>\n",
        text(title)
    );
    for (figure, svg) in figures {
        let _ = writeln!(
            html,
            "<figure id=\"{}\">\n{}\n<figcaption>{}</figcaption>\n\
             <details><summary>Numbers</summary>\n{}\n</details>\n</figure>",
            text(&figure.file),
            svg.trim(),
            text(&figure.say),
            table(&figure.grid)
        );
    }
    html.push_str("<footer>\n");
    for line in made {
        let _ = writeln!(html, "<p>{}</p>", text(line));
    }
    html + "</footer>\n</body>\n</html>\n"
}
