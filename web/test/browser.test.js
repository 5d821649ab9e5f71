// The page in Chromium: it draws, its digests are native code's, every control works, and nothing complains.

import assert from "node:assert/strict";
import { mkdirSync, readFileSync, readdirSync, statSync } from "node:fs";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch } from "../chromium.js";
import { serve } from "../serve.js";
import { digests } from "./native.js";
import { alike, difference } from "./shots.js";
import * as raykd from "raykd";

const controls = "button, select, input, canvas[tabindex]";
/** Pictures of the page, to be looked at. */
const shots = fileURLToPath(new URL("../../target/web/shots/", import.meta.url));

let server, browser, page;
const complaints = [];

before(async () => {
  mkdirSync(shots, { recursive: true });
  server = await serve(0);
  browser = await launch();
  page = await browser.newPage({ viewport: { width: 1200, height: 1000 } });
  listen();
  await page.addInitScript(() => {
    window.used = new Set();
    for (const type of ["click", "input", "change", "keydown"]) {
      addEventListener(type, ({ target }) => window.used.add(target.id), true);
    }
  });
  await page.goto(`http://localhost:${server.address().port}/`);
  await measured();
});

function listen() {
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) complaints.push(message.text());
  });
  page.on("pageerror", (error) => complaints.push(error.message));
  page.setDefaultTimeout(60_000);
}

after(async () => {
  await browser?.close();
  server?.close();
});

/** Waits for the hits of the tree that is there now. */
const measured = () => page.waitForFunction(() => document.getElementById("facts").dataset.hits);
const still = () => page.evaluate(() => window.raykd.still());
async function shot(name) {
  // The picture goes along with what is scrolled.
  await page.evaluate(() => scrollTo(0, 0));
  return page.screenshot({ path: `${shots}${name}.png`, fullPage: true });
}
/** Takes a picture for people, and compares a part of the page that has no text with one that is kept. */
async function seen(name, part = "#frame") {
  await shot(name);
  const share = await difference(browser, name, await page.locator(part).screenshot());
  assert.ok(alike(share), `${name}: ${share} of the pixels differ; look at ${shots}${name}.png`);
}
const facts = () => page.$eval("#facts", ({ dataset: { tree, hits } }) => ({ tree, hits }));

/** Chooses, and waits for what comes of it. */
async function choose(id, value) {
  await page.evaluate(() => (document.getElementById("facts").dataset.hits = ""));
  await page.selectOption(`#${id}`, value);
  await measured();
  assert.equal(await page.textContent("#error"), "");
}

/** The picture's pixels: how many differ from the first, and a number that any change alters. */
const pixels = (id = "picture") => page.$eval(`#${id}`, (canvas) => {
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
  const words = new Uint32Array(data.buffer);
  const sum = words.reduce((all, word) => (Math.imul(all, 31) + word) >>> 0, 7);
  return { drawn: words.filter((word) => word !== words[0]).length, sum };
});

test("the page draws the teapot, and its digests are native code's", async () => {
  await still();
  const native = digests(50_000, ["teapot"]).teapot;
  assert.deepEqual(await facts(), { tree: native.trees.binned, hits: native.hits["binned stack strict"] });
  assert.ok((await pixels()).drawn > 50_000);
  await seen("teapot");
});

test("the picture is what the module draws in node, to the bit", async () => {
  await still();
  raykd.initSync({ module: readFileSync(new URL("../pkg/raykd_bg.wasm", import.meta.url)) });
  const scene = raykd.Scene.of(raykd.Mesh.teapot(4));
  const camera = await page.evaluate(() => window.raykd.camera());
  const [width, height] = [512, 512];
  const { rgba } = scene.picture({
    camera, width, height, samples: 2, shading: "normal", first: 0, last: height, full: 1,
  });
  const drawn = await page.$eval("#picture", (canvas) =>
    [...canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data]);
  assert.deepEqual(Buffer.from(drawn), Buffer.from(rgba));
});

test("what the page loads first has less than 2 MB", () => {
  const files = (folder, names) => names.map((name) => statSync(new URL(`../${folder}${name}`, import.meta.url)).size);
  const page = files("page/", readdirSync(new URL("../page", import.meta.url)));
  const all = [...files("", ["index.html", "pkg/raykd.js", "pkg/raykd_bg.wasm"]), ...page];
  const sum = all.reduce((a, b) => a + b);
  assert.ok(sum < 2e6, `${sum} bytes`);
});

test("the picture turns by mouse, wheel, keys and touch", async () => {
  const box = await (await page.$("#overlay")).boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  let last = await pixels();
  const changed = async (what, act) => {
    await act();
    const begin = Date.now();
    let now;
    do {
      await still();
      now = await pixels();
    } while (now.sum === last.sum && Date.now() - begin < 5000);
    assert.notEqual(now.sum, last.sum, what);
    last = now;
  };
  await changed("mouse", async () => {
    await page.mouse.move(...middle);
    await page.mouse.down();
    await page.mouse.move(middle[0] + 80, middle[1] + 20, { steps: 8 });
    await page.mouse.up();
  });
  await changed("wheel", () => page.mouse.wheel(0, 200));
  await page.focus("#overlay");
  for (const key of ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "+", "-"]) {
    await changed(key, () => page.keyboard.press(key));
  }
  await changed("touch", () => page.$eval("#overlay", (stage) => {
    const { left, top, width } = stage.getBoundingClientRect();
    const at = (type, pointerId, x, y) => stage.dispatchEvent(new PointerEvent(type, {
      pointerId, pointerType: "touch", clientX: left + x * width, clientY: top + y * width, bubbles: true,
    }));
    stage.setPointerCapture = () => {};
    at("pointerdown", 11, 0.4, 0.5);
    at("pointerdown", 12, 0.6, 0.5);
    at("pointermove", 12, 0.9, 0.5);
    at("pointerup", 11, 0.4, 0.5);
    at("pointerup", 12, 0.9, 0.5);
  }));
  await changed("home", () => page.click("#home"));
});

test("every shading, builder, traversal and test", async () => {
  for (const value of await values("shading")) {
    await page.selectOption("#shading", value);
    await still();
    assert.ok((await pixels()).drawn > 50_000, value);
    assert.equal(await page.isVisible("#legend"), value === "heat");
    await seen(`shading-${value}`);
  }
  await page.selectOption("#shading", "normal");
  const { hits } = await facts();
  for (const id of ["builder", "traversal"]) {
    for (const value of (await values(id)).filter((value) => value !== "brute").reverse()) {
      await choose(id, value);
      assert.equal((await facts()).hits, hits, `${id} ${value}`);
    }
  }
  await choose("builder", "binned");
  await choose("traversal", "stack");
  for (const value of (await values("intersector")).reverse()) await choose("intersector", value);
  await choose("intersector", "woop");
  await page.selectOption("#traversal", "ropes");
  await page.waitForFunction(() => document.getElementById("error").textContent);
  assert.match(await page.textContent("#error"), /woop works with the traversals stack and brute/);
  assert.equal(await page.inputValue("#traversal"), "stack");
  await choose("intersector", "strict");
  await page.evaluate(() => (document.getElementById("facts").dataset.hits = ""));
  await page.click("#measure");
  await measured();
  const { tree } = await facts();
  await page.$eval("#price", (slider) => {
    slider.value = 8;
    for (const type of ["input", "change"]) slider.dispatchEvent(new Event(type));
  });
  await page.waitForFunction((old) => {
    const { tree, hits } = document.getElementById("facts").dataset;
    return tree !== old && hits;
  }, tree);
});

const values = (id) => page.$$eval(`#${id} option`, (options) => options.map(({ value }) => value));

test("cells, level by level, and one ray's way", async () => {
  const before = await pixels("overlay");
  assert.equal(before.drawn, 0);
  await page.check("#show-cells");
  await slide("level", 5);
  await page.waitForFunction(() => document.getElementById("level-told").textContent.includes("5 of"));
  assert.ok((await pixels("overlay")).drawn > 1000);
  await still();
  await seen("cells");
  await page.uncheck("#show-cells");
  await page.focus("#overlay");
  await page.keyboard.press("Enter");
  await page.waitForSelector("#ray:not([hidden])");
  assert.match(await page.textContent("#ray-told"), /hits triangle \d+/);
  const lists = new Set();
  for (const way of await values("way")) {
    await page.selectOption("#way", way);
    await page.waitForFunction((way) => document.getElementById("way-told").textContent.startsWith(`By ${way} `), way);
    const [listed, counted] = await page.evaluate((way) => {
      const all = [...document.querySelectorAll("#visits li")].map(({ textContent }) => textContent);
      const tests = all.flatMap((text) => text.match(/tests ([\d, ]+)/)?.[1].split(", ") ?? []).length;
      const [inner, leaves] = ["node", "leaf"].map((what) => all.filter((text) => text.includes(`${what} `)).length);
      const line = [...document.querySelectorAll("#counts tbody tr")].find(({ cells }) => cells[0].textContent === way);
      return [[inner, leaves, tests], [...line.cells].slice(1, 4).map(({ textContent }) => Number(textContent))];
    }, way);
    assert.deepEqual(listed, counted, way);
    lists.add(listed.join());
  }
  assert.ok(lists.size >= 4, "ways differ");
  // `wide` and `brute` do without the tree.
  assert.equal((await values("way")).length, (await values("traversal")).length - 2);
  await page.selectOption("#way", "stack");
  await page.waitForFunction(() => document.getElementById("way-told").textContent.startsWith("By stack "));
  await page.click("#beside");
  await slide("visit", 3);
  await still();
  assert.match(await page.textContent("#visit-told"), /^4 of \d+$/);
  assert.equal(await page.$$eval("#counts tbody tr", (rows) => rows.length), (await values("traversal")).length);
  assert.ok((await pixels("overlay")).drawn > 1000);
  await seen("ray");
  await page.click("#forget");
  assert.equal((await pixels("overlay")).drawn, 0);
  await page.click("#overlay");
  await page.waitForSelector("#ray:not([hidden])");
  await page.click("#home");
});

const slide = (id, value) => page.$eval(`#${id}`, (slider, value) => {
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
}, value);

test("which tree is worth its build", async () => {
  await page.click("#auto");
  await page.waitForSelector("#auto-costs:not([hidden])");
  await page.waitForFunction(() => document.querySelectorAll("#auto-costs tbody tr").length === 9);
  const advice = async (rays) => {
    await page.fill("#auto-rays", String(rays));
    const count = rays.toLocaleString("en");
    await page.waitForFunction((count) =>
      document.getElementById("auto-told").textContent.startsWith(`For ${count} rays take `), count);
    return page.$$eval("#auto-costs tbody tr", (rows) => rows.map(({ cells, ariaCurrent }) => ({
      name: cells[0].textContent.replace("→ ", ""), bytes: Number(cells[3].textContent.replaceAll(",", "")),
      total: Number(cells[4].textContent.replaceAll(",", "")), chosen: ariaCurrent === "true",
    })));
  };
  for (const rays of [1, 20_000, 1_000_000_000]) {
    const rows = await advice(rays);
    const [one, ...more] = rows.filter(({ chosen }) => chosen);
    const least = Math.min(...rows.map(({ total }) => total));
    assert.equal(more.length, 0);
    // Numbers are told with three digits.
    assert.ok(one.total <= least * 1.06, JSON.stringify(rows));
    // To build a tree takes longer than to test all triangles for one ray, which for many is the worst.
    assert.equal(one.name === "none", rays === 1, JSON.stringify(rows));
  }
  assert.match(await page.textContent("#auto-ranges"), /^From about 1 on: none\. From about/);
  // Measured again before it is done, and then the mesh is changed.
  await page.click("#auto");
  await page.click("#auto");
  await page.waitForSelector("#auto-costs:not([hidden])");
  assert.equal((await advice(1)).find(({ chosen }) => chosen).name, "none");
  await page.click("#auto");
  await choose("scene", "teapot:20");
  assert.ok(await page.isHidden("#auto-costs"));
  assert.equal(await page.textContent("#auto-told"), "");
  await choose("scene", "teapot");
});

test("six tests side by side: exact loses nothing, textbooks' tests do", async () => {
  await slide("far", 4);
  await page.click("#compare");
  await page.waitForFunction(() => document.querySelectorAll("#six figure").length === 6);
  const lost = await page.$$eval("#six figure", (all) =>
    Object.fromEntries(all.map((one) => [one.textContent.split(":")[0], Number(one.dataset.lost)])));
  assert.equal(lost.exact, 0);
  assert.ok(lost.moeller + lost.plane + lost.baldwin > 0, JSON.stringify(lost));
  await page.fill("#stress-rays", "500");
  await page.selectOption("#stress", "hair");
  await page.click("#judge");
  await page.waitForFunction(() => document.querySelectorAll("#failures tbody tr").length === 6);
  const failures = await page.$$eval("#failures tbody tr", (rows) =>
    Object.fromEntries(rows.map(({ cells }) => [cells[0].textContent, Number(cells[1].textContent)])));
  assert.equal(failures.strict + failures.exact, 0);
  assert.ok(failures.moeller > 0, JSON.stringify(failures));
  await seen("tests", "#six figure:last-child canvas:first-child");
});

test("scenes by name, files, and files that are none", async () => {
  for (const value of ["stress:hair", "dragon_res4", "teapot"]) await choose("scene", value);
  await page.evaluate(() => (document.getElementById("facts").dataset.hits = ""));
  const obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  await page.setInputFiles("#file", { name: "one.obj", mimeType: "text/plain", buffer: Buffer.from(obj) });
  await measured();
  assert.match(await page.textContent("#facts"), /triangles1/);
  await page.setInputFiles("#file", { name: "bad.ply", mimeType: "text/plain", buffer: Buffer.from("nothing") });
  await page.waitForFunction(() => document.getElementById("error").textContent);
  assert.match(await page.textContent("#error"), /bad\.ply/);
  // Then no scene is chosen, so that each can be; and after that the same file again.
  assert.equal(await page.inputValue("#scene"), "");
  await choose("scene", "teapot:20");
  assert.equal(await page.inputValue("#file"), "");
  // A file that misses the picture is not opened in its place.
  const stays = await page.evaluate(() => ["dragover", "drop"].map((type) =>
    !document.body.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true }))));
  assert.deepEqual(stays, [true, true]);
});

test("what is chosen while a mesh is read is done as well", async () => {
  let go;
  const held = new Promise((done) => (go = done));
  await page.route("**/dragon_res4.ply.gz", (route) => held.then(() => route.continue()));
  await page.selectOption("#scene", "dragon_res4");
  await choose("builder", "exact");
  go();
  await page.waitForFunction(() => document.getElementById("facts").textContent.includes("11,102"));
  await measured();
  const { tree } = await facts();
  for (const builder of ["binned", "exact"]) await choose("builder", builder);
  assert.equal((await facts()).tree, tree);
  await choose("builder", "binned");
  // There is no tree to be drawn while the next mesh is read.
  await page.evaluate(async () => {
    const [scene, overlay] = ["scene", "overlay"].map((id) => document.getElementById(id));
    scene.value = "teapot:20";
    scene.dispatchEvent(new Event("change"));
    for (let i = 0; i < 20; i++) {
      overlay.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
      await new Promise((done) => setTimeout(done, 5));
    }
  });
  await page.waitForFunction(() => document.getElementById("facts").textContent.includes("25,600"));
  await measured();
  assert.equal(await page.textContent("#error"), "");
});

test("files that are none leave what there was, also a mesh without a tree", async () => {
  const opened = (names) => page.evaluate((names) => {
    document.getElementById("error").textContent = "";
    for (const name of names) {
      const [scene, file] = ["scene", "file"].map((id) => document.getElementById(id));
      const [chosen, bad] = [name === "bad.ply" ? file : scene, new DataTransfer()];
      bad.items.add(new File(["nothing"], "bad.ply"));
      if (chosen === file) file.files = bad.files;
      else scene.value = name;
      chosen.dispatchEvent(new Event("change"));
    }
  }, names);
  const failed = () => page.waitForFunction(() => document.getElementById("error").textContent.includes("bad.ply"));
  await opened(["bad.ply", "bad.ply"]);
  await failed();
  const there = await pixels();
  await page.focus("#overlay");
  await page.keyboard.press("ArrowLeft");
  await still();
  assert.notEqual((await pixels()).sum, there.sum);
  await opened(["teapot:60", "bad.ply"]);
  await failed();
  await page.waitForFunction(() => document.getElementById("facts").textContent.includes("230,400"));
  await measured();
  await choose("scene", "teapot:20");
});

test("a page that cannot start says so", async () => {
  const other = await browser.newPage();
  try {
    await other.route("**/*.wasm", (route) => route.abort());
    await other.goto(page.url());
    await other.waitForFunction(() => document.getElementById("error").textContent);
    assert.match(await other.textContent("#error"), /^raykd cannot start here: ./);
  } finally {
    await other.close();
  }
});

test("on a phone nothing is cut off", async () => {
  const wide = page;
  page = await browser.newPage({ viewport: { width: 360, height: 800 }, hasTouch: true, isMobile: true });
  try {
    listen();
    await page.goto(wide.url());
    await measured();
    await page.click("#auto");
    await page.waitForSelector("#auto-costs:not([hidden])");
    await page.tap("#overlay");
    await page.waitForFunction(() => document.querySelectorAll("#visits li").length);
    await page.click("#compare");
    await page.waitForFunction(() => document.querySelectorAll("#six figure").length === 6);
    await page.click("#judge");
    await page.waitForFunction(() => document.querySelectorAll("#failures tbody tr").length === 6);
    // The browser would make the page as wide as what does not fit.
    assert.equal(await page.evaluate(() => innerWidth), 360);
    const cut = await page.$$eval("main *", (all) =>
      all.filter((it) => it.getBoundingClientRect().right > 360).map(({ tagName, id }) => `${tagName} ${id}`));
    assert.deepEqual(cut, []);
    await still();
    await seen("phone");
    // What is chosen far below is seen in the picture.
    await page.$eval("#visit", (slider) => slider.scrollIntoView({ block: "end" }));
    assert.ok(await page.$eval("#frame", (frame) => frame.getBoundingClientRect().top >= 0));
    await page.screenshot({ path: `${shots}phone-ray.png` });
  } finally {
    await page.close();
    page = wide;
  }
});

test("every control was used", async () => {
  const unused = await page.$$eval(controls, (all) => all.map(({ id }) => id).filter((id) => !window.used.has(id)));
  assert.deepEqual(unused, []);
});

test("memory comes back", async () => {
  const memory = async () => (await page.evaluate(() => window.raykd.memory())).reduce((a, b) => a + b);
  const round = async (i) => {
    await choose("scene", i % 2 ? "teapot:20" : "dragon_res4");
    // Both have copies of the tree.
    await page.focus("#overlay");
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => document.querySelectorAll("#visits li").length);
  };
  for (let i = 0; i < 4; i++) await round(i);
  const before = await memory();
  for (let i = 0; i < 20; i++) await round(i);
  const after = await memory();
  // Where blocks lie changes from round to round; what is never freed is more.
  assert.ok(after <= 1.25 * before, `${before} bytes became ${after}`);
  await page.reload();
  await measured();
  const anew = await memory();
  assert.ok(anew < before, `${before} bytes became ${anew}`);
});

test("every control has a name", async () => {
  const unnamed = await page.$$eval(controls, (all) =>
    all.filter((it) => !(it.labels?.length || it.textContent.trim() || it.getAttribute("aria-label")))
      .map(({ id }) => id));
  assert.deepEqual(unnamed, []);
});

test("nothing was complained of", () => assert.deepEqual(complaints, []));
