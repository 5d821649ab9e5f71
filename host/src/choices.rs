//! Enumerations of what can be chosen, with names and descriptions for programs that let people choose.

/// Makes an enumeration, in which a variant's documentation is its description too.
macro_rules! choices {
    (
        $(#[$attribute:meta])*
        pub enum $Enum:ident {
            $($(#[doc = $about:literal])+ $Variant:ident = $name:literal,)+
        }
        default = $Default:ident;
        called = $called:literal;
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum $Enum {
            $($(#[doc = $about])+ $Variant,)+
        }

        impl $Enum {
            /// All of them, in the order of their declaration. Later versions may have more.
            pub const ALL: &'static [Self] = &[$(Self::$Variant),+];

            /// Its name on the command line, which [`str::parse`] understands.
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

        impl std::str::FromStr for $Enum {
            type Err = $crate::Error;

            /// The one of this [name](Self::name).
            ///
            /// # Errors
            /// There is none: the error lists those there are.
            fn from_str(name: &str) -> Result<Self, $crate::Error> {
                let found = Self::ALL.iter().copied().find(|one| one.name() == name);
                found.ok_or_else(|| $crate::Error::UnknownName {
                    what: $called,
                    name: name.to_owned(),
                    names: &[$($name),+],
                })
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

#[cfg(test)]
mod tests {
    use crate::{Builder, Error, Intersector, Traversal};

    #[test]
    fn names_are_read_as_they_are_told() {
        for &builder in Builder::ALL {
            assert_eq!(builder.to_string().parse::<Builder>().unwrap(), builder);
        }
        for &traversal in Traversal::ALL {
            assert_eq!(traversal.to_string().parse::<Traversal>().unwrap(), traversal);
        }
        for &test in Intersector::ALL {
            assert_eq!(test.to_string().parse::<Intersector>().unwrap(), test);
        }
    }

    #[test]
    fn an_unknown_name_is_answered_by_those_there_are() {
        let error = "Binned".parse::<Builder>().unwrap_err();
        assert!(matches!(error, Error::UnknownName { what: "builder", .. }));
        let told = "no builder is named 'Binned'; there are median, zhou, binned, exact";
        assert_eq!(error.to_string(), told);
    }
}
