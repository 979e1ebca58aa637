// ---- vectors: arrays of three

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const combine = (x, a, y, b) => a.map((_, i) => x * a[i] + y * b[i]);
const unit = a => combine(1 / (Math.hypot(...a) || 1), a, 0, a);
const across = (a, axis) => unit(combine(1, a, -dot(a, axis), axis)); // the part of `a` at right angles to `axis`
const degrees = radians => radians * 180 / Math.PI;
