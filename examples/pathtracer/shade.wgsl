// Everything of the path tracer but the tracing: camera rays, what happens where a ray ended, and the picture.
//
// A path has a slot of its own, to which its light is added. Its rays move: those that go on are put side by side in
// the buffer of the next bounce, whichever comes first. As random numbers are made of pixel, sample and bounce, the
// picture does not depend on that order.

struct Frame {
    eye: vec3f,
    width: u32,
    right: vec3f,
    height: u32,
    up: vec3f,
    // Samples of a pixel that are under way at a time.
    samples: u32,
    forward: vec3f,
    // How many samples a pixel had before.
    done: u32,
    // Height of the floor, how far a new ray starts from a surface, and half the diagonal of the mesh.
    floor: f32,
    lift: f32,
    radius: f32,
    // What raykd multiplied the positions by.
    scale: f32,
}

struct Bounce {
    number: u32,
    last: u32,
}

// Of bounce k, how many rays there are is in word 128 k, and how many shadow rays in word 128 k + 64: parts of a buffer
// start at multiples of 256 bytes.
const STRIDE = 128u;
const SHADOWS = 64u;
const GROUP = 128u;
const MISS = 0xffffffffu;
const PI = 3.14159265;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> bounce: Bounce;
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>>;
// Rays are two vectors: origin and direction.x; direction.y, direction.z, t_min and t_max.
@group(0) @binding(3) var<storage> rays: array<vec4f>;
// A path: what of its light arrives, and the bits of its slot.
@group(0) @binding(4) var<storage> paths: array<vec4f>;
// A hit: triangle, and the bits of t, u and v.
@group(0) @binding(5) var<storage> hits: array<vec4u>;
@group(0) @binding(6) var<storage, read_write> next_rays: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> next_paths: array<vec4f>;
@group(0) @binding(8) var<storage, read_write> shadow_rays: array<vec4f>;
// The light that a shadow ray brings if nothing is in its way, and the bits of its slot.
@group(0) @binding(9) var<storage, read_write> shadow_light: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> light: array<vec4f>;
// raykd's own.
@group(0) @binding(11) var<storage> positions: array<f32>;
@group(0) @binding(12) var<storage> indices: array<u32>;
@group(0) @binding(13) var<storage, read_write> sums: array<vec4f>;
@group(0) @binding(14) var<storage, read_write> pixels: array<u32>;
// Rays so far: low and high word.
@group(0) @binding(15) var<storage, read_write> traced: array<u32>;

// ---- Random numbers (O'Neill's PCG, as a hash: Jarzynski & Olano 2020)

var<private> seed: u32;

fn hash(x: u32) -> u32 {
    let state = x * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

fn random() -> f32 {
    seed = hash(seed);
    return f32(seed >> 8u) / 16777216.0;
}

fn start_random(slot: u32, number: u32) {
    let sample = frame.done + slot % frame.samples;
    seed = hash(slot / frame.samples + hash(sample + hash(number)));
}

fn on_sphere() -> vec3f {
    let z = random() * 2.0 - 1.0;
    let angle = random() * 2.0 * PI;
    let r = sqrt(max(0.0, 1.0 - z * z));
    return vec3f(r * cos(angle), r * sin(angle), z);
}

// ---- The world

const TO_SUN = vec3f(-0.4969, 0.7454, 0.4443);
const SUN_SIZE = 0.05;
const SUNLIGHT = vec3f(4.0, 3.5, 2.75);
const CLAY = vec3f(0.64, 0.32, 0.18);
const FLOOR = vec3f(0.45, 0.45, 0.44);

fn sky(direction: vec3f) -> vec3f {
    return mix(vec3f(0.66, 0.76, 0.89), vec3f(0.16, 0.33, 0.68), sqrt(max(direction.y, 0.0)));
}

fn corner(triangle: u32, k: u32) -> vec3f {
    let at = 3u * indices[3u * triangle + k];
    return vec3f(positions[at], positions[at + 1u], positions[at + 2u]);
}

// ---- Kernels

fn index(group: vec3u, groups: vec3u, lane: u32) -> u32 {
    return (group.y * groups.x + group.x) * GROUP + lane;
}

@compute @workgroup_size(GROUP)
fn camera(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane);
    let paths = frame.width * frame.height * frame.samples;
    if i == 0u {
        atomicStore(&counts[0], paths);
    }
    if i >= paths {
        return;
    }
    start_random(i, 0u);
    let pixel = i / frame.samples;
    let at = vec2f(f32(pixel % frame.width), f32(pixel / frame.width)) + vec2f(random(), random());
    let x = at.x / f32(frame.width) * 2.0 - 1.0;
    let y = 1.0 - at.y / f32(frame.height) * 2.0;
    let d = normalize(frame.forward + x * frame.right + y * frame.up);
    next_rays[2u * i] = vec4f(frame.eye, d.x);
    next_rays[2u * i + 1u] = vec4f(d.yz, 0.0, 3.0e38);
    next_paths[i] = vec4f(1.0, 1.0, 1.0, bitcast<f32>(i | KEPT));
    light[i] = vec4f();
}

// A slot among floats has this bit, so that it does not look subnormal: some hardware flushes such numbers.
const KEPT = 0x40000000u;

var<workgroup> ranks: array<u32, GROUP>;
var<workgroup> first: vec2u;

// Where those of a workgroup that go on, and their shadow rays, are to be written: an exclusive scan of both counts, 16
// bits each, and one addition for the whole workgroup.
fn places(lane: u32, goes: bool, shadow: bool) -> vec2u {
    let one = u32(goes) | (u32(shadow) << 16u);
    var sum = one;
    ranks[lane] = sum;
    for (var step = 1u; step < GROUP; step *= 2u) {
        workgroupBarrier();
        var below = 0u;
        if lane >= step {
            below = ranks[lane - step];
        }
        workgroupBarrier();
        sum += below;
        ranks[lane] = sum;
    }
    if lane == GROUP - 1u && sum != 0u {
        let k = STRIDE * bounce.number;
        first = vec2u(atomicAdd(&counts[k + STRIDE], sum & 0xffffu), atomicAdd(&counts[k + SHADOWS], sum >> 16u));
    }
    let before = sum - one;
    return workgroupUniformLoad(&first) + vec2u(before & 0xffffu, before >> 16u);
}

// Where a ray ended, and what becomes of it.
struct End {
    shadow: bool,
    goes: bool,
    point: vec3f,
    normal: vec3f,
    to_sun: vec3f,
    sunlight: vec3f,
    carried: vec3f,
    direction: vec3f,
}

fn ended(ray: u32, slot: u32, arriving: vec3f) -> End {
    start_random(slot, bounce.number + 1u);
    var end: End;
    let origin = rays[2u * ray].xyz;
    let direction = vec3f(rays[2u * ray].w, rays[2u * ray + 1u].xy);
    let hit = hits[ray];
    let to_floor = (frame.floor - origin.y) / direction.y;
    let on_floor = direction.y < 0.0 && to_floor > 0.0 && (hit.x == MISS || to_floor < bitcast<f32>(hit.y));
    end.carried = arriving;
    if on_floor {
        end.point = vec3f(origin.x + to_floor * direction.x, frame.floor, origin.z + to_floor * direction.z);
        end.normal = vec3f(0.0, 1.0, 0.0);
        // Far away it blends into the sky.
        let far = to_floor / (14.0 * frame.radius);
        let haze = 1.0 - exp(-far * far);
        light[slot] += vec4f(end.carried * haze * sky(direction), 0.0);
        end.carried *= FLOOR * (1.0 - haze);
    } else if hit.x == MISS {
        light[slot] += vec4f(end.carried * sky(direction), 0.0);
        return end;
    } else {
        let a = corner(hit.x, 0u);
        let b = corner(hit.x, 1u) - a;
        let c = corner(hit.x, 2u) - a;
        end.point = (a + bitcast<f32>(hit.z) * b + bitcast<f32>(hit.w) * c) / frame.scale;
        end.normal = normalize(cross(b, c));
        end.normal *= select(1.0, -1.0, dot(end.normal, direction) > 0.0);
        end.carried *= CLAY;
    }
    end.point += end.normal * frame.lift;
    end.to_sun = normalize(TO_SUN + SUN_SIZE * on_sphere());
    let slope = dot(end.normal, end.to_sun);
    end.shadow = slope > 0.0;
    end.sunlight = end.carried * SUNLIGHT * slope / PI;
    // On a sphere that touches the surface points are as likely as light of a matt surface is strong.
    end.direction = normalize(end.normal + 0.999 * on_sphere());
    end.goes = bounce.last == 0u;
    if bounce.number >= 2u {
        // Paths that carry little end early; the others carry more for it.
        let strength = min(1.0, max(end.carried.x, max(end.carried.y, end.carried.z)));
        end.goes = end.goes && random() < strength;
        end.carried /= strength;
    }
    return end;
}

@compute @workgroup_size(GROUP)
fn shade(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane);
    var end: End;
    var slot = KEPT;
    if i < atomicLoad(&counts[STRIDE * bounce.number]) {
        let path = paths[i];
        slot = bitcast<u32>(path.w);
        end = ended(i, slot & ~KEPT, path.xyz);
    }
    let to = places(lane, end.goes, end.shadow);
    if end.shadow {
        shadow_rays[2u * to.y] = vec4f(end.point, end.to_sun.x);
        shadow_rays[2u * to.y + 1u] = vec4f(end.to_sun.yz, 0.0, 3.0e38);
        shadow_light[to.y] = vec4f(end.sunlight, bitcast<f32>(slot));
    }
    if end.goes {
        next_rays[2u * to.x] = vec4f(end.point, end.direction.x);
        next_rays[2u * to.x + 1u] = vec4f(end.direction.yz, 0.0, 3.0e38);
        next_paths[to.x] = vec4f(end.carried, bitcast<f32>(slot));
    }
}

// Adds the sunlight of shadow rays that hit nothing.
@compute @workgroup_size(GROUP)
fn sun(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane);
    if i < atomicLoad(&counts[STRIDE * bounce.number + SHADOWS]) && hits[i].x == MISS {
        let arriving = shadow_light[i];
        light[bitcast<u32>(arriving.w) & ~KEPT] += vec4f(arriving.xyz, 0.0);
    }
}

// A curve like film's (Narkowicz 2016), then that of screens.
fn shown(colour: vec3f) -> vec3f {
    let x = colour * 0.6;
    let film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    return pow(clamp(film, vec3f(), vec3f(1.0)), vec3f(1.0 / 2.2));
}

@compute @workgroup_size(GROUP)
fn picture(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = index(group, groups, lane);
    if i == 0u {
        for (var at = 0u; at < arrayLength(&counts); at += SHADOWS) {
            let rays = atomicLoad(&counts[at]);
            traced[0] += rays;
            traced[1] += u32(traced[0] < rays);
        }
    }
    if i >= frame.width * frame.height {
        return;
    }
    var sum = vec4f();
    for (var k = 0u; k < frame.samples; k++) {
        sum += light[i * frame.samples + k];
    }
    if frame.done != 0u {
        sum += sums[i];
    }
    sums[i] = sum;
    pixels[i] = pack4x8unorm(vec4f(shown(sum.xyz / f32(frame.done + frame.samples)), 1.0));
}
