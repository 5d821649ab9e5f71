//! Figure 1: speed against accuracy.

use super::{
    data::{Accuracy, Data},
    figure::{Axis, Figure, Grid, Look, Mark, Scale, Series, front},
};
use crate::report::{count, three};
use raykd::Intersector;

/// Mray/s against failures per million.
pub(super) fn figure(data: &Data, scene: &str) -> Option<Figure> {
    let all = &data.accuracy;
    let first = all.first()?;
    let mut grid = Grid::new(&["method", "stress rays", "failures", "per million", "device", "Mray/s"]);
    let mut series = Vec::new();
    let devices: Vec<&str> = first.mrays.iter().map(|&(device, _)| device).collect();
    for &device in &devices {
        let speed =
            |row: &Accuracy| row.mrays.iter().find(|(kind, _)| *kind == device).map(|&(_, speed)| speed);
        let points = all
            .iter()
            .filter_map(|row| Some(Mark { x: row.per_million(), y: speed(row)?, label: row.method.clone() }));
        let front = front(points);
        for (kind, test) in Intersector::ALL.iter().copied().enumerate() {
            let name = format!("{}, {}", device.to_uppercase(), test.name());
            let mut marks = Series::new(name, Look::Marks, kind, device == "gpu");
            for row in all.iter().filter(|row| row.test == test) {
                let Some(speed) = speed(row) else { continue };
                let label = if front.iter().any(|mark| mark.label == row.method) { &row.method } else { "" };
                marks.mark(row.per_million(), speed, label);
                grid.rows.push(vec![
                    row.method.clone(),
                    count(row.rays),
                    count(row.failures),
                    three(row.per_million()),
                    device.to_uppercase(),
                    three(speed),
                ]);
            }
            series.push(marks);
        }
        let mut line = Series::new("", Look::Dashed, 3, device == "gpu");
        line.marks = front.into_iter().map(|mark| Mark { label: String::new(), ..mark }).collect();
        series.push(line);
    }
    Some(Figure {
        file: "1-accuracy".to_owned(),
        title: "Speed against accuracy".to_owned(),
        say: say(all, &devices, scene),
        x: Axis::new("failures per million rays of the stress scenes", Scale::LogZero),
        y: Axis::new("million rays a second", Scale::Log),
        series,
        grid,
    })
}

fn say(all: &[Accuracy], devices: &[&str], scene: &str) -> String {
    let sound = all.iter().filter(|row| row.test.keeps_contract());
    let failing = sound.clone().filter(|row| row.failures > row.known).count();
    let mut fastest = Vec::new();
    for (at, device) in devices.iter().enumerate() {
        let speed = |row: &&Accuracy| row.mrays.get(at).map_or(0.0, |&(_, speed)| speed);
        let of = |sound: bool| {
            let rows = all.iter().filter(|row| row.test.keeps_contract() == sound);
            rows.max_by(|a, b| speed(a).total_cmp(&speed(b)))
        };
        if let (Some(sound), Some(other)) = (of(true), of(false)) {
            fastest.push(format!(
                "on the {} {} makes {} Mray/s and the fastest test that loses hits, {}, {}",
                device.to_uppercase(),
                sound.method,
                three(speed(&sound)),
                other.method,
                three(speed(&other))
            ));
        }
    }
    let sound = match failing {
        0 => "No way of finding triangles fails with the tests strict and exact but where that is known"
            .to_owned(),
        n => {
            format!("{n} of {} ways of finding triangles fail with the tests strict and exact", sound.count())
        }
    };
    format!(
        "{sound}: {} (rays of {scene}; failures are those of the CPU, whose bytes the GPU repeats; dashed: the \
         best there is).",
        fastest.join("; ")
    )
}
