//! What each kind of tree costs on this machine, and which is worth it for so many rays.

use crate::{
    mesh::Mesh,
    values::{error, object},
};
use raykd::{
    BuildOptions, Device, Ray, Scene,
    internals::{Moving, best_of, measure, rays_for, usual_rays},
    plan::{Choice, Cost},
};
use serde::Serialize;
use wasm_bindgen::prelude::*;

/// What kinds of trees of a mesh cost in the thread that calls, with a picture's rays and a bounce from each hit.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Costs {
    mesh: raykd::Mesh,
    rays: Vec<Ray>,
    moving: Moving,
    costs: Vec<(Choice, Cost)>,
}

/// [`Cost`], as an object.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Told {
    choice: &'static str,
    builder: String,
    price: f32,
    long: u32,
    max_depth: u32,
    build_ms: f64,
    ray_ns: f64,
    bytes: u64,
}

/// Which to take.
#[derive(Serialize)]
struct Advice {
    tree: &'static str,
    totals: Vec<f64>,
}

#[wasm_bindgen]
impl Costs {
    /// Makes the rays.
    #[wasm_bindgen(constructor)]
    pub fn new(mesh: &Mesh) -> Result<Self, JsError> {
        let (device, mesh) = (Device::cpu(), mesh.mesh.clone());
        let usual = Scene::build(&device, &mesh, &BuildOptions::default()).map_err(error)?;
        let rays = usual_rays(&mesh, rays_for(&device), |rays| usual.closest(rays)).map_err(error)?;
        let moving = Moving::measure(&usual, &rays).map_err(error)?;
        Ok(Self { mesh, rays, moving, costs: Vec::new() })
    }

    /// Builds one of `choices().trees` and traces, some times, and keeps what that took.
    #[wasm_bindgen(unchecked_return_type = "Cost")]
    pub fn measure(&mut self, tree: &str) -> Result<JsValue, JsError> {
        let unknown = || error(format!("no kind of tree is named '{}'", raykd::internals::quoted(tree)));
        let choice = Choice::named(tree).ok_or_else(unknown)?;
        let (cost, _) =
            measure(&Device::cpu(), &self.mesh, &choice, &self.rays, &self.moving).map_err(error)?;
        let options = choice.options();
        let told = object(&Told {
            choice: choice.name,
            builder: options.builder.to_string(),
            price: options.price,
            long: options.long,
            max_depth: options.max_depth,
            build_ms: cost.build_ms,
            ray_ns: cost.ray_ns,
            bytes: cost.bytes,
        });
        self.costs.retain(|(other, _)| other.name != choice.name);
        self.costs.push((choice, cost));
        told
    }

    /// Of those measured the one to take for so many rays, as `raykd::plan` decides; and what each takes in all, in
    /// milliseconds, in the order in which they were measured.
    #[wasm_bindgen(unchecked_return_type = "Advice")]
    pub fn best(&self, rays: f64) -> Result<JsValue, JsError> {
        let costs: Vec<&Cost> = self.costs.iter().map(|(_, cost)| cost).collect();
        let best = best_of(&costs, rays.max(0.0) as u64).ok_or_else(|| error("no tree was measured"))?;
        let totals = costs.iter().map(|cost| cost.total_ms(rays)).collect();
        object(&Advice { tree: self.costs[best].0.name, totals })
    }
}
