//! raykd for JavaScript, in browsers and node: meshes, trees, rays, and what the page draws.
//!
//! Numbers go in and out as typed arrays, names as strings, options and reports as objects. Errors are exceptions with
//! the library's messages. Everything runs in the thread that calls.

#![forbid(unsafe_code)]

mod costs;
mod inspect;
mod mesh;
mod scene;
mod stress;
mod values;

pub use costs::Costs;
pub use inspect::{Ways, cells};
pub use mesh::Mesh;
pub use scene::{Scene, heat_colour, hits_digest};
pub use stress::Trial;

use js_sys::JsString;
use raykd::{Builder, Intersector, Traversal, internals::picture::Shading, plan::CHOICES, stress::CASES};
use wasm_bindgen::prelude::*;

/// A panic is an exception that says why.
#[wasm_bindgen(start)]
pub fn start() {
    std::panic::set_hook(Box::new(|why| wasm_bindgen::throw_str(&why.to_string())));
}

/// What there is to choose from, each with its name and what it is.
///
/// # Errors
/// None that is known.
#[wasm_bindgen(unchecked_return_type = "Choices")]
pub fn choices() -> Result<JsValue, JsError> {
    fn list<T: Copy>(all: &[T], name: fn(T) -> &'static str, about: fn(T) -> &'static str) -> values::List {
        all.iter().map(|&one| (name(one), about(one))).collect()
    }
    values::object(&values::Choices {
        builders: list(Builder::ALL, Builder::name, Builder::about),
        traversals: list(Traversal::ALL, Traversal::name, Traversal::about),
        intersectors: list(Intersector::ALL, Intersector::name, Intersector::about),
        shadings: list(Shading::ALL, Shading::name, Shading::about),
        stress: CASES.iter().map(|case| (case.name, case.about)).collect(),
        // A page traces by the CPU, where boxes are slower.
        trees: CHOICES.iter().filter(|choice| !choice.is_wide()).map(|choice| choice.name).collect(),
    })
}

/// Version of the library.
#[wasm_bindgen]
pub fn version() -> JsString {
    env!("CARGO_PKG_VERSION").into()
}
