// The page: what people choose, and the pictures of it. Rays are traced by workers, never here.

import { Pool } from "./pool.js";
import { View } from "./view.js";

const $ = (id) => document.getElementById(id);
const SIZE = 512;
/** Rays that are measured: those of `raykd bench`, so that its digests can be compared. */
const [RAYS, SEED, TIMES] = [50_000, 2026, 7];
/** Pixels along a side of a picture of the comparison, and of the part that is shown enlarged. */
const [SMALL, LENS] = [192, 16];
const MISS = 0xffffffff;
const THOUSAND = new Intl.NumberFormat("en");

const picture = $("picture").getContext("2d");
const overlay = $("overlay").getContext("2d");
const pool = await Pool.of(Math.max(1, Math.min(navigator.hardwareConcurrency ?? 2, 8))).catch((error) => {
  complain(new Error(`raykd cannot start here: ${error.message}`));
  throw error;
});

let view, report, cells, ray, costs, full = 40;
/** Counts what was chosen, so that answers to older choices are known. */
let choice = 0;
/** Counts meshes and measurements of all trees, for the same reason. */
let weighing = 0;

function tell(text) {
  $("status").textContent = text;
}

function complain(error) {
  tell("");
  $("error").textContent = error.message;
}

/** Runs what may fail, and shows why it did. */
async function trying(act) {
  $("error").textContent = "";
  try {
    return await act();
  } catch (error) {
    complain(error);
  }
}

// Choices

const meshes = [
  ["teapot", { teapot: 4 }, "teapot"],
  ["teapot:20", { teapot: 20 }, "teapot, finer"],
  ["teapot:60", { teapot: 60 }, "teapot, very fine"],
  ["dragon_res4", { fetch: "scenes/dragon_res4.ply.gz" }, "Stanford dragon, coarse (fetched beside the page)"],
];

function fill(select, choices, chosen) {
  select.append(...choices.map(([name]) => new Option(name, name, name === chosen, name === chosen)));
}

/** Text without the marks of code. */
const plain = (text) => text.replaceAll("`", "");

/** A select whose description changes with it. */
function described(id, choices, chosen, act) {
  const [select, about] = [$(id), $(`${id}-about`)];
  fill(select, choices, chosen);
  const describe = () => (about.textContent = plain(choices.find(([name]) => name === select.value)[1]));
  describe();
  select.addEventListener("change", () => {
    describe();
    act?.();
  });
}

/** From trees that are fast to small ones; the library's default is 5. */
const PRICES = [0, 0.5, 1, 2, 5, 10, 20, 40, 100, 1000];
const price = () => PRICES[$("price").value];
const options = () => ({
  builder: $("builder").value, price: price(), traversal: $("traversal").value, intersector: $("intersector").value,
});

/** Counts meshes, as a tree that is built meanwhile does not end their loading. */
let loads = 0;
/** Until the mesh that is read has a tree, what there was before: the view of a tree, or a mesh without one. */
let before = {};
async function load(what, name) {
  const mine = ++loads;
  tell(`${name}: reading`);
  if (what.fetch) {
    const answer = await fetch(what.fetch);
    if (!answer.ok) throw new Error(`${name} is not beside the page: put it at ${what.fetch}`);
    what = { bytes: new Uint8Array(await answer.arrayBuffer()), name: what.fetch };
  }
  if (mine !== loads) return;
  weighing++;
  costs = undefined;
  advise();
  // Until it has a tree there is nothing to draw.
  if (view) before = { view };
  view = undefined;
  choice++;
  try {
    await pool.all("load", what);
  } catch (error) {
    if (mine === loads) {
      view = before.view;
      if (before.name) begin(before.name).catch(complain);
    }
    throw error;
  }
  before = { name };
  if (mine === loads) await begin(name);
}

/** Builds the first tree of the mesh that was read last. */
async function begin(name) {
  forget();
  await build(name);
}

let title = "";
async function build(name = title) {
  const mine = ++choice;
  title = name;
  tell(`${name}: building`);
  await pool.all("build", options());
  if (mine !== choice) return;
  const [camera, facts] = [await pool.ask("camera", 1), await pool.ask("report")];
  if (mine !== choice) return;
  view ??= new View(camera);
  report = facts;
  ray = undefined;
  $("ray").hidden = true;
  $("level").max = report.depth;
  cells = undefined;
  show();
  facts.rate = facts.hits = undefined;
  write();
  draw();
  await showCells();
  await still();
  if (mine === choice) await measure();
}

/** Traces random rays by all workers. */
async function measure() {
  const mine = choice;
  const parts = pool.workers.length;
  const hits = await Promise.all(pool.workers.map((worker, i) => worker.ask("random", RAYS, SEED, i, parts, TIMES)));
  if (mine !== choice) return;
  const slowest = Math.max(...hits.map(({ ms }) => ms));
  report.rate = RAYS / slowest / 1000;
  const join = (Type, name) => {
    const all = new Type(RAYS);
    hits.reduce((at, part) => (all.set(part[name], at), at + part[name].length), 0);
    return all;
  };
  const [triangle, [t, u, v]] =
    [join(Uint32Array, "triangle"), ["t", "u", "v"].map((name) => join(Float32Array, name))];
  report.hits = await pool.ask("digest", { triangle, t, u, v });
  if (mine === choice) write();
}

/** The table of facts. */
function write() {
  const number = (x, maximumFractionDigits = 1) => x?.toLocaleString("en", { maximumFractionDigits }) ?? "…";
  const code = (text) => Object.assign(document.createElement("code"), { textContent: text ?? "…" });
  const rows = [
    ["triangles", number(report.triangles, 0)],
    ["build", `${number(report.buildMs)} ms`],
    ["bytes", number(report.bytes, 0)],
    ["SAH cost", number(report.sahCost, 2)],
    ["nodes, leaves", `${number(report.nodes, 0)}, ${number(report.leaves, 0)}`],
    ["references a triangle", number(report.refs / report.triangles, 2)],
    ["depth", number(report.depth, 0)],
    [`random rays, ${pool.workers.length} workers`, `${number(report.rate, 2)} million a second`],
    ["digest of the tree", code(report.digest)],
    [`of ${THOUSAND.format(RAYS)} hits`, code(report.hits)],
  ];
  $("facts").tBodies[0].replaceChildren(...rows.map(([name, value]) => row([head(name), cell(value)])));
  $("facts").dataset.tree = report.digest;
  $("facts").dataset.hits = report.hits ?? "";
  $("facts").dataset.rate = report.rate ?? "";
}

function row(cells) {
  const tr = document.createElement("tr");
  tr.append(...cells);
  return tr;
}
function cell(value, tag = "td") {
  const it = document.createElement(tag);
  it.append(value);
  if (typeof value === "number") it.className = "number";
  return it;
}
function head(value) {
  const it = cell(value, "th");
  it.scope = "row";
  return it;
}

// Which tree is worth its build

/** Measures every kind of tree of this mesh. */
async function weigh() {
  const mine = ++weighing;
  costs = undefined;
  await advise();
  const found = [];
  $("auto-told").textContent = "measuring";
  await pool.ask("costs");
  for (const name of pool.choices.trees) {
    if (mine !== weighing) return;
    $("auto-told").textContent = `measuring: ${name}`;
    found.push(await pool.ask("cost", name));
  }
  if (mine !== weighing) return;
  costs = found;
  await advise();
}

/** Says which of them to take. */
async function advise() {
  $("auto-costs").hidden = !costs;
  $("auto-ranges").textContent = $("auto-told").textContent = "";
  const rays = Number($("auto-rays").value);
  if (!costs || !(rays >= 1)) return;
  const mine = costs;
  const counts = Array.from({ length: 28 }, (_, i) => Math.round(10 ** (i / 3)));
  const best = await pool.ask("best", [rays, ...counts]);
  if (!best || mine !== costs || rays !== Number($("auto-rays").value)) return;
  const [chosen, ...others] = best;
  const number = (x, digits = 3) => x.toLocaleString("en", { maximumSignificantDigits: digits });
  const at = costs.findIndex(({ choice }) => choice === chosen.tree);
  const { builder, price, maxDepth } = costs[at];
  const how = maxDepth === 0 ? "no tree at all" : `builder ${builder}, price ${price}, at most ${maxDepth} levels`;
  $("auto-told").textContent =
    `For ${THOUSAND.format(rays)} rays take ${chosen.tree} (${how}): ${number(chosen.totals[at])} ms in all. That is ` +
    "the least, or at most 5\u00a0% more and the tree smaller.";
  const ranges = others.map(({ tree }, i) => [tree, counts[i]]).filter(([tree], i) => tree !== others[i - 1]?.tree);
  $("auto-ranges").textContent =
    `${ranges.map(([tree, from]) => `From about ${THOUSAND.format(from)} on: ${tree}`).join(". ")}.`;
  $("auto-costs").tBodies[0].replaceChildren(...costs.map(({ choice, buildMs, rayNs, bytes }, i) => {
    const numbers = [buildMs, 1000 / rayNs, bytes / 1000, chosen.totals[i]].map((x) => {
      const it = cell(number(x));
      it.className = "number";
      return it;
    });
    const line = row([head(i === at ? `→ ${choice}` : choice), ...numbers]);
    if (i === at) line.setAttribute("aria-current", "true");
    return line;
  }));
}

// Pictures: coarse first, sharper when nothing moves

/** Pixels of the picture along a pixel that is traced, and rays along that. */
const LEVELS = [[8, 1], [4, 1], [2, 1], [1, 1], [1, 2]];
/** The coarsest level, chosen so that a picture takes at most so many milliseconds. */
const QUICK = 50;
let first = 1;
let version = 0;
let drawing = Promise.resolve();
let waiting = false;
/** When the first picture was there, and how long coarse ones took, in milliseconds: for tests and measurements. */
const seen = { first: undefined, frames: [] };

function draw() {
  version++;
  paint();
  if (waiting) return;
  waiting = true;
  drawing = drawing.then(() => {
    waiting = false;
    const mine = choice;
    return sharpen().catch((error) => mine === choice && complain(error));
  });
}

/** Waits until the picture is as sharp as it gets. */
async function still() {
  let last;
  do {
    last = drawing;
    await last;
  } while (last !== drawing);
}

async function sharpen() {
  if (!view) return;
  const mine = version;
  const [camera, shading] = [view.camera(), $("shading").value];
  for (let level = first; level < LEVELS.length; level++) {
    // A picture that is begun coarse is always shown, else nothing moves on slow machines.
    const going = () => mine === version || level === first;
    const [pixel, samples] = LEVELS[level];
    const size = SIZE / pixel;
    const rows = Math.max(8, Math.min(size / pool.workers.length, 32 * pixel));
    const jobs = [];
    for (let from = 0; from < size; from += rows) {
      const last = Math.min(size, from + rows);
      const part = { camera, width: size, height: size, samples, shading, first: from, last, full };
      jobs.push({ ask: ["picture", part], from });
    }
    const canvas = new OffscreenCanvas(size, size);
    const target = canvas.getContext("2d");
    let [hits, next] = [0, 1];
    const start = performance.now();
    const whole = await pool.share(jobs, going, ({ from }, part) => {
      hits += part.hits;
      next = Math.max(next, part.full);
      target.putImageData(new ImageData(part.rgba, size), 0, from);
    });
    if (!whole) return;
    picture.drawImage(canvas, 0, 0, SIZE, SIZE);
    const took = performance.now() - start;
    seen.first ??= performance.now();
    if (level === first) {
      seen.frames.push(took);
      if (took > QUICK && first > 0) first--;
      else if (took < QUICK / 6 && first < 2) first++;
    }
    const rays = (size * samples) ** 2;
    const rate = (rays / took / 1000).toFixed(1);
    tell(`${size} x ${size}, ${samples * samples} rays a pixel, ${took.toFixed(0)} ms: ${rate} million rays a ` +
      `second, ${((100 * hits) / rays).toFixed(0)} % hit`);
    if (shading === "heat" && next !== full) {
      full = next;
      $("full").textContent = `${full} and more`;
    }
    if (mine !== version) return;
    if (level === first) await new Promise((done) => setTimeout(done, 60));
    if (mine !== version) return;
  }
}

// What is drawn over the picture

const BOX = [0, 1, 2].flatMap((axis) =>
  [0, 1, 2, 3].map((corner) => {
    const low = corner & ((1 << axis) - 1);
    const at = ((corner - low) << 1) | low;
    return [at, at | (1 << axis)];
  }));

function outline(project, box) {
  const corner = (at) => project([0, 1, 2].map((axis) => box[axis + 3 * ((at >> axis) & 1)]));
  for (const [a, b] of BOX) {
    const [from, to] = [corner(a), corner(b)];
    if (!from || !to) continue;
    overlay.moveTo(...from);
    overlay.lineTo(...to);
  }
}

/** A line that is seen on dark and bright ground. */
function stroke(width, dash = []) {
  overlay.setLineDash(dash);
  for (const [style, more] of [["#000c", 2], ["#fff", 0]]) {
    overlay.strokeStyle = style;
    overlay.lineWidth = width + more;
    overlay.stroke();
  }
}

function paint() {
  const { width } = overlay.canvas;
  overlay.clearRect(0, 0, width, width);
  if (!view) return;
  const project = view.projection(width);
  if (cells && $("show-cells").checked) {
    for (const empty of [false, true]) {
      overlay.beginPath();
      for (let i = 0; i < cells.length; i += 7) {
        if ((cells[i + 6] === 2) === empty) outline(project, cells.subarray(i, i + 6));
      }
      stroke(cells.length > 7 * 500 ? 0.5 : 1.5, empty ? [4, 8] : []);
    }
  }
  if (ray) paintRay(project);
}

function paintRay(project) {
  const at = (t) => ray.origin.map((x, i) => x + t * ray.direction[i]);
  const visit = ray.way[$("visit").value];
  const last = ray.triangle === MISS ? (ray.way[0]?.exit ?? 1) : ray.t;
  const from = project(at(Math.max(0, (ray.way[0]?.enter ?? 0) - 0.1 * last)));
  const to = project(at(last));
  if (from && to) {
    overlay.beginPath();
    overlay.moveTo(...from);
    overlay.lineTo(...to);
    stroke(3);
    overlay.beginPath();
    overlay.arc(...to, 8, 0, 7);
    stroke(3);
  }
  overlay.beginPath();
  for (const { box, triangles } of ray.way) if (triangles?.length) outline(project, box);
  stroke(1, [3, 5]);
  if (visit) {
    overlay.beginPath();
    outline(project, visit.box);
    stroke(3);
  }
}

/** Most cells that are drawn. */
const MOST = 3000;

async function showCells() {
  const level = Number($("level").value);
  $("level-told").textContent = `${level} of ${report.depth}`;
  if ($("show-cells").checked) {
    const mine = choice;
    const found = await pool.ask("cells", level, MOST);
    if (mine !== choice || level !== Number($("level").value)) return;
    cells = found;
    const count = cells.length / 7;
    const more = count >= MOST ? " drawn, of more" : "";
    $("level-told").textContent = `${level} of ${report.depth}, ${THOUSAND.format(count)} cells${more}`;
  }
  paint();
}

// One ray

async function follow(x, y) {
  const mine = choice;
  const { intersector, traversal } = options();
  const found = await pool.ask("ray", view.camera(), SIZE, x, y, intersector, traversal);
  if (mine !== choice) return;
  ray = { ...found, origin: [...found.origin], direction: [...found.direction], way: [] };
  const hits = ray.triangle === MISS ? "nothing" : `triangle ${ray.triangle} at ${ray.t.toPrecision(6)}`;
  $("ray-told").textContent = `The ray hits ${hits}.`;
  $("counts").tBodies[0].replaceChildren(...ray.counts.map(({ name, inner, leaves, tests, turns }) =>
    row([head(name), ...[inner, leaves, tests, turns].map((x) => cell(x))])));
  $("ray").hidden = false;
  await list();
}

/** Lists the nodes that the ray visits by the traversal chosen there. */
async function list() {
  const [mine, name] = [ray, $("way").value];
  const way = await pool.ask("way", ray.origin, ray.direction, name);
  if (mine !== ray || name !== $("way").value) return;
  ray.way = way;
  const leaves = way.filter(({ triangles }) => triangles);
  const tests = leaves.reduce((sum, { triangles }) => sum + triangles.length, 0);
  const seen = new Set(way.map(({ node }) => node)).size;
  const number = (count, one, more) => `${THOUSAND.format(count)} ${count === 1 ? one : more}`;
  $("way-told").textContent =
    `By ${name} it passes ${number(way.length - leaves.length, "inner node", "inner nodes")} and ` +
    `${number(leaves.length, "leaf", "leaves")} and tests ${number(tests, "triangle", "triangles")}; ` +
    `${THOUSAND.format(way.length - seen)} of these visits are of nodes that it has seen before.`;
  const known = new Set();
  $("visits").replaceChildren(...way.map(({ node, depth, triangles, plane, enter, exit }) => {
    const from = Math.max(0, enter).toPrecision(5);
    const what = plane ? `node ${node}, level ${depth}: plane at ${"xyz"[plane[0]]} = ${plane[1].toPrecision(5)}`
      : `leaf ${node}, level ${depth}: ${triangles.length ? `tests ${triangles.join(", ")}` : "empty"}`;
    const item = document.createElement("li");
    item.textContent = `${known.has(node) ? "again " : ""}${what} (from ${from} to ${exit.toPrecision(5)})`;
    known.add(node);
    return item;
  }));
  for (const line of $("counts").tBodies[0].rows) {
    if (line.cells[0].textContent === name) line.setAttribute("aria-current", "true");
    else line.removeAttribute("aria-current");
  }
  $("visit").max = Math.max(0, way.length - 1);
  $("visit").value = 0;
  visit();
}

function visit() {
  const at = Number($("visit").value);
  $("visit-told").textContent = ray.way.length ? `${at + 1} of ${THOUSAND.format(ray.way.length)}` : "none";
  [...$("visits").children].forEach((item, i) => {
    if (i === at) {
      item.setAttribute("aria-current", "step");
      $("visits").scrollTop = item.offsetTop - $("visits").offsetTop - 60;
    } else item.removeAttribute("aria-current");
  });
  paint();
}

function forget() {
  ray = undefined;
  $("ray").hidden = true;
  $("ray-told").textContent = "Click the picture, or press Enter on it.";
  paint();
}

// Six tests

async function compare() {
  const mine = choice;
  const { intersector, traversal } = options();
  const distant = Object.assign(Object.create(View.prototype), view, { far: 10 ** Number($("far").value) });
  const camera = distant.camera();
  const tests = pool.choices.intersectors;
  tell("tracing by six tests");
  const found = [];
  // One at a time, so that times are of one worker alone.
  for (const [name] of tests) found.push(await pool.ask("test", camera, SMALL, name, intersector, traversal));
  if (mine !== choice) return;
  const exact = found[tests.findIndex(([name]) => name === "exact")];
  $("six").replaceChildren();
  for (const [i, [name, about]] of tests.entries()) {
    $("six").append(six(name, about, found[i], exact));
    // The page answers in between.
    await new Promise((done) => setTimeout(done));
  }
  tell("traced by six tests");
}

function six(name, about, hits, exact) {
  const image = new ImageData(SMALL, SMALL);
  const [lost, invented] = [[], []];
  const brightness = range(exact.t.filter((_, i) => exact.triangle[i] !== MISS));
  for (let i = 0; i < hits.t.length; i++) {
    const [hit, should] = [hits.triangle[i] !== MISS, exact.triangle[i] !== MISS];
    if (should && !hit) lost.push(i);
    if (hit && !should) invented.push(i);
    // Near is bright; a little of the triangle's number tells neighbours apart.
    const grey = hit ? 80 + 130 * brightness(hits.t[i]) + ((hits.triangle[i] * 37) % 30) : 0;
    image.data.set([grey, grey, grey, 255], 4 * i);
  }
  const figure = document.createElement("figure");
  const [whole, lens] = [canvas(SMALL * 2), canvas(LENS * 12)];
  lens.className = "lens";
  const source = new OffscreenCanvas(SMALL, SMALL);
  source.getContext("2d").putImageData(image, 0, 0);
  const target = whole.getContext("2d");
  target.imageSmoothingEnabled = false;
  target.drawImage(source, 0, 0, SMALL * 2, SMALL * 2);
  for (const [pixels, square] of [[lost, false], [invented, true]]) {
    target.beginPath();
    for (const i of pixels.slice(0, 2000)) mark(target, (i % SMALL) * 2 + 1, Math.floor(i / SMALL) * 2 + 1, 6, square);
    ring(target);
  }
  const near = [...lost, ...invented];
  const label = near.length ? `${name}: around its first wrong pixel` : `${name}: the middle, no pixel is wrong`;
  const middle = near[0] ?? (SMALL * SMALL + SMALL) / 2;
  const corner = [middle % SMALL, Math.floor(middle / SMALL)]
    .map((x) => Math.max(0, Math.min(SMALL - LENS, x - LENS / 2)));
  const enlarged = lens.getContext("2d");
  enlarged.imageSmoothingEnabled = false;
  enlarged.drawImage(source, ...corner, LENS, LENS, 0, 0, LENS * 12, LENS * 12);
  for (const [pixels, square] of [[lost, false], [invented, true]]) {
    enlarged.beginPath();
    for (const i of pixels) {
      const [x, y] = [(i % SMALL) - corner[0], Math.floor(i / SMALL) - corner[1]];
      if (x >= 0 && x < LENS && y >= 0 && y < LENS) mark(enlarged, 12 * x + 6, 12 * y + 6, 7, square);
    }
    ring(enlarged);
  }
  const caption = document.createElement("figcaption");
  const rate = hits.t.length / Math.max(hits.ms, 0.1) / 1000;
  const wrong = `${lost.length} lost, ${invented.length} invented`;
  caption.textContent = `${name}: ${wrong}, ${rate.toFixed(1)} million rays a second. ${plain(about)}.`;
  whole.setAttribute("aria-label", caption.textContent);
  lens.setAttribute("aria-label", label);
  figure.dataset.lost = lost.length;
  figure.append(whole, caption, lens);
  return figure;
}

function canvas(size) {
  const it = document.createElement("canvas");
  it.width = it.height = size;
  it.setAttribute("role", "img");
  return it;
}

/** A function that is 1 at the least of some numbers and 0 at the most. */
function range(numbers) {
  let [least, most] = [Infinity, -Infinity];
  for (const x of numbers) [least, most] = [Math.min(least, x), Math.max(most, x)];
  return (x) => (most > least ? Math.max(0, Math.min(1, (most - x) / (most - least))) : 1);
}

function mark(context, x, y, size, square) {
  if (square) return context.rect(x - size, y - size, 2 * size, 2 * size);
  context.moveTo(x + size, y);
  context.arc(x, y, size, 0, 7);
}

function ring(context) {
  for (const [style, width] of [["#000", 5], ["#fff", 2]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
  }
}

async function judge() {
  const [scene, rays] = [$("stress").value, Math.max(0, Math.floor($("stress-rays").value))];
  const body = $("failures").tBodies[0];
  tell(`${scene}: the exact answers of ${rays} rays`);
  await pool.ask("judge", scene, rays);
  body.replaceChildren();
  $("failures").hidden = false;
  for (const [name] of pool.choices.intersectors) {
    tell(`${scene}: ${name}`);
    const { rays, failures, kinds } = await pool.ask("run", name);
    const kind = kinds.map(([kind, count]) => `${THOUSAND.format(count)} ${kind}`).join(", ");
    body.append(row([head(name), cell(Math.round((1e6 * failures) / rays)), cell(kind || "none")]));
  }
  tell(`${scene}: ${THOUSAND.format(rays)} rays by six tests, judged`);
}

// Hands on the picture

const fingers = new Map();
let moved = 0;

function hands() {
  const stage = $("overlay");
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
    if (fingers.size === 1) moved = 0;
  });
  stage.addEventListener("pointermove", (event) => {
    const old = fingers.get(event.pointerId);
    if (!old || !view) return;
    const apart = () => {
      const [a, b] = [...fingers.values()];
      return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    };
    const [dx, dy] = [event.clientX - old.clientX, event.clientY - old.clientY];
    moved += Math.abs(dx) + Math.abs(dy);
    const before = fingers.size > 1 ? apart() : 0;
    fingers.set(event.pointerId, event);
    if (fingers.size > 1) view.zoom(before / Math.max(1, apart()));
    else view.turn(-dx * 0.01, dy * 0.01);
    draw();
  });
  const lift = (event) => {
    const clicked = fingers.size === 1 && moved < 4 && event.type === "pointerup";
    fingers.delete(event.pointerId);
    if (!clicked || !view) return;
    const { left, top, width } = stage.getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top]
      .map((at) => Math.max(0, Math.min(SIZE - 1, Math.floor((at / width) * SIZE))));
    trying(() => follow(x, y));
  };
  stage.addEventListener("pointerup", lift);
  stage.addEventListener("pointercancel", lift);
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    view?.zoom(Math.exp(Math.max(-0.3, Math.min(0.3, event.deltaY * 0.001))));
    if (view) draw();
  }, { passive: false });
  const keys = {
    ArrowLeft: () => view.turn(-0.1, 0), ArrowRight: () => view.turn(0.1, 0),
    ArrowUp: () => view.turn(0, 0.1), ArrowDown: () => view.turn(0, -0.1),
    "+": () => view.zoom(0.9), "=": () => view.zoom(0.9), "-": () => view.zoom(1 / 0.9),
  };
  stage.addEventListener("keydown", (event) => {
    if (!view || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter") trying(() => follow(SIZE / 2, SIZE / 2));
    else if (keys[event.key]) {
      keys[event.key]();
      draw();
    } else return;
    event.preventDefault();
  });
  const frame = $("frame");
  frame.addEventListener("dragover", (event) => {
    event.preventDefault();
    frame.classList.add("drop");
  });
  frame.addEventListener("dragleave", () => frame.classList.remove("drop"));
  frame.addEventListener("drop", (event) => {
    event.preventDefault();
    frame.classList.remove("drop");
    const [file] = event.dataTransfer.files;
    $("file").value = "";
    if (file) trying(() => open(file));
  });
  // Beside the picture the browser would leave the page for the file.
  for (const type of ["dragover", "drop"]) addEventListener(type, (event) => event.preventDefault());
}

async function open(file) {
  const what = { bytes: new Uint8Array(await file.arrayBuffer()), name: file.name };
  // Any scene may be chosen now, also the one that was there before.
  $("scene").selectedIndex = -1;
  await load(what, file.name);
}

function show() {
  $("price-told").textContent = price();
  $("far-told").textContent = THOUSAND.format(Math.round(10 ** Number($("far").value)));
  $("legend").hidden = $("shading").value !== "heat";
  $("full").textContent = `${full} and more`;
}

// Begin

const on = (id, event, act) => $(id).addEventListener(event, () => trying(act));

const { builders, traversals, intersectors, shadings, stress } = pool.choices;
const own = document.createElement("optgroup");
own.label = "meshes";
own.append(...meshes.map(([name, , about]) => new Option(about, name)));
const hard = document.createElement("optgroup");
hard.label = "scenes in which ray tracers fail";
hard.append(...stress.map(([name, about]) => new Option(`${name}: ${about}`, `stress:${name}`)));
$("scene").append(own, hard);

described("shading", shadings, "normal", () => (show(), draw()));
described("builder", builders, "binned", () => trying(build));
described("traversal", traversals, "stack", () => trying(walk));
described("intersector", intersectors, "strict", () => trying(walk));
described("stress", stress, "slivers");
// These do without the tree.
fill($("way"), traversals.filter(([name]) => name !== "wide" && name !== "brute"), "stack");

/** Another way through the same tree. */
async function walk() {
  const { traversal, intersector } = options();
  // Tests other than strict go with a full stack alone, so that is chosen first.
  await pool.all("traverse", "stack");
  await pool.all("intersect", intersector);
  try {
    await pool.all("traverse", traversal);
  } catch (error) {
    $("traversal").value = "stack";
    $("traversal").dispatchEvent(new Event("change"));
    throw error;
  }
  draw();
  await still();
  await measure();
}

on("scene", "change", () => {
  const { value } = $("scene");
  // The same file may be chosen again.
  $("file").value = "";
  const known = meshes.find(([name]) => name === value);
  return known ? load(known[1], value) : load({ stress: value.slice("stress:".length) }, value);
});
on("file", "change", async () => {
  const [file] = $("file").files;
  if (file) await open(file);
});
on("home", "click", async () => {
  view = new View(await pool.ask("camera", 1));
  draw();
});
$("price").addEventListener("input", show);
on("price", "change", () => build());
on("measure", "click", measure);
on("auto", "click", weigh);
$("auto-rays").addEventListener("input", () => trying(advise));
on("show-cells", "change", showCells);
on("level", "input", showCells);
$("visit").addEventListener("input", visit);
on("way", "change", list);
on("beside", "click", () => {
  const middle = ray.triangle === MISS ? (ray.way[0]?.exit ?? 1) : ray.t;
  view.beside(ray.direction, ray.origin.map((x, i) => x + middle * ray.direction[i]));
  draw();
});
on("forget", "click", forget);
$("far").addEventListener("input", show);
on("compare", "click", compare);
on("judge", "click", judge);
hands();

const colours = await pool.ask("heat");
const strip = $("scale").getContext("2d");
colours.forEach(([r, g, b], x) => {
  strip.fillStyle = `rgb(${r} ${g} ${b})`;
  strip.fillRect(x, 0, 1, 12);
});
show();
await trying(() => load(meshes[0][1], meshes[0][0]));
/** For tests. */
window.raykd = { still, seen, camera: () => view.camera(), memory: () => pool.all("memory") };
