// Shows a running formation: frames come through a WebSocket; the latest one is drawn.
(function (whorl) {
  "use strict";
  const SHOWN_S = 60;
  const PLOTS_PER_S = 4;
  const by = (id) => document.getElementById(id);
  const shapes = JSON.parse(by("shapes").textContent);
  const scene = new whorl.Scene(by("scene"), shapes);
  whorl.redrawScene = () => scene.redraw();
  whorl.key(by("key"), shapes);
  const numbers = new whorl.Numbers(by("numbers"), shapes);

  const keep = new URLSearchParams(location.hash.slice(1)).get("token");
  // The token goes out of the address, and stays with this tab when it is loaded anew.
  if (keep) {
    sessionStorage.setItem("token", keep);
    history.replaceState(null, "", location.pathname);
  }
  const token = sessionStorage.getItem("token");
  by("answer").textContent = token ? "" : "read-only: the address that whorl live printed, with its token, commands";
  for (const id of ["start", "hold", "abort"]) {
    by(id).hidden = !token;
    by(id).addEventListener("click", async () => {
      by("answer").textContent = "…";
      try {
        const answer = await fetch(`/${id}`, { method: "POST", headers: { Authorization: `Bearer ${token}` }, body: "" });
        by("answer").textContent = (answer.ok ? "" : "refused: ") + (await answer.text());
      } catch (error) {
        by("answer").textContent = `not sent: ${error}`;
      }
    });
  }

  const curve = (name, c, of, dashed) => ({ n: name, c, d: dashed, x: [], y: [], of });
  const each = (value) => shapes.map((shape, i) => curve(shape.name, i, (f) => value(f.platforms[i])));
  const plots = [
    // A platform that holds where it is has no error at all: less than a thousandth of a degree says no more.
    ["plot_error", { ylabel: "error [deg]", log: true, floor: 1e-3 }, each((p) => p.error_deg)],
    ["plot_innovation", { ylabel: "mean square", limits: [{ n: "expected", v: 1 }] }, each((p) => p.innovation)],
    ["plot_evidence", { ylabel: "of the limit", limits: [{ n: "mismatch", v: 1 }] }, each((p) => p.evidence)],
    ["plot_latency", { ylabel: "delay [ms]" }, shapes.flatMap((shape, i) => [
      curve(`${shape.name} link`, i, (f) => f.platforms[i].link_ms), curve(`${shape.name} command`, i, (f) => f.platforms[i].latency_ms, true)])],
  ].map(([id, spec, curves]) => ({ curves, chart: whorl.figure(by(id), { xlabel: "time [s]", height: 190, rolling: true, time: false, ...spec, curves }) }));

  let latest = null;
  let plotted = -Infinity;
  let grown = false;
  let arrived = -Infinity;
  const draw = () => {
    requestAnimationFrame(draw);
    const frame = latest;
    const quiet = performance.now() - arrived > 2000;
    if (quiet && by("connection").textContent === "live") by("connection").textContent = "silent";
    if (!frame) return;
    latest = null;
    scene.draw(frame);
    numbers.show(frame);
    by("clock").textContent = frame.length_s > 0 ? `${frame.run_s.toFixed(1)} of ${frame.length_s.toFixed(0)} s` : "";
    by("state").textContent = [frame.experiment, frame.law, frame.phase, frame.step].filter(Boolean).join(" · ");
    by("faults").replaceChildren(...frame.faults.map(([who, what]) => Object.assign(document.createElement("li"), { textContent: `${who}: ${what}` })));
    if (!grown) return;
    grown = false;
    for (const { chart, curves } of plots) chart.set(curves);
  };
  // Every frame, also those of before this page was opened, which come first and all at once.
  const plot = (frame) => {
    // A server that began anew has a new clock; one that was lost for a while tells the past again.
    if (frame.t < plotted) {
      for (const { curves } of plots) for (const c of curves) c.x.length = c.y.length = 0;
    } else if (frame.t - plotted < 1 / PLOTS_PER_S) return;
    plotted = frame.t;
    grown = true;
    for (const { curves } of plots) {
      for (const c of curves) {
        c.x.push(frame.t);
        c.y.push(c.of(frame) ?? null);
        while (c.x.length && c.x[0] < frame.t - SHOWN_S) { c.x.shift(); c.y.shift(); }
      }
    }
  };
  requestAnimationFrame(draw);

  let wait = 250;
  const connect = () => {
    // Who knows the token keeps a place where there are many others.
    const socket = new WebSocket(`ws://${location.host}/frames`, token ? ["whorl", token] : ["whorl"]);
    socket.onopen = () => { wait = 250; by("connection").textContent = "live"; };
    socket.onmessage = (message) => {
      latest = JSON.parse(message.data);
      plot(latest);
      arrived = performance.now();
      by("connection").textContent = "live";
      document.body.dataset.frames = Number(document.body.dataset.frames || 0) + 1;
    };
    socket.onclose = () => {
      by("connection").textContent = "disconnected, trying again";
      setTimeout(connect, wait);
      wait = Math.min(wait * 2, 4000);
    };
  };
  connect();
})(window.whorl);
