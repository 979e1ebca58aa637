// Encoded pictures on canvases.

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

/** Width and height of about `side`² pixels, shaped like a box on the screen; even numbers. */
export function sizeFor(box, side) {
  const width = Math.max(40, box.clientWidth), height = Math.max(40, box.clientHeight);
  const scale = side / Math.sqrt(width * height), even = x => Math.max(8, Math.min(2048, 2 * Math.round(x * scale / 2)));
  return [even(width), even(height)];
}

/** The same of a square, which is compared whatever the window's shape. */
export const squareOf = side => [side, side].map(x => Math.max(8, 2 * Math.round(x / 2)));
