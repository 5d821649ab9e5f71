//! `raykd bench --compare-with`: what changed since another version, and how sure that is.

use crate::report::{Table, three, write_json};
use anyhow::{Context as _, bail};
use raykd::internals::quoted;
use serde_json::Value;
use std::{
    io::{StdoutLock, Write as _},
    path::Path,
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
/// What rows must have alike, or their speeds tell nothing.
const OPTIONS: [&str; 3] = ["rays", "traversal", "intersector"];
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

/// A row as the file has it.
pub(super) fn values(rows: &[impl serde::Serialize]) -> anyhow::Result<Vec<Value>> {
    Ok(rows.iter().map(serde_json::to_value).collect::<Result<_, _>>()?)
}

/// Finds out whether there is anything to compare, measured with the same options.
pub(super) fn check(before: &[Value], after: &[Value]) -> anyhow::Result<()> {
    let pairs = || pairs(before, after);
    if pairs().next().is_none() {
        bail!("the file has none of these scenes on these devices: nothing to compare");
    }
    for (old, new) in pairs() {
        for name in OPTIONS {
            // An older version may not have written it, and auto chooses the traversal by itself.
            let chosen = name == "traversal" && !new["auto"].is_null();
            if chosen || old[name].is_null() || old[name] == new[name] {
                continue;
            }
            bail!(
                "{}: measured with --{name} {} before and {} now; give the same",
                named(new),
                quoted(&old[name]),
                quoted(&new[name])
            );
        }
    }
    Ok(())
}

/// Rows of the same scene and device.
fn pairs<'a>(before: &'a [Value], after: &'a [Value]) -> impl Iterator<Item = (&'a Value, &'a Value)> {
    after.iter().flat_map(|new| before.iter().filter(|old| key(old) == key(new)).map(move |old| (old, new)))
}

/// Scene and device, as messages have them.
fn named(row: &Value) -> String {
    key(row).map_or_else(String::new, |(scene, device)| {
        format!("{}, {}", quoted(scene), quoted(device.to_uppercase()))
    })
}

/// Prints what changed.
pub(super) fn tell(
    before: &[Value],
    after: &[Value],
    json: bool,
    out: &mut StdoutLock<'_>,
) -> anyhow::Result<()> {
    let changes = changes(before, after);
    if json {
        return write_json(out, &changes);
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
    for (row, old, new) in other_machines(before, after) {
        writeln!(out, "{row}: was measured on {old}, now on {new}")?;
    }
    for (row, what) in other_bytes(before, after) {
        writeln!(out, "{row}: other bytes of {what}")?;
    }
    Ok(())
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

/// Rows of another processor, number of threads or adapter than before, with both names.
fn other_machines(before: &[Value], after: &[Value]) -> Vec<(String, String, String)> {
    let mut others = Vec::new();
    for (old, new) in pairs(before, after) {
        let [was, is] = [old, new].map(|row| row["adapter"].as_str().map(quoted));
        if let (Some(was), Some(is)) = (was, is)
            && was != is
            && !others.contains(&(named(new), was.clone(), is.clone()))
        {
            others.push((named(new), was, is));
        }
    }
    others
}

/// Rows whose trees or hits are not those of before.
fn other_bytes(before: &[Value], after: &[Value]) -> Vec<(String, &'static str)> {
    let mut others = Vec::new();
    for row in after {
        let old = before.iter().find(|old| key(old) == key(row));
        for (digest, what) in DIGESTS.into_iter().zip(["the tree", "the hits"]) {
            let other = (named(row), what);
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
        assert!(changes(std::slice::from_ref(&other), &[row(10.0, 5.0)]).is_empty());
        assert!(check(&[other], &[row(10.0, 5.0)]).unwrap_err().to_string().contains("none of these scenes"));
    }

    #[test]
    fn other_options_are_not_compared() {
        let [mut old, mut new] = [row(10.0, 5.0), row(10.0, 5.0)];
        new["rays"] = json!(50_000);
        check(&[old.clone()], &[new.clone()]).unwrap();
        old["rays"] = json!(1_000_000);
        let error = check(&[old], &[new]).unwrap_err().to_string();
        assert_eq!(error, "s, CPU: measured with --rays 1000000 before and 50000 now; give the same");
    }

    #[test]
    fn other_machines_are_told() {
        let [mut old, mut new] = [row(10.0, 5.0), row(10.0, 5.0)];
        (old["adapter"], new["adapter"]) = (json!("Z3, 1 threads"), json!("Z3, 2 threads"));
        let told = other_machines(&[old], &[new.clone(), new.clone()]);
        assert_eq!(told, [("s, CPU".to_owned(), "Z3, 1 threads".to_owned(), "Z3, 2 threads".to_owned())]);
        assert!(other_machines(&[new.clone()], &[new]).is_empty());
    }
}
