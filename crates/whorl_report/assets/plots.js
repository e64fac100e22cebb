// Draws figures with uPlot. Figures over time share one cursor and one zoom.
(function (whorl) {
  "use strict";
  const HEIGHT = 230;
  const charts = []; // every figure: {u, spec, place, visible}
  const listeners = [];
  let marks = { shades: [], events: [] };
  let time = null;
  let span = null;
  let linking = false;

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colour = (index) => (index == null ? "--soft" : `--c${index % 8}`);
  // Of solid, dashed, dotted and dash-dotted curves; the marks of a legend are full for the first, hollow with such a rim for the others.
  const DASHES = [undefined, [6, 4], [2, 3], [8, 3, 2, 3]];
  const RIMS = ["solid", "solid", "dotted", "dashed"];
  whorl.css = css;

  // What is shaded and marked on every figure over time, and the time that they all show.
  whorl.setMarks = (shades, events, range) => { marks = { shades, events }; span = range; };
  whorl.onTime = (listener) => listeners.push(listener);
  whorl.time = () => time;
  // A reader points at a time; a replay sees to more.
  whorl.seek = (t, source) => whorl.setTime(t, source);
  whorl.setTime = (t, source) => {
    time = t;
    for (const chart of charts) if (chart.visible && chart !== source) follow(chart);
    for (const listener of listeners) listener(t);
  };

  function follow(chart) {
    if (time === null || !chart.spec.time) return;
    const left = chart.u.valToPos(time, "x");
    const inside = left >= 0 && left <= chart.u.over.clientWidth;
    chart.u.setCursor({ left: inside ? left : -10, top: 0 }, false);
  }

  function zoom(range, source) {
    if (linking || !range) return;
    linking = true;
    for (const chart of charts) if (chart !== source && chart.spec.time) chart.u.setScale("x", range);
    linking = false;
    for (const chart of charts) if (chart.visible) follow(chart);
  }

  const concerns = (who, spec) => !spec.who || !who || who === spec.who || who === "formation";

  function drawMarks(u, spec) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const x = (t) => u.valToPos(t, "x", true);
    const ratio = devicePixelRatio;
    if (spec.time) {
      for (const shade of marks.shades) {
        if (!concerns(shade.who, spec)) continue;
        const [from, to] = [x(shade.from), x(shade.to)];
        ctx.fillStyle = css(`--${shade.kind}`);
        ctx.fillRect(from, bbox.top, Math.max(to - from, ratio), bbox.height);
      }
    }
    for (const span of spec.spans || []) {
      const [from, to] = span.x.map(x);
      ctx.fillStyle = `${css(colour(span.c))}28`;
      ctx.fillRect(from, bbox.top, Math.max(to - from, ratio), bbox.height);
    }
    for (const band of spec.bands || []) {
      if (!band.x.length) continue;
      ctx.beginPath();
      band.x.forEach((t, i) => ctx.lineTo(x(t), u.valToPos(band.low[i], "y", true)));
      for (let i = band.x.length - 1; i >= 0; i--) ctx.lineTo(x(band.x[i]), u.valToPos(band.high[i], "y", true));
      ctx.closePath();
      // Many bands over each other stay lighter than curves.
      ctx.fillStyle = `${css(colour(band.c))}${spec.bands.length > 2 ? "1c" : "30"}`;
      ctx.fill();
    }
    if (spec.time) {
      for (const event of marks.events) {
        if (!concerns(event.who, spec)) continue;
        const at = Math.round(x(event.t)) + 0.5;
        ctx.strokeStyle = css(event.fault ? "--fault" : "--event");
        ctx.lineWidth = ratio;
        ctx.setLineDash(event.fault ? [] : [2 * ratio, 3 * ratio]);
        ctx.beginPath();
        ctx.moveTo(at, bbox.top);
        ctx.lineTo(at, bbox.top + bbox.height);
        ctx.stroke();
      }
    }
    ctx.restore();
  }

  // Text with a rim that keeps curves and marks off.
  function rimmed(ctx, text, x, y) {
    ctx.save();
    ctx.setLineDash([]);
    ctx.lineJoin = "round";
    ctx.lineWidth = 4 * devicePixelRatio;
    ctx.strokeStyle = css("--page");
    ctx.strokeText(text, x, y);
    ctx.restore();
    ctx.fillText(text, x, y);
  }

  // Limits, and the names of the steps, above the curves; one that would cover the one before is left out.
  function drawLabels(u, spec) {
    const { ctx, bbox } = u;
    const ratio = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    // The edges of bands stay visible where curves cover them.
    ctx.strokeStyle = css("--soft");
    ctx.lineWidth = ratio;
    ctx.setLineDash([2 * ratio, 2 * ratio]);
    for (const band of spec.bands || []) {
      for (const edge of [band.low, band.high]) {
        ctx.beginPath();
        band.x.forEach((t, i) => ctx.lineTo(u.valToPos(t, "x", true), u.valToPos(edge[i], "y", true)));
        ctx.stroke();
      }
    }
    ctx.setLineDash([6 * ratio, 3 * ratio]);
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.font = `${10 * ratio}px system-ui, sans-serif`;
    for (const limit of spec.limits || []) {
      const y = Math.round(u.valToPos(limit.v, "y", true)) + 0.5;
      ctx.strokeStyle = ctx.fillStyle = css("--limit");
      ctx.lineWidth = 1.2 * ratio;
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      // Below the line where names of steps are above it.
      const at = bbox.left + bbox.width - ctx.measureText(limit.n).width - 4 * ratio;
      const base = y < bbox.top + 24 * ratio ? y + 11 * ratio : y - 4 * ratio;
      rimmed(ctx, limit.n, at, base);
    }
    ctx.font = `${10 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.fillStyle = css("--soft");
    (spec.spans || []).forEach((span, i) => {
      const at = Math.max(u.valToPos(span.x[0], "x", true), bbox.left) + 3 * ratio;
      const last = bbox.left + bbox.width - ctx.measureText(span.n).width - 3 * ratio;
      rimmed(ctx, span.n, Math.min(at, last), bbox.top + (10 + 12 * i) * ratio);
    });
    const named = !spec.time ? [] : marks.events.filter((e) => e.label && concerns(e.who, spec));
    named.forEach((event, i) => {
      const at = Math.max(u.valToPos(event.t, "x", true), bbox.left);
      const next = i + 1 < named.length ? u.valToPos(named[i + 1].t, "x", true) : bbox.left + bbox.width;
      if (at + ctx.measureText(event.label).width + 5 * ratio <= Math.min(next, bbox.left + bbox.width)) {
        rimmed(ctx, event.label, at + 3 * ratio, bbox.top + 10 * ratio);
      }
    });
    ctx.restore();
  }

  // What stands for zero on a logarithmic axis, and the least that is drawn there, over the largest.
  const [ZERO, LEAST] = [1e-300, 1e-5];
  // Values and limits together; limits only where they are near the values.
  function yRange(spec) {
    return (u, low, high) => {
      if (spec.log) {
        if (low === null) return [0.1, 1];
        // An error that passes through zero does not decide how far down the axis goes.
        low = Math.max(low, high * LEAST);
        if (!(low > ZERO)) return [0.1, 1];
        const near = (spec.limits || []).map((l) => l.v).filter((v) => v > low / 30 && v < high * 30);
        return uPlot.rangeLog(Math.min(low, ...near), Math.max(high, ...near), 10, false);
      }
      const full = spec.time && span && u.scales.x.min <= span.min && u.scales.x.max >= span.max;
      if (spec.fit && full) [low, high] = spec.fit;
      if (low === null) return [0, 1];
      const reach = Math.max(high - low, Math.abs(high) * 1e-6, 1e-12);
      for (const { v } of spec.limits || []) {
        if (v > high && v < high + 2 * reach) high = v;
        if (v < low && v > low - 2 * reach) low = v;
      }
      for (const band of spec.fit ? [] : spec.bands || []) {
        low = Math.min(low, ...band.low);
        high = Math.max(high, ...band.high);
      }
      return uPlot.rangeNum(low, high, 0.08, true);
    };
  }

  // One table of all curves: undefined where a curve has no point of its own, which its line passes over.
  function aligned(spec) {
    const usable = (v) => (spec.log && v !== null && v <= 0 ? ZERO : v);
    const tables = spec.curves.map((c) => [c.x, c.y.map(usable)]);
    return tables.length > 1 ? uPlot.join(tables) : tables[0] || [[], []];
  }

  function nearest(u, series, index) {
    const values = u.data[series];
    if (values[index] != null) return index;
    let [before, after] = [index, index];
    while (before >= 0 && values[before] == null) before--;
    while (after < values.length && values[after] == null) after++;
    if (before < 0) return after < values.length ? after : null;
    if (after >= values.length) return before;
    const x = u.data[0];
    return x[index] - x[before] < x[after] - x[index] ? before : after;
  }

  const shown = (v) => (v == null ? "–" : v === ZERO ? "0" : Math.abs(v) >= 1e5 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(2) : String(+v.toPrecision(4)));

  // At the marks of an axis, in as few digits as say it; null: a mark of a logarithmic axis without a number.
  const marked = (u, values) => values.map((v) => (v == null ? null : shown(v).replace(/\.?0+e/, "e")));
  // Of a vertical axis: its title, and its longest number [px].
  const room = (u, values) => Math.max(58, 26 + 5.3 * Math.max(0, ...(values || []).map((v) => (v || "").length)));

  // Draws a figure into a place and returns it; `set(curves)` gives it new curves.
  whorl.figure = (place, spec) => {
    const chart = { spec, place, visible: true };
    const axis = (label, extra) => ({
      label, stroke: () => css("--axis"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { stroke: () => css("--grid"), width: 1 },
      font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 18, ...extra,
    });
    const options = {
      width: Math.max(place.clientWidth, 200), height: spec.height || HEIGHT,
      scales: { x: { time: false, distr: spec.logx ? 3 : 1 }, y: { distr: spec.log ? 3 : 1, range: yRange(spec) } },
      series: [
        { label: spec.xlabel || "time [s]", value: (u, v) => shown(v) },
        ...spec.curves.map((c) => ({
          label: c.n, stroke: () => css(colour(c.c)), width: c.d ? 1.2 : 1.5, dash: DASHES[c.d || 0],
          paths: spec.dots ? () => null : undefined, points: { show: spec.dots || c.x.length < 30, size: spec.dots ? 3 : 4 }, value: (u, v) => shown(v),
        })),
      ],
      axes: [
        axis(spec.xlabel || "time [s]", { size: 34, values: spec.logx ? marked : undefined }),
        axis(spec.ylabel, { size: room, values: marked }),
      ],
      // Full: a solid curve; hollow: a dashed one.
      legend: { markers: { width: 2, stroke: (u, i) => (i ? `var(${colour(spec.curves[i - 1].c)})` : "transparent"),
        dash: (u, i) => RIMS[(i && spec.curves[i - 1].d) || 0],
        fill: (u, i) => (i && !spec.curves[i - 1].d ? `var(${colour(spec.curves[i - 1].c)})` : "transparent") } },
      cursor: {
        y: false, dataIdx: (u, s, index) => (s ? nearest(u, s, index) : index), drag: { x: true, y: false, dist: 4 },
        bind: { dblclick: (u, target, handler) => (e) => (spec.time && span ? zoom(span, null) : handler(e)) },
      },
      hooks: {
        drawClear: [(u) => drawMarks(u, spec)],
        draw: [(u) => drawLabels(u, spec)],
        setScale: [(u, key) => {
          if (key === "x" && spec.time && chart.ready && !spec.rolling) zoom({ min: u.scales.x.min, max: u.scales.x.max }, chart);
        }],
      },
    };
    place.textContent = "";
    const u = (chart.u = new uPlot(options, aligned(spec), place));
    if (spec.time && span && !spec.rolling) {
      linking = true;
      u.setScale("x", span);
      linking = false;
    } else if (spec.range) {
      u.setScale("x", { min: spec.range[0], max: spec.range[1] });
    }
    // Scales are set in a microtask of their own; only what comes later is a zoom of the reader.
    setTimeout(() => (chart.ready = true), 0);
    if (spec.time && !spec.rolling) {
      u.over.addEventListener("pointermove", (e) => whorl.seek && whorl.seek(u.posToVal(e.offsetX, "x"), chart));
      u.over.addEventListener("pointerleave", () => setTimeout(() => follow(chart), 0));
      place.addEventListener("keydown", (e) => {
        const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
        if (!step || !whorl.seek) return;
        e.preventDefault();
        whorl.seek((time ?? u.scales.x.min) + step * (u.scales.x.max - u.scales.x.min) * (e.shiftKey ? 0.05 : 0.005));
      });
    }
    chart.set = (curves) => {
      spec.curves = curves;
      u.setData(aligned(spec));
      if (!u.over.matches(":hover")) u.setLegend({ idx: u.data[0].length - 1 }, false);
    };
    charts.push(chart);
    const resized = new ResizeObserver(() => {
      const width = place.clientWidth;
      if (width > 0 && width !== u.width) { u.setSize({ width, height: options.height }); follow(chart); }
    });
    resized.observe(place);
    const seen = new IntersectionObserver((entries) => {
      chart.visible = entries.some((e) => e.isIntersecting);
      if (chart.visible) follow(chart);
    }, { rootMargin: "200px" });
    seen.observe(place);
    chart.remove = () => {
      resized.disconnect();
      seen.disconnect();
      u.destroy();
      charts.splice(charts.indexOf(chart), 1);
    };
    return chart;
  };

  const redraw = () => { for (const chart of charts) chart.u.redraw(); whorl.redrawScene && whorl.redrawScene(); whorl.redrawMore && whorl.redrawMore(); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  // Paper is white.
  addEventListener("beforeprint", () => { document.documentElement.dataset.theme = "light"; redraw(); });
  addEventListener("afterprint", () => { delete document.documentElement.dataset.theme; redraw(); });

  // Curves as they are stored: times as steps in milliseconds, or plain values.
  const timed = (c) => {
    if (!c.dt) return c;
    let at = 0;
    return { ...c, x: c.dt.map((d) => (at += d) * 1e-3) };
  };
  whorl.unpacked = (spec) => ({ ...spec, curves: spec.curves.map(timed), bands: spec.bands.map(timed) });

  whorl.load = async () => {
    const text = document.getElementById("data").textContent;
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    const data = await new Response(stream).json();
    data.figures = data.figures.map(whorl.unpacked);
    return data;
  };
})((window.whorl = window.whorl || {}));
