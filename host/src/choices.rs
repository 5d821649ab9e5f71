//! Enumerations of what can be chosen, with names and descriptions for programs that let people choose.

/// Makes an enumeration, in which a variant's documentation is its description too.
macro_rules! choices {
    (
        $(#[$attribute:meta])*
        pub enum $Enum:ident {
            $($(#[doc = $about:literal])+ $Variant:ident = $name:literal,)+
        }
        default = $Default:ident;
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum $Enum {
            $($(#[doc = $about])+ $Variant,)+
        }

        impl $Enum {
            /// All of them, in the order of their declaration. Later versions may have more.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$Variant),+];

            /// Its name on the command line.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$Variant => $name,)+
                }
            }

            /// What it is, in a line.
            pub const fn about(self) -> &'static str {
                match self {
                    $(Self::$Variant => concat!($($about),+).trim_ascii_start(),)+
                }
            }
        }

        impl Default for $Enum {
            fn default() -> Self {
                Self::$Default
            }
        }

        impl std::fmt::Display for $Enum {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}
pub(crate) use choices;
