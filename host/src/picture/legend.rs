//! The strip that says which colour means how much.

use super::colour::{encode, heat};

/// Glyphs 3 wide and 5 tall, a row a digit, its bits from left to right.
const GLYPHS: [(char, [u8; 5]); 19] = [
    ('0', [7, 5, 5, 5, 7]),
    ('1', [2, 6, 2, 2, 7]),
    ('2', [7, 1, 7, 4, 7]),
    ('3', [7, 1, 3, 1, 7]),
    ('4', [5, 5, 7, 1, 1]),
    ('5', [7, 4, 7, 1, 7]),
    ('6', [7, 4, 7, 5, 7]),
    ('7', [7, 1, 2, 2, 2]),
    ('8', [7, 5, 7, 5, 7]),
    ('9', [7, 5, 7, 1, 7]),
    ('A', [2, 5, 7, 5, 5]),
    ('E', [7, 4, 6, 4, 7]),
    ('P', [7, 5, 7, 4, 4]),
    ('R', [6, 5, 6, 5, 5]),
    ('S', [3, 4, 2, 1, 6]),
    ('T', [7, 2, 2, 2, 2]),
    ('Y', [5, 5, 2, 2, 2]),
    ('+', [0, 2, 7, 2, 0]),
    (' ', [0; 5]),
];
/// From one glyph to the next, in dots.
const ADVANCE: usize = 4;
/// Width and height of the bar, in dots.
const BAR: [usize; 2] = [80, 6];
/// Width and height of the whole strip, in dots: margins, title, bar, numbers.
const STRIP: [usize; 2] = [BAR[0] + 16, 2 + 5 + 2 + BAR[1] + 2 + 5 + 2];

/// A round number that all but one in a thousand values stay below.
pub fn full_scale(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    if values.is_empty() {
        return 1.0;
    }
    let place = values.len() - 1 - values.len() / 1000;
    let (_, &mut high, _) = values.select_nth_unstable_by(place, f32::total_cmp);
    // Even numbers have a whole number in the middle of the scale.
    let mut step = 2.0;
    while high > step * 20.0 {
        step *= 2.5;
        if high > step * 20.0 {
            step *= 4.0;
        }
    }
    let full = (high / step).ceil().max(1.0) * step;
    (full / 2.0).ceil() * 2.0
}

/// Draws the strip at the lower left, if the picture has room for it.
pub(super) fn draw(rgb: &mut [u8], [width, height]: [usize; 2], full: f32, title: &str) {
    let dot = (width / 400).min(height / 200).max(1);
    if width < STRIP[0] * dot || height < STRIP[1] * dot {
        return;
    }
    let top = height - STRIP[1] * dot;
    let mut fill = |x: usize, y: usize, w: usize, h: usize, colour: [u8; 3]| {
        for row in y..y + h {
            for pixel in rgb[(row * width + x) * 3..][..w * 3].chunks_mut(3) {
                pixel.copy_from_slice(&colour);
            }
        }
    };
    fill(0, top, STRIP[0] * dot, STRIP[1] * dot, [16, 16, 20]);
    let mut write = |text: &str, x: usize, y: usize| {
        for (place, letter) in text.chars().enumerate() {
            let glyph = GLYPHS.iter().find(|(known, _)| *known == letter).map_or([7; 5], |(_, rows)| *rows);
            for (down, row) in glyph.into_iter().enumerate() {
                for across in (0..3).filter(|across| row >> (2 - across) & 1 == 1) {
                    let (x, y) = (x + place * ADVANCE + across, y + down);
                    fill(x * dot, top + y * dot, dot, dot, [232, 232, 232]);
                }
            }
        }
    };
    let below = 2 + 5 + 2 + BAR[1] + 2;
    write(title, 4, 2);
    let left = 4;
    write("0", left, below);
    let middle = format!("{}", full / 2.0);
    write(&middle, left + BAR[0] / 2 - middle.len() * ADVANCE / 2, below);
    let most = format!("{full}+");
    write(&most, left + BAR[0] + 8 - most.len() * ADVANCE, below);
    for x in 0..BAR[0] * dot {
        let share = (x as f32 + 0.5) / (BAR[0] * dot) as f32;
        fill(left * dot + x, top + (2 + 5 + 2) * dot, 1, BAR[1] * dot, encode(heat(share)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_is_round_and_covers() {
        assert_eq!(full_scale([].into_iter()), 1.0);
        assert_eq!(full_scale([0.0].into_iter()), 2.0);
        assert_eq!(full_scale([37.0].into_iter()), 38.0);
        assert_eq!(full_scale([123.0].into_iter()), 140.0);
        for high in [1.0, 9.0, 41.0, 333.0, 12_345.0] {
            let full = full_scale([high].into_iter());
            assert!(full >= high && full % 2.0 == 0.0 && full <= 1.4 * high + 2.0, "{high} {full}");
        }
        // One stray value does not darken the rest.
        assert_eq!(full_scale((0..2000).map(|i| if i == 0 { 9000.0 } else { 10.0 })), 10.0);
    }

    #[test]
    fn drawn_only_where_there_is_room() {
        let mut small = vec![0; 50 * 20 * 3];
        draw(&mut small, [50, 20], 40.0, "STEPS PER RAY");
        assert!(small.iter().all(|&x| x == 0));
        let mut large = vec![0; 1000 * 500 * 3];
        draw(&mut large, [1000, 500], 123_456.0, "STEPS PER RAY");
        assert!(large.contains(&232));
        assert!(large[..1000 * 400 * 3].iter().all(|&x| x == 0), "only at the bottom");
    }

    #[test]
    fn every_letter_has_a_glyph() {
        for letter in "STEPS PER RAY0123456789+".chars() {
            assert!(GLYPHS.iter().any(|(known, _)| *known == letter), "{letter}");
        }
    }
}
