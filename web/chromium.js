// Starts Chromium, for tests and measurements.

import { chromium } from "playwright-core";

/** Nothing is asked of the network; as root there is no sandbox. */
const args = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync",
];

export const launch = (more = ["--disable-gpu"]) =>
  chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: [...args, ...more] });
