// Compare, where, diagnose, adopt: each question with its answer, in the order of the path.
import { call } from "/assets/interface.js";
import { bars, changes, command, digits, figures, h, parameter, put, sentences, signs, times } from "/assets/parts.js";
import { attempt } from "/assets/data.js";
import { equation } from "/assets/mathml.js";

const body = (id) => document.querySelector(`#${id} .body`);
const ask = (what, more = {}) => { if (what === "adopt") wanted = more; return attempt(() => call("ask", { what, ...more })); };
// What was to be adopted last, and is adopted against an objection if a person says so.
let wanted = null;
export const anyway = () => wanted && !wanted.anyway && (() => ask("adopt", { ...wanted, anyway: true }));
const percent = (share) => `${digits(100 * share, 3)} %`;
// Errors up to here are noise: as in the command's own words.
const EXPLAINED = 1.1;
const drawn = {};
let effects = new Map();

export async function start() {
  const list = await attempt(() => call("effects"));
  effects = new Map((list || []).map((effect) => [effect.id, effect]));
}
const title = (id) => effects.get(id)?.title || id;
const named = (list) => list.map(title).join(" and ");

const row = (state, what) => state?.answers.find((answer) => answer.what === what);
const judging = (json) => json.held_out_prediction_error ?? json.prediction_error;

// The path at a glance.
export function steps(state, answers) {
  const of = (what) => {
    const there = row(state, what);
    return { answer: there && answers[what], stale: there?.is_stale, busy: state?.job?.what === what };
  };
  const compare = of("compare"), where = of("where"), diagnose = of("diagnose"), adopt = of("adopt");
  const error = compare.answer && judging(compare.answer.json);
  const top = where.answer?.json.pooled.dependences?.ranked[0];
  const verdicts = { nothing_missing: "nothing", unknown: "no known effect", not_enough_information: "cannot be told" };
  const verdict = diagnose.answer && (verdicts[diagnose.answer.json.verdict] || named(diagnose.answer.json.effects));
  const versions = adopt.answer?.json.versions;
  const list = [
    ["data", "1 Recording", { answer: state?.model }, state?.choice.runs.length ? `${state.choice.runs.length + state.choice.held_out.length} run${state.choice.runs.length + state.choice.held_out.length > 1 ? "s" : ""}${state.model ? `, ${state.model.platform}` : ""}` : "drop a file", state?.problem ? "bad" : "good"],
    ["compare", "2 Error", compare, error === undefined || error === null ? "" : `${times(error)} × noise`, error <= EXPLAINED ? "good" : "bad"],
    ["where", "3 Where", where, where.answer ? (top ? `${top.variable.replaceAll("_", " ")}, ${Math.round(100 * top.share)} %` : "nothing is left") : "", top ? "bad" : "good"],
    ["diagnose", "4 Missing", diagnose, verdict || "", diagnose.answer?.json.verdict === "nothing_missing" ? "good" : "bad"],
    ["adopt", "5 Adopted", adopt, versions ? `${times(judging(versions[0]))} → ${times(judging(versions[versions.length - 1]))}` : state?.model?.effects.length ? named(state.model.effects) : "", "good"],
  ];
  return list.map(([to, name, step, words, is]) => h("a", { className: "step", href: `#at=${to}`, dataset: { to, is: step.busy ? "busy" : !step.answer ? "" : step.stale ? "stale" : is }, title: words },
    h("b", {}, h("span", { className: "nth" }, name.slice(0, 2)), name.slice(2)), h("span", {}, step.busy ? "computing" : words || "–")));
}

// What stands above an answer: the button that asks, and whether the answer still holds.
function head(state, what, words, again) {
  const there = row(state, what);
  const can = state.choice.runs.length && !state.problem;
  return h("div", { className: "row" },
    h("button", { type: "button", id: `ask_${what}`, className: there && !there.is_stale ? "" : "main", disabled: !can, onclick: () => ask(what) }, there ? again : words),
    there?.is_stale && h("span", { className: "stale" }, "Files or choice have changed since this answer."));
}

// An answer is drawn anew when it is another, or holds no longer.
function draws(state, answers, what, more = "") {
  const there = row(state, what);
  const key = JSON.stringify([there, answers[what]?.number, !state.problem, state.choice.runs.length > 0, more]);
  if (drawn[what] === key) return false;
  drawn[what] = key;
  return true;
}

function scale(value) {
  // From 0 to twice the value; noise reaches to 1.
  const most = Math.max(2, 1.15 * value);
  const at = (x) => `${(100 * x) / most}%`;
  return h("div", { className: "scale", role: "img", "aria-label": `The error is ${times(value)} times what noise alone makes` },
    h("i", { className: "fill", style: { width: at(value) } }), h("i", { className: "noise", style: { width: at(Math.min(1, value)) } }),
    h("i", { style: { left: at(1) } }), h("span", { style: { left: `max(2.6rem, ${at(1)})` } }, "1: noise alone"), value > 1.6 ? h("span", { style: { left: at(value) } }, times(value)) : null);
}

function number(value, words) {
  return h("div", { className: `number ${value <= EXPLAINED ? "good" : "bad"}` }, times(value), " ", h("small", {}, words));
}

const unasked = (state) => ["where", "diagnose"].every((what) => !row(state, what) || row(state, what).is_stale);

function compared(state, answers) {
  if (!draws(state, answers, "compare", [state.earlier.length, unasked(state)])) return;
  const answer = row(state, "compare") && answers.compare;
  const top = head(state, "compare", "Compare", "Compare again");
  if (!answer) return put(body("compare"), top, h("p", { className: "caption" }, "Predicts every recorded channel from its start with the model and the recorded commands, and says how much larger the errors are than noise makes them."));
  const { json } = answer;
  const error = judging(json);
  if (error > EXPLAINED && unasked(state) && !row(state, "compare").is_stale) top.append(h("button", { type: "button", className: "main", id: "explain", onclick: async () => { await ask("where"); await ask("diagnose"); } }, "Find out why"));
  const channels = json.runs.flatMap((run) => run.channels.map((channel) => ({ run, channel })));
  const horizons = json.runs[0]?.channels[0]?.horizons.map((h) => h.horizon_s) || [];
  const worst = (figure) => { const found = channels.find(({ run, channel }) => run.run === figure.run && figure.title.startsWith(`${channel.name.replaceAll("_", " ")}:`)); return found ? Math.max(...found.channel.horizons.filter((h) => h.horizon_s !== null).map((h) => h.ratio)) : 0; };
  const curves = answer.figures.filter((figure) => figure.title.includes(": measured and predicted")).sort((a, b) => worst(b) - worst(a));
  const others = answer.figures.filter((figure) => !curves.includes(figure));
  put(body("compare"), top,
    error !== null && h("div", { className: "headline", id: "headline" }, number(error, json.held_out_prediction_error !== null ? "times the noise, on data that took no part" : "times what noise alone would make"), json.held_out_prediction_error !== null && json.prediction_error !== null ? h("span", { className: "soft" }, `training: ${times(json.prediction_error)}`) : null),
    error !== null && scale(error), sentences(answer.sentences.slice(0, json.runs.length)), overlays(state, answer, curves),
    figures(curves.slice(0, 3), { wide: 1 }),
    answer.sentences.length > json.runs.length && h("details", {}, h("summary", {}, "What the errors have in common"), sentences(["", ...answer.sentences.slice(json.runs.length)]).slice(1)),
    h("details", {}, h("summary", {}, "Errors by channel and horizon"), h("div", { className: "wide", tabIndex: 0 }, h("table", { className: "heat" }, h("caption", {}, "Errors over the deviation that the model predicts for them: 1 is as good as the model says"),
      h("tr", {}, h("th", {}, "run"), h("th", {}, "channel"), horizons.map((s) => h("th", { className: "n" }, s === null ? "run" : `${digits(s)} s`))),
      channels.map(({ run, channel }) => h("tr", {}, h("td", {}, run.run), h("td", {}, channel.name), channel.horizons.map((h_) => h("td", { className: `n ${h_.ratio <= EXPLAINED ? "good" : "bad"}` }, digits(h_.ratio)))))))),
    h("details", {}, h("summary", {}, "All curves, errors and what is left in them"), h("p", { className: "rule" }, `Predictions: ${json.prediction_rule}.`), figures([...curves.slice(3), ...others])),
    command(answer.command));
}

// The same channel as another version of the model predicted it, over this one.
function overlays(state, answer, curves) {
  const earlier = state.earlier.filter((row) => row.number !== answer.number);
  if (!earlier.length) return null;
  const select = h("select", { id: "overlay", "aria-label": "Overlay an earlier comparison" }, h("option", { value: "" }, "none"), earlier.map((row) => h("option", { value: row.number }, `${row.number}: ${row.of}`)));
  const place = h("div", {});
  select.addEventListener("change", async () => {
    if (!select.value) return put(place);
    const before = await attempt(() => call("answer", { of: "compare", number: Number(select.value) }));
    if (!before) return;
    const both = curves.map((figure) => {
      const old = before.figures.find((other) => other.title === figure.title && other.run === figure.run);
      if (!old) return null;
      const predicted = (spec, n, c, d) => spec.curves.filter((curve) => curve.n.includes("predicted")).map((curve) => ({ ...curve, n, c, d }));
      const spec = { ...figure.spec, id: `over_${figure.spec.id}`, bands: [], curves: [...figure.spec.curves.filter((curve) => curve.n.includes("measured")), ...predicted(figure.spec, "predicted now", 6, 0), ...predicted(old.spec, `predicted by ${select.value}`, 1, 1)] };
      return { ...figure, title: `${figure.title}, two versions`, caption: "Solid: this comparison. Dashed: the other.", spec };
    }).filter(Boolean).slice(0, 3);
    put(place, h("p", {}, `${both.length ? "" : "That was another recording: its curves have nothing in common with these. "}Then: ${times(judging(before.json))} times the noise; now: ${times(judging(answer.json))}.`), figures(both, { wide: 1 }));
  });
  return h("div", {}, h("label", { className: "row" }, "Overlay with", select), place);
}

function located(state, answers) {
  if (!draws(state, answers, "where")) return;
  const answer = row(state, "where") && answers.where;
  const top = head(state, "where", "Find where it fails", "Ask again");
  if (!answer) return put(body("where"), top, h("p", { className: "caption" }, "Finds on which recorded quantities the torque depends that the model does not explain."));
  const found = answer.json.pooled.dependences;
  const shares = [
    ...(found ? [{ name: "constant in the body", value: found.constant_body_share }] : []),
    ...(found?.ranked || []).slice(0, 6).map((d) => ({ name: `${d.variable.replaceAll("_", " ")}`, value: d.share })),
  ].map((share) => ({ ...share, said: `${Math.round(100 * share.value)} %` }));
  put(body("where"), top, sentences(answer.sentences),
    shares.length ? [h("p", { className: "caption" }, "Share of the unexplained torque's mean square, beyond noise, that a simple curve of each quantity explains. Shares overlap."), bars(shares, { most: 1 })] : null,
    figures(answer.figures), command(answer.command));
}

const VERDICT = { named: "The model lacks", confounded: "The model lacks this, or something that these data do not tell from it", unknown: "Something is missing that no effect of the catalogue explains", nothing_missing: "Nothing is missing", not_enough_information: "These data cannot show what is missing" };

function card(state, answer) {
  const { json } = answer;
  const first = json.effects.map((id) => effects.get(id)).filter(Boolean);
  const sure = json.explanations.find((e) => JSON.stringify(e.effects) === JSON.stringify(json.effects) && e.with_unknown === (json.verdict === "unknown"));
  const [before, after] = [json.versions.filter((v) => !v.effects.length).at(-1), json.versions.find((v) => v.effects.length)];
  const others = json.explanations.filter((e) => e !== sure && e.probability > 0.005).slice(0, 5);
  const parameters = json.effects.flatMap((id) => json.candidates.find((c) => c.effect === id)?.parameters || []);
  const can = !state.problem && json.effects.length;
  return h("article", { className: "card", id: "verdict", dataset: { is: json.verdict } },
    h("p", { className: "soft", style: { margin: 0 } }, VERDICT[json.verdict]),
    json.effects.length ? h("h3", {}, named(json.effects)) : null,
    first.map((effect) => [h("p", {}, signs(effect.explanation)), equation(effect.equation)]),
    h("dl", {},
      sure && [h("dt", {}, "how sure"), h("dd", {}, h("b", {}, percent(sure.probability)), " of all explanations that were weighed")],
      parameters.length ? [h("dt", {}, "how large"), h("dd", {}, parameters.map((p) => h("div", {}, `${parameter(p)} = ${digits(p.estimate)} ± ${digits(p.stddev, 2)} ${p.unit === "1" ? "" : p.unit}`)))] : null,
      before && after && [h("dt", {}, before.held_out_prediction_error === null ? "error, times the noise" : "error on data that took no part"), h("dd", {}, `${times(judging(before))} → `, h("b", {}, times(judging(after))), " times the noise")],
      others.length ? [h("dt", {}, "what else it could be"), h("dd", {}, bars(others.map((e) => ({ name: (e.effects.length ? named(e.effects) : "nothing of the catalogue") + (e.with_unknown ? " and something unknown" : ""), value: e.probability, said: percent(e.probability) })), { most: 1 }))] : null,
      json.next && [h("dt", {}, "which run would settle it"), h("dd", {}, json.next.manoeuvre)],
      json.unknown && [h("dt", {}, "what it follows"), h("dd", {}, `${json.unknown.variable.replaceAll("_", " ")}, about ${json.unknown.frame} ${json.unknown.axis}, ${Math.round(100 * json.unknown.share)} % of what is left`)]),
    h("div", { className: "row" },
      can ? h("button", { type: "button", className: "main", id: "adopt_it", onclick: () => ask("adopt", { effects: json.effects, anyway: false }) }, `Adopt ${json.effects.join(" and ")}`) : null,
      json.effects.map((id) => h("button", { type: "button", onclick: () => leaveOut(state, id) }, `Leave out ${id} and ask again`)),
      json.verdict === "unknown" || json.verdict === "not_enough_information" ? h("button", { type: "button", className: "main", id: "ask_discover", onclick: () => ask("discover") }, "Search for a law") : null));
}

async function leaveOut(state, id) {
  await attempt(() => call("choose", { ...state.choice, exclude: [...state.choice.exclude, id] }));
  await ask("diagnose");
}

function diagnosed(state, answers) {
  if (!draws(state, answers, "diagnose", [state.choice.exclude, row(state, "discover")])) return;
  const answer = row(state, "diagnose") && answers.diagnose;
  const top = head(state, "diagnose", "Diagnose", "Diagnose again");
  const excluded = state.choice.exclude.map((id) => h("button", { type: "button", title: "Takes it in again", onclick: () => attempt(() => call("choose", { ...state.choice, exclude: state.choice.exclude.filter((other) => other !== id) })) }, `left out: ${id} ×`));
  const law = row(state, "discover") && answers.discover;
  if (!answer) return put(body("diagnose"), top, h("div", { className: "row" }, excluded), h("p", { className: "caption" }, "Fits the effects of the catalogue to every sample, compares sets of them by their evidence, and says how sure the answer is."), law && laws(state, law));
  const candidates = answer.json.candidates.slice(0, 14);
  put(body("diagnose"), top, h("div", { className: "row" }, excluded), card(state, answer), answer.sentences.slice(1).filter((s) => !answer.json.remarks.includes(s)).map((s) => h("p", {}, signs(s))),
    answer.json.remarks.length ? h("details", {}, h("summary", {}, `${answer.json.remarks.length} remark${answer.json.remarks.length > 1 ? "s" : ""}`), h("ul", { className: "list" }, answer.json.remarks.map((s) => h("li", {}, signs(s))))) : null,
    figures(answer.figures),
    h("details", {}, h("summary", {}, "Every effect that was tested"), h("div", { className: "wide", tabIndex: 0 }, h("table", {}, h("tr", {}, h("th", {}, "effect"), h("th", { className: "n" }, "log evidence"), h("th", { className: "n" }, "held out"), h("th", { className: "n" }, "explains [%]"), h("th", {}, "estimate"), h("td")),
      candidates.map((c) => h("tr", {}, h("td", { title: effects.get(c.effect)?.explanation || "" }, c.effect), h("td", { className: "n" }, digits(c.delta_log_evidence)), h("td", { className: "n" }, digits(c.held_out_gain)), h("td", { className: "n" }, Math.round(100 * c.share_of_excess)), h("td", {}, c.parameters.slice(0, 2).map((p) => `${p.name} ${digits(p.estimate)} ± ${digits(p.stddev, 2)} ${p.unit}`).join(", ")),
        h("td", {}, h("button", { type: "button", className: "plain", onclick: () => ask("adopt", { effects: [c.effect], anyway: false }) }, "adopt"))))))),
    law && laws(state, law), command(answer.command));
}

function laws(state, answer) {
  const found = answer.json.discovery;
  return h("article", { className: "card", id: "law", dataset: { is: "unknown" } }, h("p", { className: "soft", style: { margin: 0 } }, "A law of no name"), sentences(answer.sentences),
    (found?.laws || []).filter((law) => law.equation && law.probability > 0.02).slice(0, 3).map((law) => h("div", {}, equation(`torque = ${law.equation}`), h("p", { className: "caption" }, `${percent(law.probability)}. ${law.parameters.map((p) => `${p.name} = ${digits(p.value)} ${p.unit}`).join(", ")}`))),
    figures(answer.figures),
    answer.json.written ? h("div", { className: "row" }, h("button", { type: "button", className: "main", id: "adopt_law", onclick: () => ask("adopt", { effects: [answer.json.written], anyway: false }) }, `Adopt it as an effect (${answer.json.written})`)) : null,
    changes(answer.changes), command(answer.command));
}

function adopted(state, answers) {
  if (!draws(state, answers, "adopt", [state.model])) return;
  const there = row(state, "adopt");
  const answer = there && answers.adopt;
  const can = state.model?.steps > 0 && state.choice.model;
  const undo = can ? h("button", { type: "button", id: "undo", onclick: () => attempt(() => call("undo")) }, `Undo step ${state.model.steps}`) : null;
  if (!answer || (there.is_stale && !can)) return put(body("adopt"), h("p", { className: "caption" }, "Adopting an effect writes it into the platform's file, with its uncertainty and where it is from. It can be taken back to the letter."), undo);
  const { versions, pointing } = answer.json;
  const kinds = [["held_out_prediction_error", "held out"], ["prediction_error", "training"]].filter(([key]) => versions[0][key] !== null);
  const [first, lastOne] = [versions[0], versions[versions.length - 1]];
  put(body("adopt"), h("div", { className: "row" }, undo, there.is_stale ? h("span", { className: "stale" }, "Files or choice have changed since.") : null),
    h("div", { className: "headline" }, h("div", { className: "number" }, `${times(judging(first))} → `, h("span", { className: judging(lastOne) <= EXPLAINED ? "number good" : "number bad" }, times(judging(lastOne))), " ", h("small", {}, "times the noise")), h("span", { className: "soft" }, named(lastOne.effects))),
    kinds.map(([key, words]) => bars(versions.map((v, k) => ({ name: `${v.name}, ${words}`, value: v[key], said: times(v[key]), className: k === versions.length - 1 ? "after" : "before" })))),
    pointing && [h("h3", {}, "Pointing error of a simulated experiment"), h("div", { id: "pointing" }, bars([["old model in the controller", pointing.before_rad, "before"], ["new model in the controller", pointing.after_rad, "after"]].map(([name, value, className]) => ({ name, value, className, said: `${digits((180 / Math.PI) * value)} deg` }))))],
    sentences(answer.sentences), figures(answer.figures), changes(answer.changes),
    h("details", {}, h("summary", {}, "Parameters before and after"), h("div", { className: "wide", tabIndex: 0 }, h("table", {}, h("tr", {}, ["of", "parameter", "unit"].map((w) => h("th", {}, w)), ["before", "after", "±"].map((w) => h("th", { className: "n" }, w))),
      lastOne.parameters.map((p) => h("tr", {}, h("td", {}, p.of), h("td", {}, p.name), h("td", {}, p.unit), h("td", { className: "n" }, digits(p.before)), h("td", { className: "n" }, digits(p.estimate)), h("td", { className: "n" }, digits(p.stddev, 2))))))),
    command(answer.command));
}

let shown = "";
export function render(state, answers) {
  const now = steps(state, answers);
  const key = now.map((step) => step.outerHTML).join("");
  if (key !== shown) { shown = key; document.getElementById("where_path").replaceChildren(...now); }
  compared(state, answers);
  located(state, answers);
  diagnosed(state, answers);
  adopted(state, answers);
}
