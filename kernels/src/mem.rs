//! Buffers and workgroup memory as kernels see them on both machines.

/// A storage buffer. On the GPU a slice; on the CPU a view that several workgroups may hold at once.
#[cfg(target_arch = "spirv")]
pub type Buf<T> = [T];

/// A storage buffer. On the GPU a slice; on the CPU a view that several workgroups may hold at once.
///
/// No `&mut` to the elements ever exists: reads and writes go through a raw pointer, one element at a time.
#[cfg(not(target_arch = "spirv"))]
#[derive(Debug)]
pub struct Buf<T> {
    ptr: *mut T,
    len: usize,
    #[cfg(feature = "traffic")]
    moved: core::cell::Cell<u64>,
}

#[cfg(not(target_arch = "spirv"))]
impl<T> Buf<T> {
    /// A view of `len` elements at `ptr`.
    ///
    /// # Safety
    /// While the view lives, `ptr` must be aligned, valid for reads of `len` initialised elements, and for
    /// writes too if anything is put or changed through the view; and no element may be written while another
    /// thread reads or writes it, unless both do so by [`Atomics`]. That is the contract every kernel keeps:
    /// a slot has one writer per dispatch.
    pub const unsafe fn new(ptr: *mut T, len: usize) -> Self {
        Self {
            ptr,
            len,
            #[cfg(feature = "traffic")]
            moved: core::cell::Cell::new(0),
        }
    }

    /// Where it is, and its length.
    #[cfg(target_arch = "x86_64")]
    pub(crate) const fn place(&self) -> (*const T, usize) {
        (self.ptr, self.len)
    }

    /// Bytes read and written through this view, if compiled to count them.
    #[allow(clippy::missing_const_for_fn, reason = "`Cell::get` is const only since Rust 1.88")]
    pub fn moved(&self) -> u64 {
        #[cfg(feature = "traffic")]
        return self.moved.get();
        #[cfg(not(feature = "traffic"))]
        0
    }
}

/// A slice that is read as a buffer is.
#[cfg(not(target_arch = "spirv"))]
#[derive(Debug)]
pub struct View<'a, T>(Buf<T>, core::marker::PhantomData<&'a [T]>);

#[cfg(not(target_arch = "spirv"))]
impl<'a, T> View<'a, T> {
    /// Of a slice.
    #[inline]
    pub const fn new(slice: &'a [T]) -> Self {
        // SAFETY: the slice is borrowed as long as the view lives, and no `&mut Buf`, which writing takes, is given
        // away.
        Self(unsafe { Buf::new(slice.as_ptr().cast_mut(), slice.len()) }, core::marker::PhantomData)
    }
}

#[cfg(not(target_arch = "spirv"))]
impl<T> core::ops::Deref for View<'_, T> {
    type Target = Buf<T>;
    #[inline(always)]
    fn deref(&self) -> &Buf<T> {
        &self.0
    }
}

/// A slice as a buffer that is only read.
#[cfg(target_arch = "spirv")]
#[inline(always)]
pub fn view<T>(slice: &[T]) -> &Buf<T> {
    slice
}

/// A slice as a buffer that is only read.
#[cfg(not(target_arch = "spirv"))]
#[inline(always)]
pub fn view<T>(slice: &[T]) -> View<'_, T> {
    View::new(slice)
}

/// Element access, checked on the CPU. On the GPU the device's robust buffer access bounds it.
pub trait Slots<T: Copy> {
    /// Reads element `i`.
    fn at(&self, i: u32) -> T;
    /// Reads elements `i` and `i + 1`.
    #[inline(always)]
    fn two(&self, i: u32) -> (T, T) {
        (self.at(i), self.at(i + 1))
    }
    /// Reads elements `i`, `i + 1` and `i + 2`.
    #[inline(always)]
    fn three(&self, i: u32) -> (T, T, T) {
        (self.at(i), self.at(i + 1), self.at(i + 2))
    }
    /// Reads four elements from `i` on, side by side: read in turn, a GPU would wait for each.
    #[inline(always)]
    fn four(&self, i: u32) -> [T; 4] {
        [self.at(i), self.at(i + 1), self.at(i + 2), self.at(i + 3)]
    }
    /// Writes element `i`.
    fn put(&mut self, i: u32, value: T);
    /// Writes elements `i` and `i + 1`.
    #[inline(always)]
    fn put_two(&mut self, i: u32, (first, second): (T, T)) {
        self.put(i, first);
        self.put(i + 1, second);
    }
    /// Says that element `i` will be read, if there is one: a CPU, which runs few lanes at a time, then
    /// fetches it.
    #[inline(always)]
    fn soon(&self, _i: u32) {}
}

/// Atomic access for the few words that several workgroups touch; all operations commute.
pub trait Atomics {
    /// Adds to word `i`.
    fn add(&mut self, i: u32, value: u32);
    /// Sets bits of word `i`.
    fn or(&mut self, i: u32, value: u32);
    /// Sets bits of word `i`, perhaps none: lanes of a GPU wait for each other at an atomic, a CPU for what
    /// it has guessed wrong.
    #[inline(always)]
    fn mark(&mut self, i: u32, value: u32) {
        if !crate::ON_GPU || value != 0 {
            self.or(i, value);
        }
    }
    /// Lowers word `i` to `value` if that is smaller.
    fn lower(&mut self, i: u32, value: u32);
    /// Raises word `i` to `value` if that is larger.
    fn raise(&mut self, i: u32, value: u32);
}

/// Workgroup memory of any length.
pub trait Table: Slots<u32> + Atomics {}
impl<const N: usize> Table for [u32; N] {}

/// What each of at most `N` lanes keeps for itself from one block to the next: a GPU's lane in registers, of
/// which there are more than workgroup memory; a CPU, which runs the lanes in turn, in an array.
#[derive(Debug)]
pub struct PerLane<T, const N: usize> {
    #[cfg(target_arch = "spirv")]
    own: T,
    #[cfg(not(target_arch = "spirv"))]
    all: [T; N],
}

/// To be written before it is read.
impl<T: Copy + Default, const N: usize> Default for PerLane<T, N> {
    #[inline(always)]
    fn default() -> Self {
        #[cfg(target_arch = "spirv")]
        return Self { own: unwritten() };
        #[cfg(not(target_arch = "spirv"))]
        Self { all: [T::default(); N] }
    }
}

impl<T: Copy, const N: usize> PerLane<T, N> {
    /// Says that nothing is read again before it is written, or a GPU would keep it in case.
    #[inline(always)]
    pub fn forget(&mut self) {
        #[cfg(target_arch = "spirv")]
        {
            self.own = unwritten();
        }
    }

    /// What this lane wrote.
    #[inline(always)]
    pub fn at(&self, lane: u32) -> T {
        #[cfg(target_arch = "spirv")]
        {
            let _ = lane;
            self.own
        }
        #[cfg(not(target_arch = "spirv"))]
        self.all[lane as usize]
    }

    /// Keeps a value for this lane.
    #[inline(always)]
    pub fn put(&mut self, lane: u32, value: T) {
        #[cfg(target_arch = "spirv")]
        {
            let _ = lane;
            self.own = value;
        }
        #[cfg(not(target_arch = "spirv"))]
        {
            self.all[lane as usize] = value;
        }
    }
}

#[cfg(not(target_arch = "spirv"))]
impl<T, const N: usize> PerLane<[T; 2], N> {
    /// Of two for each lane, the first of all lanes in turn, and then the second ones: number `i`.
    #[inline(always)]
    pub fn one(&mut self, i: u32) -> &mut T {
        let i = i as usize;
        &mut self.all[i % N][i / N]
    }
}

/// A value that nobody reads.
#[cfg(target_arch = "spirv")]
#[inline(always)]
fn unwritten<T: Copy>() -> T {
    // SAFETY: plain numbers; callers read only what they wrote.
    unsafe { core::mem::MaybeUninit::uninit().assume_init() }
}

/// Private memory of `N` elements to be written before it is read. On the GPU it starts undefined: clearing
/// a traversal stack costs more memory traffic than using it.
#[inline(always)]
pub fn scratch<T: Copy + Default, const N: usize>() -> [T; N] {
    #[cfg(target_arch = "spirv")]
    return unwritten();
    #[cfg(not(target_arch = "spirv"))]
    [T::default(); N]
}

/// A traversal's stack of at most `N` entries, written from the bottom up before they are read. Clearing it
/// would take a CPU as long as a tenth of a ray.
#[inline(always)]
pub fn stack<T: Copy + Default, const N: usize>() -> impl Slots<T> {
    #[cfg(target_arch = "spirv")]
    return scratch::<T, N>();
    #[cfg(not(target_arch = "spirv"))]
    cpu::Stack::<T, N>::new()
}

/// `N` words that a lane lays aside while it does not need them: a GPU in workgroup memory, of `ALL` words, to
/// spare registers; a CPU has the stack for that.
#[inline(always)]
pub fn aside<const N: usize, const ALL: usize>(shared: &mut [u32; ALL], lane: u32) -> impl Slots<u32> {
    #[cfg(target_arch = "spirv")]
    return gpu::Column::<ALL> { shared, lane, lanes: (ALL / N) as u32 };
    #[cfg(not(target_arch = "spirv"))]
    {
        let _ = (shared, lane);
        [0; N]
    }
}

#[cfg(target_arch = "spirv")]
mod gpu {
    use super::{Atomics, Slots};
    use spirv_std::arch::IndexUnchecked;
    use spirv_std::memory::{Scope, Semantics};

    const SCOPE: u32 = Scope::QueueFamily as u32;
    const NONE: u32 = Semantics::NONE.bits();

    // Storage buffers: an index past the end is bounded by the device's robust buffer access, which wgpu
    // switches on, so it reads something of the buffer or nothing and harms no other memory. Kernels keep to
    // their buffers all the same: on a CPU the same body is checked, and tests compare the two.
    impl<T: Copy> Slots<T> for [T] {
        #[inline(always)]
        fn at(&self, i: u32) -> T {
            // SAFETY: bounded by the device.
            unsafe { *self.index_unchecked(i as usize) }
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: T) {
            // SAFETY: bounded by the device.
            unsafe { *self.index_unchecked_mut(i as usize) = value }
        }
    }

    impl Atomics for [u32] {
        #[inline(always)]
        fn add(&mut self, i: u32, value: u32) {
            // SAFETY: bounded by the device.
            unsafe {
                spirv_std::arch::atomic_i_add::<u32, SCOPE, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
        #[inline(always)]
        fn or(&mut self, i: u32, value: u32) {
            // SAFETY: bounded by the device.
            unsafe {
                spirv_std::arch::atomic_or::<u32, SCOPE, NONE>(self.index_unchecked_mut(i as usize), value);
            }
        }
        #[inline(always)]
        fn lower(&mut self, i: u32, value: u32) {
            // SAFETY: bounded by the device.
            unsafe {
                spirv_std::arch::atomic_u_min::<u32, SCOPE, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
        #[inline(always)]
        fn raise(&mut self, i: u32, value: u32) {
            // SAFETY: bounded by the device.
            unsafe {
                spirv_std::arch::atomic_u_max::<u32, SCOPE, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
    }

    // Workgroup and private memory, which no device bounds: that indices are below N is shown by the same
    // body on a CPU, where every one is checked.
    impl<T: Copy, const N: usize> Slots<T> for [T; N] {
        #[inline(always)]
        fn at(&self, i: u32) -> T {
            // SAFETY: below N, as said above.
            unsafe { *self.index_unchecked(i as usize) }
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: T) {
            // SAFETY: below N, as said above.
            unsafe { *self.index_unchecked_mut(i as usize) = value }
        }
    }

    /// What a lane has of a table with a row a word.
    pub(super) struct Column<'a, const ALL: usize> {
        pub(super) shared: &'a mut [u32; ALL],
        pub(super) lane: u32,
        pub(super) lanes: u32,
    }

    impl<const ALL: usize> Slots<u32> for Column<'_, ALL> {
        #[inline(always)]
        fn at(&self, i: u32) -> u32 {
            self.shared.at(i * self.lanes + self.lane)
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: u32) {
            self.shared.put(i * self.lanes + self.lane, value);
        }
    }

    impl<const N: usize> Atomics for [u32; N] {
        #[inline(always)]
        fn add(&mut self, i: u32, value: u32) {
            // SAFETY: below N, as said above.
            unsafe {
                spirv_std::arch::atomic_i_add::<u32, { Scope::Workgroup as u32 }, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
        #[inline(always)]
        fn or(&mut self, i: u32, value: u32) {
            // SAFETY: below N, as said above.
            unsafe {
                spirv_std::arch::atomic_or::<u32, { Scope::Workgroup as u32 }, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
        #[inline(always)]
        fn lower(&mut self, i: u32, value: u32) {
            // SAFETY: below N, as said above.
            unsafe {
                spirv_std::arch::atomic_u_min::<u32, { Scope::Workgroup as u32 }, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
        #[inline(always)]
        fn raise(&mut self, i: u32, value: u32) {
            // SAFETY: below N, as said above.
            unsafe {
                spirv_std::arch::atomic_u_max::<u32, { Scope::Workgroup as u32 }, NONE>(
                    self.index_unchecked_mut(i as usize),
                    value,
                );
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use cpu::Stack;

#[cfg(not(target_arch = "spirv"))]
mod cpu {
    use super::{Atomics, Buf, Slots};
    use core::mem::MaybeUninit;
    use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

    impl<T> Buf<T> {
        /// Where elements `i` to `i + n - 1` stand.
        #[inline(always)]
        fn slots(&self, i: u32, n: usize) -> *mut T {
            #[cfg(feature = "traffic")]
            self.moved.set(self.moved.get() + (n * size_of::<T>()) as u64);
            let i = i as usize;
            if i >= self.len.saturating_sub(n - 1) {
                outside(i, n, self.len);
            }
            // SAFETY: they are below len, and `new` promised len elements.
            unsafe { self.ptr.add(i) }
        }

        #[inline(always)]
        fn slot(&self, i: u32) -> *mut T {
            self.slots(i, 1)
        }
    }

    /// Apart from where it is called, which would else keep the index in memory for the message.
    #[cold]
    #[inline(never)]
    fn outside(i: usize, n: usize, len: usize) -> ! {
        panic!("{n} elements from {i} on, in a buffer of {len}")
    }

    impl<T: Copy> Slots<T> for Buf<T> {
        #[inline(always)]
        fn at(&self, i: u32) -> T {
            // SAFETY: in bounds; `new` promised that nobody writes this element now.
            unsafe { self.slot(i).read() }
        }
        #[inline(always)]
        fn two(&self, i: u32) -> (T, T) {
            let first = self.slots(i, 2);
            // SAFETY: as above.
            unsafe { (first.read(), first.add(1).read()) }
        }
        #[inline(always)]
        fn three(&self, i: u32) -> (T, T, T) {
            let first = self.slots(i, 3);
            // SAFETY: as above.
            unsafe { (first.read(), first.add(1).read(), first.add(2).read()) }
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: T) {
            // SAFETY: in bounds; `new` promised that nobody else touches this element now.
            unsafe { self.slot(i).write(value) }
        }
        #[inline(always)]
        fn put_two(&mut self, i: u32, values: (T, T)) {
            let first = self.slots(i, 2);
            // SAFETY: as above.
            unsafe {
                first.write(values.0);
                first.add(1).write(values.1);
            }
        }
        #[inline(always)]
        fn soon(&self, i: u32) {
            // SAFETY: a hint, which reads nothing from any address.
            #[cfg(target_arch = "x86_64")]
            unsafe {
                use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
                _mm_prefetch::<_MM_HINT_T0>(self.ptr.wrapping_add(i as usize).cast());
            }
            #[cfg(not(target_arch = "x86_64"))]
            let _ = i;
        }
    }

    impl Atomics for Buf<u32> {
        #[inline(always)]
        fn add(&mut self, i: u32, value: u32) {
            // SAFETY: in bounds and aligned; words used atomically are used only so within a dispatch.
            unsafe { AtomicU32::from_ptr(self.slot(i)) }.fetch_add(value, Relaxed);
        }
        #[inline(always)]
        fn or(&mut self, i: u32, value: u32) {
            // SAFETY: as above.
            unsafe { AtomicU32::from_ptr(self.slot(i)) }.fetch_or(value, Relaxed);
        }
        #[inline(always)]
        fn lower(&mut self, i: u32, value: u32) {
            // SAFETY: as above.
            unsafe { AtomicU32::from_ptr(self.slot(i)) }.fetch_min(value, Relaxed);
        }
        #[inline(always)]
        fn raise(&mut self, i: u32, value: u32) {
            // SAFETY: as above.
            unsafe { AtomicU32::from_ptr(self.slot(i)) }.fetch_max(value, Relaxed);
        }
    }

    /// Entries below `written` have been.
    pub(crate) struct Stack<T, const N: usize> {
        entries: [MaybeUninit<T>; N],
        written: usize,
    }

    impl<T: Copy, const N: usize> Stack<T, N> {
        #[inline(always)]
        pub(crate) const fn new() -> Self {
            Self { entries: [MaybeUninit::uninit(); N], written: 0 }
        }
    }

    impl<T: Copy, const N: usize> Slots<T> for Stack<T, N> {
        #[inline(always)]
        fn at(&self, i: u32) -> T {
            let i = i as usize;
            assert!(i < self.written && i < N, "entry {i} of a stack of {}", self.written);
            // SAFETY: `put` leaves no gaps, so all entries below `written` hold a value.
            unsafe { self.entries[i].assume_init() }
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: T) {
            let i = i as usize;
            assert!(i <= self.written && i < N, "entry {i} above a stack of {}", self.written);
            self.entries[i].write(value);
            self.written = self.written.max(i + 1);
        }
    }

    // Workgroup memory belongs to one CPU thread, which runs the lanes in turn: plain arithmetic is atomic.
    impl<T: Copy, const N: usize> Slots<T> for [T; N] {
        #[inline(always)]
        fn at(&self, i: u32) -> T {
            self[i as usize]
        }
        #[inline(always)]
        fn put(&mut self, i: u32, value: T) {
            self[i as usize] = value;
        }
    }

    impl<const N: usize> Atomics for [u32; N] {
        #[inline(always)]
        fn add(&mut self, i: u32, value: u32) {
            self[i as usize] = self[i as usize].wrapping_add(value);
        }
        #[inline(always)]
        fn or(&mut self, i: u32, value: u32) {
            self[i as usize] |= value;
        }
        #[inline(always)]
        fn lower(&mut self, i: u32, value: u32) {
            self[i as usize] = self[i as usize].min(value);
        }
        #[inline(always)]
        fn raise(&mut self, i: u32, value: u32) {
            self[i as usize] = self[i as usize].max(value);
        }
    }
}

#[cfg(all(test, feature = "traffic"))]
mod tests {
    use super::{Atomics as _, Buf, Slots as _};

    #[test]
    fn what_is_moved_is_counted() {
        let mut words = [0u32; 8];
        // SAFETY: the words outlive the view, and nobody else has them.
        let mut view = unsafe { Buf::new(words.as_mut_ptr(), words.len()) };
        view.put(3, 7);
        assert_eq!((view.at(3), view.three(2)), (7, (0, 7, 0)));
        view.add(3, 1);
        assert_eq!(view.moved(), 4 * (1 + 1 + 3 + 1));
    }
}
