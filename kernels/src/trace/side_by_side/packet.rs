//! Eight rays side by side, on a CPU: they go through the tree together, each in its own interval of `t`, and those
//! that a node does not concern wait. The answers are those of [`stack`](crate::trace::traverse::stack), which asks the
//! same questions of one ray.
//!
//! Rays whose directions have the same signs come to all leaves in the same order, so each does what it does alone.
//! Where signs differ most decide which child comes first, which changes no closest hit. Any hit is that of the first
//! leaf that has one, so there signs must agree.

use super::{Packets, Range, Scene, apart::Visits, neighbours};
use crate::{
    Group,
    eight::SIDE_BY_SIDE,
    glam::{UVec4, Vec3, Vec4},
    kernel::Bits,
    math::{Digits, Sides, abs, div, exp2, exponent, high},
    mem::{Buf, Slots, Stack},
    trace::{
        frame::{DUST, FARTHEST, FARTHEST_SCENE, Frame, NO_SHEAR, PAD, flush, reciprocal, slab},
        intersect::{
            Best, Corners, Glance, NORMAL,
            bounds::{Edges, Starts, glance},
            filter::{Line, Turned},
            strict::{self, Sheared, Strict, sheared, weights},
            vertices,
        },
        job::{Left, record},
        traverse::{
            crossing::crossed,
            leaf::{self, Every},
        },
    },
};
use raykd_shared::{MISS, Node, TreeHeader, limits::MAX_DEPTH};

/// How many rays must start near each other to go together.
const ENOUGH: u32 = 6;
/// How far their directions must take them together, of how far they go each, squared: what bounces off a surface keeps
/// 0.4, rays to all sides an eighth.
const ALONG: f32 = 0.3;
/// Fewer rays are not worth a walk of their own.
const FEW: u32 = 3;

/// No triangle yet, as a float that is larger than any with a triangle's number and [`NORMAL`].
const NONE: f32 = f32::INFINITY;

/// A node for later: where the interval of each ray begins and ends there, and which rays have one.
#[derive(Clone, Copy)]
struct Entry<N> {
    node: Node,
    rays: u32,
    enter: N,
    exit: N,
}

/// The best hits so far.
struct Bests<N> {
    t: N,
    triangle: N,
    u: N,
    v: N,
    det: N,
}

/// Rays scaled, as [`Frame`] does it, where that is a multiplication.
pub(super) struct Scaled<N> {
    origin: [N; 3],
    /// The largest component is of size 1 to 2.
    direction: [N; 3],
    pub t_min: N,
    pub t_max: N,
    stretch: N,
    /// Which rays are ordinary: numbers, none so small or large that digits are lost.
    pub rays: u32,
}

/// Which axis is the main one of each ray.
pub(super) struct Mains<N: Sides> {
    second: N::Mask,
    third: N::Mask,
}

impl<N: Sides> Mains<N> {
    /// Of three numbers, one an axis, that of the main one.
    #[inline(always)]
    fn of(&self, x: N, y: N, z: N) -> N {
        N::choose(self.third, z, N::choose(self.second, y, x))
    }

    /// A point with the main axis last.
    #[inline(always)]
    fn cycled(&self, [x, y, z]: [N; 3]) -> Turned<N> {
        Turned { x: self.of(y, z, x), y: self.of(z, x, y), z: self.of(x, y, z) }
    }

    /// A point each.
    #[inline(always)]
    pub(super) fn turned(&self, points: &[Vec4; 8]) -> Turned<N> {
        let [x, y, z, _] = N::columns(points);
        self.cycled([x, y, z])
    }
}

impl<N: Sides> Scaled<N> {
    /// Of rays as buffers hold them; if `whole`, as [`Frame::whole`]. Of subnormal numbers more is left than there:
    /// less than any error that counts.
    #[inline(always)]
    pub(super) fn new(starts: &[Vec4; 8], ways: &[Vec4; 8], scale: f32, whole: bool) -> Self {
        let [ox, oy, oz, dx] = N::columns(starts);
        let [dy, dz, from, to] = N::columns(ways);
        let (scale, zero) = (N::all(scale), N::all(0.0));
        let (sx, sy, sz) = (dx.abs(), dy.abs(), dz.abs());
        let most = sx.high(sy).high(sz);
        let unit = most.unit();
        let stretch = unit.unit() * scale;
        let place = [ox * scale, oy * scale, oz * scale];
        let (t_min, t_max) = (from * stretch, to * stretch);
        // Comparisons with NaN are false.
        let (large, close, normal) = (N::all(exp2(60)), N::all(exp2(FARTHEST)), N::all(f32::MIN_POSITIVE));
        let sized = sx.below(large) & sy.below(large) & sz.below(large) & most.exceeds(N::all(exp2(-60)));
        let placed = place[0].abs().below(close) & place[1].abs().below(close) & place[2].abs().below(close);
        let begun = from.is(zero) | !(from.abs().below(normal) | t_min.abs().below(normal));
        let ended = to.is(zero) | !(to.abs().below(normal) | t_max.abs().below(normal));
        let rays = sized & placed & begun & ended & from.is(from) & to.is(to);
        let direction = [dx * unit, dy * unit, dz * unit];
        let mut origin = place;
        if !whole {
            origin = [flush(place[0], DUST), flush(place[1], DUST), flush(place[2], DUST)];
        }
        Self { origin, direction, t_min, t_max, stretch, rays: N::bits(rays) }
    }

    /// The main axes: of equal components the first is the main one.
    #[inline(always)]
    pub(super) fn mains(&self) -> Mains<N> {
        let [x, y, z] = self.direction;
        let (x, y) = (x.abs(), y.abs());
        Mains { second: y.exceeds(x), third: z.abs().exceeds(x.high(y)) }
    }

    /// How far away the scene's corners are at most, along an axis.
    #[inline(always)]
    fn far(&self, header: &TreeHeader) -> N {
        let mut far = N::all(exp2(-40));
        let mut axis = 0;
        while axis < 3 {
            far = far.high((N::all(header.lo[axis]) - self.origin[axis]).abs());
            far = far.high((N::all(header.hi[axis]) - self.origin[axis]).abs());
            axis += 1;
        }
        far
    }

    /// For more digits; of rays made `WHOLE`.
    #[inline(always)]
    pub(super) fn line(&self, mains: &Mains<N>, header: &TreeHeader) -> Line<N> {
        let (from, way) = (mains.cycled(self.origin), mains.cycled(self.direction));
        Line {
            from,
            way,
            // Nothing is left out of ordinary rays.
            whole: self.t_min.is(self.t_min),
            along: way.z.inverse(),
            far: self.far(header),
            t_min: self.t_min,
            t_max: self.t_max,
        }
    }

    /// What makes of a scaled `t` one of the ray's own.
    #[inline(always)]
    pub(super) fn unstretch(&self) -> N {
        self.stretch.unit()
    }

    /// Whether directions do not cancel out.
    #[inline(always)]
    fn agree(&self) -> bool {
        let [x, y, z] = self.direction;
        let (sx, sy, sz) = (sum(x), sum(y), sum(z));
        let most = SIDE_BY_SIDE as f32 * sum(x * x + y * y + z * z);
        sx * sx + sy * sy + sz * sz > ALONG * most
    }
}

/// Which of some rays start near the first one, on every axis.
#[inline(always)]
fn close<N: Sides>(rows: &[Vec4; 8], near: f32) -> u32 {
    let first = rows[0];
    let [x, y, z, _] = N::columns(rows);
    let near = N::all(near);
    let (x, y, z) = (x - N::all(first.x), y - N::all(first.y), z - N::all(first.z));
    N::bits(x.abs().below(near) & y.abs().below(near) & z.abs().below(near))
}

/// The sum of all.
#[inline(always)]
fn sum<N: Sides>(numbers: N) -> f32 {
    let [a, b, c, d, e, f, g, h] = numbers.numbers();
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// What is made of the leaves that some rays meet.
pub(super) trait Leaves<N: Sides> {
    /// Tests the triangles of a leaf.
    fn visit(&mut self, packet: &Packet<N>, leaf: Node, rays: u32, corners: &Buf<Vec4>);
    /// The last `t` that counts.
    fn last(&self) -> N;
    /// Which rays are done.
    fn done(&self) -> u32;
}

/// Rays made ready, as [`Frame`] is.
pub(in crate::trace) struct Packet<N: Sides> {
    /// The number of the first one.
    pub first: u32,
    /// Which go together.
    pub together: u32,
    pub(super) scaled: Scaled<N>,
    /// By axis; there is no fourth one, but its number is that of a leaf.
    origins: [N; 4],
    inverses: [N; 4],
    /// Which rays go down on an axis.
    back: [u32; 4],
    pad: N,
    /// What turns a corner so that a ray's main axis is the last.
    turns: [N::Turn; 3],
    /// The origins, turned.
    seats: [N; 3],
    shear_x: N,
    shear_y: N,
    /// Reciprocals of the main components.
    along: N,
    main: N,
    enter: N,
    exit: N,
}

impl<N: Sides> Packet<N> {
    /// The eight rays from `first` on, if enough go together.
    #[inline(always)]
    pub(super) fn of(first: u32, scene: &Scene<'_>, near: f32, whole: bool) -> Option<Self> {
        let Scene { header, rays, .. } = scene;
        let (mut starts, mut ways) = ([Vec4::ZERO; 8], [Vec4::ZERO; 8]);
        let mut ray = 0;
        while ray < SIDE_BY_SIDE {
            starts[ray as usize] = rays.at(2 * (first + ray));
            ways[ray as usize] = rays.at(2 * (first + ray) + 1);
            ray += 1;
        }
        let mut together = close::<N>(&starts, near);
        if together.count_ones() < ENOUGH {
            return None;
        }
        let scaled = Scaled::<N>::new(&starts, &ways, header.scale, whole);
        together &= scaled.rays;
        if together.count_ones() < ENOUGH || !scaled.agree() {
            return None;
        }
        // No closure: one that is not inlined, as in development builds, is compiled without AVX2.
        Some(Self::new(first, together, scaled, header))
    }

    #[inline(always)]
    fn new(first: u32, together: u32, scaled: Scaled<N>, header: &TreeHeader) -> Self {
        let (all, zero) = (N::all, N::all(0.0));
        let ([ox, oy, oz], [dx, dy, dz]) = (scaled.origin, scaled.direction);
        let inverse = [reciprocal(dx), reciprocal(dy), reciprocal(dz)];
        let pad = all(PAD) * scaled.far(header);
        let (mut enter, mut exit) = (scaled.t_min, scaled.t_max);
        let mut axis = 0;
        while axis < 3 {
            let (lo, hi) = (header.lo[axis], header.hi[axis]);
            (enter, exit) = slab(lo, hi, scaled.origin[axis], inverse[axis], pad, enter, exit);
            axis += 1;
        }
        let mains = scaled.mains();
        let by_main = |a, b, c| mains.of(a, b, c);
        let along = by_main(inverse[0], inverse[1], inverse[2]);
        let (one, two) = (all(1.0), all(2.0));
        let back = |axis: usize| N::bits(inverse[axis].below(zero));
        Self {
            first,
            together,
            origins: [ox, oy, oz, zero],
            inverses: [inverse[0], inverse[1], inverse[2], zero],
            back: [back(0), back(1), back(2), 0],
            pad,
            turns: [
                N::turn(by_main(one, two, zero)),
                N::turn(by_main(two, zero, one)),
                N::turn(by_main(zero, one, two)),
            ],
            seats: [by_main(oy, oz, ox), by_main(oz, ox, oy), by_main(ox, oy, oz)],
            shear_x: flush(by_main(dy, dz, dx) * along, NO_SHEAR),
            shear_y: flush(by_main(dz, dx, dy) * along, NO_SHEAR),
            along,
            main: by_main(zero, one, two),
            enter,
            exit,
            scaled,
        }
    }

    /// Those of some rays whose directions have the signs of the first one's.
    #[inline(always)]
    fn alike(&self, rays: u32) -> u32 {
        let first = rays & rays.wrapping_neg();
        let like = |back: u32| if back & first == 0 { !back } else { back };
        rays & like(self.back[0]) & like(self.back[1]) & like(self.back[2])
    }

    /// Takes some rays to their leaves, as [`stack::walk`](crate::trace::traverse::stack::walk) does.
    #[inline(always)]
    pub(super) fn walk(&self, rays: u32, scene: &Scene<'_>, leaves: &mut impl Leaves<N>) {
        let Scene { pairs, corners, .. } = *scene;
        let mut stack = Stack::<Entry<N>, { MAX_DEPTH as usize }>::new();
        let mut top = 0;
        let root = pairs.at(0);
        let mut node = Node::from_words(root.x, root.y);
        let (mut enter, mut exit) = (self.enter, self.exit);
        let mut running = rays & !N::bits(enter.exceeds(exit));
        let mut rays = running;
        while rays != 0 {
            while !node.is_leaf() {
                let pair = pairs.at(node.below() >> 1);
                let axis = node.axis() as usize;
                let (at, wide) =
                    crossed(N::all(node.split()), self.origins[axis], self.inverses[axis], self.pad);
                let (first, last) = (at - wide, at + wide);
                let (past, before) = (last.below(enter), first.exceeds(exit));
                let (near_rays, far_rays) = (rays & !N::bits(past), rays & !N::bits(before));
                let (below, above) = (Node::from_words(pair.x, pair.y), Node::from_words(pair.z, pair.w));
                let (begins, ends) = (enter.high(first), exit.low(last));
                let back = self.back[axis] & rays;
                let (next, later);
                if back == 0 || back == rays {
                    let near = if back == 0 { below } else { above };
                    let far = if back == 0 { above } else { below };
                    // A ray that goes to both begins in the far child where the plane does.
                    let later_enter = N::choose(past, enter, first);
                    next = Entry { node: near, rays: near_rays, enter, exit: ends };
                    later = Entry { node: far, rays: far_rays, enter: later_enter, exit };
                    if near.is_empty() || near_rays == 0 {
                        (node, rays, enter) = (far, far_rays, begins);
                        if rays == 0 {
                            node = Node::PADDING;
                        }
                        continue;
                    }
                } else {
                    let down = N::mask(back);
                    let one = Entry {
                        node: below,
                        rays: (near_rays & !back) | (far_rays & back),
                        enter: N::choose(down, begins, enter),
                        exit: N::choose(down, exit, ends),
                    };
                    let other = Entry {
                        node: above,
                        rays: (far_rays & !back) | (near_rays & back),
                        enter: N::choose(down, enter, begins),
                        exit: N::choose(down, ends, exit),
                    };
                    let turned = back.count_ones() * 2 > rays.count_ones();
                    (next, later) = if turned { (other, one) } else { (one, other) };
                    if next.node.is_empty() || next.rays == 0 {
                        Entry { node, rays, enter, exit } = later;
                        if rays == 0 {
                            node = Node::PADDING;
                        }
                        continue;
                    }
                }
                if !later.node.is_empty() && later.rays != 0 {
                    stack.put(top, later);
                    top += 1;
                }
                Entry { node, rays, enter, exit } = next;
            }
            if rays != 0 {
                leaves.visit(self, node, rays, corners);
            }
            running &= !leaves.done();
            let last = leaves.last();
            rays = 0;
            while rays == 0 && top > 0 {
                top -= 1;
                let entry = stack.at(top);
                (node, enter, exit) = (entry.node, entry.enter, entry.exit.low(last));
                rays = entry.rays & running & !N::bits(enter.exceeds(last));
            }
        }
    }

    /// Takes rays to their leaves that go together, for any hit those whose directions have the same signs, and returns
    /// which they are.
    #[inline(always)]
    pub(super) fn walk_together<const ANY: bool>(
        &self,
        scene: &Scene<'_>,
        leaves: &mut impl Leaves<N>,
    ) -> u32 {
        let (mut waiting, mut gone) = (self.together, 0);
        while waiting != 0 {
            let some = if ANY { self.alike(waiting) } else { waiting };
            if some.count_ones() >= FEW {
                self.walk(some, scene, leaves);
                gone |= some;
            }
            waiting &= !some;
        }
        gone
    }

    /// What floats tell of a triangle, and for which rays it may be hit; nothing if for none of some.
    #[inline(always)]
    pub(super) fn glance(&self, corners: Corners, some: u32) -> Option<(N::Mask, Glance<N>)> {
        let s = self.sheared(corners);
        let edges = Edges::new(&s, self.pad);
        if N::bits(edges.may_hit()) & some == 0 {
            return None;
        }
        let edges = edges.closer(&s, self.pad);
        let may = edges.may_hit();
        if N::bits(may) & some == 0 {
            return None;
        }
        let ([ox, oy, oz, _], [ix, iy, iz, _]) = (self.origins, self.inverses);
        let starts = Starts { origin: [ox, oy, oz], inverse: [ix, iy, iz] };
        Some((may, glance(&s, edges, &starts, self.along, self.pad, vertices(corners))))
    }

    /// No hit before these `t` counts any more.
    #[inline(always)]
    pub(super) fn begin_at(&mut self, t: N) {
        self.enter = self.enter.high(t);
    }

    /// A ray alone, for tests of those that are whole and for records.
    #[inline(always)]
    pub(super) fn frame(&self, ray: usize) -> Frame {
        let one = |numbers: N| numbers.numbers()[ray];
        let three = |numbers: &[N; 4]| Vec3::new(one(numbers[0]), one(numbers[1]), one(numbers[2]));
        Frame {
            origin: three(&self.origins),
            inverse: three(&self.inverses),
            main: one(self.main) as u32,
            shear_x: one(self.shear_x),
            shear_y: one(self.shear_y),
            t_min: one(self.scaled.t_min),
            stretch: -exponent(one(self.scaled.unstretch())),
            ..Frame::NOTHING
        }
    }

    /// [`strict::test`] of a triangle, if its coordinates are plain, in any range.
    #[inline(always)]
    pub(super) fn meet(&self, s: &Sheared<N>) -> Met<N> {
        let zero = N::all(0.0);
        let (u, v, w) = s.edges();
        let negative = u.below(zero) | v.below(zero) | w.below(zero);
        let positive = u.exceeds(zero) | v.exceeds(zero) | w.exceeds(zero);
        let hit = (negative | positive) & !(negative & positive);
        let (u, v, w, det) = weights(u, v, w);
        let t = s.depth(self.along, u, v, w).over(det);
        Met { hit, t, u: v, v: w, det }
    }

    /// A triangle seen along the rays.
    #[inline(always)]
    pub(super) fn sheared(&self, (a, b, c): Corners) -> Sheared<N> {
        let seen = |v: Vec4, k: usize| N::turned(v, self.turns[k]) - self.seats[k];
        let (az, bz, cz) = (seen(a, 2), seen(b, 2), seen(c, 2));
        Sheared {
            ax: sheared(seen(a, 0), self.shear_x, az),
            ay: sheared(seen(a, 1), self.shear_y, az),
            bx: sheared(seen(b, 0), self.shear_x, bz),
            by: sheared(seen(b, 1), self.shear_y, bz),
            cx: sheared(seen(c, 0), self.shear_x, cz),
            cy: sheared(seen(c, 1), self.shear_y, cz),
            az,
            bz,
            cz,
        }
    }
}

/// Where rays hit a triangle, if they do, and by which weights.
pub(super) struct Met<N: Sides> {
    pub hit: N::Mask,
    pub t: N,
    pub u: N,
    pub v: N,
    pub det: N,
}

/// Keeps the best hits, or the first.
struct Hits<N, const ANY: bool>(Bests<N>);

impl<N: Sides, const ANY: bool> Leaves<N> for Hits<N, ANY> {
    #[inline(always)]
    fn visit(&mut self, packet: &Packet<N>, leaf: Node, rays: u32, corners: &Buf<Vec4>) {
        let end = leaf.first() + leaf.count();
        let mut r = leaf.first();
        while r < end {
            let (a, b, c) = corners.three(3 * r);
            r += 1;
            let s = packet.sheared((a, b, c));
            let may_hit = N::bits(s.agree()) & rays;
            if may_hit != 0 {
                let plain = N::bits(s.is_plain());
                self.0.test(packet, &s, a.w, may_hit & plain);
                for ray in Bits(may_hit & !plain) {
                    self.0.test_one(packet, ray as usize, (a, b, c));
                }
            }
        }
    }

    #[inline(always)]
    fn last(&self) -> N {
        self.0.t
    }

    #[inline(always)]
    fn done(&self) -> u32 {
        if ANY { N::bits(self.0.triangle.below(N::all(NONE))) } else { 0 }
    }
}

impl<N: Sides> Bests<N> {
    /// None yet.
    #[inline(always)]
    fn new(packet: &Packet<N>) -> Self {
        let (all, zero) = (N::all, N::all(0.0));
        Self { t: packet.scaled.t_max, triangle: all(NONE), u: zero, v: zero, det: all(1.0) }
    }

    /// [`strict::test`] of one triangle for some rays, whose coordinates are plain.
    #[inline(always)]
    fn test(&mut self, packet: &Packet<N>, s: &Sheared<N>, triangle: f32, rays: u32) {
        let (Met { hit, t, u, v, det }, triangle) = (packet.meet(s), N::all(triangle));
        let best = self;
        let better = t.below(best.t) | (t.is(best.t) & triangle.below(best.triangle));
        let take = hit & better & !t.below(packet.scaled.t_min) & N::mask(rays);
        best.t = N::choose(take, t, best.t);
        best.triangle = N::choose(take, triangle, best.triangle);
        best.u = N::choose(take, u, best.u);
        best.v = N::choose(take, v, best.v);
        best.det = N::choose(take, det, best.det);
    }

    /// [`strict::test`] of one triangle for one ray.
    #[inline(always)]
    fn test_one(&mut self, packet: &Packet<N>, ray: usize, corners: Corners) {
        let one = |numbers: N| numbers.numbers()[ray];
        let numbers = self;
        let triangle = one(numbers.triangle);
        let mut best = Best {
            t: one(numbers.t),
            triangle: if triangle < NONE { triangle.to_bits() & !NORMAL } else { MISS },
            u: one(numbers.u),
            v: one(numbers.v),
            det: one(numbers.det),
        };
        offer(&packet.frame(ray), corners, &mut best);
        if best.triangle != MISS {
            let here = N::mask(1 << ray);
            numbers.t = N::choose(here, N::all(best.t), numbers.t);
            numbers.triangle =
                N::choose(here, N::all(f32::from_bits(best.triangle | NORMAL)), numbers.triangle);
            numbers.u = N::choose(here, N::all(best.u), numbers.u);
            numbers.v = N::choose(here, N::all(best.v), numbers.v);
            numbers.det = N::choose(here, N::all(best.det), numbers.det);
        }
    }

    /// Writes the hits of some rays, as [`record`](super::job::record) does.
    #[inline(always)]
    fn record(&self, packet: &Packet<N>, rays: u32, hits: &mut Buf<UVec4>) {
        let best = self;
        // What is subnormal is 0, and so is a negative zero.
        let t = flush(best.t * packet.scaled.unstretch(), f32::MIN_POSITIVE);
        let (triangles, t) = (best.triangle.numbers(), t.numbers());
        let (u, v) = (quotients(best.u, best.det), quotients(best.v, best.det));
        let mut ray = 0;
        while ray < SIDE_BY_SIDE as usize {
            let hit = UVec4::new(
                triangles[ray].to_bits() & !NORMAL,
                t[ray].to_bits(),
                u[ray].to_bits(),
                v[ray].to_bits(),
            );
            let missed = UVec4::new(MISS, 0, 0, 0);
            if rays >> ray & 1 != 0 {
                hits.put(packet.first + ray as u32, if triangles[ray] < NONE { hit } else { missed });
            }
            ray += 1;
        }
    }
}

/// Quotients of weights by their sums.
#[inline(always)]
fn quotients<N: Sides>(a: N, sum: N) -> [f32; 8] {
    let mut found = (a.over(sum) + N::all(0.0)).numbers();
    // Few are so small that their quotients may not be normal.
    for ray in Bits(N::bits(a.is_small(exp2(-100)))) {
        let ray = ray as usize;
        found[ray] = div(a.numbers()[ray], sum.numbers()[ray]) + 0.0;
    }
    found
}

/// [`strict::test`], for the few cases that need it.
#[cold]
#[inline(never)]
pub(super) fn offer(ray: &Frame, corners: Corners, best: &mut Best) {
    strict::test(ray, corners.0.w.to_bits() & !NORMAL, &strict::shear(ray, vertices(corners)), best);
}

/// Where closest hits go, or if `ANY`, some hits.
struct Answers<'a, const ANY: bool>(&'a mut Buf<UVec4>);

impl<N: Sides, const ANY: bool> Packets<N> for Answers<'_, ANY> {
    #[inline(always)]
    fn answer(&mut self, scene: &Scene<'_>, packet: &mut Packet<N>) -> u32 {
        let mut found = Hits::<N, ANY>(Bests::new(packet));
        let answered = packet.walk_together::<ANY>(scene, &mut found);
        found.0.record(packet, answered, self.0);
        answered
    }
}

impl<N: Sides, const ANY: bool> Visits<N> for Answers<'_, ANY> {
    #[inline(always)]
    fn begin(&mut self, _lane: usize) {}

    #[inline(always)]
    fn visit(&mut self, _lane: usize, ray: &Frame, leaf: Node, corners: &Buf<Vec4>, best: &mut Best) -> bool {
        leaf::visit(Strict, ray, leaf, corners, &mut Every, best);
        best.is_enough(ANY)
    }

    #[inline(always)]
    fn end(&mut self, _lane: usize, i: u32, ray: &Frame, best: &Best) -> bool {
        self.0.put(i, record(ray, best));
        true
    }

    #[inline(always)]
    fn miss(&mut self, i: u32) {
        self.0.put(i, UVec4::new(MISS, 0, 0, 0));
    }
}

/// The largest extent of a scene; nothing if its numbers are out of the ordinary.
#[inline(always)]
pub(super) fn extent(header: &TreeHeader) -> Option<f32> {
    let (mut extent, mut most) = (0.0, 0.0);
    let mut axis = 0;
    while axis < 3 {
        let (lo, hi) = (header.lo[axis], header.hi[axis]);
        extent = high(extent, hi - lo);
        most = high(most, high(abs(lo), abs(hi)));
        axis += 1;
    }
    let ordinary = most < exp2(FARTHEST_SCENE - 1) && header.scale > exp2(-40) && header.scale < exp2(40);
    if ordinary { Some(extent * header.scale.unit()) } else { None }
}

/// Answers some rays that go side by side, compiled for AVX2, and returns which are left.
///
/// # Safety
/// The processor has these instructions.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn by_eight<const ANY: bool>(
    range: Range,
    scene: Scene<'_>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) -> Left {
    scene.side_by_side(range, outcome, &mut Answers::<ANY>(hits))
}

/// Answers those of a workgroup's rays that go side by side, or if `ANY`, finds some hit of theirs.
#[inline(always)]
pub(in crate::trace) fn closest<const ANY: bool>(
    group: &Group,
    job: &Buf<u32>,
    header: &Buf<TreeHeader>,
    pairs: &Buf<UVec4>,
    corners: &Buf<Vec4>,
    rays: &Buf<Vec4>,
    hits: &mut Buf<UVec4>,
    outcome: &mut Buf<u32>,
) -> Left {
    let Some(range) = neighbours(group, job) else { return Left::ALL };
    let scene = Scene { header: &header.at(0), pairs, corners, rays };
    // SAFETY: that the group is usual says so.
    unsafe { by_eight::<ANY>(range, scene, hits, outcome) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        eight::{Eight, tests::has_usual},
        math::Number,
        mem::view,
    };

    #[test]
    fn quotients_of_any_size_are_those_of_single_numbers() {
        if !has_usual() {
            return;
        }
        for e in -126..=1 {
            for sum in [1.0, 1.000_001, 1.7, 2.0, 3.999, 4.0] {
                let a = exp2(e) * 1.500_001;
                for a in [a, -a, 0.0, -0.0] {
                    let found = quotients(Eight::all(a), Eight::all(sum));
                    assert_eq!(found.map(f32::to_bits), [(div(a, sum) + 0.0).to_bits(); 8], "{a:e} / {sum}");
                }
            }
        }
    }

    /// A triangle, and the rays of a small picture: all go side by side but those of a group that is cut off.
    #[test]
    fn rays_that_start_together_go_side_by_side() {
        if !has_usual() {
            return;
        }
        let corner = |x: f32, y: f32| Vec4::new(x, y, 0.0, f32::from_bits(NORMAL));
        let corners = [corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)];
        let (leaf, pad) = (Node::leaf(0, 1).words(), Node::PADDING.words());
        let pairs = [UVec4::new(leaf.0, leaf.1, pad.0, pad.1)];
        let header = TreeHeader { hi: [1.0, 1.0, 0.0], scale: 1.0, ..bytemuck::Zeroable::zeroed() };
        let mut rays = [Vec4::ZERO; 40];
        for (i, ray) in rays.chunks_mut(2).enumerate() {
            ray[0] = Vec4::new(0.2, 0.2, 1.0, 0.01 * i as f32);
            ray[1] = Vec4::new(0.01, -1.0, 0.0, f32::INFINITY);
        }
        let mut hits = [UVec4::ZERO; 20];
        // SAFETY: the array outlives the view, and nobody else has it.
        let out = &mut unsafe { Buf::new(hits.as_mut_ptr(), hits.len()) };
        let (header, pairs, corners, rays) = (&header, &view(&pairs), &view(&corners), &view(&rays));
        let scene = Scene { header, pairs, corners, rays };
        let left = scene.together::<Eight, _>((0, 20), &mut Answers::<true>(out));
        let lanes = (0..64).fold(0u64, |bits, lane| bits | u64::from(left.has(lane)) << lane);
        assert_eq!(lanes, 0xF_0000);
        assert!(hits[..16].iter().all(|hit| hit.x == 0 && f32::from_bits(hit.y) == 1.0));
        assert_eq!(hits[16..], [UVec4::ZERO; 4]);
    }
}
