//! A property test of a kernel, as a user would write it: kernel bodies are ordinary functions on the CPU.
//!
//! `cargo test --example property_test`

fn main() {
    println!("This example is a test: cargo test --example property_test");
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use raykd::{
        Ray,
        kernels::{
            glam::{Vec3, Vec4},
            math::div,
            trace::{NOTHING, frame::Frame, triangle},
        },
        shared::TreeHeader,
    };

    /// Whether a ray hits a triangle in the unit box, by the function that the GPU runs too.
    fn hits(ray: &Ray, [a, b, c]: [Vec3; 3]) -> bool {
        let header = TreeHeader { hi: [1.0; 3], scale: 1.0, ..bytemuck::Zeroable::zeroed() };
        let [ox, oy, oz] = ray.origin;
        let [dx, dy, dz] = ray.direction;
        let frame = Frame::new(Vec4::new(ox, oy, oz, dx), Vec4::new(dy, dz, ray.t_min, ray.t_max), &header);
        let mut best = NOTHING;
        triangle::test(&frame, 0, a, b, c, &mut best);
        best.triangle == 0
    }

    fn point() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(0.0f32..1.0).prop_map(Vec3::from_array)
    }

    proptest! {
        #[test]
        fn quotients_are_rounded_correctly(a in 1e-18f32..1e18, b in 1e-18f32..1e18) {
            prop_assert_eq!(div(a, b), a / b);
        }

        #[test]
        fn no_ray_slips_between_two_triangles_that_share_an_edge(
            (a, b) in (point(), point()), left in 0.0f32..1.0, right in 0.0f32..1.0, s in 0.0f32..1.0,
        ) {
            // The edge from a to b, seen from in front; one triangle on either side of it.
            let (x, y) = (Vec3::new(-1.0 - left, 0.5, 0.5), Vec3::new(2.0 + right, 0.5, 0.5));
            prop_assume!((a.y - b.y).abs() > 0.01);
            let target = a + (b - a) * s;
            let eye = Vec3::new(0.5, 0.5, 4.0);
            let ray = Ray::new(eye.to_array(), (target - eye).to_array());
            prop_assert!(hits(&ray, [a, b, x]) || hits(&ray, [b, a, y]));
        }
    }
}
