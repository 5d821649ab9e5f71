//! `raykd bench --compare-with`: what changed since another version, and how sure that is.

use crate::report::{Table, three, write_json};
use anyhow::{Context as _, bail};
use raykd::internals::quoted;
use serde_json::Value;
use std::{
    io::{StdoutLock, Write as _},
    path::Path,
    process::ExitCode,
};

/// How often the newer version is measured.
pub(super) const RUNS: usize = 3;

/// What is compared, and whether more of it is better.
const NUMBERS: [(&str, bool); 11] = [
    ("upload_ms", false),
    ("build_ms", false),
    ("trace_ms", false),
    ("primary_mrays", true),
    ("mrays_a", true),
    ("mrays_b", true),
    ("mrays_c", true),
    ("mrays_d", true),
    ("mrays_d_any", true),
    ("tree_bytes", false),
    ("sah_cost", false),
];
/// What must not change unless it was meant to.
const DIGESTS: [&str; 2] = ["digest", "sets_digest"];

/// One number, before and after.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
struct Change {
    scene: String,
    device: String,
    what: &'static str,
    before: f64,
    after: f64,
    /// In percent of before.
    change: f64,
    /// Half of the spread of repeated runs, in percent; at least a percent for times.
    noise: f64,
    /// `same`, `better`, `worse`; `same` if the change is not larger than the noise of both together.
    verdict: &'static str,
}

/// Rows of `raykd bench --json`; several runs may stand one after the other in one array.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<Value>> {
    let bytes = raykd::internals::all_of(path, raykd::default_max_bytes())?;
    let rows: Vec<Value> = serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: not what raykd bench --json writes", quoted(path.display())))?;
    if rows.iter().any(|row| key(row).is_none()) {
        bail!("{}: a row without scene or device; raykd bench --json writes both", quoted(path.display()));
    }
    Ok(rows)
}

fn key(row: &Value) -> Option<(&str, &str)> {
    Some((row["scene"].as_str()?, row["device"].as_str()?))
}

/// Prints what changed; exit code 0 whatever it is.
pub(super) fn tell(
    before: &[Value],
    after: &[impl serde::Serialize],
    json: bool,
    out: &mut StdoutLock<'_>,
) -> anyhow::Result<ExitCode> {
    let after: Vec<Value> = after.iter().map(serde_json::to_value).collect::<Result<_, _>>()?;
    let changes = changes(before, &after);
    if changes.is_empty() {
        bail!("the file has none of these scenes on these devices: nothing to compare");
    }
    if json {
        write_json(out, &changes)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut table = Table::new(["Scene", "device", "what", "before", "after", "change %", "noise %", ""]);
    for c in &changes {
        table.row([
            c.scene.clone(),
            c.device.to_uppercase(),
            c.what.to_owned(),
            three(c.before),
            three(c.after),
            format!("{:+.1}", c.change),
            format!("{:.1}", c.noise),
            c.verdict.to_owned(),
        ]);
    }
    writeln!(out, "{table}")?;
    for (row, what) in other_bytes(before, &after) {
        writeln!(out, "{row}: other bytes of {what}")?;
    }
    Ok(ExitCode::SUCCESS)
}

fn changes(before: &[Value], after: &[Value]) -> Vec<Change> {
    let mut changes: Vec<Change> = Vec::new();
    for row in after {
        let Some((scene, device)) = key(row) else { continue };
        if changes.iter().any(|change| (change.scene.as_str(), change.device.as_str()) == (scene, device)) {
            continue;
        }
        for (what, more_is_better) in NUMBERS {
            let of = |rows: &[Value]| -> Vec<f64> {
                let rows = rows.iter().filter(|row| key(row) == Some((scene, device)));
                rows.filter_map(|row| row[what].as_f64()).collect()
            };
            let (Some((old, old_noise)), Some((new, new_noise))) = (middle(of(before)), middle(of(after)))
            else {
                continue;
            };
            let timed = !matches!(what, "tree_bytes" | "sah_cost");
            let noise = old_noise.max(new_noise).max(if timed { 1.0 } else { 0.0 });
            let change = if old == new { 0.0 } else { 100.0 * (new - old) / old };
            let verdict = match change {
                c if c.abs() <= 2.0 * noise => "same",
                c if (c > 0.0) == more_is_better => "better",
                _ => "worse",
            };
            let (scene, device) = (scene.to_owned(), device.to_owned());
            changes.push(Change { scene, device, what, before: old, after: new, change, noise, verdict });
        }
    }
    changes
}

/// Median, and half of the spread in percent of it.
fn middle(mut numbers: Vec<f64>) -> Option<(f64, f64)> {
    numbers.sort_by(f64::total_cmp);
    let (low, high) = (*numbers.first()?, *numbers.last()?);
    let middle = numbers[numbers.len() / 2];
    let spread = if middle == 0.0 { 0.0 } else { 50.0 * (high - low) / middle };
    Some((middle, spread))
}

/// Rows whose trees or hits are not those of before.
fn other_bytes(before: &[Value], after: &[Value]) -> Vec<(String, &'static str)> {
    let mut others = Vec::new();
    for row in after {
        let old = before.iter().find(|old| key(old) == key(row));
        for (digest, what) in DIGESTS.into_iter().zip(["the tree", "the hits"]) {
            let name = key(row).map_or_else(String::new, |(scene, device)| {
                format!("{}, {}", quoted(scene), quoted(device.to_uppercase()))
            });
            let other = (name, what);
            if old.is_some_and(|old| old[digest] != row[digest]) && !others.contains(&other) {
                others.push(other);
            }
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(build_ms: f64, mrays_b: f64) -> Value {
        json!({
            "scene": "s", "device": "cpu", "build_ms": build_ms, "mrays_b": mrays_b,
            "digest": "x", "sets_digest": "h",
        })
    }

    fn verdicts(before: &[Value], after: &[Value]) -> Vec<&'static str> {
        changes(before, after).iter().map(|change| change.verdict).collect()
    }

    #[test]
    fn what_is_beyond_the_noise_is_told() {
        let before = [row(10.0, 5.0)];
        assert_eq!(verdicts(&before, &[row(10.1, 5.05)]), ["same", "same"]);
        assert_eq!(verdicts(&before, &[row(8.0, 6.0)]), ["better", "better"]);
        assert_eq!(verdicts(&before, &[row(12.0, 4.0)]), ["worse", "worse"]);
        // A fifth more, but repeated runs differ by as much.
        let noisy = [row(10.0, 5.0), row(12.0, 5.0), row(14.0, 5.0)];
        assert_eq!(verdicts(&before, &noisy), ["same", "same"]);
        let told = changes(&before, &noisy);
        assert_eq!((told[0].before, told[0].after), (10.0, 12.0));
        assert!((told[0].change - 20.0).abs() < 1e-9 && (told[0].noise - 100.0 / 6.0).abs() < 1e-9);
    }

    #[test]
    fn other_bytes_are_told() {
        let mut after = row(10.0, 5.0);
        assert!(other_bytes(&[row(10.0, 5.0)], &[after.clone()]).is_empty());
        after["sets_digest"] = json!("other");
        let told = other_bytes(&[row(10.0, 5.0)], &[after]);
        assert_eq!(told, [("s, CPU".to_owned(), "the hits")]);
    }

    #[test]
    fn other_scenes_are_not_compared() {
        let mut other = row(10.0, 5.0);
        other["scene"] = json!("t");
        assert!(changes(&[other], &[row(10.0, 5.0)]).is_empty());
    }
}
