// Plays a recording: the slider, the scene and every figure over time show the same instant.
(function (whorl) {
  "use strict";
  // Integers stored as differences; null where there is nothing.
  const decoded = (steps, scale) => {
    let at = 0;
    return steps.map((d) => (d === null ? null : (at += d) / scale));
  };
  const last = (list, t) => {
    let [low, high] = [0, list.length];
    while (low < high) { const mid = (low + high) >> 1; if (list[mid][0] <= t) low = mid + 1; else high = mid; }
    return low ? list[low - 1] : null;
  };

  class Recording {
    constructor(scene) {
      Object.assign(this, { step_s: scene.step_s, frames: scene.frames, steps: scene.steps });
      this.platforms = scene.platforms.map((p) => ({
        q: p.q.map((c) => decoded(c, 1e5)), ref: p.ref.map((c) => decoded(c, 1e5)), h: p.h.map((c) => decoded(c, 1e3)),
        jets: p.jets.map((c) => decoded(c, 100)), error_deg: decoded(p.error_mdeg, 1e3), gas_g: decoded(p.gas_mg, 1e3),
        link_ms: decoded(p.link_ms, 1), modes: p.modes,
      }));
    }

    at(t) {
      const place = Math.max(0, Math.min(this.frames - 1, t / this.step_s));
      const i = Math.min(Math.floor(place), Math.max(this.frames - 2, 0));
      const j = Math.min(i + 1, this.frames - 1);
      const f = place - i;
      const near = f < 0.5 ? i : j;
      const mixed = (parts) => {
        const v = parts.map((c) => (c[i] == null || c[j] == null ? c[near] : c[i] + f * (c[j] - c[i])));
        return v.length && v.every((x) => x != null) ? v : null;
      };
      const turned = (parts) => {
        const v = mixed(parts);
        if (!v) return null;
        const n = Math.hypot(...v);
        return n > 0 ? v.map((x) => x / n) : null;
      };
      const platforms = this.platforms.map((p) => {
        const mode = last(p.modes, t);
        return {
          q: turned(p.q), ref: turned(p.ref), h: mixed(p.h), jets: p.jets.map((c) => c[i]), error_deg: p.error_deg[near],
          gas_g: p.gas_g[near], link_ms: p.link_ms[near], mode: mode ? mode[1] : null, alarm: mode ? mode[2] : false,
        };
      });
      const step = last(this.steps, t);
      return { t, step: step ? step[1] : "", platforms };
    }
  }

  whorl.replay = (data, duration_s) => {
    const by = (id) => document.getElementById(id);
    const recording = new Recording(data.scene);
    const scene = new whorl.Scene(by("scene"), data.scene.shapes);
    whorl.redrawScene = () => scene.redraw();
    const numbers = new whorl.Numbers(by("numbers"), data.scene.shapes);
    whorl.key(by("key"), data.scene.shapes);
    const [slider, play, speed, clock, state] = ["time", "play", "speed", "clock", "state"].map(by);
    slider.max = duration_s;
    slider.step = "any";
    let playing = null;

    whorl.onTime((t) => {
      const frame = recording.at(t);
      scene.draw(frame);
      numbers.show(frame);
      slider.value = t;
      clock.textContent = `${t.toFixed(2)} of ${duration_s.toFixed(1)} s`;
      state.textContent = frame.step;
      slider.setAttribute("aria-valuetext", `${t.toFixed(1)} s, ${frame.step}`);
    });
    const clamp = (t) => Math.max(0, Math.min(duration_s, t));
    // A reader who points at a figure takes the time over, unless the recording is played.
    whorl.seek = (t, source) => { if (playing === null) whorl.setTime(clamp(t), source); };
    const stop = () => { playing = null; play.textContent = "Play"; };
    const tick = (now) => {
      if (playing === null) return;
      const t = clamp(whorl.time() + ((now - playing) / 1000) * Number(speed.value));
      playing = now;
      whorl.setTime(t);
      if (t >= duration_s) stop();
      else requestAnimationFrame(tick);
    };
    play.addEventListener("click", () => {
      if (playing !== null) return stop();
      if (whorl.time() >= duration_s) whorl.setTime(0);
      playing = performance.now();
      play.textContent = "Pause";
      requestAnimationFrame(tick);
    });
    slider.addEventListener("input", () => { stop(); whorl.setTime(Number(slider.value)); });
    for (const row of document.querySelectorAll("tr[data-time]")) {
      row.style.cursor = "pointer";
      row.addEventListener("click", () => { stop(); whorl.setTime(clamp(Number(row.dataset.time))); });
    }
    const begin = Number(new URLSearchParams(location.hash.slice(1)).get("t"));
    whorl.setTime(clamp(begin || data.scene.begin_s || 0));
  };
})((window.whorl = window.whorl || {}));
