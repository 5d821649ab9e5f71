//! What goes in and out.

use js_sys::{Float32Array, JSON, Object, Reflect, Uint32Array};
use raykd::{BuildOptions, Hit, Intersector, Ray, Traversal};
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use wasm_bindgen::prelude::*;

#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** How a tree is built and traced; what is left out has the library's default. */
export interface Options {
  builder?: string; traversal?: string; intersector?: string;
  costStep?: number; costTest?: number; price?: number; long?: number; budget?: number;
  empty?: number; maxDepth?: number; clip?: boolean;
}
/** One entry a ray. Misses have the triangle 0xffffffff. */
export interface Hits {
  triangle: Uint32Array; t: Float32Array; u: Float32Array; v: Float32Array;
  /** Time of the trace alone. */ ms: number;
  /** Invalid rays: NaN, infinite, zero direction. */ invalid: number;
}
/** How often rays cross the mesh: from outside to inside, and back. */
export interface Counts { entering: Uint32Array; leaving: Uint32Array; invalid: number }
export interface Winding { counts: Int32Array; invalid: number }
export interface Steps { inner: Uint32Array; leaves: Uint32Array; tests: Uint32Array; turns: Uint32Array; hits: Hits }
export interface Rays { origins: Float32Array; directions: Float32Array }
export interface Camera {
  eye: [number, number, number]; target: [number, number, number]; up: [number, number, number]; fov: number;
}
export interface Part {
  camera: Camera; width: number; height: number; samples: number; shading: string;
  /** Rows to draw: from first to before last. */ first: number; last: number;
  /** Steps that are the brightest in a heat map. */ full: number;
}
export interface Picture { rgba: Uint8ClampedArray; hits: number; ms: number; /** For Part.full. */ full: number }
export interface Report {
  triangles: number; kept: number; nodes: number; leaves: number; emptyLeaves: number; largestLeaf: number;
  depth: number; refs: number; bytes: number; sahCost: number; buildMs: number; uploadMs: number; layoutMs: number;
  peakBytes: number;
}
/** A node that a ray visits, with its box and where the ray is in it. */
export interface Visit {
  node: number; depth: number; enter: number; exit: number; box: number[];
  /** Triangles of a leaf; null for an inner node. */ triangles: number[] | null;
  /** Axis and position of an inner node's plane. */ plane: [number, number] | null;
}
export interface Outcome {
  rays: number; failures: number; inexact: number; kinds: [string, number][]; known: boolean; ms: number;
}
/** What a kind of tree costs on this machine; see `Costs`. */
export interface Cost {
  choice: string; builder: string; price: number; long: number; maxDepth: number;
  /** Build and layout of leaves. */ buildMs: number; /** Each ray. */ rayNs: number; bytes: number;
}
/** The kind of tree to take, and what each takes in all, in milliseconds. */
export interface Advice { tree: string; totals: number[] }
export type Choice = [name: string, about: string];
export interface Choices {
  builders: Choice[]; traversals: Choice[]; intersectors: Choice[]; shadings: Choice[]; stress: Choice[];
  /** Kinds of trees for `Costs`. */ trees: string[];
}
"#;

/// Names, each with what it is.
pub(crate) type List = Vec<(&'static str, &'static str)>;

#[derive(Serialize)]
pub(crate) struct Choices {
    pub builders: List,
    pub traversals: List,
    pub intersectors: List,
    pub shadings: List,
    pub stress: List,
    pub trees: Vec<&'static str>,
}

/// [`BuildOptions`], and how rays are traced.
#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase", deny_unknown_fields)]
pub(crate) struct Options {
    builder: String,
    pub traversal: String,
    pub intersector: String,
    cost_step: f32,
    cost_test: f32,
    price: f32,
    long: u32,
    budget: Option<f32>,
    empty: f32,
    max_depth: u32,
    clip: bool,
}

impl Default for Options {
    fn default() -> Self {
        let BuildOptions {
            cost_step, cost_test, price, long, budget, empty, max_depth, builder, clip, ..
        } = BuildOptions::default();
        Self {
            builder: builder.to_string(),
            traversal: Traversal::default().to_string(),
            intersector: Intersector::default().to_string(),
            cost_step,
            cost_test,
            price,
            long,
            budget,
            empty,
            max_depth,
            clip,
        }
    }
}

impl Options {
    pub(crate) fn build(&self) -> Result<BuildOptions, JsError> {
        Ok(BuildOptions::default()
            .with_builder(self.builder.parse().map_err(error)?)
            .with_cost_step(self.cost_step)
            .with_cost_test(self.cost_test)
            .with_price(self.price)
            .with_long(self.long)
            .with_budget(self.budget)
            .with_empty(self.empty)
            .with_max_depth(self.max_depth)
            .with_clip(self.clip))
    }
}

/// An exception.
pub(crate) fn error(why: impl Display) -> JsError {
    JsError::new(&why.to_string())
}

/// What an object says; `undefined` says nothing.
pub(crate) fn read<T: for<'a> Deserialize<'a> + Default>(what: &str, given: &JsValue) -> Result<T, JsError> {
    if given.is_undefined() || given.is_null() {
        return Ok(T::default());
    }
    let text = JSON::stringify(given).ok().and_then(|text| text.as_string());
    let text = text.ok_or_else(|| error(format!("{what}: an object is wanted")))?;
    serde_json::from_str(&text).map_err(|why| error(format!("{what}: {why}")))
}

/// As an object.
pub(crate) fn object(value: &impl Serialize) -> Result<JsValue, JsError> {
    let text = serde_json::to_string(value).map_err(error)?;
    JSON::parse(&text).map_err(|_| error("a report is no JSON"))
}

/// An object of these fields.
pub(crate) fn fields<const N: usize>(fields: [(&str, JsValue); N]) -> JsValue {
    let object = Object::new();
    for (name, value) in fields {
        // A new object refuses no field.
        let _ = Reflect::set(&object, &name.into(), &value);
    }
    object.into()
}

/// An array of a number of each.
pub(crate) fn words<T>(all: &[T], number: impl Fn(&T) -> u32) -> JsValue {
    Uint32Array::from(all.iter().map(number).collect::<Vec<_>>().as_slice()).into()
}

/// The same.
pub(crate) fn floats<T>(all: &[T], number: impl Fn(&T) -> f32) -> JsValue {
    Float32Array::from(all.iter().map(number).collect::<Vec<_>>().as_slice()).into()
}

/// One array a field.
pub(crate) fn hits(hits: &[Hit], ms: f64, invalid: u64) -> JsValue {
    fields([
        ("triangle", words(hits, |hit| hit.triangle)),
        ("t", floats(hits, |hit| hit.t)),
        ("u", floats(hits, |hit| hit.u)),
        ("v", floats(hits, |hit| hit.v)),
        ("ms", ms.into()),
        ("invalid", (invalid as f64).into()),
    ])
}

/// Rays from arrays of three numbers a ray; ranges are all from 0 unless given.
pub(crate) fn rays(
    origins: &[f32],
    directions: &[f32],
    t_min: Option<Vec<f32>>,
    t_max: Option<Vec<f32>>,
) -> Result<Vec<Ray>, JsError> {
    let (origins, rest) = origins.as_chunks::<3>();
    let (directions, more) = directions.as_chunks::<3>();
    let count = origins.len();
    let fits = |range: &Option<Vec<f32>>| range.as_ref().is_none_or(|range| range.len() == count);
    if !rest.is_empty() || !more.is_empty() || directions.len() != count || !fits(&t_min) || !fits(&t_max) {
        return Err(error(format!(
            "{count} origins and {} directions: three numbers each are wanted, as many of both, and of tMin and tMax \
             none or one a ray",
            directions.len()
        )));
    }
    let both = origins.iter().zip(directions).enumerate();
    let ray = both.map(|(i, (&origin, &direction))| {
        let mut ray = Ray::new(origin, direction);
        ray.t_min = t_min.as_ref().map_or(ray.t_min, |range| range[i]);
        ray.t_max = t_max.as_ref().map_or(ray.t_max, |range| range[i]);
        ray
    });
    Ok(ray.collect())
}
