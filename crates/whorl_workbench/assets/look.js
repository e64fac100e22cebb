// All channels over one cursor: zoom, pan, marks of what is wrong; one signal against another, expressions, histogram, spectrum.
import { call, series } from "/assets/interface.js";
import { address, digits, h, put } from "/assets/parts.js";
import { attempt } from "/assets/data.js";
import * as signals from "/assets/signals.js";

const place = document.querySelector("#look .body");
const HEIGHT = 150;
// Numbers of a signal that are asked for: an hour at 100 Hz, whole.
const MOST = 400_000;
const MARKS = { gap: "--soft", held: "--c5", left_out: "--bad", rest: "--c2" };
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

let data = null;
let other = null;
let own = [];
let lanes = [];
let span = null;
let shown = "";
let pending = false;
let told = 0;

export async function render(state) {
  const read = new Map(state.looked.map((row) => [row.file, row.number]));
  const runs = [...state.choice.runs, ...state.choice.held_out].filter((run) => read.has(run));
  const all = [...new Set([...runs, ...read.keys()])];
  if (!all.length) { if (shown !== "none") { shown = "none"; clear(); put(place, h("p", { className: "caption" }, "A recording that is chosen is drawn here.")); } return; }
  const wanted = address.get("run");
  const run = all.includes(wanted) ? wanted : all[0];
  const key = JSON.stringify([all, run, read.get(run), read.get(address.get("beside"))]);
  if (key === shown) return;
  shown = key;
  const found = await attempt(() => series(run, MOST));
  if (!found) { shown = ""; return; }
  data = found;
  const second = address.get("beside");
  other = second && second !== run && all.includes(second) ? await attempt(() => series(second, MOST)) : null;
  document.body.dataset.drawnRun = run;
  draw(all, run, state);
}

function clear() { lanes.forEach((lane) => lane.u.destroy()); lanes = []; }

function groups() {
  const found = new Map();
  const more = other ? other.signals.map((signal) => ({ ...signal, name: `${signal.name} (${other.file})`, dashed: true })) : [];
  for (const signal of [...data.signals, ...own, ...more]) { if (!found.has(signal.group)) found.set(signal.group, []); found.get(signal.group).push(signal); }
  return found;
}

function draw(all, run, state) {
  clear();
  const from = Number(address.get("from")), to = Number(address.get("to"));
  span = to > from ? [from, to] : [...data.span_s];
  const hidden = new Set((address.get("hidden") || "").split(",").filter(Boolean));
  const select = h("select", { "aria-label": "Recording", onchange: (e) => { address.set({ run: e.target.value, from: null, to: null }); shown = ""; render(state); } }, all.map((name) => h("option", { value: name }, name)));
  select.value = run;
  const names = [...groups().keys()];
  const boxes = names.map((name) => h("label", {}, h("input", { type: "checkbox", checked: !hidden.has(name), onchange: (e) => { e.target.checked ? hidden.delete(name) : hidden.add(name); address.set({ hidden: [...hidden].join(",") }); draw(all, run, state); } }), name));
  const expression = h("input", { type: "text", placeholder: "norm(gyro_x, gyro_y)", "aria-label": "A derived signal, as an expression", size: 26 });
  const refused = h("span", { role: "alert", className: "soft" });
  const add = (e) => {
    e.preventDefault();
    try { const signal = signals.derived(expression.value, [...data.signals, ...own]); own = [...own.filter((other) => other.name !== signal.name), signal]; address.set({ more: own.map((s) => s.name).join(";") }); draw(all, run, state); } catch (error) { refused.textContent = error.message; }
  };
  const kinds = [...new Set(data.marks.map((mark) => mark.kind))];
  const use = (held_out) => attempt(() => call("stretch", { file: run, from_s: span[0], to_s: span[1], held_out }));
  const beside = h("select", { "aria-label": "Another recording, drawn beside", onchange: (e) => { address.set({ beside: e.target.value }); shown = ""; render(state); } }, h("option", { value: "" }, "none"), all.filter((name) => name !== run).map((name) => h("option", { value: name }, name)));
  beside.value = other?.file || "";
  const laneBox = h("div", {});
  put(place,
    h("div", { className: "tools" }, h("label", {}, "Recording", select), h("button", { type: "button", onclick: () => zoom([...data.span_s]) }, "Show all"), h("span", { className: "soft", id: "span" }),
      all.length > 1 && h("label", {}, "beside", beside),
      data.is_mapped && h("span", { id: "stretch", className: "row", hidden: true }, "this stretch is", h("button", { type: "button", onclick: () => use(false) }, "for training"), h("button", { type: "button", onclick: () => use(true) }, "held out")),
      !data.is_mapped && h("span", { className: "origin", dataset: { is: "assumed" } }, "columns as they are in the file: units and axes are not known yet")),
    h("div", { className: "tools", role: "group", "aria-label": "Channels" }, boxes),
    h("p", { className: "key" }, "Drag: zoom. Shift and drag: pan. Ctrl and wheel: zoom. Double click: all. Keys: arrows, +, -, Home. ", kinds.map((kind) => h("span", {}, h("i", { className: kind }), { gap: "gap", held: "held: no new reading", left_out: "left out of fits: at the end of its range, or far from its neighbours", rest: "at rest" }[kind]))),
    laneBox,
    h("form", { className: "tools", onsubmit: add }, h("label", {}, "Derived signal", expression), h("button", { type: "submit" }, "Draw it"), own.length ? h("button", { type: "button", onclick: () => { own = []; address.set({ more: null }); draw(all, run, state); } }, "Remove derived") : null, refused),
    analysis(),
    data.remarks.length ? h("details", { open: !data.is_mapped }, h("summary", {}, `${data.remarks.length} remark${data.remarks.length > 1 ? "s" : ""} on this recording`), h("ul", { className: "list" }, data.remarks.map((remark) => h("li", {}, remark)))) : null);
  // What an address has of derived signals.
  const more = (address.get("more") || "").split(";").filter(Boolean);
  if (more.length && !own.length) { try { own = more.map((text) => signals.derived(text, data.signals)); } catch { own = []; } }
  for (const [name, list] of groups()) if (!hidden.has(name)) lane(laneBox, name, list);
  refresh();
}

function tones(list) {
  const axis = { x: 0, y: 1, z: 2 };
  return list.map((signal, k) => axis[signal.name.split(" (")[0].split("_").at(-1)] ?? (k + (list.length > 3 ? 0 : 3)) % 8);
}

function lane(box, name, list) {
  const noise = list.map((s) => s.noise).filter(Boolean);
  const plot = h("div", { className: "plot", tabIndex: 0, role: "img", "aria-label": `${name}: ${list.map((s) => s.name).join(", ")} over time, ${list[0].unit}` });
  box.append(h("div", { className: "lane" }, h("h3", {}, name, h("span", { className: "soft" }, ` [${list[0].unit}]${noise.length ? `, noise ${digits(Math.max(...noise), 2)}` : ""}`)), plot));
  const colours = tones(list);
  const axis = (extra) => ({ stroke: () => css("--axis"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { stroke: () => css("--grid"), width: 1 }, font: "11px system-ui, sans-serif", ...extra });
  const u = new uPlot({
    width: Math.max(200, plot.clientWidth), height: HEIGHT + (list.length > 4 ? 20 : 0), padding: [6, 8, 0, 0],
    scales: { x: { time: false }, y: { range: (_, low, high) => (low === null ? [0, 1] : uPlot.rangeNum(low, high, 0.08, true)) } },
    series: [{ label: "time [s]", value: (_, v) => digits(v, 6) }, ...list.map((signal, k) => ({ label: signal.name, stroke: () => css(`--c${colours[k]}`), width: devicePixelRatio > 1 ? 1.2 : 1, dash: signal.dashed ? [5, 3] : undefined, points: { show: false }, spanGaps: true, paths: signal.holds && signal.group !== "jets" ? uPlot.paths.stepped({ align: 1 }) : undefined, value: (_, v) => digits(v, 4) }))],
    axes: [axis({ size: 28 }), axis({ size: 58 })],
    legend: { markers: { width: 2, stroke: (_, i) => (i ? css(`--c${colours[i - 1]}`) : "transparent"), fill: (_, i) => (i ? css(`--c${colours[i - 1]}`) : "transparent") } },
    cursor: { sync: { key: "look", setSeries: false }, y: false, drag: { x: true, y: false, setScale: false, dist: 4 }, points: { size: 5 } },
    hooks: {
      setSelect: [(self) => { if (self.select.width > 3) zoom([self.posToVal(self.select.left, "x"), self.posToVal(self.select.left + self.select.width, "x")]); self.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false); }],
      drawClear: [(self) => marks(self, name)],
      setCursor: [(self) => { if (self.cursor.left >= 0 && self.cursor.event) whorl.setTime(self.posToVal(self.cursor.left, "x")); }],
    },
  }, [[], ...list.map(() => [])], plot);
  const one = { u, list, plot };
  lanes.push(one);
  pointer(one);
  new ResizeObserver(() => { if (plot.clientWidth > 0 && plot.clientWidth !== u.width && plot.isConnected) { u.setSize({ width: plot.clientWidth, height: u.height }); refresh(); } }).observe(plot);
}

function marks(u, group) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const mark of data.marks) {
    if (mark.group && mark.group !== group) continue;
    const [from, to] = [u.valToPos(mark.from_s, "x", true), u.valToPos(mark.to_s, "x", true)];
    if (to < bbox.left || from > bbox.left + bbox.width) continue;
    ctx.fillStyle = css(MARKS[mark.kind]);
    ctx.globalAlpha = mark.kind === "rest" ? 0.1 : 0.28;
    ctx.fillRect(from, bbox.top, Math.max(to - from, 2), bbox.height);
  }
  ctx.restore();
}

// Panning and zooming by hand.
function pointer({ u, plot }) {
  const over = u.over;
  let pan = null;
  over.addEventListener("pointerdown", (e) => { if (e.shiftKey || e.button === 1) { pan = { x: e.clientX, span: [...span] }; over.setPointerCapture(e.pointerId); e.preventDefault(); e.stopImmediatePropagation(); } }, true);
  over.addEventListener("mousedown", (e) => { if (e.shiftKey || e.button === 1) e.stopImmediatePropagation(); }, true);
  over.addEventListener("pointermove", (e) => { if (pan) { const shift = ((pan.x - e.clientX) / over.clientWidth) * (pan.span[1] - pan.span[0]); zoom([pan.span[0] + shift, pan.span[1] + shift]); } });
  over.addEventListener("pointerup", () => (pan = null));
  over.addEventListener("wheel", (e) => { if (!e.ctrlKey) return; e.preventDefault(); about(u.posToVal(e.offsetX, "x"), e.deltaY > 0 ? 1.2 : 1 / 1.2); }, { passive: false });
  over.addEventListener("dblclick", (e) => { e.stopImmediatePropagation(); zoom([...data.span_s]); }, true);
  plot.addEventListener("keydown", (e) => {
    const length = span[1] - span[0], middle = (span[0] + span[1]) / 2;
    const to = { ArrowLeft: () => zoom(span.map((s) => s - 0.1 * length)), ArrowRight: () => zoom(span.map((s) => s + 0.1 * length)), "+": () => about(middle, 0.8), "=": () => about(middle, 0.8), "-": () => about(middle, 1.25), Home: () => zoom([...data.span_s]) }[e.key];
    if (to) { e.preventDefault(); to(); }
  });
}

function about(centre, factor) { zoom([centre - (centre - span[0]) * factor, centre + (span[1] - centre) * factor]); }

function zoom([from, to]) {
  const whole = data.span_s[1] - data.span_s[0];
  let length = Math.min(whole, Math.max(to - from, whole * 1e-6));
  from = Math.max(data.span_s[0], Math.min(from, data.span_s[1] - length));
  span = [from, from + length];
  const all = length >= whole * 0.999999;
  // Browsers bound how often an address changes.
  clearTimeout(told);
  told = setTimeout(() => address.set({ from: all ? null : span[0].toFixed(4), to: all ? null : span[1].toFixed(4) }), 250);
  if (!pending) { pending = true; requestAnimationFrame(() => { pending = false; refresh(); }); }
}

// Every lane anew, thinned to the columns of the screen.
function refresh(all = false) {
  const [from, to] = span;
  for (const one of lanes) {
    const { u, list, plot } = one;
    // What is out of sight is drawn when it comes into sight.
    const { top, bottom } = plot.getBoundingClientRect();
    one.is_late = !all && (bottom < -200 || top > innerHeight + 200);
    if (one.is_late) continue;
    const columns = Math.max(100, Math.round(u.bbox.width / devicePixelRatio) || 600);
    const of = new Map();
    for (const signal of list) of.set(signal.t, [...(of.get(signal.t) || []), signal]);
    const tables = [...of.values()].map((those) => signals.thin(those, from, to, columns));
    const order = [...of.values()].flat();
    const joined = tables.length > 1 ? uPlot.join(tables) : tables[0];
    const table = [joined[0], ...list.map((signal) => joined[1 + order.indexOf(signal)])];
    u.batch(() => { u.setData(table, false); u.setScale("x", { min: from, max: to }); u.setScale("y", extent(tables)); });
  }
  const said = document.getElementById("span");
  if (said) said.textContent = `${digits(from, 6)} to ${digits(to, 6)} s`;
  const whole = to - from >= (data.span_s[1] - data.span_s[0]) * 0.999;
  const stretch = document.getElementById("stretch");
  if (stretch) stretch.hidden = whole;
  document.body.dataset.frames = Number(document.body.dataset.frames || 0) + 1;
}

function extent(tables) {
  let [low, high] = [Infinity, -Infinity];
  for (const [, ...all] of tables) for (const y of all) for (const v of y) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
  if (!(low <= high)) return { min: 0, max: 1 };
  const pad = 0.06 * (high - low) || Math.abs(high) * 0.1 || 1;
  return { min: low - pad, max: high + pad };
}

// One signal against another; its distribution, spectrum, and whether its noise is white: of the stretch that is shown.
function analysis() {
  const all = [...data.signals, ...own];
  const pick = (label, key, fallback) => {
    const select = h("select", { "aria-label": label }, h("option", { value: "" }, "time"), all.map((s) => h("option", { value: s.name }, s.name)));
    select.value = address.get(key) || fallback;
    return select;
  };
  const y = pick("Signal", "y", all[0]?.name || ""), x = pick("Against", "x", ""), kind = h("select", { "aria-label": "What is drawn" }, [["xy", "against"], ["histogram", "histogram"], ["spectrum", "spectrum"], ["whiteness", "whiteness of its noise"]].map(([value, words]) => h("option", { value }, words)));
  kind.value = address.get("tool") || "spectrum";
  const plot = h("div", { className: "plot", role: "img", tabIndex: 0, id: "analysis_plot" });
  const said = h("p", { className: "caption" });
  let chart = null;
  const go = () => {
    address.set({ y: y.value, x: x.value, tool: kind.value });
    chart?.remove();
    chart = null;
    const signal = all.find((s) => s.name === y.value), other = all.find((s) => s.name === x.value);
    if (!signal) return;
    const [from, to] = span;
    const spec = { id: "analysis", xlabel: "", ylabel: `${signal.name} [${signal.unit}]`, curves: [], bands: [], limits: [], spans: [], log: false, logx: false, time: false, height: 260 };
    const curve = (n, points, c = 0) => ({ n, c, x: points.x, y: points.y });
    if (kind.value === "xy") {
      if (!other) { said.textContent = "Choose what it is drawn against."; return; }
      const [t] = signals.thin([signal], from, to, 4000);
      const points = t.map((time) => [signals.at(other, time), signals.at(signal, time)]).filter(([a, b]) => Number.isFinite(a) && Number.isFinite(b)).sort((a, b) => a[0] - b[0]);
      spec.xlabel = `${other.name} [${other.unit}]`;
      spec.curves = [curve(signal.name, { x: points.map((p) => p[0]), y: points.map((p) => p[1]) })];
      spec.dots = true;
      said.textContent = `${signal.name} against ${other.name}, each at the times of ${signal.name}.`;
    } else if (kind.value === "histogram") {
      const found = signals.histogram(signal, from, to);
      if (!found) { said.textContent = "It does not change."; return; }
      Object.assign(spec, { xlabel: `${signal.name} [${signal.unit}]`, ylabel: "readings", curves: [curve(signal.name, found)] });
      said.textContent = "How often each value was read in the stretch that is shown.";
    } else if (kind.value === "spectrum") {
      const found = signals.spectrum(signal, from, to);
      if (!found) { said.textContent = "Too few readings for a spectrum."; return; }
      Object.assign(spec, { xlabel: "frequency [Hz]", ylabel: `density [(${signal.unit})²/Hz]`, log: true, logx: true, curves: [curve(signal.name, found)] });
      said.textContent = "Power spectral density (Welch, Hann windows that overlap by half) of the stretch that is shown.";
    } else {
      const found = signals.whiteness(signal, from, to);
      if (!found) { said.textContent = "Too few readings."; return; }
      Object.assign(spec, { xlabel: "lag [readings]", ylabel: "autocorrelation", curves: [curve(signal.name, found)], bands: [{ c: null, x: [1, found.x.length], low: [-found.band, -found.band], high: [found.band, found.band] }] });
      said.textContent = "Autocorrelation of what a mean over 21 readings leaves (which by itself makes it slightly negative). White noise stays near the band (99 %).";
    }
    plot.setAttribute("aria-label", `${kind.selectedOptions[0].textContent}: ${signal.name}`);
    chart = whorl.figure(plot, spec);
  };
  for (const select of [x, y, kind]) select.addEventListener("change", go);
  const details = h("details", { open: Boolean(address.get("tool")) }, h("summary", {}, "Signal against signal, histogram, spectrum, whiteness"), h("div", { className: "tools" }, h("label", {}, "Signal", y), h("label", {}, "as", kind), h("label", {}, "against", x), h("button", { type: "button", onclick: go }, "Draw the stretch that is shown")), said, plot);
  details.addEventListener("toggle", () => { if (details.open && !chart) go(); });
  return details;
}

addEventListener("scroll", () => { if (!pending && lanes.some((lane) => lane.is_late)) { pending = true; requestAnimationFrame(() => { pending = false; refresh(); }); } }, { passive: true });
addEventListener("beforeprint", () => { if (data) refresh(true); });
whorl.redrawMore = () => lanes.forEach(({ u }) => u.redraw());
