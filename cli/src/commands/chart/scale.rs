//! An axis as plotters wants it.

use super::figure::Scale;
use crate::report::three;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// A [`Scale`] with its ends.
#[derive(Clone, Debug)]
pub(super) struct Ruler {
    scale: Scale,
    ends: [f64; 2],
    /// Where 0 lies among logarithms.
    zero: f64,
}

impl Ruler {
    /// The ruler that these numbers lie on.
    pub(super) fn over(scale: &Scale, numbers: impl Iterator<Item = f64> + Clone) -> Self {
        let high = numbers.clone().fold(f64::NEG_INFINITY, f64::max);
        let mut zero = 0.0;
        let ends = match scale {
            Scale::Linear => [0.0, if high > 0.0 { high * 1.08 } else { 1.0 }],
            Scale::Names(names) => [-0.5, names.len() as f64 - 0.5],
            Scale::Log | Scale::LogZero => {
                let low = numbers.filter(|&x| x > 0.0).fold(f64::INFINITY, f64::min);
                let (low, high) = if low.is_finite() { (low, high) } else { (1.0, 10.0) };
                // A little room on either side, that marks need; a whole decade for 0.
                let room = (high / low).powf(0.05).max(1.3);
                let (low, high) = (low / room, (high * room).max(low * 2.0));
                zero = zero_below(low);
                // The line of 0 stands apart from the axis.
                if *scale == Scale::LogZero { [zero / 2.0, high] } else { [low, high] }
            }
        };
        Self { scale: scale.clone(), ends, zero }
    }

    /// Where a number lies: its logarithm, or itself.
    fn place(&self, x: f64) -> f64 {
        match self.scale {
            Scale::Log | Scale::LogZero => x.max(self.zero).max(f64::MIN_POSITIVE).log10(),
            Scale::Linear | Scale::Names(_) => x,
        }
    }

    /// Where 0 has a line of its own.
    pub(super) fn zero(&self) -> Option<f64> {
        (self.scale == Scale::LogZero).then_some(self.zero)
    }

    /// Where bars begin.
    pub(super) const fn start(&self) -> f64 {
        self.ends[0]
    }
}

/// The power of ten, as far below a number as leaves a gap.
fn zero_below(low: f64) -> f64 {
    10f64.powf(low.log10().floor() - 1.0)
}

impl Ranged for Ruler {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, &value: &f64, (from, to): (i32, i32)) -> i32 {
        let log = !matches!(self.scale, Scale::Linear | Scale::Names(_));
        let [low, high] = self.ends.map(|end| if log { end.log10() } else { end });
        let share = (self.place(value) - low) / (high - low);
        from + (share * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let [low, high] = self.ends;
        let most = hint.max_num_points().max(2);
        match &self.scale {
            Scale::Names(names) => (0..names.len()).map(|at| at as f64).collect(),
            Scale::Linear => {
                let rough = high / most as f64;
                let ten = 10f64.powf(rough.log10().floor());
                let step = [1.0, 2.0, 5.0, 10.0].map(|x| x * ten).into_iter().find(|&s| s >= rough);
                let step = step.unwrap_or(high);
                (0..=(high / step) as usize).map(|i| i as f64 * step).collect()
            }
            Scale::Log | Scale::LogZero => {
                let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
                // Few decades: also what lies between; many: not all of them.
                let count = decades.clone().count();
                let between: &[f64] = match high / low {
                    ..6.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
                    ..2e3 => &[1.0, 2.0, 5.0],
                    _ => &[1.0],
                };
                let skip = count.div_ceil(most);
                let at = |k: i32| between.iter().map(move |x| x * 10f64.powi(k));
                let mut points: Vec<f64> =
                    decades.step_by(skip).flat_map(at).filter(|x| (low..=high).contains(x)).collect();
                if self.scale == Scale::LogZero {
                    points.retain(|&x| x > 2.0 * self.zero);
                    points.insert(0, self.zero);
                }
                points
            }
        }
    }

    fn range(&self) -> Range<f64> {
        self.ends[0]..self.ends[1]
    }
}

impl ValueFormatter<f64> for Ruler {
    fn format_ext(&self, &value: &f64) -> String {
        match &self.scale {
            Scale::Names(names) => names.get(value.round() as usize).cloned().unwrap_or_default(),
            Scale::LogZero if value <= self.zero => "0".to_owned(),
            _ => short(value),
        }
    }
}

/// A round number in few letters: `0.01`, `5`, `20 k`, `1 M`.
fn short(x: f64) -> String {
    let (x, unit) = match x.abs() {
        1e9.. => (x * 1e-9, " G"),
        1e6..1e9 => (x * 1e-6, " M"),
        1e4..1e6 => (x * 1e-3, " k"),
        _ => (x, ""),
    };
    let text = three(x);
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let cases =
            [(0.0, "0"), (0.01, "0.01"), (5.0, "5"), (20_000.0, "20 k"), (1e6, "1 M"), (1e10, "10 G")];
        for (x, text) in cases {
            assert_eq!(short(x), text);
        }
    }

    #[test]
    fn rulers_hold_their_numbers_in_order() {
        let numbers = [0.02, 3.0, 7000.0];
        for scale in [Scale::Linear, Scale::Log, Scale::LogZero] {
            let ruler = Ruler::over(&scale, numbers.into_iter().chain([0.0]));
            let places = numbers.map(|x| ruler.map(&x, (0, 10_000)));
            assert!(places[0] < places[1] && places[1] < places[2], "{scale:?} {places:?}");
            assert!(places.iter().all(|p| (0..=10_000).contains(p)), "{scale:?} {places:?}");
            let ticks = ruler.key_points(6);
            assert!((2..=8).contains(&ticks.len()), "{scale:?} {ticks:?}");
        }
        let ruler = Ruler::over(&Scale::LogZero, numbers.into_iter());
        assert!((1..40).contains(&ruler.map(&0.0, (0, 100))));
        assert_eq!(ruler.format_ext(&ruler.zero().unwrap()), "0");
    }
}
