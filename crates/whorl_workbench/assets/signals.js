// Computations on signals: thinning for the screen, expressions, histogram, spectrum, autocorrelation. A signal is {name, unit, t, v}.

// First index at which a time is not before `at`.
export function index(t, at) {
  let [low, high] = [0, t.length];
  while (low < high) { const mid = (low + high) >> 1; if (t[mid] < at) low = mid + 1; else high = mid; }
  return low;
}

// Smallest and largest value of each block of so many readings, in the order in which they come: made once, and kept as long as the readings.
const made = new WeakMap();
function blocks(v, size) {
  if (!made.has(v)) made.set(v, new Map());
  const sizes = made.get(v);
  if (!sizes.has(size)) {
    const pairs = new Float32Array(2 * Math.ceil(v.length / size));
    for (let block = 0; 2 * block < pairs.length; block++) {
      let low = -1, high = -1;
      const end = Math.min(v.length, (block + 1) * size);
      for (let i = block * size; i < end; i++) { if (Number.isNaN(v[i])) continue; if (low < 0 || v[i] < v[low]) low = i; if (high < 0 || v[i] > v[high]) high = i; }
      [pairs[2 * block], pairs[2 * block + 1]] = low < 0 ? [NaN, NaN] : low < high ? [v[low], v[high]] : [v[high], v[low]];
    }
    sizes.set(size, pairs);
  }
  return sizes.get(size);
}

const shown = (v, begin, end) => Array.from(v.subarray(begin, end), (x) => (Number.isFinite(x) ? x : null));

// Times and values of signals that share their times, thinned to at most `columns` blocks between two times. Blocks begin at the same readings
// wherever a stretch begins, so that a picture that is moved does not flicker.
export function thin(list, from, to, columns) {
  const { t } = list[0];
  const begin = Math.max(0, index(t, from) - 1), end = Math.min(t.length, index(t, to) + 1);
  if (end - begin <= 2 * columns) return [Array.from(t.subarray(begin, end)), ...list.map(({ v }) => shown(v, begin, end))];
  const size = 2 ** Math.ceil(Math.log2((end - begin) / columns));
  const [first, last] = [Math.floor(begin / size), Math.ceil(end / size)];
  const x = [];
  for (let block = first; block < last; block++) x.push(t[block * size], t[Math.min(t.length - 1, block * size + size / 2)]);
  return [x, ...list.map(({ v }) => shown(blocks(v, size), 2 * first, 2 * last))];
}

// The value at a time, between neighbours; of a command the last one.
export function at(signal, time) {
  const { t, v } = signal;
  const k = index(t, time);
  if (k < t.length && t[k] === time) return v[k];
  if (k === 0 || k >= t.length) return NaN;
  if (signal.holds) return v[k - 1];
  return v[k - 1] + ((time - t[k - 1]) / (t[k] - t[k - 1])) * (v[k] - v[k - 1]);
}

const WORDS = {
  sin: Math.sin, cos: Math.cos, tan: Math.tan, abs: Math.abs, sqrt: Math.sqrt, exp: Math.exp, log: Math.log, sign: Math.sign, atan2: Math.atan2,
  norm: Math.hypot, min: Math.min, max: Math.max, rad: (x) => (x * Math.PI) / 180, deg: (x) => (x * 180) / Math.PI,
};
export const FUNCTIONS = [...Object.keys(WORDS), "d", "lag"];

// A derived signal: numbers, + - * / ^, parentheses, names of signals, functions, d(x) for dx/dt, lag(x, seconds). Its times are those of
// the first signal that it names.
export function derived(text, signals) {
  const words = text.match(/\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|\S/g) || [];
  let position = 0;
  const used = [];
  const peek = () => words[position];
  const take = (word) => peek() === word && (position++, true);
  const sum = () => {
    let left = product();
    while (peek() === "+" || peek() === "-") { const sign = words[position++]; const [a, b] = [left, product()]; left = sign === "+" ? (k) => a(k) + b(k) : (k) => a(k) - b(k); }
    return left;
  };
  const product = () => {
    let left = power();
    while (peek() === "*" || peek() === "/") { const sign = words[position++]; const [a, b] = [left, power()]; left = sign === "*" ? (k) => a(k) * b(k) : (k) => a(k) / b(k); }
    return left;
  };
  const power = () => {
    if (take("-")) { const a = power(); return (k) => -a(k); }
    const a = unit();
    if (!take("^")) return a;
    const b = power();
    return (k) => a(k) ** b(k);
  };
  const unit = () => {
    const word = words[position++];
    if (word === undefined) throw new Error("the expression ends too early");
    if (word === "(") { const inside = sum(); if (!take(")")) throw new Error("a parenthesis is not closed"); return inside; }
    if (/^\d/.test(word)) { const number = Number(word); return () => number; }
    if (word === "t") return (time) => time;
    if (word === "pi") return () => Math.PI;
    if (peek() === "(" && (WORDS[word] || word === "d" || word === "lag")) {
      position++;
      const list = [sum()];
      while (take(",")) list.push(sum());
      if (!take(")")) throw new Error("a parenthesis is not closed");
      if (word === "d") { const [a] = list; return (time) => (a(time + step()) - a(time - step())) / (2 * step()); }
      if (word === "lag") { if (list.length < 2) throw new Error("lag(x, seconds)"); const [a, b] = list; return (time) => a(time - b(time)); }
      return (time) => WORDS[word](...list.map((a) => a(time)));
    }
    const signal = signals.find((s) => s.name === word);
    if (!signal) throw new Error(`there is no signal "${word}"; there are ${signals.slice(0, 12).map((s) => s.name).join(", ")}; functions: ${FUNCTIONS.join(", ")}`);
    used.push(signal);
    return (time) => at(signal, time);
  };
  const step = () => { const { t } = used[0] || { t: [0, 0.01] }; return (t[t.length - 1] - t[0]) / Math.max(1, t.length - 1); };
  const value = sum();
  if (position < words.length) throw new Error(`"${words[position]}" is not expected there`);
  if (!used.length) throw new Error("name a signal");
  const t = used[0].t;
  return { name: text, group: text, unit: "", t, v: Float32Array.from(t, value), noise: null, holds: false };
}

const finite = (v, begin, end) => Array.from(v.subarray(begin, end)).filter(Number.isFinite);

export function histogram(signal, from, to, bins = 60) {
  const values = finite(signal.v, index(signal.t, from), index(signal.t, to));
  let [low, high] = [Infinity, -Infinity];
  for (const x of values) { if (x < low) low = x; if (x > high) high = x; }
  if (!(high > low)) return null;
  const counts = new Array(bins).fill(0);
  for (const x of values) counts[Math.min(bins - 1, Math.floor(((x - low) / (high - low)) * bins))]++;
  return { x: counts.map((_, k) => low + ((k + 0.5) / bins) * (high - low)), y: counts };
}

// In place, of a power of two.
function fft(re, im) {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) { [re[i], re[j]] = [re[j], re[i]]; [im[i], im[j]] = [im[j], im[i]]; }
  }
  for (let length = 2; length <= n; length *= 2) {
    const angle = (-2 * Math.PI) / length, half = length / 2;
    for (let i = 0; i < n; i += length) for (let k = 0; k < half; k++) {
      const [c, s] = [Math.cos(angle * k), Math.sin(angle * k)], a = i + k, b = a + half;
      const [x, y] = [re[b] * c - im[b] * s, re[b] * s + im[b] * c];
      re[b] = re[a] - x; im[b] = im[a] - y; re[a] += x; im[a] += y;
    }
  }
}

// Evenly spaced samples between two times.
function even(signal, from, to) {
  const begin = index(signal.t, from), end = index(signal.t, to);
  const count = end - begin;
  if (count < 32) return null;
  const step = (signal.t[end - 1] - signal.t[begin]) / (count - 1);
  const values = new Float64Array(count);
  for (let k = 0; k < count; k++) { const x = at(signal, signal.t[begin] + k * step); values[k] = Number.isFinite(x) ? x : 0; }
  const mean = values.reduce((a, b) => a + b, 0) / count;
  return { step, values: values.map((x) => x - mean) };
}

// Power spectral density by Welch: Hann windows that overlap by half, one-sided [unit^2/Hz].
export function spectrum(signal, from, to) {
  const found = even(signal, from, to);
  if (!found) return null;
  const { step, values } = found;
  const n = Math.min(4096, 2 ** Math.floor(Math.log2(values.length / 2)));
  const window = Float64Array.from({ length: n }, (_, k) => 0.5 - 0.5 * Math.cos((2 * Math.PI * k) / n));
  const power = window.reduce((sum, w) => sum + w * w, 0);
  const density = new Float64Array(n / 2);
  let count = 0;
  for (let start = 0; start + n <= values.length; start += n / 2, count++) {
    const re = Float64Array.from({ length: n }, (_, k) => values[start + k] * window[k]), im = new Float64Array(n);
    fft(re, im);
    for (let k = 0; k < n / 2; k++) density[k] += (2 * (re[k] ** 2 + im[k] ** 2) * step) / power;
  }
  return { x: Array.from(density, (_, k) => k / (n * step)).slice(1), y: Array.from(density, (d) => d / count).slice(1) };
}

// Autocorrelation of the noise: of second differences' remainder after a running mean; white noise stays in the band of 99 %.
export function whiteness(signal, from, to, lags = 40) {
  const found = even(signal, from, to);
  if (!found) return null;
  const half = 10, { values } = found;
  const rest = [];
  for (let k = half; k + half < values.length; k++) { let sum = 0; for (let i = -half; i <= half; i++) sum += values[k + i]; rest.push(values[k] - sum / (2 * half + 1)); }
  const power = rest.reduce((sum, x) => sum + x * x, 0);
  if (!(power > 0)) return null;
  const y = Array.from({ length: lags }, (_, lag) => { let sum = 0; for (let k = 0; k + lag + 1 < rest.length; k++) sum += rest[k] * rest[k + lag + 1]; return sum / power; });
  return { x: y.map((_, k) => k + 1), y, band: 2.576 / Math.sqrt(rest.length) };
}
