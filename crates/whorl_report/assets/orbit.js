// The Earth, spacecraft and target in three dimensions on a canvas. Earth-fixed axes [km].
(function () {
  "use strict";
  const RADIUS_KM = 6371;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((v) => v / Math.hypot(...a));
  const onEarth = (latitude, longitude) => {
    const [b, l] = [latitude, longitude].map((d) => (d * Math.PI) / 180);
    return [RADIUS_KM * Math.cos(b) * Math.cos(l), RADIUS_KM * Math.cos(b) * Math.sin(l), RADIUS_KM * Math.sin(b)];
  };

  for (const place of document.querySelectorAll(".orbit")) {
    const pass = JSON.parse(place.querySelector("script").textContent);
    const [canvas, slider, play, clock] = ["canvas", "input", "button", "output"].map((name) => place.querySelector(name));
    const middle = pass.target_km[Math.floor(pass.target_km.length / 2)];
    const reach = Math.max(...pass.spacecraft.flatMap((craft) => craft.position_km.map((p) => Math.hypot(...sub(p, middle)))), 1);
    // The local frame of the target: up, and east across it.
    const up = unit(middle), east = unit(Math.hypot(up[0], up[1]) > 1e-6 ? cross([0, 0, 1], up) : [0, 1, 0]), north = cross(up, east);
    const thrusts = (burn, i) => burn.orbit_s[0] <= pass.time_s[i][1] && pass.time_s[i][1] <= burn.orbit_s[1];
    const view = { azimuth: 0.9, elevation: 0.35, zoom: 1 };

    const draw = () => {
      const ratio = devicePixelRatio, [w, h] = [canvas.clientWidth, canvas.clientHeight];
      canvas.width = w * ratio;
      canvas.height = h * ratio;
      const ctx = canvas.getContext("2d");
      ctx.scale(ratio, ratio);
      const [sa, ca, se, ce] = [Math.sin(view.azimuth), Math.cos(view.azimuth), Math.sin(view.elevation), Math.cos(view.elevation)];
      const scale = (0.42 * Math.min(w, h) * view.zoom) / reach;
      // Right, up and towards the reader.
      const project = (p) => {
        const d = sub(p, middle), [x, y, z] = [dot(d, east), dot(d, north), dot(d, up)];
        const away = -sa * x + ca * y;
        return [w / 2 + scale * (ca * x + sa * y), 0.68 * h - scale * (z * ce + away * se), z * se - away * ce];
      };
      const line = (points, colour, width, dash = []) => {
        ctx.strokeStyle = colour;
        ctx.lineWidth = width;
        ctx.setLineDash(dash);
        ctx.beginPath();
        let pen = false;
        for (const p of points) {
          if (!p) { pen = false; continue; }
          const [x, y] = project(p);
          if (pen) ctx.lineTo(x, y); else ctx.moveTo(x, y);
          pen = true;
        }
        ctx.stroke();
      };
      // The side of the Earth that is turned to the reader.
      const towards = (() => {
        const v = [ca * 0 + sa * ce, -ca * ce, se];
        return [0, 1, 2].map((k) => v[0] * east[k] + v[1] * north[k] + v[2] * up[k]);
      })();
      const seen = (p) => (dot(p, towards) >= 0 ? p : null);
      const disc = project([0, 0, 0]);
      ctx.beginPath();
      ctx.arc(disc[0], disc[1], RADIUS_KM * scale, 0, 2 * Math.PI);
      ctx.fillStyle = css("--grid");
      ctx.fill();
      const step = reach * 2 < 1500 ? 2 : 10;
      const here = { latitude: (Math.asin(up[2]) * 180) / Math.PI, longitude: (Math.atan2(up[1], up[0]) * 180) / Math.PI };
      const extent = step === 2 ? 20 : 180;
      const around = (centre, low, high) => {
        const list = [];
        for (let v = Math.ceil(Math.max(low, centre - extent) / step) * step; v <= Math.min(high, centre + extent); v += step) list.push(v);
        return list;
      };
      const latitudes = around(here.latitude, -80, 80), longitudes = around(here.longitude, here.longitude - 180, here.longitude + 180);
      const fine = (a, b) => Array.from({ length: 61 }, (_, k) => a + ((b - a) * k) / 60);
      for (const b of latitudes) line(fine(longitudes[0], longitudes.at(-1)).map((l) => seen(onEarth(b, l))), css("--line"), 1);
      for (const l of longitudes) line(fine(latitudes[0], latitudes.at(-1)).map((b) => seen(onEarth(b, l))), css("--line"), 1);
      const now = Number(slider.value);
      const dotAt = (p, colour, radius) => {
        const [x, y] = project(p);
        ctx.fillStyle = colour;
        ctx.beginPath();
        ctx.arc(x, y, radius, 0, 2 * Math.PI);
        ctx.fill();
      };
      line(pass.target_km, css(`--c${pass.spacecraft.length % 8}`), 1.5);
      dotAt(pass.target_km[now], css(`--c${pass.spacecraft.length % 8}`), 4);
      pass.spacecraft.forEach((craft, k) => {
        const colour = css(`--c${k % 8}`), at = craft.position_km[now];
        line(craft.position_km.map((p) => p.map((v) => (v * RADIUS_KM) / Math.hypot(...p))), colour, 1, [2, 3]);
        line(craft.position_km, colour, 1);
        line(craft.position_km.slice(0, now + 1), colour, 2.5);
        for (const burn of craft.burns) line(craft.position_km.map((p, i) => (thrusts(burn, i) ? p : null)), colour, 7);
        const length = Math.hypot(...sub(pass.target_km[now], at));
        line([at, at.map((v, i) => v + length * craft.boresight[now][i])], colour, 1);
        dotAt(at, colour, 4.5);
      });
      const [laboratory, orbit] = pass.time_s[now];
      const firing = pass.spacecraft.filter((craft) => craft.burns.some((burn) => thrusts(burn, now))).map((craft) => `, ${craft.name} thrusts`);
      clock.textContent = `${laboratory.toFixed(1)} s, orbit ${orbit.toFixed(0)} s${firing.join("")}`;
      canvas.dataset.drawn = Number(canvas.dataset.drawn || 0) + 1;
    };

    const turn = (dx, dy) => { view.azimuth += dx * 0.008; view.elevation = Math.max(-0.2, Math.min(1.55, view.elevation + dy * 0.008)); draw(); };
    const zoom = (factor) => { view.zoom = Math.max(0.05, Math.min(60, view.zoom * factor)); draw(); };
    let from = null;
    canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => { if (from) { turn(e.clientX - from[0], e.clientY - from[1]); from = [e.clientX, e.clientY]; } });
    canvas.addEventListener("pointerup", () => (from = null));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-e.deltaY * 0.0015)); }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const turns = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, 12], ArrowDown: [0, -12] }[e.key];
      if (turns) turn(...turns);
      else if (e.key === "+" || e.key === "=") zoom(1.25);
      else if (e.key === "-") zoom(0.8);
      else return;
      e.preventDefault();
    });
    slider.addEventListener("input", draw);
    let timer = null;
    play.addEventListener("click", () => {
      play.textContent = timer ? "Play" : "Pause";
      if (timer) { clearInterval(timer); timer = null; return; }
      timer = setInterval(() => { slider.value = (Number(slider.value) + 1) % pass.time_s.length; draw(); }, 50);
    });
    new ResizeObserver(draw).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    addEventListener("beforeprint", () => setTimeout(draw, 0));
  }
})();
