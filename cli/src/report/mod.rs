//! Numbers and tables for people, JSON for programs.

mod table;

pub(crate) use table::Table;

use raykd::Device;
use std::io::{StdoutLock, Write as _};

/// Behind the number of invalid rays.
pub(crate) const INVALID: &str =
    "(with NaN, infinite or zero directions, or origins out of range): they hit nothing";

/// Three significant digits, thousands apart: `0.00123`, `1.23`, `12.3`, `123`, `1,230`. Very large and very small
/// numbers have an exponent.
pub(crate) fn three(x: f64) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    // By way of the exponent form, which rounds right: 9.996 is 1.00e1.
    let text = format!("{x:.2e}");
    let (_, exponent) = text.split_once('e').expect("exponent form");
    let exponent: i32 = exponent.parse().expect("an exponent");
    match exponent {
        ..-6 | 15.. => text,
        -6..=1 => format!("{x:.*}", (2 - exponent) as usize),
        2 => format!("{x:.0}"),
        _ => {
            let unit = 10f64.powi(exponent - 2);
            let rounded = (x / unit).round() * unit;
            let sign = if rounded < 0.0 { "-" } else { "" };
            format!("{sign}{}", count(rounded.abs() as u64))
        }
    }
}

/// All digits, thousands apart: `871,414`.
pub(crate) fn count(n: u64) -> String {
    indicatif::HumanCount(n).to_string()
}

/// `CPU` or `GPU`.
pub(crate) fn capitals(device: &Device) -> String {
    device.kind().name().to_uppercase()
}

/// Bytes with a unit: `640 B`, `12.3 kB`, `1.20 MB`.
pub(crate) fn bytes(n: u64) -> String {
    let x = n as f64;
    match n {
        ..1000 => format!("{n} B"),
        1000..1_000_000 => format!("{} kB", three(x * 1.0e-3)),
        1_000_000..1_000_000_000 => format!("{} MB", three(x * 1.0e-6)),
        _ => format!("{} GB", three(x * 1.0e-9)),
    }
}

/// Writes a value as JSON, indented, with a line end.
pub(crate) fn write_json(out: &mut StdoutLock<'_>, value: &impl serde::Serialize) -> anyhow::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    Ok(writeln!(out)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits() {
        let cases = [
            (0.0, "0"),
            (0.001_234, "0.00123"),
            (0.5, "0.500"),
            (1.0, "1.00"),
            (9.996, "10.0"),
            (99.96, "100"),
            (123.4, "123"),
            (999.6, "1,000"),
            (1234.0, "1,230"),
            (8_714_140.0, "8,710,000"),
            (-1234.0, "-1,230"),
            (1.5e-9, "1.50e-9"),
            (9.99e14, "999,000,000,000,000"),
            (2e37, "2.00e37"),
            (-2e37, "-2.00e37"),
        ];
        for (x, text) in cases {
            assert_eq!(three(x), text);
        }
    }

    #[test]
    fn counts_and_bytes() {
        assert_eq!(count(0), "0");
        assert_eq!(count(999), "999");
        assert_eq!(count(1000), "1,000");
        assert_eq!(count(12_345_678), "12,345,678");
        assert_eq!(bytes(640), "640 B");
        assert_eq!(bytes(12_345), "12.3 kB");
        assert_eq!(bytes(128 << 20), "134 MB");
        assert_eq!(bytes(4_294_967_295), "4.29 GB");
    }
}
