//! A program that calls the library as no sane one would, by one thread and by two.

use crate::harness::{Case, Good, Judged, Tally, holds};
use raykd::{
    BuildOptions, Builder, Device, DeviceKind, Error, Hit, Intersector, KdTree, Mesh, Query, Ray,
    ResidentRays, Scene, Stepped, Traversal,
    internals::Cpu,
    rays::{Camera, Random, random},
};
use std::thread;

pub(crate) fn cases() -> Vec<Case> {
    let mut all = vec![
        Case::many("library/meshes", meshes),
        Case::many("library/options", options),
        Case::many("library/sizes", sizes),
        Case::many("library/odd rays", odd_rays),
        Case::many("library/cameras", cameras),
    ];
    for device in ["one thread", "all threads", "the GPU"] {
        all.push(Case::many(format!("library/two threads, {device}"), move |tally| {
            let device = match device {
                "one thread" => Cpu::with_threads(1).map(Device::from),
                "all threads" => Ok(Device::cpu()),
                _ => Device::gpu(None),
            };
            match device {
                Ok(device) => two_threads(&device, tally),
                // Without an adapter there is nothing to share.
                Err(error) => tally.attempt("", || {
                    if matches!(error, Error::NoAdapter { .. }) {
                        Ok(Good::Refused)
                    } else {
                        Err(error.to_string())
                    }
                }),
            }
        }));
    }
    all
}

fn said<T>(result: Result<T, impl std::fmt::Display>) -> Judged {
    match result {
        Ok(_) => Ok(Good::Right),
        Err(error) => {
            let told = error.to_string();
            holds(told.len() > 10 && told.len() < 2000, || {
                format!("a message of {} bytes: {told}", told.len())
            })?;
            Ok(Good::Refused)
        }
    }
}

fn must_fail<T>(result: Result<T, impl std::fmt::Display>) -> Judged {
    match said(result)? {
        Good::Refused => Ok(Good::Refused),
        Good::Right => Err("accepted".to_owned()),
    }
}

fn meshes(tally: &mut Tally) {
    let one = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    for triangles in [vec![], vec![[0, 1, 3]], vec![[u32::MAX; 3]], vec![[0, 1, 2], [2, 1, 0x8000_0000]]] {
        tally.attempt(&format!("{triangles:?}"), || must_fail(Mesh::new(one.clone(), triangles.clone())));
    }
    tally.attempt("no vertices", || must_fail(Mesh::new(vec![], vec![[0, 0, 0]])));
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut positions = one.clone();
        positions[2][1] = x;
        tally.attempt(&format!("{x}"), || must_fail(Mesh::new(positions.clone(), vec![[0, 1, 2]])));
        // Even where no triangle names it.
        positions.extend(&one);
        tally.attempt(&format!("{x} unused"), || said(Mesh::new(positions.clone(), vec![[3, 4, 5]])));
    }
    for size in [f32::MIN_POSITIVE, f32::from_bits(1), 1e-30, 1e30, f32::MAX, f32::MAX / 4.0] {
        tally.attempt(&format!("of size {size}"), || {
            let positions = one.iter().map(|p| p.map(|x| x * size)).collect();
            let Ok(mesh) = Mesh::new(positions, vec![[0, 1, 2]]) else { return Ok(Good::Refused) };
            let device = Device::cpu();
            let scene = Scene::build(&device, &mesh, &BuildOptions::default()).map_err(|e| e.to_string())?;
            let ray = Ray::new([size / 4.0, size / 4.0, size], [0.0, 0.0, -1.0]);
            let hit = scene.closest(&[ray]).map_err(|e| e.to_string())?[0];
            holds(hit.is_hit() && (hit.t / size - 1.0).abs() < 1e-5, || format!("{hit:?}"))?;
            Ok(Good::Right)
        });
    }
    for level in [0, 1] {
        tally.attempt(&format!("teapot of level {level}"), || {
            let count = Mesh::teapot(level).triangles().len();
            holds(count == 64, || format!("{count} triangles"))?;
            Ok(Good::Right)
        });
    }
}

/// Whatever is built, hits are those of brute force.
fn options(tally: &mut Tally) {
    let device = Device::cpu();
    let mesh = Mesh::teapot(2);
    let rays = random(mesh.bounds(), 200, 1);
    let usual = BuildOptions::default();
    let mut all = Vec::new();
    for &builder in Builder::ALL {
        for odd in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE, 1e-45]
        {
            let base = usual.clone().with_builder(builder);
            all.extend([
                base.clone().with_cost_step(odd),
                base.clone().with_cost_test(odd),
                base.clone().with_price(odd),
                base.clone().with_empty(odd),
                base.clone().with_budget(Some(odd)),
            ]);
        }
        for max_depth in [0, 1, 2, 47, 48, 49, 1000, u32::MAX] {
            all.push(usual.clone().with_builder(builder).with_max_depth(max_depth));
        }
        for long in [0, 1, u32::MAX] {
            all.push(usual.clone().with_builder(builder).with_long(long).with_clip(false));
        }
    }
    for options in all {
        tally.attempt(&format!("{options:?}"), || {
            let Ok(scene) = Scene::build(&device, &mesh, &options) else { return Ok(Good::Refused) };
            let same = scene.closest(&rays).map_err(|e| e.to_string())?
                == scene.brute(&rays).map_err(|e| e.to_string())?;
            holds(same, || "hits differ from brute force".to_owned())?;
            scene.tree().and_then(|tree| tree.validate()).map_err(|e| e.to_string())?;
            Ok(Good::Right)
        });
    }
}

fn sizes(tally: &mut Tally) {
    let device = Device::cpu();
    let mesh = Mesh::teapot(2);
    let rays = random(mesh.bounds(), 70, 1);
    let mut scene = Scene::build(&device, &mesh, &BuildOptions::default()).expect("a CPU builds it");
    for count in [0, 1, 63, 64, 65, 70] {
        let rays = &rays[..count];
        tally.attempt(&format!("{count} rays"), || {
            let hits = scene.closest(rays).map_err(|e| e.to_string())?;
            holds(hits.len() == count && scene.brute(rays).is_ok_and(|brute| brute == hits), || {
                format!("{} hits", hits.len())
            })?;
            let mut resident = scene.resident(rays).map_err(|e| e.to_string())?;
            trace_resident(&mut resident, Query::Closest, &hits)?;
            let Stepped { hits: same, steps, .. } = scene.steps(rays).map_err(|e| e.to_string())?;
            holds(same == hits && steps.len() == count, || "steps differ".to_owned())?;
            Ok(Good::Right)
        });
        for limit in [0, 1, 2, 8, 4096, u32::MAX] {
            tally.attempt(&format!("all of {count} rays, {limit}"), || {
                let all = scene.all(rays, limit).map_err(|e| e.to_string())?;
                let wanted: usize = all.totals.iter().map(|&total| total.min(limit) as usize).sum();
                holds(all.hits.len() == wanted && all.totals.len() == count, || {
                    format!("{} hits", all.hits.len())
                })?;
                Ok(Good::Right)
            });
        }
        for excluded in [0, 1, 71] {
            tally.attempt(&format!("{count} rays without {excluded} triangles"), || {
                let done = scene.trace_except(Query::Closest, rays, &vec![u32::MAX; excluded]);
                if count == excluded { said(done) } else { must_fail(done) }
            });
        }
    }
    for &test in Intersector::ALL {
        for &traversal in Traversal::ALL {
            tally.attempt(&format!("{test} {traversal}"), || {
                scene
                    .intersect_by(Intersector::Strict)
                    .and_then(|()| scene.traverse_by(traversal))
                    .map_err(|e| e.to_string())?;
                let done = said(scene.intersect_by(test))?;
                scene.closest(&rays).map_err(|e| e.to_string())?;
                let reset = scene.intersect_by(Intersector::Strict);
                reset.map_err(|e| e.to_string())?;
                Ok(done)
            });
        }
    }
}

fn odd_rays(tally: &mut Tally) {
    let device = Device::cpu();
    let mesh = Mesh::teapot(2);
    let mut scene = Scene::build(&device, &mesh, &BuildOptions::default()).expect("a CPU builds it");
    let odd = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -f32::MAX,
        f32::MIN_POSITIVE,
        1e-45,
        3e38,
        2e-38,
        1e9,
        1e-9,
        5.5,
    ];
    let mut random = Random::new(5);
    let rays: Vec<Ray> =
        (0..4000).map(|_| bytemuck::cast([(); 8].map(|()| odd[random.below(odd.len())]))).collect();
    let brute = scene.brute(&rays).expect("a CPU traces");
    for &traversal in Traversal::ALL {
        tally.attempt(traversal.name(), || {
            scene.traverse_by(traversal).map_err(|e| e.to_string())?;
            let hits = scene.closest(&rays).map_err(|e| e.to_string())?;
            let other =
                (0..rays.len()).find(|&i| bytemuck::bytes_of(&hits[i]) != bytemuck::bytes_of(&brute[i]));
            holds(other.is_none(), || {
                format!("{other:?}: {:?}", other.map(|i| (rays[i], hits[i], brute[i])))
            })?;
            Ok(Good::Right)
        });
    }
    tally.attempt("hits lie in range", || {
        for (ray, hit) in rays.iter().zip(&brute).filter(|(_, hit)| hit.is_hit()) {
            let numbers = [hit.t, hit.u, hit.v].iter().all(|x| !x.is_nan());
            holds(numbers && (hit.triangle as usize) < mesh.triangles().len(), || {
                format!("{hit:?} of {ray:?}")
            })?;
            holds(ray.t_min <= hit.t && hit.t <= ray.t_max, || format!("{hit:?} of {ray:?}"))?;
        }
        Ok(Good::Right)
    });
}

fn cameras(tally: &mut Tally) {
    let odd = [0.0, f64::NAN, f64::INFINITY, 1e300, -1.0];
    for x in odd {
        for fov in [0.0, 180.0, f64::NAN, -40.0] {
            tally.attempt(&format!("{x} {fov}"), || {
                let rays = Camera { eye: [x, 0.0, 1.0], target: [0.0, x, 0.0], up: [x; 3], fov }.rays(5, 3);
                holds(rays.len() == 15, || format!("{} rays", rays.len()))?;
                let device = Device::cpu();
                let scene = Scene::build(&device, &Mesh::teapot(1), &BuildOptions::default())
                    .map_err(|e| e.to_string())?;
                said(scene.closest(&rays))
            });
        }
    }
}

fn trace_resident(resident: &mut ResidentRays, query: Query, expected: &[Hit]) -> Result<(), String> {
    resident.trace(query).map_err(|e| e.to_string())?;
    let hits = resident.hits().map_err(|e| e.to_string())?;
    holds(hits == expected, || "hits of resident rays differ".to_owned())
}

/// What one thread finds with nobody beside it.
struct Alone {
    rays: Vec<Ray>,
    closest: Vec<Hit>,
    any: Vec<bool>,
    all: Vec<Hit>,
    totals: Vec<u32>,
    except: Vec<Hit>,
}

impl Alone {
    fn new(scene: &Scene, rays: Vec<Ray>) -> Result<Self, Error> {
        let closest = scene.closest(&rays)?;
        let excluded: Vec<u32> = closest.iter().map(|hit| hit.triangle).collect();
        let all = scene.all(&rays, 3)?;
        Ok(Self {
            any: scene.any(&rays)?.iter().map(|hit| hit.is_hit()).collect(),
            except: scene.trace_except(Query::Closest, &rays, &excluded)?.hits,
            all: all.hits,
            totals: all.totals,
            closest,
            rays,
        })
    }

    /// Everything that can be asked, beside another thread that asks.
    fn again(&self, scene: &Scene, digest: &str) -> Result<(), String> {
        let ask = || -> Result<Vec<(&str, bool)>, Error> {
            let excluded: Vec<u32> = self.closest.iter().map(|hit| hit.triangle).collect();
            let all = scene.all(&self.rays, 3)?;
            let any: Vec<bool> = scene.any(&self.rays)?.iter().map(|hit| hit.is_hit()).collect();
            Ok(vec![
                ("closest", scene.closest(&self.rays)? == self.closest),
                ("any", any == self.any),
                ("all", all.hits == self.all && all.totals == self.totals),
                ("except", scene.trace_except(Query::Closest, &self.rays, &excluded)?.hits == self.except),
                ("brute", scene.brute(&self.rays)? == self.closest),
                ("steps", scene.steps(&self.rays)?.hits == self.closest),
                ("tree", scene.tree()?.digest() == digest),
            ])
        };
        for (what, same) in ask().map_err(|e| e.to_string())? {
            holds(same, || format!("{what} differs beside another thread"))?;
        }
        let mut resident = scene.resident(&self.rays).map_err(|e| e.to_string())?;
        (0..4).try_for_each(|_| trace_resident(&mut resident, Query::Closest, &self.closest))
    }
}

/// All that can be shared, by two threads at once.
fn two_threads(device: &Device, tally: &mut Tally) {
    let mesh = Mesh::teapot(4);
    let scene = Scene::build(device, &mesh, &BuildOptions::default()).expect("it is built");
    let digest = scene.tree().expect("it is read").digest();
    let alone = [1, 2]
        .map(|seed| Alone::new(&scene, random(mesh.bounds(), 500 * seed, seed as u64)).expect("it traces"));
    let rounds = if device.kind() == DeviceKind::Gpu { 10 } else { 60 };
    let both = |work: &(dyn Fn(usize) -> Result<(), String> + Sync)| {
        thread::scope(|scope| {
            let threads = [0, 1].map(|i| scope.spawn(move || work(i)));
            threads.into_iter().try_for_each(|it| it.join().map_err(|_| "a thread panicked".to_owned())?)
        })
        .map(|()| Good::Right)
    };
    for round in 0..rounds {
        tally.attempt(&format!("asking, round {round}"), || both(&|i| alone[i].again(&scene, &digest)));
    }
    for round in 0..rounds / 5 {
        tally.attempt(&format!("building, round {round}"), || {
            both(&|i| {
                let builder = Builder::ALL[(round + i) % 4];
                let options = BuildOptions::default().with_builder(builder);
                let mut scene = Scene::build(device, &mesh, &options).map_err(|e| e.to_string())?;
                let traversal = Traversal::ALL[(round * 2 + i) % 11];
                scene.traverse_by(traversal).map_err(|e| e.to_string())?;
                let hits = scene.closest(&alone[i].rays).map_err(|e| e.to_string())?;
                holds(hits == alone[i].closest, || {
                    format!("{} {traversal} differs beside another thread", builder.name())
                })
            })
        });
    }
    let tree = scene.tree().expect("it is read");
    let folder = tempfile::tempdir().expect("there is room");
    let path = folder.path().join("tree");
    for round in 0..rounds {
        tally.attempt(&format!("saving, round {round}"), || {
            both(&|_| {
                tree.save(&path).map_err(|e| e.to_string())?;
                let read = KdTree::load(&path).map_err(|e| e.to_string())?;
                holds(read == tree, || "another tree was read".to_owned())
            })
        });
    }
    tally.attempt("one tree in two scenes", || {
        both(&|i| {
            let scene = Scene::with_tree(device, &mesh, &tree).map_err(|e| e.to_string())?;
            holds(scene.closest(&alone[i].rays).map_err(|e| e.to_string())? == alone[i].closest, || {
                "hits differ".to_owned()
            })
        })
    });
}
