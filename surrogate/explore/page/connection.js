// What the page asks of the program: calls over one WebSocket, and exports over plain HTTP.  The addresses are relative, so that the
// page works below the path of any proxy.  A program that stops is waited for: it comes back under the same address.

const SOONEST = 400, LATEST = 3000; // milliseconds between attempts to find the program again
const PATIENCE = 4000, BETWEEN = 1000; // milliseconds without an answer before that is said, and said anew

let socket, open, waiting = []; // { resolve, reject } of calls without an answer yet, in their order, which is that of the answers
let handlers = { lost: () => {}, back: () => {}, late: () => {} };
let heard = 0, watching = 0; // when there was an answer, or the first question after the last

/** Raised by calls while the program is gone. */
export class Gone extends Error {}

/**
 * `lost(reason)` hears that the program can't be asked any more, `back()` that it can again, and
 * `late(seconds)` for how long it has not answered: 0 once it does.
 */
export const listen = given => { handlers = given; };

let ready = connected();

/** Resolves when the socket is open, or can't be opened. */
function connected() {
  return new Promise(resolve => {
    const created = new WebSocket(new URL("ws", document.baseURI).href.replace(/^http/, "ws"));
    created.binaryType = "arraybuffer";
    created.onmessage = event => {
      const answer = unpacked(event.data), { resolve: take, reject } = waiting.shift();
      answered();
      if (answer.error) reject(new Error(answer.error));
      else take(answer);
    };
    created.onopen = () => {
      [socket, open] = [created, true];
      resolve();
    };
    created.onclose = () => {
      lose();
      resolve();
    };
  });
}

/** An answer came: the next is waited for from now on. */
function answered() {
  if (performance.now() - heard > PATIENCE) handlers.late(0);
  heard = performance.now();
  watch();
}

/** Say so when what was asked is not answered for long. */
function watch() {
  clearTimeout(watching);
  if (!waiting.length) return;
  const silent = performance.now() - heard;
  if (silent > PATIENCE) handlers.late(Math.round(silent / 1000));
  watching = setTimeout(watch, silent > PATIENCE ? BETWEEN : PATIENCE - silent + 1);
}

function lose() {
  const unanswered = waiting;
  [open, waiting] = [false, []];
  for (const { reject } of unanswered) reject(new Gone("The explorer has stopped."));
  handlers.lost("");
  find(SOONEST);
}

/** Try to reach the program until it answers. */
function find(pause) {
  setTimeout(async () => {
    const answer = await fetch(document.baseURI, { method: "HEAD", cache: "no-store" }).catch(() => null);
    if (answer?.ok) {
      ready = connected();
      await ready;
      if (open) handlers.back(); // else it was lost again, and is being looked for
      return;
    }
    if (answer?.status === 403) handlers.lost("It runs again, but wants a new token: open the address that it printed.");
    find(Math.min(LATEST, 1.5 * pause));
  }, pause);
}

export const facts = () => call("facts");

/** What to expect all over the parameters, as a page alone holds it, once it is measured: { survey, views, seen, sentence }. */
export async function survey() {
  for (;;) {
    const answer = await call("survey").catch(error => {
      if (error instanceof Gone) return {};
      throw error;
    });
    if (answer.survey || answer.sentence) return answer;
    await new Promise(resolve => { setTimeout(resolve, LATEST); });
  }
}

/** The surrogate for browsers that draw: {record, megabytes, best, facts, tensors, field}, the last two null where there are none. */
export async function drawable() {
  const { pictures: [tensors, field], ...content } = await call("model"), held = bytes => bytes.length ? bytes.slice() : null;
  return { ...content, tensors: held(tensors), field: held(field) };
}

/** Tell the program what is shown, and hear what it sets: {number, parameters}, the latter null where nothing is newer. */
export const follow = message => call("follow", message);

/** There is a program that answers questions. */
export const asks = true;

/** A map to lay over a picture, `about` "error" or a parameter: {pictures: [PNG with alpha], high, words, shares}. */
export const over = (request, about) => call("over", { ...request, about });

/** Runs that would teach most: [[value of each parameter]]. */
export const suggested = async () => (await call("next")).runs;

/** The emulated field's value that is seen at a `pixel`, null for none, and, by setting, at `pins`, world places: {seen, pins, name, unit}. */
export const probed = (request, pixel, pins) => call("probe", { ...request, pixel, pins });

/** How often the field has which value in what a request shows: {edges, shares}. */
export const here = request => call("here", request);

/** Numbers of the field all over the parameters; while they are made `done`, the share of them that are. */
export const predictions = request => call("predictions", request);

/** Whether a graphics card draws here without the program; see draw/local.js. */
export const drawsAlone = () => false;

/** What error to expect of the pictures of a request. */
export const expected = async request => (await call("expected", request)).expected;

/** An answer with pictures; throws an Error that says in a sentence why there is none. */
export const frame = request => call("frame", request);

/** The stored picture nearest to what a request for pictures shows, or null. */
export const nearest = async request => (await call("nearest", request)).found;

async function call(name, request) {
  if (open === undefined) await ready; // of the first connection
  if (!open || socket.readyState !== WebSocket.OPEN) throw new Gone("The explorer has stopped.");
  return new Promise((resolve, reject) => {
    waiting.push({ resolve, reject });
    if (waiting.length === 1) {
      heard = performance.now();
      watch();
    }
    socket.send(JSON.stringify({ call: name, request }));
  });
}

/** An answer with its pictures as bytes: behind the length of a JSON object come the object and the pictures that it lists by size. */
function unpacked(buffer) {
  let start = 4 + new DataView(buffer).getUint32(0, true);
  const answer = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, start - 4)));
  answer.pictures = answer.pictures.map(size => new Uint8Array(buffer, (start += size) - size, size));
  return answer;
}

/** A file to be saved: { name, blob }; `count(done, total)` hears how far it is, and `signal` ends it. */
export async function exported(request, { count, signal }) {
  const ticket = String(Math.random()).slice(2), headers = { "Content-Type": "application/json" };
  const watching = setInterval(async () => {
    const { made } = await call("made", ticket).catch(() => ({}));
    if (made) count(...made);
  }, BETWEEN);
  try {
    const response = await fetch(`export?ticket=${ticket}`, { method: "POST", headers, body: JSON.stringify(request), signal }).catch(error => {
      throw error instanceof TypeError ? new Gone("Nothing was saved: the explorer has stopped.") : error;
    });
    return await fileOf(response);
  } finally {
    clearInterval(watching);
  }
}

async function fileOf(response) {
  if (!response.ok) {
    const refusal = await response.json().catch(() => ({}));
    throw new Error(refusal.error ?? `the explorer refused (${response.status})`);
  }
  const name = /filename="([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "export";
  return { name, blob: await response.blob() };
}
