// What the page asks of the program: calls over one WebSocket, and exports over plain HTTP.  The addresses are relative, so that the
// page works below the path of any proxy.

const waiting = []; // { resolve, reject } of calls without an answer yet, in their order, which is that of the answers
const socket = new WebSocket(new URL("ws", location.href).href.replace(/^http/, "ws"));
socket.binaryType = "arraybuffer";
socket.onmessage = event => {
  const answer = unpacked(event.data), { resolve, reject } = waiting.shift();
  if (answer.error) reject(new Error(answer.error));
  else resolve(answer);
};
const opened = new Promise(resolve => { socket.onopen = resolve; });

/** Resolves when the program can't be asked any more. */
export const stopped = new Promise(resolve => { socket.onclose = resolve; });

export const facts = () => call("facts");

/** An answer with pictures; throws an Error that says in a sentence why there is none. */
export const frame = request => call("frame", request);

/** The stored picture nearest to what a request for pictures shows, or null. */
export const nearest = async request => (await call("nearest", request)).found;

async function call(name, request) {
  await opened;
  if (socket.readyState !== WebSocket.OPEN) throw new Error("The explorer has stopped.");
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
    const said = await response.json().catch(() => ({}));
    throw new Error(said.error ?? `the explorer refused (${response.status})`);
  }
  const name = /filename="([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "export";
  return { name, blob: await response.blob() };
}
