// Draws what a page holds: its figures one after the other, then the replay, if it has one.
(async function (whorl) {
  "use strict";
  const told = (words) => { const p = document.createElement("p"); p.className = "warning"; p.textContent = words; document.querySelector("h1").after(p); };
  if (!document.getElementById("data")) return;
  let data;
  try {
    data = await whorl.load();
  } catch (error) {
    return told(`The figures cannot be drawn in this browser (it needs DecompressionStream: Chrome 103, Firefox 113, Safari 16.4 or later): ${error}`);
  }
  const range = data.span ? { min: data.span[0], max: data.span[1] } : null;
  whorl.setMarks(data.shades, data.events, range);
  if (data.scene) whorl.replay(data, data.span[1]);
  for (const spec of data.figures) {
    whorl.figure(document.getElementById(spec.id), spec);
    // The page stays usable meanwhile.
    await new Promise((resume) => setTimeout(resume, 0));
  }
  if (data.scene) whorl.setTime(whorl.time());
  document.body.dataset.drawn = data.figures.length;
})(window.whorl);
