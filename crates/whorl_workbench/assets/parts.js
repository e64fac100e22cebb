// Pieces of the page: elements, figures, bars, changes of files, and the address of what is shown.
export function h(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(props)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "dataset") Object.assign(element.dataset, value);
    else if (key === "style") Object.assign(element.style, value);
    else if (key in element && key !== "list" && key !== "role") element[key] = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat(4).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const signs = (text) => text.replaceAll("+-", "±").replaceAll(" -> ", " → ");
// Names of parameters end with their unit, which stands beside the number.
export const parameter = (p) => { const end = `_${p.unit.toLowerCase().replaceAll(/[ /^]+/g, "_")}`; return (p.name.endsWith(end) ? p.name.slice(0, -end.length) : p.name).replaceAll("_", " "); };

export const sentences = (list) => list.map((sentence, k) => h("p", { className: k ? "" : "answer" }, signs(sentence)));
export const digits = (value, count = 3) => (value === null || value === undefined || !Number.isFinite(value) ? "–" : Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3) ? value.toExponential(count - 1) : String(+value.toPrecision(count)));
export const times = (value) => (value === null || value === undefined ? "–" : value < 10 ? value.toFixed(2) : digits(value));

// Draws figures into new places; those of an earlier answer are forgotten.
export function figures(list, { wide = 0 } = {}) {
  const drawn = [];
  const place = h("div", { className: "figures" });
  list.forEach((figure, k) => {
    const id = `f_${figure.spec.id}`;
    const plot = h("div", { className: "plot", id, tabIndex: 0, role: "img", "aria-label": figure.spoken });
    place.append(h("div", { className: k < wide ? "figure wide_one" : "figure" }, h("h3", {}, figure.title), h("p", { className: "caption" }, signs(figure.caption)), plot));
    drawn.push([plot, figure.spec]);
  });
  let charts = [];
  // Once it is in the page: a plot is as wide as its place.
  const draw = () => { charts = drawn.map(([plot, spec]) => whorl.figure(plot, whorl.unpacked(spec))); };
  addEventListener("beforeprint", () => { if (!charts.length && place.isConnected) draw(); });
  const observer = new IntersectionObserver((entries) => { if (entries.some((e) => e.isIntersecting) && !charts.length) draw(); }, { rootMargin: "400px" });
  observer.observe(place);
  place.forget = () => { observer.disconnect(); charts.forEach((chart) => chart.remove()); };
  return place;
}

// Puts content into a place; figures that stood there are forgotten.
export function put(place, ...content) {
  place.querySelectorAll(".figures").forEach((old) => old.forget && old.forget());
  place.replaceChildren(...content.flat(4).filter(Boolean));
}

export function bars(rows, { most = null, unit = "" } = {}) {
  const largest = most ?? Math.max(1e-12, ...rows.map((row) => row.value || 0));
  return h("div", { className: "bars" }, rows.map((row) => [
    h("span", {}, row.name),
    h("div", { className: "bar_of", "aria-hidden": "true" }, h("i", { className: row.className || "", style: { width: `${Math.min(100, (100 * (row.value || 0)) / largest)}%` } })),
    h("output", {}, row.said ?? `${digits(row.value)}${unit}`),
  ]));
}

// Lines of a file before and after: longest common subsequence, of files of a few hundred lines.
export function lines(before, after) {
  const [a, b] = [before.split("\n"), after.split("\n")];
  if (a.length * b.length > 4e6) return b.map((line) => ["new", line]);
  const length = Array.from({ length: a.length + 1 }, () => new Uint16Array(b.length + 1));
  for (let i = a.length - 1; i >= 0; i--) for (let j = b.length - 1; j >= 0; j--) length[i][j] = a[i] === b[j] ? length[i + 1][j + 1] + 1 : Math.max(length[i + 1][j], length[i][j + 1]);
  const all = [];
  for (let i = 0, j = 0; i < a.length || j < b.length; ) {
    if (i < a.length && j < b.length && a[i] === b[j]) { all.push(["same", a[i]]); i++; j++; }
    else if (j >= b.length || (i < a.length && length[i + 1][j] >= length[i][j + 1])) all.push(["old", a[i++]]);
    else all.push(["new", b[j++]]);
  }
  return all;
}

export function changes(list, open = true) {
  const around = 2;
  return list.map((change) => {
    const all = change.before ? lines(change.before, change.after) : change.after.split("\n").map((line) => ["new", line]);
    const near = all.map((_, k) => all.slice(Math.max(0, k - around), k + around + 1).some(([kind]) => kind !== "same"));
    return h("details", { open }, h("summary", {}, `${change.file}: `, change.before ? "what was written" : "a new file"),
      h("pre", { tabIndex: 0, "aria-label": `${change.file}, lines changed` }, all.map(([kind, line], k) => near[k] && h("span", { className: kind }, line || " "))));
  });
}

export function command(text) {
  const copied = h("span", { role: "status", className: "soft" });
  return h("div", { className: "command" }, h("code", {}, text),
    h("button", { type: "button", title: "Copies the command that does the same", onclick: async () => { await navigator.clipboard?.writeText(text); copied.textContent = "copied"; } }, "Copy"), copied);
}

// The address of what is shown: `#at=compare&run=swing.csv&from=2&to=8`.
const listeners = new Map();
export const address = {
  get: (key) => new URLSearchParams(location.hash.slice(1)).get(key),
  set(values) {
    const all = new URLSearchParams(location.hash.slice(1));
    for (const [key, value] of Object.entries(values)) value === null || value === "" ? all.delete(key) : all.set(key, value);
    history.replaceState(null, "", all.size ? `#${all}` : location.pathname);
  },
  on: (key, listener) => listeners.set(key, listener),
};
addEventListener("hashchange", () => listeners.forEach((listener) => listener()));
export const show = (id) => { address.set({ at: id }); document.getElementById(id)?.scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" }); };
