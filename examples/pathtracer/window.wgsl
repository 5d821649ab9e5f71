// Shows the picture, a pixel of the window for each of it.

@group(0) @binding(0) var<storage> pixels: array<u32>;
// `Frame` of shade.wgsl, of which the width is needed.
@group(0) @binding(1) var<uniform> frame: vec4u;

@vertex
fn corner(@builtin(vertex_index) number: u32) -> @builtin(position) vec4f {
    return vec4f(f32(number & 1u) * 4.0 - 1.0, f32(number >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn pixel(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let place = u32(at.y) * frame.w + u32(at.x);
    return vec4f(unpack4x8unorm(pixels[place]).rgb, 1.0);
}
