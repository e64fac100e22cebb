// The platform: a drawing in three dimensions, its numbers with their priors, and how the model came to be.
import { call } from "/assets/interface.js";
import { digits, h, put, times } from "/assets/parts.js";
import { attempt } from "/assets/data.js";

const place = document.querySelector("#platform .body");
const past = document.querySelector("#history .body");
let shown = "";
let scene = null;

export async function render(state) {
  const key = JSON.stringify([state.model, state.choice.model, state.choice.platform, state.choice.runs[0], state.answers.map((a) => a.is_stale)]);
  if (key === shown) return;
  shown = key;
  scene?.end();
  scene = null;
  if (!state.model) { put(place, h("p", { className: "caption" }, "No platform is chosen.")); put(past); return; }
  const platform = await attempt(() => call("platform"));
  if (!platform) return;
  drawn(state, platform);
  history(platform.history);
}

function drawn(state, platform) {
  const view = h("div", { className: "scene3d" });
  const moments = platform.principal_moments_kg_m2.map((x) => digits(x)).join(", ");
  const words = { on_bearing: "on a bearing: it turns about all three axes", hinge: "on a hinge", free: "free: nothing holds it", clamped: "clamped: only its wheels move" }[platform.freedom];
  put(place, h("div", { className: "columns" },
    h("div", {}, view, h("p", { className: "caption" }, `${platform.platform}, ${words}. Body axes x, y, z in blue, orange and green; the ellipsoid has its principal moments of inertia, ${moments} kg m². Drag or arrow keys turn the view, + and - zoom.`)),
    form(state, platform)));
  // The library is loaded only where it is needed.
  import("/assets/scene3d.js").then(({ Scene }) => { if (view.isConnected) scene = new Scene(view, platform); }).catch((error) => view.append(h("p", { className: "caption" }, `no drawing: ${error.message}`)));
}

function form(state, platform) {
  const filter = h("input", { type: "text", placeholder: "filter", "aria-label": "Show only numbers whose name has" });
  const editable = Boolean(state.choice.model);
  const field = (key, value, label, placeholder = "") => {
    const input = h("input", { type: "text", value, placeholder, "aria-label": label, disabled: !editable });
    input.addEventListener("change", async () => {
      const done = await attempt(() => call("set", { key, value: input.value }));
      if (done === null) input.value = value;
    });
    return input;
  };
  const prior = (key) => key.replace(/^model\./, "model_prior.");
  const rows = platform.parameters.map((p) => h("tr", { dataset: { key: p.key } }, h("td", { className: "code", title: p.origin }, p.key.replace(/^model\./, "")), h("td", {}, field(p.key, p.value, p.key)), h("td", {}, p.stddev !== null || /^[-\d[]/.test(p.value) && !p.key.includes("sensors") && !p.key.includes("freedom") ? field(prior(p.key), p.stddev || "", `standard deviation of ${p.key}`, "typical") : ""), h("td", { className: "soft", title: p.source || "" }, h("span", { className: "clamp" }, p.source || ""))));
  filter.addEventListener("input", () => rows.forEach((row) => (row.hidden = !row.dataset.key.includes(filter.value))));
  return h("div", {}, h("div", { className: "row" }, filter, h("span", { className: "caption" }, editable ? "Each change is written into the file, and is a step that can be taken back." : "The run has its own parameters: choose a platform's file to change them.")),
    h("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Numbers of the platform" }, h("table", { className: "form numbers" }, h("tr", {}, ["number", "value", "± prior", "from"].map((w) => h("th", {}, w))), rows)));
}

function history(found) {
  if (!found.steps.length) return put(past, h("p", { className: "caption" }, "Nothing has been adopted into this model."));
  put(past, h("div", { className: "wide", tabIndex: 0 }, h("table", { id: "steps" }, h("tr", {}, h("th", {}, "step"), h("th", {}, "when"), h("th", {}, "what"), h("th", { className: "n" }, "error before"), h("th", { className: "n" }, "after"), h("th", {}, "from")),
    found.steps.map((step) => { const error = step.held_out_prediction_error || step.prediction_error; return h("tr", {}, h("td", {}, String(step.number)), h("td", {}, step.date || ""), h("td", {}, step.effects.length ? `adopted ${step.effects.join(" and ")}` : "numbers changed"), h("td", { className: "n" }, error ? times(error[0]) : "–"), h("td", { className: "n" }, error ? times(error[1]) : "–"), h("td", { className: "code" }, step.source || "")); }))));
}
