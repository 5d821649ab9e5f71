//! What choices cost on one device, measured on meshes of several sizes, kept in a file.

use super::{
    choice::{CHOICES, Choice},
    cost::{self, Cost, Moving, Round},
    look::{LOOKS, Looking, Seen},
};
use crate::{
    BuildOptions, Device, Error, Mesh, Scene, Traversal,
    mesh::{of_user, teapot_level_for},
    output,
    quoted::quoted,
};
use std::{
    io::{self, ErrorKind, Read as _, Write as _},
    path::{Path, PathBuf},
};

/// Sizes of the meshes: leaning teapots, cut finer and finer.
const SIZES: [u32; 6] = [50, 200, 1_000, 8_000, 64_000, 512_000];
/// How often all choices are measured in turn on each mesh.
const ROUNDS: u32 = 3;
/// A mesh is the last one if the default builder takes so long, in milliseconds.
const SLOW: f64 = 300.0;
/// A calibration file is not larger.
const MOST_BYTES: u64 = 1 << 20;

/// What all choices cost on one device: measured, or read from the file of a calibration.
///
/// As JSON, by `serde`, it is what [`Calibration::save`] writes. To read one there is [`Calibration::load`] alone,
/// which checks it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Calibration {
    /// raykd's version: another one has other costs.
    version: String,
    device: String,
    name: String,
    /// Triangles, and what a glance and a closer look show of the mesh; by rising size.
    looks: Vec<(u32, [Seen; 2])>,
    costs: Vec<Cost>,
}

/// A file's, before it is checked.
#[derive(serde::Deserialize)]
struct Given {
    version: String,
    device: String,
    name: String,
    looks: Vec<(u32, [Seen; 2])>,
    costs: Vec<Cost>,
}

impl Given {
    /// Refuses what no measurement gives.
    fn check(&self) -> Result<(), String> {
        let numbers = |c: &Cost| [c.upload_ms, c.build_ms, c.launch_ms, c.ray_ns, c.worst_ns, c.transfer_ns];
        let looks = self
            .looks
            .iter()
            .flat_map(|&(_, looks)| looks)
            .flat_map(|seen| [seen.whole, seen.halfway, seen.wide]);
        if self.costs.iter().flat_map(numbers).chain(looks).any(|x| !(x.is_finite() && x >= 0.0)) {
            return Err("a cost is negative or no number".to_owned());
        }
        if self.costs.iter().any(|cost| !(cost.spread.is_finite() && cost.spread >= 1.0)) {
            return Err("a slowest round is faster than the fastest".to_owned());
        }
        let sizes = || self.looks.iter().map(|&(triangles, _)| triangles);
        if sizes().next().is_none_or(|first| first == 0) || !sizes().is_sorted_by(|a, b| a < b) {
            return Err("the sizes of its meshes do not rise from 1 or more".to_owned());
        }
        for Choice { name, .. } in CHOICES {
            let of = self.costs.iter().filter(|cost| cost.choice == *name).map(|cost| cost.triangles);
            if !of.eq(sizes()) {
                return Err(format!("the choice {name} has no costs of each mesh, in their order"));
            }
        }
        let unknown = self.costs.iter().find(|cost| Choice::named(&cost.choice).is_none());
        unknown.map_or(Ok(()), |cost| Err(format!("there is no choice {}", quoted(&cost.choice))))
    }
}

/// Rays by which a device is measured: enough to fill it.
pub fn rays_for(device: &Device) -> usize {
    1 << if device.is_card() { 20 } else { 15 }
}

impl Calibration {
    /// Measures a device, which takes from seconds to minutes; `told` hears which share is done, from 0 to 1.
    ///
    /// # Errors
    /// The device failed.
    pub fn measure(device: &Device, told: impl Fn(f64)) -> Result<Self, Error> {
        Self::over(device, &SIZES, told)
    }

    /// The same by small meshes only: quick, and less sure of large ones.
    ///
    /// # Errors
    /// The device failed.
    #[doc(hidden)]
    pub fn small(device: &Device) -> Result<Self, Error> {
        Self::over(device, &SIZES[..4], |_| ())
    }

    pub(super) fn over(device: &Device, sizes: &[u32], told: impl Fn(f64)) -> Result<Self, Error> {
        let (mut costs, mut looks): (Vec<Cost>, Vec<_>) = (Vec::new(), Vec::new());
        let mut movings = Vec::new();
        let (all, mut begun) = (sizes.len() * CHOICES.len() * ROUNDS as usize, 0);
        for &size in sizes {
            let mesh = leaning(teapot_level_for(size));
            let usual = Scene::build(device, &mesh, &BuildOptions::default())?;
            let rays = cost::usual_rays(&mesh, rays_for(device), |rays| usual.closest(rays))?;
            let slow = usual.times().build.as_secs_f64() * 1e3 > SLOW;
            let moving = Moving::measure(&usual, &rays)?;
            drop(usual);
            let looking = Looking::at(&mesh);
            let [glance, closer] = LOOKS.each_ref().map(|look| looking.seen(look));
            looks.push((mesh.kept().len() as u32, [glance?, closer?]));
            let mut rounds: Vec<(Vec<Round>, f64)> = vec![(Vec::new(), f64::INFINITY); CHOICES.len()];
            for _ in 0..ROUNDS {
                for (choice, (done, worst)) in CHOICES.iter().zip(&mut rounds) {
                    told(begun as f64 / all as f64);
                    begun += 1;
                    if done.last().is_some_and(Round::is_long) {
                        continue;
                    }
                    let (times, mut scene) = Round::run(device, &mesh, choice, &rays, ROUNDS)?;
                    done.push(times);
                    if choice.tests_all() {
                        // Brute force tests every triangle in full.
                        scene.traverse_by(Traversal::Brute)?;
                        *worst = worst.min(1e3 / cost::speed_in(&scene, &rays, ROUNDS)?);
                    }
                }
            }
            for (choice, (done, worst)) in CHOICES.iter().zip(&rounds) {
                let mut cost = Round::cost(done, choice, &moving);
                if choice.tests_all() {
                    cost.worst_ns = cost.ray_ns.max(*worst);
                }
                costs.push(cost);
                movings.push(moving);
            }
            if slow {
                break;
            }
        }
        // Rays move as fast whatever the mesh; but what else the machine did at the time can double it.
        let least = |of: fn(&Moving) -> f64| movings.iter().map(of).fold(f64::INFINITY, f64::min);
        let (once_ms, ray_ns) = (least(|moving| moving.once_ms), least(|moving| moving.ray_ns));
        for (cost, moving) in costs.iter_mut().zip(&movings) {
            cost.launch_ms += once_ms - moving.once_ms;
            cost.transfer_ns = ray_ns;
        }
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            device: device.kind().to_string(),
            name: device.name().to_owned(),
            looks,
            costs,
        })
    }

    /// `cpu` or `gpu`, as [`DeviceKind::name`](crate::DeviceKind::name) has it.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Name of the adapter or processor, as [`Device::name`] has it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What every choice cost on the meshes that were measured, for each choice by rising size.
    pub fn costs(&self) -> &[Cost] {
        &self.costs
    }

    /// What the [`cache_file`] holds of this device, if there is such a file: its costs, or why they cannot be used.
    pub fn from_cache(device: &Device) -> Option<Result<Self, Error>> {
        let path = cache_file(device).ok().filter(|path| path.exists())?;
        Some(Self::load(&path, device))
    }

    /// Reads the file that [`Calibration::save`] wrote for this device. Numbers that a measurement could give are
    /// believed, whoever wrote them.
    ///
    /// # Errors
    /// The file cannot be read, or is no calibration, or is not that of this device and version.
    pub fn load(path: impl AsRef<Path>, device: &Device) -> Result<Self, Error> {
        let path = path.as_ref();
        let fail = |source| Error::Io { path: path.to_owned(), source };
        let mut bytes = Vec::new();
        let file = std::fs::File::open(path).map_err(fail)?;
        file.take(MOST_BYTES).read_to_end(&mut bytes).map_err(fail)?;
        let wrong = |what: String| Error::Calibration { path: path.to_owned(), what };
        let read: Given = serde_json::from_slice(&bytes).map_err(|error| wrong(quoted(error)))?;
        if read.version != env!("CARGO_PKG_VERSION") {
            return Err(wrong(format!("it is of raykd {}", quoted(&read.version))));
        }
        if (read.device.as_str(), read.name.as_str()) != (device.kind().name(), device.name()) {
            return Err(wrong(format!("it is of {}, not of {}", quoted(&read.name), device.name())));
        }
        read.check().map_err(wrong)?;
        let Given { version, device, name, looks, costs } = read;
        Ok(Self { version, device, name, looks, costs })
    }

    /// Writes it to a file, whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        crate::output::write_whole(path.as_ref(), |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            writeln!(file)
        })
    }

    /// What a choice costs for so many triangles: read between the sizes measured, each cost a power of the size, and
    /// beyond them by the last two. If a look at the mesh has shown how many steps a ray takes, rays cost as many
    /// times more than in a teapot. `through` is the share of triangles that a first look does not turn away.
    pub(super) fn predict(
        &self,
        choice: &Choice,
        triangles: u32,
        through: f64,
        seen: Option<(usize, Seen)>,
    ) -> Option<Cost> {
        let costs: Vec<&Cost> = self.costs.iter().filter(|cost| cost.choice == choice.name).collect();
        let first = costs.first()?;
        let read = |number: fn(&Cost) -> f64| {
            let points = costs.iter().map(|cost| (f64::from(cost.triangles), number(cost)));
            power(&points.collect::<Vec<_>>(), f64::from(triangles))
        };
        let steps = |seen: Seen| {
            if choice.is_wide() {
                seen.wide
            } else if choice.ends_halfway() {
                seen.halfway
            } else {
                seen.whole
            }
        };
        let harder = seen.map_or(1.0, |(at, seen)| {
            let known: Vec<_> =
                self.looks.iter().map(|&(n, looks)| (f64::from(n), steps(looks[at]))).collect();
            steps(seen) / power(&known, f64::from(triangles)).max(1e-3)
        });
        let harder = if choice.tests_all() { 1.0 } else { harder };
        let (usual_ns, worst_ns) = (read(|cost| cost.ray_ns), read(|cost| cost.worst_ns));
        let ray_ns = usual_ns + through * (worst_ns - usual_ns);
        Some(Cost {
            choice: first.choice.clone(),
            triangles,
            upload_ms: read(|cost| cost.upload_ms),
            build_ms: read(|cost| cost.build_ms),
            launch_ms: read(|cost| cost.launch_ms),
            ray_ns: ray_ns * harder,
            worst_ns: worst_ns * harder,
            transfer_ns: read(|cost| cost.transfer_ns),
            bytes: read(|cost| cost.bytes as f64) as u64,
            spread: read(|cost| cost.spread),
        })
    }
}

/// A teapot leaning to a side: an upright one is easier than most scenes.
fn leaning(level: u32) -> Mesh {
    let teapot = Mesh::teapot(level);
    let positions =
        teapot.positions().iter().map(|[x, y, z]| [0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, *z]).collect();
    Mesh::new(positions, teapot.triangles().to_vec()).expect("a leaning teapot is a mesh")
}

/// No cost is larger, whatever a file says: sums and products of costs are numbers.
const MOST: f64 = 1e60;

/// Reads between points by rising x, as if y were a power of x between two of them.
fn power(points: &[(f64, f64)], x: f64) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|&(x, y)| (x.max(1.0).ln(), y.max(1e-9).ln())).collect();
    let x = x.max(1.0).ln();
    let [(x0, y0), (x1, y1)] = match logs.windows(2).find(|pair| x <= pair[1].0).or(logs.windows(2).last()) {
        Some(pair) => [pair[0], pair[1]],
        None => return points.first().map_or(0.0, |point| point.1.min(MOST)),
    };
    // Below the smallest mesh nothing gets cheaper than there.
    let y = if x <= x0 || x1 <= x0 { y0 } else { y0 + (x - x0) / (x1 - x0) * (y1 - y0) };
    y.exp().min(MOST)
}

/// The file of a device in the user's cache: in the folder that `RAYKD_CACHE` names, or the system's.
///
/// # Errors
/// No folder is named, and the system has none.
pub fn cache_file(device: &Device) -> Result<PathBuf, Error> {
    let named = std::env::var_os("RAYKD_CACHE").filter(|folder| !folder.is_empty()).map(PathBuf::from);
    let folder = named.or_else(|| of_user("XDG_CACHE_HOME", ".cache", "Library/Caches"));
    let letter = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    let name: String = format!("{}-{}", device.kind(), device.name()).chars().map(letter).collect();
    let missing = || {
        let why = "there is no folder to keep it in; name one by RAYKD_CACHE";
        Error::Io {
            path: PathBuf::from(format!("{name}.json")),
            source: io::Error::new(ErrorKind::NotFound, why),
        }
    };
    Ok(folder.ok_or_else(missing)?.join(format!("{name}.json")))
}

/// [`cache_file`], in a folder that is made if it is missing, and checked to be a file that can be written.
///
/// # Errors
/// There is no such folder, or the file cannot be written.
pub fn create_cache_file(device: &Device) -> Result<PathBuf, Error> {
    let path = cache_file(device)?;
    let made = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|source| Error::Io { path: folder.to_owned(), source })?;
        }
        output::check(&path)
    };
    made().map_err(|error| match error {
        Error::Io { path, source } => {
            let why = format!("{source}; name another folder by RAYKD_CACHE");
            Error::Io { path, source: io::Error::new(source.kind(), why) }
        }
        other => other,
    })?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{choose, choose_tree};

    #[test]
    fn powers_are_read_exactly() {
        let points = [(10.0, 1.0), (100.0, 10.0), (1000.0, 1000.0)];
        let near = |x: f64, y: f64| (power(&points, x) / y - 1.0).abs() < 1e-9;
        assert!(near(10.0, 1.0) && near(100.0, 10.0) && near(1000.0, 1000.0));
        assert!(near(50.0, 5.0), "linear between the first two");
        assert!(near(1e4, 1e5), "square beyond the last");
        assert!(near(1.0, 1.0), "no cheaper than the first");
        assert_eq!(power(&[(5.0, 7.0)], 100.0), 7.0);
    }

    fn made() -> Calibration {
        // Better trees take longer to build.
        let cost = |choice: &Choice, quality: f64, triangles: u32| Cost {
            choice: choice.name.to_owned(),
            triangles,
            upload_ms: 0.0,
            build_ms: if choice.tests_all() { 0.0 } else { f64::from(triangles) * 1e-3 * quality },
            launch_ms: 0.01,
            ray_ns: if choice.tests_all() { f64::from(triangles) * 10.0 } else { 1000.0 / quality },
            worst_ns: if choice.tests_all() { f64::from(triangles) * 10.0 } else { 1000.0 / quality },
            transfer_ns: 1.0,
            bytes: u64::from(triangles) * 10,
            spread: 1.0,
        };
        let sizes = [100, 100_000];
        let all = CHOICES.iter().enumerate();
        let costs = all.flat_map(|(at, choice)| sizes.map(|size| cost(choice, 1.0 + at as f64, size)));
        Calibration {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            device: "cpu".to_owned(),
            name: Device::cpu().name().to_owned(),
            looks: [(100, 10.0), (100_000, 20.0)]
                .map(|(n, whole)| (n, [Seen { whole, halfway: 2.0 * whole, wide: whole }; 2]))
                .to_vec(),
            costs: costs.collect(),
        }
    }

    #[test]
    fn more_rays_get_better_trees() {
        let (calibration, mesh) = (made(), Mesh::teapot(8));
        let name = |rays| choose(&mesh, rays, &[&calibration]).choice.name;
        assert_eq!(name(1), "none");
        assert_eq!(name(3_000), "shallow");
        assert_eq!(name(1_000_000_000), "wide");
        let tree = |rays| choose_tree(&mesh, rays, &[&calibration]).choice.name;
        assert_eq!(tree(1), "none");
        assert_eq!(tree(1_000_000_000), "exact-small");
    }

    #[test]
    fn of_like_times_the_smallest_tree() {
        let mut calibration = made();
        for cost in &mut calibration.costs {
            (cost.build_ms, cost.ray_ns, cost.worst_ns) = (1.0, 100.0, 100.0);
            cost.bytes = if cost.choice == "zhou" { 10 } else { 20 };
            cost.launch_ms = 0.0;
        }
        let plan = |c: &Calibration| choose(&Mesh::teapot(4), 100_000, &[c]).choice.name;
        assert_eq!(plan(&calibration), "zhou");
        // 4 % slower is still like; 10 % is not.
        let slow = |calibration: &mut Calibration, factor: f64| {
            let of = calibration.costs.iter_mut().filter(|cost| cost.choice == "zhou");
            of.for_each(|cost| {
                (cost.build_ms, cost.ray_ns, cost.worst_ns) = (factor, 100.0 * factor, 100.0 * factor);
            });
        };
        slow(&mut calibration, 1.04);
        assert_eq!(plan(&calibration), "zhou");
        slow(&mut calibration, 1.1);
        assert_ne!(plan(&calibration), "zhou");
        // However long rays are on their way.
        calibration.costs.iter_mut().for_each(|cost| cost.transfer_ns = 10_000.0);
        assert_ne!(plan(&calibration), "zhou");
    }

    #[test]
    fn files_come_back_and_others_are_refused() {
        let (folder, device) = (tempfile::tempdir().unwrap(), Device::cpu());
        let path = folder.path().join("c.json");
        let good = made();
        good.save(&path).unwrap();
        assert_eq!(Calibration::load(&path, &device).unwrap(), good);
        let refused = |calibration: Calibration, why: &str| {
            calibration.save(&path).unwrap();
            let told = Calibration::load(&path, &device).unwrap_err().to_string();
            assert!(told.contains(why) && told.contains("c.json"), "{told}");
        };
        refused(Calibration { version: "0.0.1".to_owned(), ..good.clone() }, "raykd 0.0.1");
        refused(Calibration { name: "Abacus".to_owned(), ..good.clone() }, "Abacus");
        refused(Calibration { costs: good.costs[2..].to_vec(), ..good.clone() }, "no costs");
        refused(Calibration { looks: Vec::new(), ..good.clone() }, "sizes");
        refused(Calibration { looks: good.looks.iter().rev().copied().collect(), ..good.clone() }, "sizes");
        refused(Calibration { looks: good.looks[1..].to_vec(), ..good.clone() }, "choice none has no costs");
        let edited = |edit: fn(&mut Cost), why| {
            let mut edited = good.clone();
            edit(&mut edited.costs[3]);
            refused(edited, why);
        };
        edited(|cost| cost.triangles = 1, "choice shallow has no costs");
        edited(|cost| cost.spread = 0.0, "slowest");
        let mut more = good.clone();
        more.costs.push(Cost { choice: "guess".to_owned(), ..more.costs[0].clone() });
        refused(more, "no choice guess");
        let mut negative = good.clone();
        negative.costs[3].ray_ns = -1.0;
        refused(negative, "negative");
        let mut negative = good.clone();
        negative.looks[1].1[0].wide = -1.0;
        refused(negative, "negative");
        std::fs::write(&path, "{ nonsense").unwrap();
        let told = Calibration::load(&path, &device).unwrap_err().to_string();
        assert!(told.contains("c.json") && told.contains("line 1"), "{told}");
    }

    /// Of costs that no machine has a choice is made, too.
    #[test]
    fn costs_beyond_all_numbers_are_compared() {
        for steep in [[1e-9, 1e308], [1e308, 1e308], [1e308, 0.0]] {
            let mut calibration = made();
            for (i, cost) in calibration.costs.iter_mut().enumerate() {
                cost.triangles = [10, 11][i % 2];
                (cost.ray_ns, cost.worst_ns) = (steep[i % 2], steep[i % 2]);
                (cost.build_ms, cost.launch_ms, cost.transfer_ns) = (cost.ray_ns, cost.ray_ns, cost.ray_ns);
            }
            assert!(choose(&Mesh::teapot(8), u64::MAX, &[&calibration]).total_ms() >= 0.0, "{steep:?}");
        }
    }

    #[test]
    fn measured_costs_are_costs() {
        let device = Device::cpu();
        // Testing all triangles costs more a ray, the more there are. Other work on the machine may hide that from one
        // measurement, not from three.
        let dearer = (0..3).any(|_| {
            let calibration = Calibration::over(&device, &[200, 1000], |_| ()).unwrap();
            assert_eq!(calibration.costs.len(), 2 * CHOICES.len());
            for cost in &calibration.costs {
                assert!(cost.build_ms >= 0.0 && cost.ray_ns > 0.0 && cost.bytes > 0, "{cost:?}");
                assert!(cost.spread >= 1.0, "{cost:?}");
            }
            let none: Vec<_> = calibration.costs.iter().filter(|cost| cost.choice == "none").collect();
            none[1].ray_ns > 1.5 * none[0].ray_ns
        });
        assert!(dearer);
    }
}
