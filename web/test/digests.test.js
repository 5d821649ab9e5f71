// The module in node: the same trees and hits as native code, and errors that say what is wrong.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import * as raykd from "raykd";
import { digests, scenes } from "./native.js";

raykd.initSync({ module: readFileSync(new URL("../pkg/raykd_bg.wasm", import.meta.url)) });
const { Mesh, Scene } = raykd;

const ofHits = ({ triangle, t, u, v }) => raykd.hitsDigest(triangle, t, u, v);

test("trees and hits are native code's", () => {
  const rays = 1000;
  const native = digests(rays, Object.keys(scenes));
  for (const [name, load] of Object.entries(scenes)) {
    const mesh = load(raykd);
    const { seed, trees, hits, crossings } = native[name];
    const { origins, directions } = mesh.randomRays(rays, seed);
    assert.deepEqual(Object.keys(trees).sort(), raykd.choices().builders.map(([builder]) => builder).sort());
    for (const [builder, digest] of Object.entries(trees)) {
      const scene = Scene.of(mesh, { builder });
      assert.equal(scene.digest(), digest, `${name}: the tree of ${builder}`);
      scene.free();
    }
    for (const [way, digest] of Object.entries(hits)) {
      const [builder, traversal, intersector] = way.split(" ");
      const scene = Scene.of(mesh, { builder, traversal, intersector });
      assert.equal(ofHits(scene.closest(origins, directions)), digest, `${name}: ${way}`);
      scene.free();
    }
    const scene = Scene.of(mesh);
    const { entering, leaving } = scene.crossings(origins, directions);
    const words = Uint32Array.from({ length: 2 * rays }, (_, i) => (i % 2 ? leaving : entering)[i >> 1]);
    const counted = createHash("sha256").update(new Uint8Array(words.buffer)).digest("hex");
    assert.equal(counted, crossings, `${name}: crossings`);
    scene.free();
    mesh.free();
  }
});

test("a mesh from arrays is the mesh that gave them", () => {
  const mesh = Mesh.teapot(2);
  const [a, b] = [Scene.of(mesh), new Scene(mesh.positions(), mesh.indices())];
  assert.equal(a.digest(), b.digest());
});

test("inside and outside, any hit, ranges", () => {
  const corners = new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]);
  const scene = new Scene(corners, new Uint32Array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]));
  assert.deepEqual([...scene.winding(new Float32Array([0.1, 0.1, 0.1, 0.9, 0.9, 0.9])).counts], [1, 0]);
  const [origin, direction] = [new Float32Array([0.1, 0.1, -1]), new Float32Array([0, 0, 1])];
  const hit = scene.closest(origin, direction);
  assert.deepEqual([hit.triangle[0], hit.t[0], hit.invalid], [0, 1, 0]);
  assert.notEqual(scene.any(origin, direction).triangle[0], 0xffffffff);
  const short = scene.closest(origin, direction, undefined, new Float32Array([0.5]));
  assert.equal(short.triangle[0], 0xffffffff);
  assert.equal(scene.closest(new Float32Array([NaN, 0, 0]), direction).invalid, 1);
});

test("a ray's way has the steps that the kernels count, by each traversal", () => {
  const mesh = Mesh.teapot(8);
  const scene = Scene.of(mesh);
  const ways = new raykd.Ways(scene);
  const { origins, directions } = mesh.randomRays(300, 7);
  for (const [traversal] of raykd.choices().traversals) {
    scene.traverse(traversal);
    const { inner, leaves, tests, hits } = scene.steps(origins, directions);
    for (let i = 0; i < inner.length; i++) {
      const [from, to] = [3 * i, 3 * i + 3];
      const way = ways.of(origins.subarray(from, to), directions.subarray(from, to), traversal);
      if (traversal === "wide" || traversal === "brute") {
        assert.deepEqual(way, []);
        continue;
      }
      const seen = way.filter(({ triangles }) => triangles);
      const count = seen.reduce((sum, { triangles }) => sum + triangles.length, 0);
      const counts = [way.length - seen.length, seen.length, count];
      assert.deepEqual(counts, [inner[i], leaves[i], tests[i]], `${traversal}, ray ${i}`);
      // The ray is in each box, and what it hits was tested.
      assert.ok(way.every(({ enter, exit }) => enter <= exit), `${traversal}, ray ${i}`);
      const hit = hits.triangle[i];
      assert.ok(hit === 0xffffffff || seen.some(({ triangles }) => triangles.includes(hit)));
    }
  }
  ways.free();
});

test("cells of a level fill the box", () => {
  const scene = Scene.of(Mesh.teapot(4));
  const volume = (level) => {
    const cells = raykd.cells(scene, level, 1 << 20);
    let sum = 0;
    for (let i = 0; i < cells.length; i += 7) {
      const [a, b, c, d, e, f] = cells.subarray(i, i + 6);
      sum += (d - a) * (e - b) * (f - c);
    }
    return [sum, cells.length / 7];
  };
  const [whole, one] = volume(0);
  const [parts, many] = volume(9);
  assert.equal(one, 1);
  assert.ok(many > 50 && Math.abs(parts / whole - 1) < 1e-5, `${many} cells, ${parts} of ${whole}`);
});

test("stress scenes: the default loses nothing, a textbook's test does", () => {
  const trial = new raykd.Trial("slivers", 500);
  assert.equal(trial.run("strict").failures, 0);
  assert.equal(trial.run("exact").failures, 0);
  assert.ok(trial.run("moeller").failures > 0);
});

test("wrong input is an error that says what is wrong", () => {
  const numbers = (...all) => new Float32Array(all);
  const mesh = Mesh.teapot(1);
  const scene = Scene.of(mesh);
  for (const [act, message] of [
    [() => Mesh.load(new Uint8Array(0), "mesh.ply"), /mesh\.ply.*nothing in it/],
    [() => Mesh.load(new TextEncoder().encode("ply\nformat"), "mesh.ply"), /mesh\.ply/],
    [() => Mesh.teapot(0), /level/],
    [() => Mesh.stress("no such scene"), /no such scene/],
    [() => new Mesh(numbers(0, 1), new Uint32Array(3)), /three numbers/],
    [() => new Mesh(numbers(0, 0, NaN), new Uint32Array(3)), /finite/],
    [() => new Mesh(numbers(0, 0, 0), new Uint32Array([0, 0, 1])), /1/],
    [() => Scene.of(mesh, { builder: "best" }), /'best'.*median/],
    [() => Scene.of(mesh, { colour: "red" }), /colour/],
    [() => Scene.of(mesh, { price: NaN }), /null/],
    [() => Scene.of(mesh, { price: -1 }), /price/],
    [() => Scene.of(mesh, { traversal: "ropes", intersector: "woop" }), /woop/],
    [() => scene.closest(numbers(0, 0), numbers(0, 0, 1)), /three numbers/],
    [() => scene.closest(numbers(0, 0, 0), numbers(0, 0, 1), numbers(0, 1)), /tMin/],
    [() => scene.picture({ ...part(scene), last: 65 }), /rows/],
    [() => scene.picture({ ...part(scene), width: 1e6 }), /width/],
    [() => scene.picture({ ...part(scene), shading: "plaid" }), /plaid/],
    [() => mesh.randomRays(2 ** 31, 1), /rays/],
    [() => new raykd.Trial("slivers", 0), /rays/],
    [() => new raykd.Ways(scene).of(numbers(0, 0, 0, 1, 1, 1), numbers(0, 0, 1, 0, 0, 1), "stack"), /one ray/],
    [() => new raykd.Ways(scene).of(numbers(0, 0, 0), numbers(0, 0, 1), "jump"), /'jump'.*ropes/],
    [() => new raykd.Costs(mesh).measure("oak"), /'oak'/],
    [() => new raykd.Costs(mesh).best(1), /no tree was measured/],
  ]) {
    assert.throws(act, (error) => error instanceof Error && message.test(error.message), String(act));
  }
});

const part = (scene) => {
  const camera = scene.camera(1);
  return { camera, width: 64, height: 64, samples: 1, shading: "normal", first: 0, last: 64, full: 1 };
};

test("every shading gives a picture in which the mesh shows", () => {
  const scene = Scene.of(Mesh.teapot(4));
  for (const [shading] of raykd.choices().shadings) {
    const { rgba, hits, full } = scene.picture({ ...part(scene), shading, full: 40 });
    assert.equal(rgba.length, 64 * 64 * 4);
    assert.ok(hits > 500 && hits < 4000, `${shading}: ${hits}`);
    assert.ok(new Set(new Uint32Array(rgba.buffer)).size >= 10, shading);
    assert.ok(shading !== "heat" || full > 10);
  }
});

test("memory is given back", () => {
  const memory = () => raykd.initSync({}).memory.buffer.byteLength;
  const round = () => {
    const mesh = Mesh.teapot(30);
    Scene.of(mesh).free();
    mesh.free();
  };
  round();
  const before = memory();
  for (let i = 0; i < 10; i++) round();
  assert.ok(memory() <= 1.5 * before, `${before} bytes became ${memory()}`);
});
