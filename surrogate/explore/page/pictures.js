// Encoded pictures on canvases.

import { AUTOMATIC, EVERY_PIXEL } from "./state.js";

const TYPES = { jpeg: "image/jpeg", png: "image/png" };

/** A bitmap of encoded bytes; what is a bitmap already stays one. */
export const decoded = (picture, form) => picture instanceof ImageBitmap ? picture : createImageBitmap(new Blob([picture], { type: TYPES[form] }));

/** Put decoded pictures (ImageBitmap), of which some have `alpha`, onto canvases; surplus ones of either are left alone. */
export function paint(canvases, bitmaps, alpha = false) {
  bitmaps.forEach((bitmap, i) => {
    const canvas = canvases[i];
    if (!canvas) return;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    const context = canvas.getContext("2d", { alpha });
    if (alpha) context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(bitmap, 0, 0);
    bitmap.close();
  });
}

const MOVING = 256, USUAL = 512, MOST = 2048; // sides of pictures, pixels
const sidesOf = box => [Math.max(40, box.clientWidth), Math.max(40, box.clientHeight)];

/** Width and height of about `side`² pixels, shaped like a box on the screen; even numbers. */
export function sizeFor(box, side) {
  const [width, height] = sidesOf(box), scale = Math.min(side / Math.sqrt(width * height), MOST / Math.max(width, height));
  return [width, height].map(x => Math.max(8, 2 * Math.round(x * scale / 2)));
}

/** The same of a square, which is compared whatever the window's shape. */
export const squareOf = side => [side, side].map(x => Math.max(8, Math.min(MOST, 2 * Math.round(x / 2))));

/**
 * The side of a picture for a box that has a `share` of the stage: `full` is one of FULL_SIZES; what is fast draws every pixel, and
 * while something moves too.
 */
export function sideOf(box, full, { moving, isFast, share }) {
  if (moving && !isFast) return share * MOVING;
  if (full === EVERY_PIXEL || (full === AUTOMATIC && isFast)) return Math.sqrt(sidesOf(box).reduce((area, x) => area * x, devicePixelRatio ** 2));
  return share * (full || USUAL);
}
