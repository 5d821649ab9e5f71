// raykd's tree for shaders in WGSL: what its buffers hold, and a walk for the closest hit or for any.
//
// Put this text before a shader's own. Bind three buffers of `Scene::buffers`, as parts of group 1:
//   0 header, 1 nodes, 2 corners
// `raykd_closest(ray)` and `raykd_any(ray)` then trace one ray. For whole buffers of rays there is `Scene::encode`, whose
// bytes are promised.
//
// Of these hits no bytes are promised. WGSL leaves it to the driver whether `a * b + c` is rounded once or twice, and its
// quotients are off by a few units in the last place. So a ray that passes an edge nearer than rounding may hit the
// neighbour, of two triangles with the same corners in another order either may be hit, and `t`, `u` and `v` may differ in
// their last digits. The rules are raykd's: edges belong to triangles, `t_min` and `t_max` are inclusive, and of equal `t`
// the lowest number wins. No hit is lost to the tree: its planes count as thick as in raykd's kernels.
//
// Measured with a million random rays each. Through the teapot all hit the triangle that raykd's kernels find, on llvmpipe
// and on an NVIDIA H200. Through the Stanford dragon (dragon_res4) 0 and 1 hit another, besides 1586 and 2413 that hit a
// triangle with the same corners.
//
// Rays are as `Scene::encode` takes them: in the mesh's units, less its translation. Directions need no unit length, but
// a normal number for their largest component, between 2^-60 and 2^60 in size; others hit nothing. Numbers that are
// infinite or NaN have no meaning in WGSL: for a ray without end give `t_max` a large number.
//
// `RaykdRay` and `RaykdHit` are for variables. In the buffers of `Scene::encode` a ray is 8 `f32` in another order
// (origin, direction, `t_min`, `t_max`) and a hit 4 words (triangle, `t`, `u`, `v`): declare structs of your own there.

struct RaykdHeader {
    // Corners of the scene, times scale.
    lo: vec3f,
    nodes: u32,
    hi: vec3f,
    refs: u32,
    triangles: u32,
    depth: u32,
    // The power of two that coordinates in all buffers were multiplied by.
    scale: f32,
    cost_step: f32,
    cost_test: f32,
    mesh_low: u32,
    mesh_high: u32,
    checksum: u32,
}

@group(1) @binding(0) var<storage> raykd_header: RaykdHeader;
// Two nodes a vector: the root and padding, then pairs of children.
@group(1) @binding(1) var<storage> raykd_pairs: array<vec4u>;
// Three vectors a reference: a triangle's corners, times scale. See `raykd_triangle`.
@group(1) @binding(2) var<storage> raykd_corners: array<vec4f>;

struct RaykdRay {
    origin: vec3f,
    t_min: f32,
    direction: vec3f,
    t_max: f32,
}

const RAYKD_MISS = 0xffffffffu;

struct RaykdHit {
    // Its number in file order, or RAYKD_MISS.
    triangle: u32,
    t: f32,
    // Weights of the second and the third corner.
    u: f32,
    v: f32,
    // What the ray cost: inner nodes passed, and triangles tested.
    steps: u32,
    tests: u32,
}

// ---- Nodes. Each is two words.

// Whether it is a leaf; if not, `raykd_axis`, `raykd_split` and `raykd_below` are its plane and its children.
fn raykd_is_leaf(node: vec2u) -> bool { return (node.y & 3u) == 3u; }
fn raykd_axis(node: vec2u) -> u32 { return node.y & 3u; }
// Where its plane is on that axis, times scale.
fn raykd_split(node: vec2u) -> f32 { return bitcast<f32>(node.x); }
// The number of the child below the plane, which is even; the other follows it.
fn raykd_below(node: vec2u) -> u32 { return node.y >> 2u; }
// Of a leaf the first reference, and how many.
fn raykd_first(node: vec2u) -> u32 { return node.x; }
fn raykd_count(node: vec2u) -> u32 { return node.y >> 2u; }
// The number of a reference's triangle. A bit is added to it, so that it does not look like a subnormal float.
fn raykd_triangle(reference: u32) -> u32 {
    return bitcast<u32>(raykd_corners[3u * reference].w) & ~0x40000000u;
}

// ---- The walk

struct RaykdFrame {
    // Times scale.
    origin: vec3f,
    inverse: vec3f,
    // Half the thickness of planes.
    pad: f32,
    main: u32,
    shear: vec2f,
    t_min: f32,
    t_max: f32,
    enter: f32,
    exit: f32,
}

// A vector with an axis moved last, the others in cyclic order.
fn raykd_cycle(v: vec3f, axis: u32) -> vec3f {
    return select(select(v, v.zxy, axis == 1u), v.yzx, axis == 0u);
}

// `unit` brings the direction's largest component to 1 to 2, and `stretch` is what `t` is multiplied by for that.
fn raykd_frame(ray: RaykdRay, unit: f32, stretch: f32) -> RaykdFrame {
    var frame: RaykdFrame;
    let d = ray.direction * unit;
    frame.origin = ray.origin * raykd_header.scale;
    let size = abs(d);
    frame.main = select(0u, 1u, size.y > size.x);
    frame.main = select(frame.main, 2u, size.z > max(size.x, size.y));
    // No component is so small that its reciprocal is infinite.
    let steep = 0x1p-40;
    let away = select(vec3f(steep), vec3f(-steep), (bitcast<vec3u>(d) >> vec3u(31u)) == vec3u(1u));
    frame.inverse = 1.0 / select(d, away, size < vec3f(steep));
    let turned = raykd_cycle(select(d, vec3f(), size < vec3f(0x1p-30)), frame.main);
    let shear = turned.xy * raykd_cycle(frame.inverse, frame.main).z;
    frame.shear = select(shear, vec2f(), abs(shear) < vec2f(0x1p-30));
    let reach = max(abs(raykd_header.lo - frame.origin), abs(raykd_header.hi - frame.origin));
    let far = max(max(reach.x, reach.y), max(reach.z, 0x1p-40));
    frame.pad = 0x1p-19 * far;
    frame.t_min = clamp(ray.t_min * stretch, -3e38, 3e38);
    frame.t_max = clamp(ray.t_max * stretch, -3e38, 3e38);
    let to_lo = (raykd_header.lo - frame.origin) * frame.inverse;
    let to_hi = (raykd_header.hi - frame.origin) * frame.inverse;
    let wide = frame.pad * abs(frame.inverse);
    let near = min(to_lo, to_hi) - wide;
    let beyond = max(to_lo, to_hi) + wide;
    frame.enter = max(frame.t_min, max(near.x, max(near.y, near.z)));
    frame.exit = min(frame.t_max, min(beyond.x, min(beyond.y, beyond.z)));
    return frame;
}

// a * b - c * d, with ten digits more than that: products of halves are exact, so that it does not matter which of them
// the driver fuses with a sum, and swapping both pairs changes the sign and nothing else. So triangles on both sides of an
// edge agree on which side of it a ray passes.
fn raykd_difference(a: f32, b: f32, c: f32, d: f32) -> f32 {
    let whole = vec4f(a, b, c, d);
    let high = bitcast<vec4f>(bitcast<vec4u>(whole) & vec4u(0xfffff000u));
    let low = whole - high;
    return (high.x * high.y - high.z * high.w)
        + (((high.x * low.y + low.x * high.y) - (high.z * low.w + low.z * high.w))
        + (low.x * low.y - low.z * low.w));
}

// The watertight test of Woop, Benthin & Wald 2013. Keeps the better of a triangle and `best`, whose `t` is scaled.
fn raykd_test(frame: RaykdFrame, reference: u32, best: ptr<function, RaykdHit>) {
    let a = raykd_cycle(raykd_corners[3u * reference].xyz - frame.origin, frame.main);
    let b = raykd_cycle(raykd_corners[3u * reference + 1u].xyz - frame.origin, frame.main);
    let c = raykd_cycle(raykd_corners[3u * reference + 2u].xyz - frame.origin, frame.main);
    let pa = a.xy - frame.shear * a.z;
    let pb = b.xy - frame.shear * b.z;
    let pc = c.xy - frame.shear * c.z;
    let u = raykd_difference(pc.x, pb.y, pc.y, pb.x);
    let v = raykd_difference(pa.x, pc.y, pa.y, pc.x);
    let w = raykd_difference(pb.x, pa.y, pb.y, pa.x);
    let negative = u < 0.0 || v < 0.0 || w < 0.0;
    let positive = u > 0.0 || v > 0.0 || w > 0.0;
    // Both: outside. Neither: the ray lies in the triangle's plane.
    if negative == positive {
        return;
    }
    let det = u + v + w;
    let depths = raykd_cycle(frame.inverse, frame.main).z * vec3f(a.z, b.z, c.z);
    let t = (u * depths.x + v * depths.y + w * depths.z) / det;
    let triangle = raykd_triangle(reference);
    let better = t < (*best).t || (t == (*best).t && triangle < (*best).triangle);
    if t >= frame.t_min && t <= frame.t_max && better {
        (*best).triangle = triangle;
        (*best).t = t;
        (*best).u = v / det;
        (*best).v = w / det;
    }
}

// No tree is deeper than this.
const RAYKD_DEPTH = 48u;

fn raykd_walk(ray: RaykdRay, any: bool) -> RaykdHit {
    var best = RaykdHit(RAYKD_MISS, 3e38, 0.0, 0.0, 0u, 0u);
    let size = max(max(abs(ray.direction.x), abs(ray.direction.y)), abs(ray.direction.z));
    let exponent = bitcast<u32>(size) >> 23u;
    if exponent < 67u || exponent > 187u {
        best.t = 0.0;
        return best;
    }
    let unit = bitcast<f32>((254u - exponent) << 23u);
    let stretch = bitcast<f32>(exponent << 23u) * raykd_header.scale;
    let frame = raykd_frame(ray, unit, stretch);
    // Waiting nodes, where they end, and where they begin.
    var stack: array<vec4u, RAYKD_DEPTH>;
    var top = 0u;
    var node = raykd_pairs[0].xy;
    var enter = frame.enter;
    var exit = frame.exit;
    while enter <= exit {
        while !raykd_is_leaf(node) {
            best.steps++;
            let pair = raykd_pairs[raykd_below(node) >> 1u];
            let axis = raykd_axis(node);
            let inverse = frame.inverse[axis];
            let at = (raykd_split(node) - frame.origin[axis]) * inverse;
            let wide = frame.pad * abs(inverse);
            let near = select(pair.xy, pair.zw, inverse < 0.0);
            let far = select(pair.zw, pair.xy, inverse < 0.0);
            if at + wide < enter {
                node = far;
            } else if at - wide > exit {
                node = near;
            } else {
                if top < RAYKD_DEPTH {
                    stack[top] = vec4u(far, bitcast<u32>(exit), bitcast<u32>(max(enter, at - wide)));
                    top++;
                }
                node = near;
                exit = min(exit, at + wide);
            }
        }
        let end = raykd_first(node) + raykd_count(node);
        best.tests += raykd_count(node);
        for (var reference = raykd_first(node); reference < end; reference++) {
            raykd_test(frame, reference, &best);
        }
        if any && best.triangle != RAYKD_MISS {
            break;
        }
        // The next that does not begin beyond the best hit.
        enter = 1.0;
        exit = 0.0;
        while top > 0u && enter > exit {
            top--;
            node = stack[top].xy;
            exit = min(bitcast<f32>(stack[top].z), best.t);
            enter = bitcast<f32>(stack[top].w);
        }
    }
    best.t = select(best.t / stretch, 0.0, best.triangle == RAYKD_MISS);
    return best;
}

// The closest hit of a ray.
fn raykd_closest(ray: RaykdRay) -> RaykdHit {
    return raykd_walk(ray, false);
}

// Some hit of a ray, if there is one.
fn raykd_any(ray: RaykdRay) -> RaykdHit {
    return raykd_walk(ray, true);
}
