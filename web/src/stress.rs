//! Rays at scenes in which ray tracers fail, judged by exact arithmetic.

use crate::values::{error, object};
use raykd::{
    Builder, Device, Traversal,
    internals::quoted,
    stress::{CASES, Case, Method, Way},
};
use serde::Serialize;
use wasm_bindgen::prelude::*;

/// A stress scene with the exact answers of its rays.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Trial(raykd::stress::Trial);

#[derive(Serialize)]
struct Outcome {
    rays: u64,
    failures: u64,
    inexact: u64,
    kinds: Vec<(&'static str, u64)>,
    known: bool,
    ms: f64,
}

/// The stress scene of this name.
pub(crate) fn case(name: &str) -> Result<&'static Case, JsError> {
    let case = CASES.iter().find(|case| case.name == name);
    case.ok_or_else(|| error(format!("no stress scene is named '{}'", quoted(name))))
}

/// The exact answers of more rays take long.
const MOST_RAYS: u32 = 1 << 20;

#[wasm_bindgen]
impl Trial {
    /// Makes the scene, its rays and their answers.
    #[wasm_bindgen(constructor)]
    pub fn new(scene: &str, rays: u32) -> Result<Self, JsError> {
        let case = case(scene)?;
        if !(1..=MOST_RAYS).contains(&rays) {
            return Err(error(format!("{rays} rays; there may be from 1 to {MOST_RAYS}")));
        }
        case.prepare(rays as usize).map(Self).map_err(error)
    }

    /// Traces all rays by the default tree and a triangle test, and judges the answers.
    #[wasm_bindgen(unchecked_return_type = "Outcome")]
    pub fn run(&mut self, intersector: &str) -> Result<JsValue, JsError> {
        let test = intersector.parse().map_err(error)?;
        let method = Method::new(test, Way::Tree(Builder::default(), Traversal::default()));
        let start = js_sys::Date::now();
        let outcome = self.0.run(&method, &Device::cpu(), None).map_err(error)?;
        object(&Outcome {
            rays: outcome.rays,
            failures: outcome.failures,
            inexact: outcome.inexact,
            kinds: outcome.kinds.iter().map(|&(kind, count)| (kind.name(), count)).collect(),
            known: outcome.expected,
            ms: js_sys::Date::now() - start,
        })
    }
}
