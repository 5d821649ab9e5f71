//! How values on the command line are written.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use std::str::FromStr;

/// A parser of names; `--help` says what each is.
pub(crate) fn one_of<T: Copy + Send + Sync + FromStr<Err = raykd::Error>>(
    all: &'static [T],
    name: fn(T) -> &'static str,
    about: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let offered = all.iter().map(|&one| PossibleValue::new(name(one)).help(about(one)));
    PossibleValuesParser::new(offered).try_map(|given| given.parse())
}

/// A parser of numbers in a range.
pub(crate) fn within<T>(lo: T, hi: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + std::fmt::Display + Copy,
{
    move |text| {
        let x: T = text.parse().map_err(|_| "not a number".to_owned())?;
        if lo <= x && x <= hi { Ok(x) } else { Err(format!("it must lie between {lo} and {hi}")) }
    }
}

/// A parser of whole numbers in a range. clap's own tells of a digit in 1.5, not of a number.
pub(crate) fn whole<T>(lo: T, hi: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + std::fmt::Display + Copy,
{
    let number = within(lo, hi);
    move |text| number(text).map_err(|_| format!("write a whole number from {lo} to {hi}"))
}

pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| whole(1, 16384)(text).ok();
    let sides = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| "write it like 1024x768, each from 1 to 16384".to_owned())
}

/// A number of bytes.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let (number, shift) = match text.as_bytes().last() {
        Some(unit @ (b'K' | b'M' | b'G' | b'T')) => (
            &text[..text.len() - 1],
            [b'K', b'M', b'G', b'T'].iter().position(|u| u == unit).map_or(0, |i| 10 * (i + 1)),
        ),
        _ => (text, 0),
    };
    let bytes = number.parse::<u64>().ok().and_then(|n| n.checked_mul(1 << shift)).filter(|&n| n > 0);
    bytes.ok_or_else(|| "write it like 5000000000, 500M or 5G".to_owned())
}

pub(crate) fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|x: &f64| x.abs() <= 1.0e30)).collect();
    let numbers = numbers.and_then(|n| <[f64; 3]>::try_from(n).ok());
    numbers.ok_or_else(|| "write it like 1,2.5,-3, each at most 1e30 in size".to_owned())
}

pub(crate) fn direction(text: &str) -> Result<[f64; 3], String> {
    let direction = point(text)?;
    if direction == [0.0; 3] { Err("0,0,0 is no direction".to_owned()) } else { Ok(direction) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        for wrong in ["640", "0x1", "1x16385", "x", "axb", "1x2x3"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
        assert_eq!(bytes("17"), Ok(17));
        assert_eq!(bytes("3K"), Ok(3072));
        assert_eq!(bytes("2G"), Ok(2 << 30));
        assert_eq!(bytes("1T"), Ok(1 << 40));
        for wrong in ["", "G", "0", "-1", "1.5G", "1g", "1GB", "99999999T", "\u{e9}"] {
            assert!(bytes(wrong).is_err(), "{wrong}");
        }
        assert_eq!(point("1,-2.5, 3e2"), Ok([1.0, -2.5, 300.0]));
        for wrong in ["1,2", "1,2,3,4", "a,b,c", "", "nan,0,0", "inf,0,0"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
        assert_eq!(direction("0,-2,0"), Ok([0.0, -2.0, 0.0]));
        assert!(direction("0,0,-0").is_err() && direction("up").is_err());
        let whole = whole(1_u16, 4096);
        assert_eq!([whole("1"), whole("4096")], [Ok(1), Ok(4096)]);
        for wrong in ["", "0", "-1", "1.5", "x", "4097", "99999"] {
            assert_eq!(whole(wrong).unwrap_err(), "write a whole number from 1 to 4096", "{wrong}");
        }
        let cost = within(1e-6_f32, 1e6);
        assert!(cost("nan").is_err() && cost("-1").is_err() && cost("inf").is_err() && cost("0.5").is_ok());
    }
}
