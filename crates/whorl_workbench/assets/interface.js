// What the page and the program say to each other: see api.schema.json.
const KEPT = "whorl-token";

// The token comes in the fragment of the address, which browsers send to nobody, and is kept for this address alone.
const given = new URLSearchParams(location.hash.slice(1));
if (given.get("token")) {
  localStorage.setItem(KEPT, given.get("token"));
  given.delete("token");
  history.replaceState(null, "", `${location.pathname}${given.size ? `#${given}` : ""}`);
}
const token = () => localStorage.getItem(KEPT) || "";

export class Refused extends Error {}

async function request(path, body, headers = {}) {
  const answer = await fetch(`/api/${path}`, { method: "POST", body, headers: { Authorization: `Bearer ${token()}`, ...headers } });
  if (!answer.ok) throw new Refused((await answer.text()).trim());
  return answer;
}

export const call = async (path, value) => (await request(path, value === undefined ? "" : JSON.stringify(value))).json();
export const text = async (path) => (await request(path, "")).text();

// A header is ASCII: other letters as JSON writes them.
const ascii = (name) => JSON.stringify(name).replace(/[^\x20-\x7e]/g, (c) => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`);
export const upload = (name, file) => request("file", file, { "x-name": ascii(name) });

// Samples: a head, then times as float64 and values as float32.
export async function series(file, most, from_s = null, to_s = null) {
  const buffer = await (await request("series", JSON.stringify({ file, most, from_s, to_s }))).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const start = 4 + length;
  const times = new Map();
  for (const signal of head.signals) {
    if (!times.has(signal.times_at)) times.set(signal.times_at, new Float64Array(buffer, start + signal.times_at, signal.count));
    signal.t = times.get(signal.times_at);
    signal.v = new Float32Array(buffer, start + signal.values_at, signal.count);
  }
  return head;
}

// The state, whenever it changes; `lost` while the program is not there.
export function follow(changed, lost) {
  let wait = 300;
  const connect = () => {
    const socket = new WebSocket(`ws://${location.host}/api/states`, token() ? ["whorl", token()] : ["whorl"]);
    let was = false;
    socket.onmessage = (message) => { was = true; wait = 300; if (message.data) changed(JSON.parse(message.data)); };
    socket.onclose = async () => {
      let why = "the program has ended";
      // A server that is there and refuses knows another token.
      if (!was) {
        try {
          const answer = await fetch("/api/state", { method: "POST", headers: { Authorization: `Bearer ${token()}` } });
          if (answer.status === 401) why = "this address has no token, or that of an earlier start: open the one that whorl open printed";
        } catch { /* nobody is there */ }
      }
      lost(why);
      setTimeout(connect, wait);
      wait = Math.min(5000, wait * 1.6);
    };
  };
  connect();
}
