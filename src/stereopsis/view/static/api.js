/** Talks to the server; every failure becomes a `Refused` whose message is one sentence. */

export class Refused extends Error {
  constructor(message, status = 0) {
    super(message);
    this.status = status;
  }
}

/** What the server knows this tab by: a new computation replaces the tab's older one. */
export const client = Array.from(crypto.getRandomValues(new Uint32Array(4)), (n) => n.toString(16).padStart(8, "0")).join("");

async function ask(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("The server does not answer: is stereopsis view still running?");
  }
  if (response.ok) return response;
  let sentence = `The server answered ${response.status} ${response.statusText}.`;
  try {
    sentence = (await response.json()).error ?? sentence;
  } catch {
    // Not JSON: the status has to do.
  }
  throw new Refused(sentence, response.status);
}

export async function getJSON(path, signal) {
  return (await ask(path, { signal })).json();
}

export async function postJSON(path, body, signal) {
  const headers = { "Content-Type": "application/json" };
  return (await ask(path, { method: "POST", headers, body: JSON.stringify(body), signal })).json();
}

export async function postForm(path, form) {
  return (await ask(path, { method: "POST", body: form })).json();
}

const ARRAYS = { uint8: Uint8Array, uint16: Uint16Array, float32: Float32Array };

/** Raw little-endian values. */
export async function getArray(path, dtype, signal) {
  return new ARRAYS[dtype](await (await ask(path, { signal })).arrayBuffer());
}

export async function getPicture(path) {
  return createImageBitmap(await (await ask(path)).blob());
}
