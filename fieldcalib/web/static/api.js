// Requests to the server that this page came from; addresses are relative, so that the token stays in the path.

/** The server answered with an error: its words, its status, and the body. */
export class Refused extends Error {
  constructor(status, body) {
    super(body?.error ?? `The server answered with status ${status}.`);
    this.status = status;
    this.body = body;
  }
}

/** The server did not answer. */
export class Offline extends Error {
  constructor() {
    super("The server does not answer.");
  }
}

/** Whether the server that made this page is gone: no answer, or that of another one with another token. */
export function isGone(error) {
  return error instanceof Offline || error.status === 404;
}

/** GET; `query` becomes part of the address. */
export async function get(path, { query = {}, signal } = {}) {
  return answer(address(path, query), { signal });
}

/** POST of JSON. */
export async function post(path, body = {}) {
  return answer(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

/** An address with its query. */
export function address(path, query = {}) {
  const words = new URLSearchParams(query).toString();
  return words ? `${path}?${words}` : path;
}

async function answer(path, options) {
  let response;
  try {
    response = await fetch(path, { ...options, credentials: "omit" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Offline();
  }
  const body = await response.json().catch(() => null);
  if (!response.ok) throw new Refused(response.status, body);
  return body;
}

/** Where the pixels of a frame come from. */
export function pictureSource(frame) {
  const { number, width, height } = frame;
  return {
    key: number,
    width,
    height,
    whole: (least) => address(`image/${number}`, { width: least }),
    crop: (part, least) => address(`image/${number}/crop`, { ...part, width: least }),
  };
}
