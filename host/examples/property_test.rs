//! A property test of a kernel, as a user would write it: kernel bodies are ordinary functions on the CPU.
//!
//! `cargo test --example property_test`

fn main() {
    println!("This example is a test: cargo test --example property_test");
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use raykd::{Ray, shared::TreeHeader};
    use raykd_kernels::{
        glam::Vec3,
        math::div,
        trace::{
            frame::Frame,
            intersect::{Best, Intersector as _, strict::Strict},
        },
    };

    /// Whether a ray hits a triangle of a scene in this box, by the function that the GPU runs too.
    fn hits(ray: &Ray, [a, b, c]: [Vec3; 3]) -> bool {
        let header = TreeHeader { lo: [-4.0; 3], hi: [4.0; 3], scale: 1.0, ..bytemuck::Zeroable::zeroed() };
        let frame = Frame::of(ray, &header);
        let mut best = Best::NOTHING;
        Strict.test_unseen(&frame, 0, Strict::lay_out(a, b, c), &mut best);
        best.triangle == 0
    }

    fn between(lo: [f32; 3], hi: [f32; 3]) -> impl Strategy<Value = Vec3> {
        [lo[0]..hi[0], lo[1]..hi[1], lo[2]..hi[2]].prop_map(Vec3::from_array)
    }

    proptest! {
        #[test]
        fn quotients_are_rounded_correctly(a in 1e-18f32..1e18, b in 1e-18f32..1e18) {
            prop_assert_eq!(div(a, b), a / b);
        }

        #[test]
        fn no_ray_slips_between_two_triangles_that_share_an_edge(
            low in between([-1.0, -2.0, -1.0], [1.0, -1.0, 1.0]),
            high in between([-1.0, 1.0, -1.0], [1.0, 2.0, 1.0]),
            left in between([-4.0, -0.5, -1.0], [-3.0, 0.5, 1.0]),
            right in between([3.0, -0.5, -1.0], [4.0, 0.5, 1.0]),
            s in 0.1f32..0.9,
        ) {
            let eye = Vec3::new(0.0, 0.0, 4.0);
            let target = low + (high - low) * s;
            let ray = Ray::new(eye.to_array(), (target - eye).to_array());
            prop_assert!(hits(&ray, [low, high, left]) || hits(&ray, [high, low, right]));
        }
    }
}
