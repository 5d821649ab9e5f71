//! Options changed one by one: other crates cannot write the struct, as it may get more fields.

use super::{BuildOptions, Builder};

/// Declares a method that changes a field.
macro_rules! with {
    ($($with:ident: $field:ident: $t:ty,)+) => {
        /// The same options with one of them changed.
        impl BuildOptions {
            $(
                #[doc = concat!("With [`", stringify!($field), "`](field@Self::", stringify!($field), ").")]
                #[must_use]
                pub const fn $with(mut self, $field: $t) -> Self {
                    self.$field = $field;
                    self
                }
            )+
        }
    };
}

with! {
    with_cost_step: cost_step: f32,
    with_cost_test: cost_test: f32,
    with_price: price: f32,
    with_long: long: u32,
    with_budget: budget: Option<f32>,
    with_empty: empty: f32,
    with_max_depth: max_depth: u32,
    with_builder: builder: Builder,
    with_clip: clip: bool,
    with_profile: profile: bool,
}
