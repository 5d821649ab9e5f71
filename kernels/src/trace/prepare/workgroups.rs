//! Rays whose number stands in a buffer: how many workgroups trace them.

use crate::{
    mem::{Buf, Slots},
    put_groups,
    trace::job::{JOB_RAYS, THREADS},
};

/// Lowers the number of rays of a job, at first what the buffers have room for, to the number in `count`, and writes
/// the arguments of the dispatch over them.
pub fn workgroups(i: u32, count: &Buf<u32>, job: &mut Buf<u32>, args: &mut Buf<u32>) {
    if i == 0 {
        let (asked, room) = (count.at(0), job.at(JOB_RAYS));
        let rays = if asked < room { asked } else { room };
        job.put(JOB_RAYS, rays);
        put_groups(args, 0, rays.div_ceil(THREADS));
    }
}

kernel! {
    /// [`workgroups`], once.
    map WORKGROUPS = workgroups, threads 64, { 0 count: read u32, 1 job: write u32, 2 args: write u32 }
}
