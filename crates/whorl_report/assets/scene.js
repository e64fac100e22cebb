// Platforms in three dimensions on a canvas: no library, no graphics processor. World axes: x east, y north, z up [m].
(function (whorl) {
  "use strict";
  const SPACING_M = 2.3;
  const DISC_M = 0.5;

  const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const norm = (a) => Math.hypot(...a);
  const unit = (a) => { const n = norm(a); return n > 0 ? a.map((v) => v / n) : [1, 0, 0]; };
  // v rotated by the unit quaternion [w, x, y, z].
  const rotate = (q, v) => {
    const u = [q[1], q[2], q[3]];
    const t = cross(u, v).map((c) => 2 * c);
    return add(add(v, t, q[0]), cross(u, t));
  };
  whorl.rotate = rotate;
  // Yaw, pitch and roll (z-y-x) of a unit quaternion [deg].
  whorl.angles = ([w, x, y, z]) => [
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))),
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
  ].map((a) => (a * 180) / Math.PI);

  // Two unit vectors across a direction.
  const across = (direction) => {
    const d = unit(direction);
    const a = unit(cross(d, Math.abs(d[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
    return [a, cross(d, a)];
  };
  const circle = (centre, direction, radius, n = 36) => {
    const [a, b] = across(direction);
    return Array.from({ length: n + 1 }, (_, i) => {
      const angle = (2 * Math.PI * i) / n;
      return add(add(centre, a, radius * Math.cos(angle)), b, radius * Math.sin(angle));
    });
  };

  // setup: {platforms: [{name, tilt: {kind, max_rad}, boresight, keep_out, jets: [{position_m, force_direction}], momentum_max_n_m_s}]}
  whorl.Scene = class {
    constructor(canvas, platforms) {
      this.canvas = canvas;
      this.platforms = platforms;
      this.view = { azimuth: -2.1, elevation: 0.5, zoom: 1 };
      this.frame = null;
      this.drawn = 0;
      this.controls();
      new ResizeObserver(() => this.redraw()).observe(canvas);
    }

    controls() {
      const { canvas, view } = this;
      const turn = (dx, dy) => {
        view.azimuth -= dx * 0.008;
        view.elevation = Math.max(-0.1, Math.min(1.55, view.elevation + dy * 0.008));
        this.redraw();
      };
      const zoom = (factor) => { view.zoom = Math.max(0.4, Math.min(6, view.zoom * factor)); this.redraw(); };
      let from = null;
      canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", (e) => { if (from) { turn(e.clientX - from[0], e.clientY - from[1]); from = [e.clientX, e.clientY]; } });
      canvas.addEventListener("pointerup", () => (from = null));
      canvas.addEventListener("wheel", (e) => { if (e.ctrlKey || document.activeElement === canvas) { e.preventDefault(); zoom(Math.exp(-e.deltaY * 0.001)); } }, { passive: false });
      canvas.addEventListener("dblclick", () => { Object.assign(view, { azimuth: -2.1, elevation: 0.5, zoom: 1 }); this.redraw(); });
      canvas.addEventListener("keydown", (e) => {
        const key = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, 12], ArrowDown: [0, -12] }[e.key];
        if (key) turn(...key);
        else if (e.key === "+" || e.key === "=") zoom(1.15);
        else if (e.key === "-") zoom(1 / 1.15);
        else return;
        e.preventDefault();
      });
    }

    draw(frame) { this.frame = frame; this.redraw(); }

    redraw() {
      const { canvas } = this;
      const ratio = devicePixelRatio || 1;
      const [w, h] = [canvas.clientWidth, canvas.clientHeight];
      if (!w || !h) return;
      if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
        canvas.width = Math.round(w * ratio);
        canvas.height = Math.round(h * ratio);
      }
      const ctx = canvas.getContext("2d");
      ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
      ctx.clearRect(0, 0, w, h);
      const n = this.platforms.length;
      const { azimuth, elevation, zoom } = this.view;
      const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
      const right = [-sa, ca, 0];
      const back = [ca * ce, sa * ce, se];
      const up = cross(back, right);
      const distance = 9;
      // Everything that is drawn of a platform fits into the canvas, from wherever it is seen.
      const flat = (p) => {
        const z = [p[0], p[1], p[2] - 0.05];
        const depth = z[0] * back[0] + z[1] * back[1] + z[2] * back[2];
        const k = 1 / Math.max(distance - depth, 0.5);
        return [k * (z[0] * right[0] + z[1] * right[1]), k * (z[0] * up[0] + z[1] * up[1] + z[2] * up[2]), depth];
      };
      let [wide, high] = [0, 0];
      for (let i = 0; i < n; i += Math.max(n - 1, 1)) {
        for (const corner of [[1.1, 0, 0], [-1.1, 0, 0], [0, 1.1, 0], [0, -1.1, 0], [0, 0, 1], [0, 0, -1.08]]) {
          const at = flat(add([(i - (n - 1) / 2) * SPACING_M, 0, 0], corner));
          wide = Math.max(wide, Math.abs(at[0]));
          high = Math.max(high, Math.abs(at[1]));
        }
      }
      const focal = zoom * Math.min(w / 2 / wide, h / 2 / high) * 0.97;
      this.project = (p) => {
        const at = flat(p);
        return [w / 2 + focal * at[0], h / 2 - focal * at[1], at[2]];
      };
      this.shapes = [];
      this.floor(n);
      this.platforms.forEach((platform, i) => this.platform(platform, this.frame && this.frame.platforms[i], [(i - (n - 1) / 2) * SPACING_M, 0, 0]));
      this.shapes.sort((a, b) => a.depth - b.depth);
      for (const shape of this.shapes) shape.paint(ctx);
      this.drawn++;
      canvas.dataset.drawn = this.drawn;
    }

    path(points, { stroke, fill, width = 1.5, dash = [], alpha = 1, lift = 0 }) {
      const at = points.map(this.project);
      const depth = at.reduce((sum, p) => sum + p[2], 0) / at.length + lift;
      this.shapes.push({ depth, paint: (ctx) => {
        ctx.globalAlpha = alpha;
        ctx.setLineDash(dash);
        ctx.beginPath();
        at.forEach((p) => ctx.lineTo(p[0], p[1]));
        if (fill) { ctx.fillStyle = fill; ctx.fill(); }
        if (stroke) { ctx.globalAlpha = 1; ctx.strokeStyle = stroke; ctx.lineWidth = width; ctx.stroke(); }
        ctx.globalAlpha = 1;
      } });
    }

    text(p, words, fill, size = 12) {
      const at = this.project(p);
      this.shapes.push({ depth: at[2] + 5, paint: (ctx) => {
        ctx.fillStyle = fill;
        ctx.font = `${size}px system-ui, sans-serif`;
        ctx.textAlign = "center";
        ctx.fillText(words, at[0], at[1]);
      } });
    }

    arrow(from, vector, stroke, width = 2.5, dash = []) {
      const length = norm(vector);
      if (!(length > 1e-3)) return;
      const tip = add(from, vector);
      this.path([from, tip], { stroke, width, dash, lift: 0.02 });
      const [a] = across(vector);
      const neck = add(from, vector, Math.max(0, 1 - 0.09 / length));
      // The head lies across the line of sight so that it is seen from everywhere.
      const s = this.project(from), e = this.project(tip);
      const flat = Math.hypot(e[0] - s[0], e[1] - s[1]) < 4;
      if (flat) return this.path(circle(tip, vector, 0.03, 10), { fill: stroke, lift: 0.05 });
      const b = unit(cross(vector, a));
      this.path([add(neck, a, 0.035), tip, add(neck, a, -0.035)], { fill: stroke, lift: 0.05 });
      this.path([add(neck, b, 0.035), tip, add(neck, b, -0.035)], { fill: stroke, lift: 0.05 });
    }

    cone(apex, direction, half, length, stroke, alpha) {
      const d = unit(direction);
      const rim = circle(add(apex, d, length * Math.cos(half)), d, length * Math.sin(half));
      this.path(rim, { stroke, width: 1.2, fill: stroke, alpha });
      for (let i = 0; i < 36; i += 6) this.path([apex, rim[i]], { stroke, width: 0.6, dash: [3, 3] });
    }

    floor(n) {
      const grid = whorl.css("--line");
      const half = (n * SPACING_M) / 2 + 0.2;
      for (let x = -Math.ceil(half * 2) / 2; x <= half + 0.01; x += 0.5) this.path([[x, -1, -0.75], [x, 1, -0.75]], { stroke: grid, width: 0.6, lift: -9 });
      for (let y = -1; y <= 1.01; y += 0.5) this.path([[-half, y, -0.75], [half, y, -0.75]], { stroke: grid, width: 0.6, lift: -9 });
      const soft = whorl.css("--soft");
      this.text([0, 1.15, -0.75], "N", soft, 11);
      this.text([half + 0.15, 0, -0.75], "E", soft, 11);
    }

    platform(shape, state, at) {
      const soft = whorl.css("--soft");
      this.path([add(at, [0, 0, -0.75]), add(at, [0, 0, -0.08])], { stroke: soft, width: 5, lift: -0.3 });
      this.text(add(at, [0, 0, -0.98]), shape.name, whorl.css("--text"), 13);
      this.limits(shape, at);
      if (!state || !state.q) {
        this.path(circle(at, [0, 0, 1], DISC_M), { stroke: soft, width: 1, dash: [4, 4] });
        this.text(add(at, [0, 0, 0.3]), "no attitude", soft);
        return;
      }
      const of = (v) => rotate(state.q, v);
      const safe = state.alarm;
      const disc = circle([0, 0, 0], [0, 0, 1], DISC_M, 8).map((p) => add(at, of(p)));
      this.path(disc, { fill: whorl.css(safe ? "--c1" : "--c4"), stroke: whorl.css(safe ? "--fault" : "--axis"), width: safe ? 2.5 : 1, alpha: safe ? 0.6 : 0.32 });
      [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, i) => this.arrow(at, of(axis).map((c) => 0.62 * c), whorl.css(`--c${i}`), 2.5));
      const sight = unit(shape.boresight || [1, 0, 0]);
      const colour = whorl.css("--c5");
      this.arrow(add(at, of(sight), 0.62), of(sight).map((c) => 0.45 * c), colour, 3.5);
      if (state.ref) {
        const target = rotate(state.ref, sight);
        this.arrow(at, target.map((c) => 1.16 * c), whorl.css("--c6"), 1.2, [4, 4]);
        this.path(circle(add(at, target, 1.16), target, 0.05, 14), { stroke: whorl.css("--c6"), width: 1.5 });
      }
      if (state.h) {
        const scale = 0.8 / (shape.momentum_max_n_m_s || 5);
        this.arrow(at, of(state.h).map((c) => c * scale), whorl.css("--c3"), 3);
      }
      this.jets(shape, state, at, of);
    }

    jets(shape, state, at, of) {
      (shape.jets || []).forEach((jet, i) => {
        const open = (state.jets && state.jets[i]) || 0;
        const nozzle = add(at, of(jet.position_m));
        this.path(circle(nozzle, of(jet.force_direction), 0.018, 6), { fill: whorl.css("--axis"), lift: 0.01 });
        if (open <= 0) return;
        const out = of(unit(jet.force_direction)).map((c) => -c * (0.16 + 0.24 * Math.min(1, open)));
        const [a] = across(out);
        const end = add(nozzle, out);
        this.path([nozzle, add(end, a, 0.05), add(end, a, -0.05)], { fill: whorl.css("--c1"), alpha: 0.85, lift: 0.1 });
      });
    }

    limits(shape, at) {
      const limit = whorl.css("--limit");
      if (shape.tilt && shape.tilt.kind === "cone") this.cone(at, [0, 0, 1], shape.tilt.max_rad, 0.8, limit, 0.08);
      if (shape.tilt && shape.tilt.kind === "pitch") {
        for (const sign of [-1, 1]) {
          const ring = circle(add(at, [0, 0, sign * 0.62 * Math.sin(shape.tilt.max_rad)]), [0, 0, 1], 0.62 * Math.cos(shape.tilt.max_rad), 48);
          this.path(ring, { stroke: limit, width: 0.8, dash: [3, 3] });
        }
      }
      if (shape.keep_out) this.cone(at, shape.keep_out.direction_world, shape.keep_out.half_angle_rad, 1.2, whorl.css("--fault"), 0.25);
    }
  };

  // What the colours mean, and a table of numbers below the canvas.
  whorl.key = (place, platforms) => {
    const items = [["--c0", "body x"], ["--c1", "body y, firing jet"], ["--c2", "body z"], ["--c5", "boresight"], ["--c6", "its target (dashed)"], ["--c3", "momentum of the wheels"], ["--limit", "tilt limit"]];
    if (platforms.some((p) => p.keep_out)) items.push(["--fault", "keep-out cone"]);
    for (const [colour, words] of items) {
      const item = document.createElement("span");
      const patch = document.createElement("i");
      patch.style.background = `var(${colour})`;
      item.append(patch, words);
      place.append(item, " ");
    }
  };

  const COLUMNS = ["platform", "mode", "yaw, pitch, roll [deg]", "relative error [deg]", "gas [g]", "link [ms]"];
  whorl.Numbers = class {
    constructor(table, platforms) {
      const head = table.createTHead().insertRow();
      for (const words of COLUMNS) head.append(Object.assign(document.createElement("th"), { textContent: words, scope: "col" }));
      const body = table.createTBody();
      this.rows = platforms.map((platform) => {
        const row = body.insertRow();
        COLUMNS.forEach(() => row.insertCell());
        row.cells[0].textContent = platform.name;
        return row;
      });
    }

    show(frame) {
      // Adding 0 makes 0 of -0, which would be printed with its sign.
      const number = (v, digits) => (v == null || !Number.isFinite(v) ? "–" : (Number(v.toFixed(digits)) + 0).toFixed(digits));
      this.rows.forEach((row, i) => {
        const p = frame.platforms[i] || {};
        const words = [p.mode || "–", p.q ? whorl.angles(p.q).map((a) => number(a, 2)).join(", ") : "–", number(p.error_deg, 3), number(p.gas_g, 2), number(p.link_ms, 0)];
        words.forEach((text, k) => { if (row.cells[k + 1].textContent !== text) row.cells[k + 1].textContent = text; });
        row.className = p.alarm ? "fault" : "";
      });
    }
  };
})((window.whorl = window.whorl || {}));
