// What the page asks of the program, over trame's connection and, for exports, over plain HTTP.

/** Resolves once trame is there and has put our place into the page. */
export function ready() {
  return new Promise(resolve => {
    const look = () => {
      const place = document.getElementById("explorer-page");
      if (place && window.trame) resolve(place);
      return Boolean(place && window.trame);
    };
    if (look()) return;
    const observer = new MutationObserver(() => { if (look()) observer.disconnect(); });
    observer.observe(document.documentElement, { childList: true, subtree: true });
  });
}

export const facts = () => window.trame.trigger("facts");

/** An answer with pictures; throws an Error that says in a sentence why there is none. */
export const frame = request => asked("frame", request);

/** The stored picture nearest to what a request for pictures shows, or null. */
export const nearest = async request => (await asked("nearest", request)).found;

async function asked(name, request) {
  const answer = await window.trame.trigger(name, [request]);
  if (!answer || answer.error) throw new Error(answer?.error ?? "the explorer gave no answer");
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
