//! On other processors, and on a GPU: nothing goes side by side.

use crate::{
    Group,
    glam::{UVec4, Vec4},
    mem::Buf,
};
use raykd_shared::TreeHeader;

/// All rays of a workgroup.
#[derive(Clone, Copy, Debug)]
pub(in crate::trace) struct Left;

impl Left {
    pub(in crate::trace) const ALL: Self = Self;

    #[inline(always)]
    pub(in crate::trace) fn and(self, _other: Self) -> Self {
        self
    }

    #[inline(always)]
    pub(in crate::trace) fn has(self, _lane: u32) -> bool {
        true
    }
}

#[inline(always)]
pub(in crate::trace) fn closest<const ANY: bool>(
    _group: &Group,
    _job: &Buf<u32>,
    _header: &Buf<TreeHeader>,
    _pairs: &Buf<UVec4>,
    _corners: &Buf<Vec4>,
    _rays: &Buf<Vec4>,
    _hits: &mut Buf<UVec4>,
    _outcome: &mut Buf<u32>,
) -> Left {
    Left
}

#[inline(always)]
pub(in crate::trace) fn exact(
    _group: &Group,
    _job: &Buf<u32>,
    _header: &Buf<TreeHeader>,
    _pairs: &Buf<UVec4>,
    _corners: &Buf<Vec4>,
    _rays: &Buf<Vec4>,
    _hits: &mut Buf<UVec4>,
    _outcome: &mut Buf<u32>,
) -> Left {
    Left
}

#[inline(always)]
pub(in crate::trace) fn crossings(
    _group: &Group,
    _job: &Buf<u32>,
    _header: &Buf<TreeHeader>,
    _pairs: &Buf<UVec4>,
    _corners: &Buf<Vec4>,
    _rays: &Buf<Vec4>,
    _hits: &mut Buf<UVec4>,
    _outcome: &mut Buf<u32>,
    _crossings: &mut Buf<u32>,
    _more: &mut Buf<UVec4>,
) -> Left {
    Left
}

#[inline(always)]
pub(in crate::trace) fn locate(
    group: &Group,
    _job: &Buf<u32>,
    _header: &TreeHeader,
    _regions: &Buf<UVec4>,
    _points: &Buf<f32>,
    _found: &mut Buf<u32>,
    _outcome: &mut Buf<u32>,
) -> u32 {
    group.id * group.width
}
