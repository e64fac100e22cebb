// The page: follows the state of the program and draws what has changed of it.
import { call, follow, text } from "/assets/interface.js";
import { address, h, put, show } from "/assets/parts.js";
import * as data from "/assets/data.js";
import * as look from "/assets/look.js";
import * as path from "/assets/path.js";
import * as platform from "/assets/platform.js";
import { follow as guide, tour } from "/assets/tour.js";

const $ = (id) => document.getElementById(id);
let state = null;
const answers = {};
const dismissed = new Set();
let local = 0;
const ownNotices = [];

function tell(words, kind = "failed") {
  ownNotices.push({ number: `own${local++}`, kind, text: words });
  if (ownNotices.length > 3) ownNotices.shift();
  drawNotices();
}

// How the command says that it can be told to.
const ANYWAY = "; --anyway overrides this";
const leaving = new Set();
function drawNotices() {
  // What went well needs no answer.
  for (const notice of state?.notices || []) if (notice.kind === "done" && !leaving.has(notice.number)) { leaving.add(notice.number); setTimeout(() => { dismissed.add(notice.number); drawNotices(); }, 15_000); }
  const all = [...(state?.notices || []), ...ownNotices].filter((notice) => !dismissed.has(notice.number));
  $("notices").replaceChildren(...all.slice(-4).map((notice) => h("div", { className: "notice", dataset: { is: notice.kind, what: notice.what || "" } }, h("span", {}, notice.text.replace(ANYWAY, ".")), notice.text.includes(ANYWAY) && path.anyway() ? h("button", { type: "button", className: "anyway", onclick: () => { dismissed.add(notice.number); path.anyway()(); drawNotices(); } }, "Adopt it anyway") : null,
    h("button", { type: "button", className: "plain", "aria-label": `Dismiss: ${notice.text}`, onclick: () => { dismissed.add(notice.number); drawNotices(); } }, "×"))));
}

let began = null;
function drawJob() {
  const job = state?.job;
  const place = $("working");
  place.hidden = !job;
  document.body.dataset.busy = job ? job.what : "";
  if (!job) { began = null; return; }
  if (began?.number !== job.number) {
    began = { number: job.number, at: performance.now() - 1000 * job.elapsed_s };
    const stop = h("button", { type: "button", id: "stop", onclick: () => data.attempt(() => call("stop", job.number)) }, "Stop");
    place.replaceChildren(h("div", {}, h("b", { id: "job_title" }, job.title), " ", h("span", { id: "job_time", className: "soft" })), stop, h("progress", { id: "job_share", max: 1, "aria-label": job.title }), h("ol", { id: "job_stages" }));
  }
  $("job_share").value = job.share || 0.01;
  $("stop").disabled = job.stops;
  $("stop").textContent = job.stops ? "stopping" : "Stop";
  $("job_stages").replaceChildren(...job.stages.map((stage) => h("li", {}, `${stage.doing} `, h("span", { className: "soft" }, `from ${stage.began_s.toFixed(1)} s`))), ...state.queue.map((words) => h("li", { className: "soft" }, `then: ${words}`)));
  $("job_stages").scrollTop = 1e6;
}
setInterval(() => { const at = $("job_time"); if (at && began) at.textContent = `${((performance.now() - began.at) / 1000).toFixed(0)} s`; }, 250);

// Answers are fetched when their number changes.
async function fetchAnswers(of) {
  for (const row of of.answers) {
    if (answers[row.what]?.number !== row.number) {
      const answer = await data.attempt(() => call("answer", { of: row.what }));
      if (answer) answers[row.what] = answer;
    }
  }
}

let last = Promise.resolve();
function changed(next) {
  $("connection").textContent = "connected";
  $("connection").dataset.is = "open";
  if (state && next.version < state.version && next.folder === state.folder && !restarted) return;
  restarted = false;
  state = next;
  document.body.dataset.version = state.version;
  $("about").textContent = `${state.folder}${state.model ? `, ${state.model.platform}` : ""}`;
  drawJob();
  drawNotices();
  last = last.then(async () => {
    const now = state;
    await fetchAnswers(now);
    data.render(now, answers);
    path.render(now, answers);
    await look.render(now);
    await platform.render(now);
    if (!document.body.dataset.drawn) arrive();
    guide();
    document.body.dataset.drawn = now.version;
  }).catch((error) => tell(`the page could not draw this: ${error.message}`));
}
let restarted = false;

function lost(why) {
  restarted = true;
  $("connection").textContent = why;
  $("connection").dataset.is = "lost";
}

// At the place that the address names.
function arrive() {
  const at = address.get("at");
  if (at) requestAnimationFrame(() => document.getElementById(at)?.scrollIntoView());
}
address.on("at", arrive);

$("export").addEventListener("click", () => data.attempt(async () => {
  const page = await text("export");
  const link = h("a", { href: URL.createObjectURL(new Blob([page], { type: "text/html" })), download: `${state.model?.platform || "whorl"}.html` });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  document.body.dataset.exported = page.length;
}));
$("tour").addEventListener("click", () => tour(() => answers));
data.start(tell);
path.start();
document.addEventListener("click", (e) => { const step = e.target.closest?.("a.step"); if (step) { e.preventDefault(); show(step.dataset.to); } });
follow(changed, lost);
put($("where_path"), path.steps(null, {}));
