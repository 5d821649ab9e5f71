// Pictures of the page, compared loosely with small ones that are kept. Text is not compared: fonts differ.

import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

const kept = fileURLToPath(new URL("shots/", import.meta.url));
/** Pixels of the page along one that is compared. */
const COARSE = 8;
/** A pixel differs if its brightness, of 255, does so by more; so many of them may. */
const [FAR, SHARE] = [24, 0.01];

/** What share of a picture's pixels differs from the one that is kept; 0 if it is kept only now, as KEEP_SHOTS asks. */
export async function difference(browser, name, png) {
  const path = `${kept}${name}.png`;
  const page = await browser.newPage();
  try {
    const small = await page.evaluate(shrink, [png.toString("base64"), COARSE]);
    if (process.env.KEEP_SHOTS || !existsSync(path)) {
      if (!process.env.KEEP_SHOTS) throw new Error(`there is no ${path}: KEEP_SHOTS=1 npm test makes it`);
      mkdirSync(kept, { recursive: true });
      writeFileSync(path, Buffer.from(small.png, "base64"));
      return 0;
    }
    const old = await page.evaluate(shrink, [readFileSync(path).toString("base64"), 1]);
    if (small.width !== old.width) return 1;
    const far = small.grey.filter((grey, i) => !(Math.abs(grey - old.grey[i]) <= FAR));
    return far.length / small.grey.length;
  } finally {
    await page.close();
  }
}

/** Whether that is little enough. */
export const alike = (share) => share <= SHARE;

/** Runs in the browser: brightnesses of a picture made smaller, and its PNG. */
async function shrink([base64, times]) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
  const [width, height] = [bitmap.width, bitmap.height].map((side) => Math.floor(side / times));
  const all = new OffscreenCanvas(width * times, height * times).getContext("2d");
  all.drawImage(bitmap, 0, 0);
  const { data } = all.getImageData(0, 0, width * times, height * times);
  const image = new ImageData(width, height);
  const grey = [];
  for (let at = 0; at < width * height; at++) {
    let sum = 0;
    for (let y = 0; y < times; y++) {
      for (let x = 0; x < times; x++) {
        const from = 4 * ((Math.floor(at / width) * times + y) * width * times + (at % width) * times + x);
        sum += 0.299 * data[from] + 0.587 * data[from + 1] + 0.114 * data[from + 2];
      }
    }
    const mean = Math.round(sum / times ** 2);
    grey.push(mean);
    image.data.set([mean, mean, mean, 255], 4 * at);
  }
  const canvas = new OffscreenCanvas(width, height);
  canvas.getContext("2d").putImageData(image, 0, 0);
  const png = new Uint8Array(await (await canvas.convertToBlob({ type: "image/png" })).arrayBuffer());
  return { width, grey, png: btoa(String.fromCharCode(...png)) };
}
