//! Colours: linear light until they are encoded.

/// Red, green and blue, linear.
pub type Rgb = [f32; 3];

pub(super) fn add(a: Rgb, b: Rgb) -> Rgb {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn scale(a: Rgb, s: f32) -> Rgb {
    a.map(|x| x * s)
}

/// From `a` at 0 to `b` at 1.
pub(super) fn mix(a: Rgb, b: Rgb, share: f32) -> Rgb {
    add(scale(a, 1.0 - share), scale(b, share))
}

/// As sRGB bytes (IEC 61966-2-1).
pub fn encode(colour: Rgb) -> [u8; 3] {
    colour.map(|x| {
        let x = x.clamp(0.0, 1.0);
        let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (y * 255.0).round() as u8
    })
}

/// Colours of heat from nothing to full scale, in linear light; each brighter than the one before.
const HEAT: [Rgb; 6] = [
    [0.001, 0.001, 0.004],
    [0.035, 0.010, 0.150],
    [0.250, 0.020, 0.210],
    [0.680, 0.080, 0.055],
    [0.960, 0.420, 0.020],
    [1.000, 0.980, 0.700],
];

/// The colour of a share of full scale.
pub fn heat(share: f32) -> Rgb {
    let place = share.clamp(0.0, 1.0) * (HEAT.len() - 1) as f32;
    let below = (place as usize).min(HEAT.len() - 2);
    mix(HEAT[below], HEAT[below + 1], place - below as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_ends_and_middle() {
        assert_eq!(encode([0.0, 1.0, 2.0]), [0, 255, 255]);
        assert_eq!(encode([0.2, -1.0, f32::NAN]), [124, 0, 0]);
    }

    #[test]
    fn heat_only_gets_brighter() {
        let light = |c: Rgb| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        let scale: Vec<f32> = (0..=100).map(|i| light(heat(i as f32 / 100.0))).collect();
        assert!(scale.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(heat(7.0), HEAT[5]);
    }
}
