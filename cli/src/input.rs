//! Meshes, as every command reads them.

use crate::{args::ReadArgs, notes::Notes, report::three};
use raykd::{
    Mesh,
    internals::quoted,
    mesh::{MeshSource, Repairs, Spot},
};
use std::{
    ffi::OsStr,
    time::{Duration, Instant},
};

/// A mesh with its name.
#[derive(Debug)]
pub(super) struct Input {
    /// The scene's name or the file's path.
    pub name: String,
    /// Where its tree is: moved by `translation`, which it does not know of.
    pub mesh: Mesh,
    /// What the mesh's own coordinates have more than those of `mesh`.
    pub translation: [f64; 3],
    /// Time to read and check it.
    pub load: Duration,
}

impl Input {
    /// Reads a file, or fetches a scene by its name.
    pub(super) fn load(name: &OsStr, read: ReadArgs, notes: &Notes) -> anyhow::Result<Self> {
        let scene = MeshSource::try_from(name)?;
        let name = scene.to_string();
        notes.stage(format_args!("{name}: reading"));
        let start = Instant::now();
        let mesh = match read.max_bytes {
            Some(most) => scene.load_up_to(most)?,
            None => scene.load()?,
        };
        let load = start.elapsed();
        Ok(Self { name, translation: mesh.translation(), mesh: mesh.into_local(), load })
    }

    /// Whether the mesh is closed, so that every point is inside or outside. Notes that it is not.
    pub(super) fn is_closed(&self, notes: &Notes) -> bool {
        notes.stage(format_args!("{}: telling whether it is closed", self.name));
        let closed = self.mesh.edges().are_closed();
        if !closed {
            notes.note(format_args!(
                "{}: not closed, so inside is not certain; `raykd check` tells where",
                quoted(&self.name)
            ));
        }
        closed
    }
}

/// What was set aside or changed in a mesh, for JSON.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub(super) struct RepairCounts {
    /// What was subtracted from all coordinates, to save digits.
    #[serde(skip_serializing_if = "Option::is_none")]
    translation: Option<[f64; 3]>,
    zero_area: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    zero_area_at: Option<u32>,
    duplicates: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    duplicate_at: Option<u32>,
    polygons: u32,
    concave: u32,
    crossed: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    crossed_at: Option<String>,
    bent: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    bent_at: Option<String>,
    ignored: u32,
    flushed: u32,
    unposed: u32,
    rounded: u32,
    /// By rounding, in the mesh's units.
    largest_change: f64,
    collapsed: u32,
}

impl From<&Input> for RepairCounts {
    fn from(input: &Input) -> Self {
        let r = input.mesh.repairs();
        let &Repairs { zero_area, duplicates, polygons, concave, crossed, bent, ignored, flushed, .. } = r;
        let &Repairs { unposed, rounded, largest_change, collapsed, zero_area_at, duplicate_at, .. } = r;
        let [crossed_at, bent_at] = [&r.crossed_at, &r.bent_at].map(|at| at.as_ref().map(Spot::to_string));
        let translation = Some(input.translation).filter(|by| *by != [0.0; 3]);
        Self {
            translation,
            zero_area,
            zero_area_at,
            duplicates,
            duplicate_at,
            polygons,
            concave,
            crossed,
            crossed_at,
            bent,
            bent_at,
            ignored,
            flushed,
            unposed,
            rounded,
            largest_change,
            collapsed,
        }
    }
}

impl RepairCounts {
    /// In words; nothing if there is nothing to tell.
    pub(super) fn told(&self) -> Option<String> {
        let first = |at: &Option<String>| at.as_ref().map(|at| format!(" (first: {at})")).unwrap_or_default();
        let number = |at: Option<u32>| first(&at.map(|at| format!("triangle {at}")));
        let rounded =
            format!("coordinates rounded to 32-bit floats, by {} at most", three(self.largest_change));
        let parts = [
            (
                self.zero_area,
                format!("zero-area triangles kept out of the tree{}", number(self.zero_area_at)),
            ),
            (
                self.duplicates,
                format!("duplicate triangles, of which the lowest number wins{}", number(self.duplicate_at)),
            ),
            (self.polygons, "polygons cut into triangles".to_owned()),
            (self.concave, "of them concave".to_owned()),
            (self.crossed, format!("crossed by their own edges, left as fans{}", first(&self.crossed_at))),
            (self.bent, format!("not flat{}", first(&self.bent_at))),
            (self.ignored, "points, lines and curves ignored".to_owned()),
            (self.flushed, "coordinates too small to matter taken as 0".to_owned()),
            (self.unposed, "meshes with skins or morph targets taken as they are stored".to_owned()),
            (self.rounded, rounded),
            (self.collapsed, "triangles that lost their area by rounding".to_owned()),
        ];
        let moved =
            self.translation.map(|[x, y, z]| format!("moved by {:?} {:?} {:?}", 0.0 - x, 0.0 - y, 0.0 - z));
        let told = parts
            .iter()
            .filter(|(n, _)| *n > 0)
            .map(|(n, what)| format!("{} {what}", crate::report::count((*n).into())));
        let told: Vec<_> = moved.into_iter().chain(told).collect();
        (!told.is_empty()).then(|| told.join("; "))
    }
}
