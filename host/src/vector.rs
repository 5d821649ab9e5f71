//! Vectors of `f64`, and how they become `f32`.

/// Three numbers.
pub(crate) type V = [f64; 3];

pub(crate) fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn mul(a: V, s: f64) -> V {
    a.map(|x| x * s)
}

pub(crate) fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The vector with length 1; up, if it has none.
pub(crate) fn normalize(a: V) -> V {
    let length = dot(a, a).sqrt();
    if length > 0.0 { mul(a, 1.0 / length) } else { [0.0, 1.0, 0.0] }
}

pub(crate) fn wide(a: [f32; 3]) -> V {
    a.map(f64::from)
}

/// The nearest `f32`.
pub(crate) fn narrow(a: V) -> [f32; 3] {
    a.map(|x| x as f32)
}

/// The largest `f32` that is not above a number.
pub(crate) fn below(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x { nearest.next_down() } else { nearest }
}
