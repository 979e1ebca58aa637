// What the page asks of the program: calls over one WebSocket, and exports over plain HTTP.  The addresses are relative, so that the
// page works below the path of any proxy.  A program that stops is waited for: it comes back under the same address.

const SOONEST = 400, LATEST = 3000; // milliseconds between attempts to find the program again

let socket, open, waiting = []; // { resolve, reject } of calls without an answer yet, in their order, which is that of the answers
let handlers = { lost: () => {}, back: () => {} };

/** Raised by calls while the program is gone. */
export class Gone extends Error {}

/** `lost(reason)` hears that the program can't be asked any more, `back()` that it can again. */
export const listen = given => { handlers = given; };

let ready = connected();

/** Resolves when the socket is open, or can't be opened. */
function connected() {
  return new Promise(resolve => {
    const created = new WebSocket(new URL("ws", document.baseURI).href.replace(/^http/, "ws"));
    created.binaryType = "arraybuffer";
    created.onmessage = event => {
      const answer = unpacked(event.data), { resolve: take, reject } = waiting.shift();
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

/** An answer with pictures; throws an Error that says in a sentence why there is none. */
export const frame = request => call("frame", request);

/** The stored picture nearest to what a request for pictures shows, or null. */
export const nearest = async request => (await call("nearest", request)).found;

async function call(name, request) {
  if (open === undefined) await ready; // of the first connection
  if (!open || socket.readyState !== WebSocket.OPEN) throw new Gone("The explorer has stopped.");
  return new Promise((resolve, reject) => {
    waiting.push({ resolve, reject });
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

/** A file to be saved: { name, blob }. */
export async function exported(request) {
  const response = await fetch("export", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(request) });
  if (!response.ok) {
    const refusal = await response.json().catch(() => ({}));
    throw new Error(refusal.error ?? `the explorer refused (${response.status})`);
  }
  const name = /filename="([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "export";
  return { name, blob: await response.blob() };
}
