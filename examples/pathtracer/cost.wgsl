// What a ray through the middle of each pixel costs, laid over the picture. raykd's own WGSL stands before this.

// As in shade.wgsl.
struct Frame {
    eye: vec3f,
    width: u32,
    right: vec3f,
    height: u32,
    up: vec3f,
    samples: u32,
    forward: vec3f,
    done: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage> pixels: array<u32>;
@group(0) @binding(2) var<storage, read_write> overlay: array<u32>;

// From blue, few, by green and yellow to red: 256 nodes and triangles.
fn heat(cost: u32) -> vec3f {
    let x = 4.0 * min(1.0, log2(1.0 + f32(cost)) / 8.0);
    return clamp(vec3f(x - 2.0, 2.0 - abs(x - 2.0), 2.0 - x), vec3f(), vec3f(1.0));
}

@compute @workgroup_size(8, 8)
fn cost(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= frame.width || at.y >= frame.height {
        return;
    }
    let x = (f32(at.x) + 0.5) / f32(frame.width) * 2.0 - 1.0;
    let y = 1.0 - (f32(at.y) + 0.5) / f32(frame.height) * 2.0;
    let direction = frame.forward + x * frame.right + y * frame.up;
    let hit = raykd_closest(RaykdRay(frame.eye, 0.0, direction, 3e38));
    let i = at.y * frame.width + at.x;
    let colour = mix(unpack4x8unorm(pixels[i]).rgb, heat(hit.steps + hit.tests), 0.8);
    overlay[i] = pack4x8unorm(vec4f(colour, 1.0));
}
