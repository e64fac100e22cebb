// A guided tour: one place of the page after the other, from the file to the adopted effect. Each step can be done from here, by the page's own
// buttons, and then says what came out.
import { h, put, show, signs } from "/assets/parts.js";

const STOPS = [
  ["data", "Bring a recording", "Drop a CSV file or a bag. Columns, units, axes and rates are recognised; each line says where its number is from. Choose which runs are fitted and which only test. The example is of a real rig: the torque-limited pendulum of the DFKI Underactuated Robotics Lab, twice swung up by its motor.", ["#example"], "import"],
  ["look", "Look at it", "All channels share one cursor. Drag to zoom, shift-drag to pan, double-click for all of it. Gaps, held readings, clipping and rest are shaded."],
  ["compare", "How far off is the model?", "One number: how much larger the errors of its predictions are than noise makes them. 1 is as good as can be.", ["#ask_compare"], "compare"],
  ["where", "Where does it fail?", "The torque that the model does not explain, over time and over the quantity on which it depends.", ["#ask_where"], "where"],
  ["diagnose", "What is missing?", "A named effect, how sure that is, how much it improves data that took no part, and what else it could be.", ["#ask_diagnose"], "diagnose"],
  ["diagnose", "If it has no name", "Where no effect of the catalogue explains the data, a law is searched for. It becomes the file of an effect, which can be adopted like any other.", ["#ask_discover"], "discover"],
  ["adopt", "Adopt it, or take it back", "The effect is written into the platform's file. Undo takes it back to the letter; Export makes one page of it all for a colleague.", ["#adopt_law", "#adopt_it"], "adopt"],
];

let redraw = () => {};
// The page has changed: what can be done and what came out may have, too.
export const follow = () => redraw();

export function tour(answers) {
  const dialog = document.getElementById("guide");
  let at = 0;
  const draw = () => {
    const [, title, words, selectors = [], what] = STOPS[at];
    const button = selectors.map((selector) => document.querySelector(selector)).find((found) => found && !found.disabled);
    const found = answers()[what]?.sentences[0];
    put(dialog, h("h2", { id: "guide_title", style: { marginTop: 0 } }, title), h("p", {}, words),
      found ? h("p", { className: "soft" }, "Here: ", signs(found)) : null,
      h("div", { className: "row" }, h("button", { type: "button", disabled: at === 0, onclick: () => go(at - 1) }, "Back"),
        button && !found ? h("button", { type: "button", className: "main", id: "guide_do", onclick: () => { button.click(); } }, button.textContent) : null,
        at + 1 < STOPS.length ? h("button", { type: "button", className: button && !found ? "" : "main", id: "guide_next", onclick: () => go(at + 1) }, "Next") : null,
        h("button", { type: "button", onclick: () => { redraw = () => {}; dialog.close(); } }, "Close"), h("span", { className: "soft" }, `${at + 1} of ${STOPS.length}`)));
  };
  const go = (to) => { at = to; show(STOPS[at][0]); draw(); };
  // Drawn anew only when something of it is another, so that the keyboard's focus stays.
  let last = "";
  redraw = () => { const [, , , selectors = [], what] = STOPS[at]; const key = JSON.stringify([at, answers()[what]?.number, selectors.map((s) => document.querySelector(s)?.disabled)]); if (key !== last) { last = key; draw(); } };
  go(0);
  if (!dialog.open) dialog.show();
}
