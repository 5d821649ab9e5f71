//! The order in which a CPU traces rays that go all ways from places beside each other, as they leave a surface. Those
//! of a place that go the same way, one after the other, go side by side.

use super::{Scene, batch::Batch};
use crate::{Error, exec::To};
use bytemuck::allocation::zeroed_vec;
use raykd_kernels::glam::{Vec3, Vec4};
use raykd_shared::{Hit, Ray};
use rayon::prelude::*;
use std::{borrow::Cow, time::Duration};

/// Fewer rays a thread keep their order: smaller parts gain less than that takes.
const FEW: usize = 1 << 14;
/// Most rays that are put in order at once: so a processor's cache holds what is moved.
const BLOCK: usize = 1 << 16;
/// Eights of rays that are looked at.
const LOOKS: usize = 64;

/// How near to each other eight rays start that are put in order, of the scene's largest extent.
const NEAR: f32 = 1.0 / 16.0;
/// How far their directions take them together, of how far they go each, squared: nearly parallel rays go side by side
/// as they are. What bounces off a surface keeps 0.4.
const ALONG: f32 = 0.7;

impl Scene {
    /// The box of the triangles, where the mesh is.
    pub(super) fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let scale = 1.0 / self.header.scale;
        (self.header.lo.map(|x| x * scale), self.header.hi.map(|x| x * scale))
    }
}

/// An order of rays, of each block in itself.
#[derive(Debug)]
pub(super) struct Order {
    block: usize,
    /// The places that rays come from, in their blocks; none if they keep their order.
    places: Vec<u32>,
}

impl Order {
    /// The best order for rays that are where the mesh is.
    pub(super) fn of(scene: &Scene, rays: &[Ray]) -> Self {
        let mut order = Self { block: BLOCK, places: Vec::new() };
        let Some(threads) = scene.device.side_by_side() else { return order };
        if rays.len() < threads * FEW {
            return order;
        }
        let (lo, hi) = scene.bounds();
        let extent = (Vec3::from(hi) - Vec3::from(lo)).max_element();
        let scattered =
            |look: &usize| is_scattered(&rays[look * (rays.len() / 8 / LOOKS) * 8..][..8], NEAR * extent);
        if 2 * (0..LOOKS).filter(scattered).count() > LOOKS {
            scene.device.install(|| {
                // A block for each thread at least.
                order.block = rays.len().div_ceil(threads).min(BLOCK);
                let cells = Cells::new(lo, hi, if order.block < BLOCK / 2 { 4 } else { 5 });
                order.places = zeroed_vec(rays.len());
                let blocks = order.places.par_chunks_mut(order.block).zip(rays.par_chunks(order.block));
                blocks.for_each(|(places, rays)| {
                    let key = |ray: &Ray| cells.of(ray.origin) << 3 | signs(ray);
                    let keys: Vec<u32> = rays.iter().map(key).collect();
                    by_keys(&keys, 8 * cells.count(), places);
                });
            });
        }
        order
    }

    /// Puts in order what there is one of a ray.
    pub(super) fn apply<'a, T: Copy + Send + Sync>(&self, scene: &Scene, each: &'a [T]) -> Cow<'a, [T]> {
        if self.places.is_empty() {
            return each.into();
        }
        let one = |(i, &place): (usize, &u32)| each[i / self.block * self.block + place as usize];
        scene.device.install(|| self.places.par_iter().enumerate().map(one).collect::<Vec<_>>()).into()
    }

    /// Traces a batch that is in this order, by a function of where its hits go.
    pub(super) fn trace(
        &self,
        scene: &Scene,
        batch: &Batch,
        hits: To<'_, Hit>,
        trace: impl FnOnce(To<'_, Hit>) -> Result<(Duration, u32), Error>,
    ) -> Result<(Duration, u32), Error> {
        if self.places.is_empty() {
            return trace(hits);
        }
        let told = trace(To::Room(&mut []))?;
        self.put_back(scene, scene.device.kept(&batch.hits)?.slice(), hits);
        Ok(told)
    }

    /// Puts hits where their rays were.
    fn put_back(&self, scene: &Scene, found: &[Hit], hits: To<'_, Hit>) {
        let put = |room: &mut [Hit]| {
            let blocks = room.par_chunks_mut(self.block).zip(self.places.par_chunks(self.block));
            blocks.zip(found.par_chunks(self.block)).for_each(|((room, places), found)| {
                places.iter().zip(found).for_each(|(&place, hit)| room[place as usize] = *hit);
            });
        };
        match hits {
            To::Room(room) => scene.device.install(|| put(room)),
            To::End(list, count) => {
                let mut room = zeroed_vec(count);
                scene.device.install(|| put(&mut room));
                if list.is_empty() { *list = room } else { list.append(&mut room) }
            }
        }
    }
}

/// Whether eight rays start within `near` of the first, but go different ways.
fn is_scattered(eight: &[Ray], near: f32) -> bool {
    let first = Vec3::from(eight[0].origin);
    let is_near = |ray: &Ray| (Vec3::from(ray.origin) - first).abs().max_element() < near;
    let along: Vec3 = eight.iter().map(|ray| Vec3::from(ray.direction).normalize_or_zero()).sum();
    eight.iter().all(is_near) && along.length_squared() < ALONG * (eight.len() * eight.len()) as f32
}

/// The signs of a ray's direction.
fn signs(ray: &Ray) -> u32 {
    let [x, y, z] = ray.direction.map(|x| u32::from(x.is_sign_negative()));
    x | y << 1 | z << 2
}

/// Cells of a box, `8^bits` in the order of Morton 1966: mostly the next one is beside.
pub(super) struct Cells {
    lo: Vec4,
    /// Cells to a unit of length.
    rates: Vec4,
    bits: u32,
}

impl Cells {
    pub(super) fn new(lo: [f32; 3], hi: [f32; 3], bits: u32) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| (1 << bits) as f32 / (hi[axis] - lo[axis]));
        Self { lo: Vec4::new(lo[0], lo[1], lo[2], 0.0), rates: Vec4::new(x, y, z, 0.0), bits }
    }

    /// How many there are.
    pub(super) const fn count(&self) -> usize {
        1 << (3 * self.bits)
    }

    /// The number of the cell in which a point lies; of points outside, and of what is no number, one at the border.
    #[inline]
    pub(super) fn of(&self, point: [f32; 3]) -> u32 {
        let most = ((1u32 << self.bits) - 1) as f32;
        let at = Vec4::new(point[0], point[1], point[2], 0.0);
        let [x, y, z, _] = ((at - self.lo) * self.rates).min(Vec4::splat(most)).to_array().map(|x| x as u32);
        spread(x) | spread(y) << 1 | spread(z) << 2
    }
}

/// Eight bits, two zeros before each.
const fn spread(bits: u32) -> u32 {
    let bits = (bits | (bits << 8)) & 0x0000_F00F;
    let bits = (bits | (bits << 4)) & 0x000C_30C3;
    (bits | (bits << 2)) & 0x0024_9249
}

/// Fills `order` with the numbers of things in the order of their keys, which are less than `end`.
pub(super) fn by_keys(keys: &[u32], end: usize, order: &mut [u32]) {
    let mut next = vec![0u32; end + 1];
    for &key in keys {
        next[key as usize + 1] += 1;
    }
    for i in 1..next.len() {
        next[i] += next[i - 1];
    }
    for (i, &key) in (0..).zip(keys) {
        let next = &mut next[key as usize];
        order[*next as usize] = i;
        *next += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        BuildOptions, Device, Error, Mesh,
        rays::{Camera, bounces},
    };

    #[test]
    fn what_bounces_off_is_put_in_order_and_its_hits_back() -> Result<(), Error> {
        let mesh = Mesh::teapot(6);
        let scene = Scene::build(&Device::cpu_with_threads(2)?, &mesh, &BuildOptions::default())?;
        let picture = Camera::framing(mesh.bounds()).rays(600, 450);
        let bounced = bounces(&mesh, &picture, &scene.closest(&picture)?, 1);
        assert!(Order::of(&scene, &picture).places.is_empty());
        assert!(Order::of(&scene, &bounced[..2 * FEW - 1]).places.is_empty());
        let order = Order::of(&scene, &bounced);
        assert_eq!(order.places.is_empty(), scene.device.side_by_side().is_none());
        if order.places.is_empty() {
            return Ok(());
        }

        assert!(bounced.len() > order.block, "several blocks");
        let numbers: Vec<u32> = (0..bounced.len() as u32).collect();
        let hit = |&triangle: &u32| Hit { triangle, ..Hit::NONE };
        let hits: Vec<Hit> = order.apply(&scene, &numbers).iter().map(hit).collect();
        let (mut list, mut room) = (vec![Hit::NONE], vec![Hit::NONE; numbers.len()]);
        order.put_back(&scene, &hits, To::End(&mut list, numbers.len()));
        order.put_back(&scene, &hits, To::Room(&mut room));
        assert!(room.iter().map(|hit| hit.triangle).eq(numbers));
        assert_eq!(list[1..], room);
        Ok(())
    }
}
