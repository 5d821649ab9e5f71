//! Scenes: a mesh with its tree.

use crate::{
    mesh::{Mesh, of_rays},
    values::{Options, error, fields, hits, object, rays, read, words},
};
use js_sys::{Int32Array, Uint8ClampedArray};
use raykd::{
    Device, Hit, Query,
    internals::picture::{self, Shading, encode, full_scale, heat, rows},
    rays::Camera,
};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use wasm_bindgen::prelude::*;

/// A mesh with its tree.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Scene {
    pub(crate) scene: raykd::Scene,
    pub(crate) mesh: raykd::Mesh,
}

/// [`Camera`], as an object.
#[derive(Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct View {
    eye: [f64; 3],
    target: [f64; 3],
    up: [f64; 3],
    fov: f64,
}

impl From<View> for Camera {
    fn from(View { eye, target, up, fov }: View) -> Self {
        Self { eye, target, up, fov }
    }
}

/// A part of a picture.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Part {
    camera: View,
    width: u32,
    height: u32,
    samples: u32,
    shading: String,
    first: u32,
    last: u32,
    full: f32,
}

/// What a build made, and what that took.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Report {
    triangles: u32,
    kept: usize,
    nodes: u32,
    leaves: u32,
    empty_leaves: u32,
    largest_leaf: u32,
    depth: u32,
    refs: u32,
    bytes: u64,
    sah_cost: f64,
    build_ms: f64,
    upload_ms: f64,
    layout_ms: f64,
    peak_bytes: u64,
}

/// Pixels along a side, and samples along a pixel's.
const MOST_PIXELS: u32 = 8192;
const MOST_SAMPLES: u32 = 8;

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[wasm_bindgen]
impl Scene {
    /// Of coordinates, three a vertex, and vertices, three a triangle.
    #[wasm_bindgen(constructor)]
    pub fn new(
        positions: &[f32],
        indices: &[u32],
        #[wasm_bindgen(unchecked_optional_param_type = "Options")] options: JsValue,
    ) -> Result<Self, JsError> {
        Self::of(&Mesh::new(positions, indices)?, options)
    }

    /// Of a mesh, which may be freed.
    pub fn of(
        mesh: &Mesh,
        #[wasm_bindgen(unchecked_optional_param_type = "Options")] options: JsValue,
    ) -> Result<Self, JsError> {
        let options: Options = read("options", &options)?;
        let mesh = mesh.mesh.clone();
        let scene = raykd::Scene::build(&Device::cpu(), &mesh, &options.build()?).map_err(error)?;
        let mut scene = Self { scene, mesh };
        scene.traverse(&options.traversal)?;
        scene.intersect(&options.intersector)?;
        Ok(scene)
    }

    /// Chooses how rays find their way through the tree. All ways give the same closest hits.
    pub fn traverse(&mut self, traversal: &str) -> Result<(), JsError> {
        self.scene.traverse_by(traversal.parse().map_err(error)?).map_err(error)
    }

    /// Chooses how triangles are tested. All but `strict` and `exact` lose hits.
    pub fn intersect(&mut self, intersector: &str) -> Result<(), JsError> {
        self.scene.intersect_by(intersector.parse().map_err(error)?).map_err(error)
    }

    /// The closest hit of every ray: three numbers each for origins and directions.
    #[wasm_bindgen(unchecked_return_type = "Hits")]
    pub fn closest(
        &self,
        origins: &[f32],
        directions: &[f32],
        #[wasm_bindgen(js_name = tMin)] t_min: Option<Vec<f32>>,
        #[wasm_bindgen(js_name = tMax)] t_max: Option<Vec<f32>>,
    ) -> Result<JsValue, JsError> {
        self.trace(Query::Closest, &rays(origins, directions, t_min, t_max)?)
    }

    /// Some hit of every ray that has one.
    #[wasm_bindgen(unchecked_return_type = "Hits")]
    pub fn any(
        &self,
        origins: &[f32],
        directions: &[f32],
        #[wasm_bindgen(js_name = tMin)] t_min: Option<Vec<f32>>,
        #[wasm_bindgen(js_name = tMax)] t_max: Option<Vec<f32>>,
    ) -> Result<JsValue, JsError> {
        self.trace(Query::Any, &rays(origins, directions, t_min, t_max)?)
    }

    fn trace(&self, query: Query, rays: &[raykd::Ray]) -> Result<JsValue, JsError> {
        let traced = self.scene.trace(query, rays).map_err(error)?;
        Ok(hits(&traced.hits, ms(traced.times.trace), traced.invalid))
    }

    /// How often every ray crosses the mesh.
    #[wasm_bindgen(unchecked_return_type = "Counts")]
    pub fn crossings(
        &self,
        origins: &[f32],
        directions: &[f32],
        #[wasm_bindgen(js_name = tMin)] t_min: Option<Vec<f32>>,
        #[wasm_bindgen(js_name = tMax)] t_max: Option<Vec<f32>>,
    ) -> Result<JsValue, JsError> {
        let counted = self.scene.crossings(&rays(origins, directions, t_min, t_max)?).map_err(error)?;
        Ok(fields([
            ("entering", words(&counted.counts, |count| count.entering)),
            ("leaving", words(&counted.counts, |count| count.leaving)),
            ("invalid", (counted.invalid as f64).into()),
        ]))
    }

    /// How often the surface goes round each point: 0 outside, for a closed mesh.
    #[wasm_bindgen(unchecked_return_type = "Winding")]
    pub fn winding(&self, points: &[f32]) -> Result<JsValue, JsError> {
        let (points, rest) = points.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(error("points: three numbers each are wanted"));
        }
        let counted = self.scene.winding(points).map_err(error)?;
        Ok(fields([
            ("counts", Int32Array::from(counted.counts.as_slice()).into()),
            ("invalid", (counted.invalid as f64).into()),
        ]))
    }

    /// The closest hits, and what each cost by the traversal chosen.
    #[wasm_bindgen(unchecked_return_type = "Steps")]
    pub fn steps(&self, origins: &[f32], directions: &[f32]) -> Result<JsValue, JsError> {
        let stepped = self.scene.steps(&rays(origins, directions, None, None)?).map_err(error)?;
        let steps = &stepped.steps;
        Ok(fields([
            ("inner", words(steps, |steps| steps.inner)),
            ("leaves", words(steps, |steps| steps.leaves)),
            ("tests", words(steps, |steps| steps.tests)),
            ("turns", words(steps, |steps| steps.turns)),
            ("hits", hits(&stepped.hits, 0.0, 0)),
        ]))
    }

    /// SHA-256 of the tree, as `raykd bench` prints it.
    pub fn digest(&self) -> Result<String, JsError> {
        Ok(self.scene.tree().map_err(error)?.digest())
    }

    /// Counts, bytes and expected cost of the tree, and what its build took.
    #[wasm_bindgen(unchecked_return_type = "Report")]
    pub fn report(&self) -> Result<JsValue, JsError> {
        let header = self.scene.header();
        let tree = self.scene.tree().map_err(error)?.validate().map_err(error)?;
        let times = self.scene.times();
        object(&Report {
            triangles: header.triangles,
            kept: self.mesh.kept().len(),
            nodes: header.nodes,
            leaves: tree.leaves,
            empty_leaves: tree.empty_leaves,
            largest_leaf: tree.largest_leaf,
            depth: header.depth,
            refs: header.refs,
            bytes: self.scene.tree_bytes(),
            sah_cost: tree.sah_cost,
            build_ms: ms(times.build),
            upload_ms: ms(times.upload),
            layout_ms: ms(times.layout),
            peak_bytes: times.peak_bytes,
        })
    }

    /// A camera that sees the whole mesh.
    #[wasm_bindgen(unchecked_return_type = "Camera")]
    pub fn camera(&self, aspect: f64) -> Result<JsValue, JsError> {
        let Camera { up, fov, .. } = Camera::framing(self.mesh.bounds());
        let camera = picture::camera(&self.mesh, aspect, [None; 2], up, fov);
        object(&View { eye: camera.eye, target: camera.target, up: camera.up, fov: camera.fov })
    }

    /// A ray through each pixel's centre, row by row from the top left.
    #[wasm_bindgen(js_name = cameraRays, unchecked_return_type = "Rays")]
    pub fn camera_rays(
        &self,
        #[wasm_bindgen(unchecked_param_type = "Camera")] camera: JsValue,
        width: u32,
        height: u32,
    ) -> Result<JsValue, JsError> {
        check("width and height", width.max(height), MOST_PIXELS)?;
        let view: View = read("camera", &camera)?;
        Ok(of_rays(&Camera::from(view).rays(width, height)))
    }

    /// Draws some rows of a picture.
    #[wasm_bindgen(unchecked_return_type = "Picture")]
    pub fn picture(
        &self,
        #[wasm_bindgen(unchecked_param_type = "Part")] part: JsValue,
    ) -> Result<JsValue, JsError> {
        let part: Part = read("part", &part)?;
        let shading = part.shading.parse::<Shading>().map_err(error)?;
        check("width and height", part.width.max(part.height), MOST_PIXELS)?;
        check("samples", part.samples, MOST_SAMPLES)?;
        if part.first >= part.last || part.last > part.height {
            return Err(error(format!("no rows from {} to {} of {}", part.first, part.last, part.height)));
        }
        let start = js_sys::Date::now();
        let (size, span) = ([part.width, part.height], part.first..part.last);
        let camera = part.camera.into();
        let (seen, [hits, _], _) =
            rows(&self.scene, &self.mesh, &camera, size, part.samples, shading, span).map_err(error)?;
        let heats = shading == Shading::Heat;
        let colour = |seen: &[f32; 3]| encode(if heats { heat(seen[0] / part.full) } else { *seen });
        let rgba: Vec<u8> = seen.iter().map(colour).flat_map(|[r, g, b]| [r, g, b, 255]).collect();
        let full = if heats { full_scale(seen.iter().map(|seen| seen[0])) } else { 1.0 };
        Ok(fields([
            ("rgba", Uint8ClampedArray::from(rgba.as_slice()).into()),
            ("hits", (hits as f64).into()),
            ("ms", (js_sys::Date::now() - start).into()),
            ("full", full.into()),
        ]))
    }
}

fn check(what: &str, value: u32, most: u32) -> Result<(), JsError> {
    if (1..=most).contains(&value) {
        return Ok(());
    }
    Err(error(format!("{what} are {value}, and must be from 1 to {most}")))
}

/// SHA-256 of hits, as `raykd bench` prints it.
#[wasm_bindgen(js_name = hitsDigest)]
pub fn hits_digest(triangle: &[u32], t: &[f32], u: &[f32], v: &[f32]) -> Result<String, JsError> {
    if [t.len(), u.len(), v.len()] != [triangle.len(); 3] {
        return Err(error("hits: four arrays of one length are wanted"));
    }
    let all: Vec<Hit> =
        (0..t.len()).map(|i| Hit { triangle: triangle[i], t: t[i], u: u[i], v: v[i] }).collect();
    Ok(raykd::internals::hits_digest(&all))
}

/// The colour of a share of a heat map's scale: red, green and blue.
#[wasm_bindgen(js_name = heatColour)]
pub fn heat_colour(share: f32) -> Vec<u8> {
    encode(heat(share)).to_vec()
}
