// A guided tour: one place of the page after the other, from the file to the adopted effect.
import { h, show } from "/assets/parts.js";

const STOPS = [
  ["data", "Bring a recording", "Drop a CSV file or a bag. Columns, units, axes and rates are recognised; each line says where its number is from. Choose which runs are fitted and which only test."],
  ["look", "Look at it", "All channels share one cursor. Drag to zoom, shift-drag to pan, double-click for all of it. Gaps, held readings, clipping and rest are shaded."],
  ["compare", "How far off is the model?", "One number: how much larger the errors of its predictions are than noise makes them. 1 is as good as can be."],
  ["where", "Where does it fail?", "The torque that the model does not explain, over time and over the quantity on which it depends."],
  ["diagnose", "What is missing?", "A named effect, how sure that is, how much it improves data that took no part, and what else it could be."],
  ["adopt", "Adopt it, or take it back", "The effect is written into the platform's file. Undo takes it back to the letter; Export makes one page of it all for a colleague."],
];

export function tour() {
  const dialog = document.getElementById("guide");
  let at = 0;
  const draw = () => {
    const [id, title, words] = STOPS[at];
    show(id);
    dialog.replaceChildren(h("h2", { id: "guide_title", style: { marginTop: 0 } }, title), h("p", {}, words),
      h("div", { className: "row" }, h("button", { type: "button", disabled: at === 0, onclick: () => { at--; draw(); } }, "Back"),
        at + 1 < STOPS.length ? h("button", { type: "button", className: "main", onclick: () => { at++; draw(); } }, "Next") : null,
        h("button", { type: "button", onclick: () => dialog.close() }, "Close"), h("span", { className: "soft" }, `${at + 1} of ${STOPS.length}`)));
  };
  draw();
  if (!dialog.open) dialog.show();
}
