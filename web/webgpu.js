// What WebGPU makes of floats on this machine: node webgpu.js. It computes sums, products, quotients and a * b + c of
// many numbers in WGSL, and compares them with those of a processor, which rounds each operation once.

import { launch } from "./chromium.js";
import { serve } from "./serve.js";

const MOST = 1 << 18;

/** Runs in the page. */
async function probe(count) {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) return { fault: "this browser offers no adapter" };
  const device = await adapter.requestDevice();
  const { vendor, architecture, device: name, description } = adapter.info;
  const limits = { storageBuffers: adapter.limits.maxStorageBuffersPerShaderStage };
  // Numbers of all sizes that neither overflow nor become subnormal, by a generator of 32 bits.
  let seed = 2026;
  const random = () => {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    return seed / 2 ** 32;
  };
  const number = () => Math.fround((random() < 0.5 ? -1 : 1) * (1 + random()) * 2 ** Math.floor(random() * 40 - 20));
  const input = Float32Array.from({ length: 3 * count }, number);
  const wanted = {
    "a + b": (a, b) => a + b,
    "a * b": (a, b) => a * b,
    "a / b": (a, b) => a / b,
    "a * b + c": (a, b, c) => Math.fround(a * b) + c,
    "a * b - b * c": (a, b, c) => Math.fround(a * b) - Math.fround(b * c),
  };
  const formulas = Object.keys(wanted);
  const lines = formulas.map((formula, i) => `result[${formulas.length}u * i + ${i}u] = ${formula};`);
  const code = `
    @group(0) @binding(0) var<storage, read> input: array<f32>;
    @group(0) @binding(1) var<storage, read_write> result: array<f32>;
    @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
      let i = id.x;
      let a = input[3u * i];
      let b = input[3u * i + 1u];
      let c = input[3u * i + 2u];
      ${lines.join("\n      ")}
    }`;
  const bytes = 4 * formulas.length * count;
  const { STORAGE, COPY_DST, COPY_SRC, MAP_READ } = GPUBufferUsage;
  const from = device.createBuffer({ size: input.byteLength, usage: STORAGE | COPY_DST });
  const result = device.createBuffer({ size: bytes, usage: STORAGE | COPY_SRC });
  const back = device.createBuffer({ size: bytes, usage: COPY_DST | MAP_READ });
  device.queue.writeBuffer(from, 0, input);
  const module = device.createShaderModule({ code });
  const pipeline = await device.createComputePipelineAsync({ layout: "auto", compute: { module, entryPoint: "main" } });
  const entries = [from, result].map((buffer, binding) => ({ binding, resource: { buffer } }));
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginComputePass();
  pass.setPipeline(pipeline);
  pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
  pass.dispatchWorkgroups(count / 64);
  pass.end();
  encoder.copyBufferToBuffer(result, 0, back, 0, bytes);
  device.queue.submit([encoder.finish()]);
  await back.mapAsync(GPUMapMode.READ);
  const found = new Float32Array(back.getMappedRange());
  const differ = Object.fromEntries(formulas.map((formula) => [formula, 0]));
  for (let i = 0; i < count; i++) {
    const [a, b, c] = input.subarray(3 * i, 3 * i + 3);
    formulas.forEach((formula, k) => {
      differ[formula] += !Object.is(found[formulas.length * i + k], Math.fround(wanted[formula](a, b, c)));
    });
  }
  return { adapter: [vendor, architecture, name, description].filter(Boolean).join(", "), limits, count, differ };
}

const server = await serve(0);
const browser = await launch(["--enable-unsafe-webgpu", "--enable-features=Vulkan", ...process.argv.slice(2)]);
try {
  const page = await browser.newPage();
  await page.goto(`http://localhost:${server.address().port}/`);
  console.log(browser.version(), JSON.stringify(await page.evaluate(probe, MOST), null, 1));
} finally {
  await browser.close();
  server.close();
}
