// Small preferences of a person, kept by the browser where it may.

const ROOM = "gs-surrogate ", held = new Map();

export function remember(name, value) {
  held.set(name, value);
  try {
    localStorage.setItem(ROOM + name, value);
  } catch { /* this browser keeps nothing of this page: until it is closed `held` does */ }
}

export function recalled(name, otherwise) {
  try {
    return held.get(name) ?? localStorage.getItem(ROOM + name) ?? otherwise;
  } catch {
    return held.get(name) ?? otherwise;
  }
}
