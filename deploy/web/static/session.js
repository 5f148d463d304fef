// The key to steer with: it comes in the fragment of the address once, and stays with this origin (a port's, too).

const PLACE = "railctl-key";
let known = { steers: false, read_only: false };

export function takeKey() {
  const found = /^#key=([\w-]{20,})$/.exec(location.hash);
  if (found === null) return;
  localStorage.setItem(PLACE, found[1]);
  history.replaceState(null, "", location.pathname + location.search);
}

const headers = () => {
  const key = localStorage.getItem(PLACE);
  return key === null ? {} : { "X-Railctl-Key": key };
};

/** Ask whether this page may steer; the answer changes when the server is another one. */
export async function refreshSession() {
  try {
    known = await (await fetch("/api/session", { headers: headers() })).json();
  } catch {
    known = { steers: false, read_only: false };
  }
  return known;
}

export const steers = () => known.steers;
export const whyNot = () => (known.read_only
  ? "Started with --read-only"
  : "Read-only here: open the address that railctl watch prints, which has a key");

async function answer(response) {
  const document = await response.json().catch(() => ({ error: `${response.status} ${response.statusText}` }));
  if (!response.ok) throw new Error(document.error ?? `${response.status} ${response.statusText}`);
  return document;
}

export const get = async (path, values = {}, signal = undefined) =>
  answer(await fetch(`${path}?${new URLSearchParams(values)}`, { signal }));

export const post = async (path, body) =>
  answer(await fetch(path, { method: "POST", headers: { ...headers(), "Content-Type": "application/json" }, body: JSON.stringify(body) }));
