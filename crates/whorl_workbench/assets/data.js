// Recordings and model: bring files, choose what they are for, see what a file is taken to be, correct it.
import { call, upload } from "/assets/interface.js";
import { changes, command, h, put, sentences } from "/assets/parts.js";

const size = (bytes) => (bytes > 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.max(1, Math.round(bytes / 1e3))} kB`);
const RIGS = [["", "what the file looks like"], ["table", "table: on an air bearing or a ball"], ["hinge", "hinge: a pendulum, a turntable"], ["wheel_bench", "wheel bench: wheels in a stand"], ["free", "free: a spacecraft, a drone"]];

let tell = () => {};
let imported = null;
let shown = "";
const place = document.querySelector("#data .body");

// What failed is said; what worked shows by itself.
export const attempt = async (work) => { try { return await work(); } catch (error) { tell(error.message); return null; } };

export async function bring(list) {
  for (const { name, file } of list) await attempt(() => upload(name, file));
}

// Files and folders that are dropped: a bag is a folder.
async function dropped(items) {
  const found = [];
  const walk = async (entry, below, depth) => {
    if (entry.isFile) { found.push({ name: below + entry.name, file: await new Promise((done, failed) => entry.file(done, failed)) }); return; }
    if (depth > 2) return;
    const reader = entry.createReader();
    for (;;) {
      const batch = await new Promise((done, failed) => reader.readEntries(done, failed));
      if (!batch.length) return;
      for (const inner of batch) await walk(inner, `${below}${entry.name}/`, depth + 1);
    }
  };
  for (const entry of [...items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean)) await walk(entry, "", 0);
  return found;
}

export function start(say) {
  tell = say;
  const cover = document.getElementById("drop");
  let depth = 0;
  addEventListener("dragenter", (e) => { if (e.dataTransfer?.types.includes("Files")) { depth++; cover.hidden = false; } });
  addEventListener("dragleave", () => { if (--depth <= 0) { depth = 0; cover.hidden = true; } });
  addEventListener("dragover", (e) => e.preventDefault());
  addEventListener("drop", async (e) => {
    e.preventDefault();
    depth = 0;
    cover.hidden = true;
    await bring(await dropped(e.dataTransfer.items));
  });
}

const role = (state, path) => (state.choice.runs.includes(path) ? "training" : state.choice.held_out.includes(path) ? "held_out" : "none");

function choose(state, change) {
  attempt(() => call("choose", { ...state.choice, ...change }));
}

function assign(state, path, to) {
  const without = (list) => list.filter((run) => run !== path);
  const choice = { runs: without(state.choice.runs), held_out: without(state.choice.held_out) };
  if (to === "training") choice.runs.push(path);
  if (to === "held_out") choice.held_out.push(path);
  choose(state, choice);
}

function picker(state, kind, key, label, none) {
  const files = state.files.filter((file) => file.kind === kind);
  const select = h("select", { "aria-label": label, onchange: (e) => choose(state, { [key]: e.target.value || null }) }, h("option", { value: "" }, none), files.map((file) => h("option", { value: file.path }, file.path)));
  select.value = state.choice[key] || "";
  return h("label", { className: "row" }, label, select, state.choice[key] && h("button", { type: "button", className: "plain", onclick: () => edit(state.choice[key]) }, "show and edit"));
}

// Which column is which axis, its sign, its unit: corrected by clicking.
async function columnsOf(state, place) {
  if (!state.choice.channels) return;
  let map;
  try { map = await call("map"); } catch { return; }
  if (!map.rows.length || !map.columns.length) return;
  const write = (row, columns, unit) => attempt(() => call("set_channel", { key: row.key, columns, unit }));
  const cell = (row, k) => {
    const [sign, name] = row.columns[k].startsWith("-") ? ["-", row.columns[k].slice(1)] : ["", row.columns[k]];
    const change = (to) => write(row, row.columns.map((column, i) => (i === k ? to : column)), null);
    const select = h("select", { "aria-label": `Column ${k + 1} of ${row.key}`, onchange: (e) => change(e.target.value === "~" ? "~" : sign + e.target.value) }, h("option", { value: "~" }, "none"), map.columns.map((column) => h("option", { value: column }, column)));
    select.value = name;
    return h("span", { className: "row", style: { display: "inline-flex", flexWrap: "nowrap" } }, row.columns.length === 3 ? h("span", { className: "soft" }, "xyz"[k]) : null, h("button", { type: "button", disabled: name === "~", "aria-pressed": sign === "-", title: "Reverses its sign", "aria-label": `Sign of column ${k + 1} of ${row.key}: ${sign === "-" ? "reversed" : "as it is"}`, onclick: () => change(sign === "-" ? name : `-${name}`) }, sign === "-" ? "−" : "+"), select);
  };
  const unit = (row) => {
    const select = h("select", { "aria-label": `Unit of ${row.key}`, onchange: (e) => write(row, row.columns, e.target.value) }, row.units.map((name) => h("option", { value: name }, name)));
    select.value = row.unit || row.units[0];
    return row.units.length > 1 ? select : row.units[0] || "";
  };
  place.replaceChildren(h("table", { className: "form", id: "columns" }, h("caption", {}, `What is what, in ${map.file}`), h("tr", {}, h("th", {}, "channel"), h("th", {}, "columns"), h("th", {}, "unit")),
    map.rows.map((row) => h("tr", {}, h("td", {}, row.key.replaceAll("_", " ")), h("td", {}, h("div", { className: "row" }, row.columns.map((_, k) => cell(row, k)))), h("td", {}, unit(row))))));
}

// The text of a platform's file or of a map; what cannot be read is refused with its line.
async function edit(file) {
  const found = await attempt(() => call("text", { file }));
  if (!found) return;
  const said = h("p", { role: "alert" });
  const area = h("textarea", { className: "text", value: found.text, spellcheck: false, "aria-label": `Text of ${file}` });
  const dialog = h("dialog", { style: { maxWidth: "min(64rem, 94vw)", width: "94vw" }, "aria-label": file }, h("h2", {}, file), area, said,
    h("div", { className: "row" }, h("button", { type: "button", className: "main", onclick: async () => {
      try { await call("write", { file, text: area.value }); dialog.close(); } catch (error) { said.textContent = error.message; }
    } }, "Write"), h("button", { type: "button", onclick: () => dialog.close() }, "Leave as it is")));
  dialog.addEventListener("close", () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}

function importer(state, run) {
  const select = h("select", { "aria-label": "Kind of rig" }, RIGS.map(([value, words]) => h("option", { value }, words)));
  return h("div", { className: "row" }, h("button", { type: "button", id: "make_model", onclick: () => attempt(() => call("ask", { what: "import", file: run, rig: select.value || null })) }, `Make platform and map of ${run}`), "as", select);
}

function made(answer) {
  const lines = answer.json.lines;
  return h("details", { open: true }, h("summary", {}, "What the file was taken to be"), sentences(answer.sentences),
    h("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Lines of both files" }, h("table", { className: "form" }, h("tr", {}, ["line", "from", "how"].map((word) => h("th", {}, word))),
      lines.filter((line) => line.from).map((line) => h("tr", {}, h("td", { className: "code" }, line.line), h("td", {}, h("span", { className: "origin", dataset: { is: line.from } }, line.from)), h("td", {}, line.how))))),
    changes(answer.changes, false), command(answer.command));
}

export function render(state, answers) {
  const key = JSON.stringify([state.files, state.choice, state.problem, state.platforms, state.model, answers.import?.number, state.notices.filter((n) => n.what === "write").length && state.notices.filter((n) => n.what === "write").at(-1).number]);
  if (key === shown) return;
  shown = key;
  imported = answers.import;
  const recordings = state.files.filter((file) => file.kind === "recording");
  const input = h("input", { type: "file", multiple: true, id: "pick", hidden: true, onchange: (e) => bring([...e.target.files].map((file) => ({ name: file.name, file }))) });
  const rows = recordings.map((file) => {
    const select = h("select", { "aria-label": `Use of ${file.path}`, onchange: (e) => assign(state, file.path, e.target.value) }, [["none", "not used"], ["training", "training: fitted"], ["held_out", "held out: tests"]].map(([value, words]) => h("option", { value }, words)));
    select.value = role(state, file.path);
    return h("tr", {}, h("td", {}, file.path), h("td", { className: "n" }, size(file.bytes)), h("td", {}, select));
  });
  const columns = h("div", { className: "wide" });
  columnsOf(state, columns);
  const first = state.choice.runs[0];
  const lacks = first && (!state.choice.model || (/\.csv(\.gz)?$/.test(first) && !state.choice.channels));
  put(place, h("div", { className: "columns" },
    h("div", {},
      h("div", { className: "dropzone" }, h("p", {}, "Drop a CSV file or a bag here, or ", h("button", { type: "button", onclick: () => input.click() }, "choose files"), input), h("p", { className: "caption" }, `They are put into ${state.folder}, and stay on this computer.`)),
      recordings.length ? null : h("p", {}, h("button", { type: "button", id: "example", onclick: () => attempt(() => call("example")) }, "Try it with an example"), " a real rig: the pendulum of a robotics laboratory, swung up by its motor, and a model without friction"),
      recordings.length ? h("table", { className: "files" }, h("caption", {}, "Recordings of the folder"), h("tr", {}, h("th", {}, "recording"), h("th", { className: "n" }, "size"), h("th", {}, "use")), rows) : null),
    h("div", {},
      state.problem && h("p", { className: "problem", id: "problem" }, state.problem),
      state.model && h("p", {}, "Platform ", h("b", {}, state.model.platform), state.model.effects.length ? ` with ${state.model.effects.join(", ")}` : ", without effects beyond the base model"),
      state.platforms.length ? h("label", { className: "row" }, "Platform", h("select", { onchange: (e) => choose(state, { platform: e.target.value || null }) }, h("option", { value: "" }, "choose"), state.platforms.map((name) => h("option", {}, name)))) : null,
      picker(state, "model", "model", "Platform's file", "that of the run"),
      picker(state, "map", "channels", "Map of columns", "none"),
      state.platforms.length ? null : first && (lacks || !state.model) ? importer(state, first) : first && h("details", {}, h("summary", {}, "Make platform and map anew"), importer(state, first)))),
    columns,
  imported && made(imported));
}
