//! Figure 5: growth with the size of the mesh and with the number of threads.

use super::{
    data::{Data, Sample},
    figure::{Axis, Figure, Grid, Look, Scale, Series},
};
use crate::report::{count, three};

/// The power by which y grows with x: the slope of a line through the logarithms.
fn exponent(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs = || points.iter().map(|&(x, y)| (x.ln(), y.ln()));
    let (mx, my) = logs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (top, bottom) =
        logs().fold((0.0, 0.0), |(t, b), (x, y)| (t + (x - mx) * (y - my), b + (x - mx) * (x - mx)));
    top / bottom
}

/// A number of a sample, with its name.
type Number = (&'static str, fn(&Sample) -> f64);

/// Time to build and to trace against triangles.
pub(super) fn sizes(data: &Data) -> Option<Figure> {
    let mut series = Vec::new();
    let mut said = Vec::new();
    for device in ["cpu", "gpu"] {
        let of: Vec<&Sample> = data.sizes.iter().filter(|s| s.device == device).collect();
        if of.len() < 2 {
            continue;
        }
        let numbers: [Number; 2] = [("build", |s| s.cost.build_ms), ("a million rays", |s| s.cost.ray_ns)];
        for (kind, (what, number)) in numbers.into_iter().enumerate() {
            let points: Vec<_> = of.iter().map(|s| (f64::from(s.cost.triangles), number(s))).collect();
            // From ten thousand on, if there are enough: below, a card waits for launches.
            let large: Vec<_> = points.iter().copied().filter(|&(n, _)| n > 9e3).collect();
            let fitted = if large.len() >= 2 { &large } else { &points };
            let power = exponent(fitted);
            let name = format!("{}, {what}: N^{power:.2}", device.to_uppercase());
            said.push(format!("{what} on the {} as N^{power:.2}", device.to_uppercase()));
            let mut line = Series::new(name, Look::Line, kind, device == "gpu");
            points.into_iter().for_each(|(x, y)| line.mark(x, y, ""));
            series.push(line);
        }
    }
    let mut grid = Grid::new(&["device", "triangles", "build ms", "build ns a triangle", "ns a ray"]);
    grid.rows = data
        .sizes
        .iter()
        .map(|s| {
            vec![
                s.device.to_uppercase(),
                count(s.cost.triangles.into()),
                three(s.cost.build_ms),
                three(s.cost.build_ms * 1e6 / f64::from(s.cost.triangles.max(1))),
                three(s.cost.ray_ns),
            ]
        })
        .collect();
    (!series.is_empty()).then(|| Figure {
        file: "5-size".to_owned(),
        title: "Growth with the mesh (teapots)".to_owned(),
        say: format!(
            "Of ten thousand triangles and more, time grows: {}; N log N would be about N^1.08.",
            said.join(", ")
        ),
        x: Axis::new("triangles", Scale::Log),
        y: Axis::new("ms", Scale::Log),
        series,
        grid,
    })
}

/// Speed-up by threads.
pub(super) fn threads(data: &Data) -> Option<Figure> {
    let most = data.threads.iter().map(|s| s.threads).max()?;
    let mut series = Vec::new();
    let mut said = Vec::new();
    let numbers: [Number; 2] = [("build", |s| s.cost.build_ms), ("rays", |s| s.cost.ray_ns)];
    for (kind, (builder, (what, number))) in
        ["binned", "exact"].into_iter().flat_map(|b| numbers.map(|n| (b, n))).enumerate()
    {
        let of: Vec<&Sample> = data.threads.iter().filter(|s| s.choice.name == builder).collect();
        let Some(one) = of.iter().find(|s| s.threads == 1).map(|s| number(s)) else { continue };
        let mut line = Series::new(format!("{builder}, {what}"), Look::Line, kind, false);
        for sample in of {
            let gain = one / number(sample);
            line.mark(sample.threads as f64, gain, "");
            if sample.threads == most {
                said.push(format!("{builder} {what} {gain:.1} times"));
            }
        }
        series.push(line);
    }
    let mut ideal = Series::new("as many times as threads", Look::Dashed, 3, false);
    ideal.mark(1.0, 1.0, "");
    ideal.mark(most as f64, most as f64, "");
    series.push(ideal);
    let mut grid = Grid::new(&["threads", "builder", "build ms", "ns a ray"]);
    grid.rows = data
        .threads
        .iter()
        .map(|s| {
            vec![
                s.threads.to_string(),
                s.choice.name.to_owned(),
                three(s.cost.build_ms),
                three(s.cost.ray_ns),
            ]
        })
        .collect();
    Some(Figure {
        file: "5-threads".to_owned(),
        title: "Growth with threads (a teapot)".to_owned(),
        say: format!("{most} threads against one: {}.", said.join(", ")),
        x: Axis::new("threads", Scale::Linear),
        y: Axis::new("times as fast as one thread", Scale::Linear),
        series,
        grid,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents() {
        let square: Vec<_> = [1.0f64, 3.0, 10.0].iter().map(|&x| (x, 7.0 * x * x)).collect();
        assert!((exponent(&square) - 2.0).abs() < 1e-12);
    }
}
