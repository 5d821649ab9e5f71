//! Embree 4 or 3, if the system has the library, through its C interface: <https://www.embree.org/api.html>.

use crate::peer::{Answer, Peer, each, timed};
use libloading::{Library, Symbol};
use raykd::{Mesh, Ray, shared::MISS};
use std::{
    ffi::{CStr, c_char, c_void},
    ptr::null_mut,
    rc::Rc,
    sync::OnceLock,
};

type Handle = *mut c_void;

/// `RTCRayHit`, and room for what later versions add at its end.
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    uv: [f32; 2],
    triangle: u32,
    geometry: u32,
    more: [u32; 9],
}

impl RayHit {
    fn new(ray: &Ray) -> Self {
        Self {
            origin: ray.origin,
            near: ray.t_min,
            direction: ray.direction,
            time: 0.0,
            far: ray.t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            uv: [0.0; 2],
            triangle: MISS,
            geometry: MISS,
            more: [MISS; 9],
        }
    }
}

/// Embree 3's `RTCIntersectContext`, with room at its end.
#[repr(C, align(16))]
struct Context {
    flags: u32,
    filter: Handle,
    more: [u32; 8],
}

/// `rtcIntersect1` and `rtcOccluded1`: a scene; then the ray and arguments, or in version 3 a context and the ray.
type Query = extern "C" fn(Handle, Handle, Handle);

/// A scene, and what keeps it alive.
struct Scene {
    library: &'static Library,
    intersect: Query,
    occluded: Query,
    device: Handle,
    scene: Handle,
    /// Whether it is version 3.
    old: bool,
    /// Shared with the library, which may read 16 bytes from any vertex.
    _vertices: Vec<[f32; 3]>,
    _indices: Vec<[u32; 3]>,
}

impl Scene {
    fn ask(&self, query: Query, ray: &Ray) -> RayHit {
        let mut found = RayHit::new(ray);
        let hit: Handle = (&raw mut found).cast();
        if self.old {
            let mut context = Context { flags: 0, filter: null_mut(), more: [MISS; 8] };
            query(self.scene, (&raw mut context).cast(), hit);
        } else {
            query(self.scene, hit, null_mut());
        }
        found
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: both handles are the library's, and nothing uses them from now on.
        unsafe {
            call::<extern "C" fn(Handle)>(self.library, c"rtcReleaseScene")(self.scene);
            call::<extern "C" fn(Handle)>(self.library, c"rtcReleaseDevice")(self.device);
        }
    }
}

/// A function of the library.
///
/// # Safety
/// It must have this type.
unsafe fn call<'l, T>(library: &'l Library, name: &CStr) -> Symbol<'l, T> {
    // SAFETY: the caller's promise.
    unsafe { library.get(name.to_bytes_with_nul()) }.expect("every version of Embree has it")
}

/// The newest version that there is, and whether it is version 3. Never unloaded: its threads would be left without
/// code.
fn library() -> Option<&'static (Library, bool)> {
    const NAMES: [(&str, bool); 4] = [
        ("libembree4.so.4", false),
        ("libembree4.so", false),
        ("libembree3.so.3", true),
        ("libembree3.so", true),
    ];
    static LIBRARY: OnceLock<Option<(Library, bool)>> = OnceLock::new();
    // SAFETY: loading Embree does nothing but set up its own state.
    let load = |&(name, old): &(&str, bool)| unsafe { Library::new(name) }.ok().map(|library| (library, old));
    LIBRARY.get_or_init(|| NAMES.iter().find_map(load)).as_ref()
}

/// Its usual tree on one thread.
pub fn embree<'a>(mesh: &Mesh) -> Option<Peer<'a>> {
    const INDICES: (u32, u32) = (0, 0x5003);
    const VERTICES: (u32, u32) = (1, 0x9003);
    let &(ref library, old) = library()?;
    let mut vertices = mesh.positions().to_vec();
    vertices.extend([[0.0; 3]; 2]);
    let indices = mesh.triangles().to_vec();
    // SAFETY: the types are those of Embree's headers, the same in versions 3 and 4; both buffers outlive the scene, in
    // one struct with it.
    let (build, [device, scene]) = unsafe {
        let device =
            call::<extern "C" fn(*const c_char) -> Handle>(library, c"rtcNewDevice")(c"threads=1".as_ptr());
        let scene = call::<extern "C" fn(Handle) -> Handle>(library, c"rtcNewScene")(device);
        let geometry = call::<extern "C" fn(Handle, u32) -> Handle>(library, c"rtcNewGeometry")(device, 0);
        let share = call::<extern "C" fn(Handle, u32, u32, u32, *const c_void, usize, usize, usize)>(
            library,
            c"rtcSetSharedGeometryBuffer",
        );
        share(geometry, INDICES.0, 0, INDICES.1, indices.as_ptr().cast(), 0, 12, indices.len());
        share(geometry, VERTICES.0, 0, VERTICES.1, vertices.as_ptr().cast(), 0, 12, vertices.len() - 2);
        let commit = call::<extern "C" fn(Handle)>(library, c"rtcCommitScene");
        let (build, ()) = timed(|| {
            call::<extern "C" fn(Handle)>(library, c"rtcCommitGeometry")(geometry);
            call::<extern "C" fn(Handle, Handle) -> u32>(library, c"rtcAttachGeometry")(scene, geometry);
            commit(scene);
        });
        call::<extern "C" fn(Handle)>(library, c"rtcReleaseGeometry")(geometry);
        (build, [device, scene])
    };
    let name = if old { "Embree 3" } else { "Embree 4" };
    // SAFETY: both take three pointers.
    let [intersect, occluded] =
        [c"rtcIntersect1", c"rtcOccluded1"].map(|name| unsafe { *call::<Query>(library, name) });
    let scene =
        Scene { library, intersect, occluded, device, scene, old, _vertices: vertices, _indices: indices };
    let scene = Rc::new(scene);
    let again = Rc::clone(&scene);
    let closest = each(move |ray| {
        let found = scene.ask(scene.intersect, ray);
        if found.triangle == MISS { Answer::MISS } else { Answer { triangle: found.triangle, t: found.far } }
    });
    let any = each(move |ray| {
        // What is hidden ends at minus infinity.
        if again.ask(again.occluded, ray).far < 0.0 { Answer { triangle: 0, t: 0.0 } } else { Answer::MISS }
    });
    Some(Peer { name, build, closest, any: Some(any) })
}
