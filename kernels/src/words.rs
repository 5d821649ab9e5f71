//! Records of words that kernels read and write one by one, and a host as a whole.

/// Declares a record: a struct for the host, and constants that number its words for kernels.
macro_rules! words {
    ($(#[$doc:meta])* $name:ident { $($(#[$about:meta])* $number:ident $field:ident: $t:ty),+ $(,)? }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[$about])* pub $field: $t),+
        }

        $($(#[$about])* pub const $number: u32 = core::mem::offset_of!($name, $field) as u32 / 4;)+
    };
}
