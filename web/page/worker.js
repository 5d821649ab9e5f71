// One worker: a copy of the mesh and its tree, and a share of the rays.

import init, * as raykd from "../pkg/raykd.js";

let memory, mesh, scene, trial, ways, costs;

/** Forgets what there is, so that the module can use its memory again. */
function free() {
  ways?.free();
  costs?.free();
  ways = costs = undefined;
  scene?.free();
  mesh?.free();
  scene = mesh = undefined;
}

const arrays = (object) => Object.values(object).filter(ArrayBuffer.isView).map(({ buffer }) => buffer);

const calls = {
  async start(module) {
    ({ memory } = await init({ module_or_path: module }));
    return raykd.choices();
  },
  load({ teapot, stress, bytes, name }) {
    const next =
      teapot ? raykd.Mesh.teapot(teapot) : stress ? raykd.Mesh.stress(stress) : raykd.Mesh.load(bytes, name);
    free();
    mesh = next;
    return { triangles: mesh.triangles, bounds: mesh.bounds };
  },
  build(options) {
    const next = raykd.Scene.of(mesh, options);
    ways?.free();
    ways = undefined;
    scene?.free();
    scene = next;
  },
  report: () => ({ ...scene.report(), digest: scene.digest() }),
  camera: (aspect) => scene.camera(aspect),
  heat: () => Array.from({ length: 256 }, (_, i) => [...raykd.heatColour(i / 255)]),
  traverse: (name) => scene.traverse(name),
  intersect: (name) => scene.intersect(name),
  picture: (part) => scene.picture(part),
  cells: (level, most) => raykd.cells(scene, level, most),
  /** The hits of a part of the rays, traced several times, and the median of the times. */
  random(count, seed, part, parts, times) {
    const { origins, directions } = mesh.randomRays(count, seed);
    const [from, to] = [part, part + 1].map((at) => 3 * Math.floor((at * count) / parts));
    const trace = () => scene.closest(origins.subarray(from, to), directions.subarray(from, to));
    const all = Array.from({ length: times }, trace).sort((a, b) => a.ms - b.ms);
    return all[times >> 1];
  },
  digest: ({ triangle, t, u, v }) => raykd.hitsDigest(triangle, t, u, v),
  /** What a test finds in a picture. The test chosen stays. */
  test(camera, size, test, chosen, traversal) {
    const { origins, directions } = scene.cameraRays(camera, size, size);
    scene.traverse("stack");
    scene.intersect(test);
    const hits = scene.closest(origins, directions);
    scene.intersect(chosen);
    scene.traverse(traversal);
    return hits;
  },
  /** One ray's hit, and what it costs by each traversal. */
  ray(camera, size, x, y, chosen, traversal) {
    const { origins, directions } = scene.cameraRays(camera, size, size);
    const from = 3 * (y * size + x);
    const [origin, direction] = [origins, directions].map((all) => all.slice(from, from + 3));
    scene.traverse("stack");
    scene.intersect("strict");
    const counts = raykd.choices().traversals.map(([name]) => {
      scene.traverse(name);
      const { inner, leaves, tests, turns } = scene.steps(origin, direction);
      return { name, inner: inner[0], leaves: leaves[0], tests: tests[0], turns: turns[0] };
    });
    scene.traverse("stack");
    const hit = scene.closest(origin, direction);
    scene.intersect(chosen);
    scene.traverse(traversal);
    return { origin, direction, counts, triangle: hit.triangle[0], t: hit.t[0] };
  },
  /** The nodes that it visits by one of them. */
  way(origin, direction, traversal) {
    if (!scene) return [];
    ways ??= new raykd.Ways(scene);
    return ways.of(new Float32Array(origin), new Float32Array(direction), traversal);
  },
  costs() {
    costs?.free();
    costs = undefined;
    costs = new raykd.Costs(mesh);
  },
  cost: (tree) => costs.measure(tree),
  /** Nothing if the mesh was changed. */
  best: (counts) => costs && counts.map((rays) => costs.best(rays)),
  judge(name, rays) {
    trial?.free();
    trial = new raykd.Trial(name, rays);
  },
  run: (test) => trial.run(test),
  /** Bytes of the module. */
  memory: () => memory.buffer.byteLength,
};

onmessage = async ({ data: { id, call, given } }) => {
  try {
    const result = await calls[call](...given);
    postMessage({ id, result }, result && typeof result === "object" ? arrays(result) : []);
  } catch (error) {
    postMessage({ id, error: error.message ?? String(error) });
  }
};
