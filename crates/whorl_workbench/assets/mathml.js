// Equations in plain text (`torque = -k * w * norm(w)`) as MathML, which browsers set by themselves.
const NS = "http://www.w3.org/1998/Math/MathML";
const m = (tag, ...children) => { const e = document.createElementNS(NS, tag); e.append(...children); return e; };
const GREEK = { w: "ω", eta: "η", zeta: "ζ", Om: "Ω", e: "e", alpha: "α", beta: "β", gamma: "γ", delta: "δ", theta: "θ", lambda: "λ", mu: "μ", rho: "ρ", sigma: "σ", tau: "τ", phi: "φ", omega: "ω", Omega: "Ω", psi: "ψ", pi: "π", torque: "τ" };

function tokens(text) {
  return text.match(/\d+(?:\.\d+)?(?:e[+-]?\d+)?|[A-Za-zα-ωΑ-Ω][\wα-ω]*(?:\.[A-Za-z]\w*)*|<=|>=|\S/g) || [];
}

// A name: its first part, the rest below it.
function name(word) {
  const [first, ...rest] = word.split(/[_.]/);
  const letter = m("mi", GREEK[first] || first);
  return rest.length ? m("msub", letter, m("mtext", rest.map((part) => GREEK[part] || part).join(" "))) : letter;
}

class Reader {
  constructor(text) { this.list = tokens(text); this.at = 0; this.inBars = 0; }
  peek() { return this.list[this.at]; }
  take(word) { if (this.peek() === word) { this.at++; return true; } return false; }
  sum() {
    const parts = [this.product()];
    while (["+", "-", "=", "<", ">", "<=", ">=", ",", ";", ":"].includes(this.peek())) { const sign = this.list[this.at++]; parts.push(m("mo", { "-": "−", "<=": "≤", ">=": "≥" }[sign] || sign), this.product()); }
    return m("mrow", ...parts);
  }
  product() {
    let left = this.power();
    for (;;) {
      if (this.take("*") || this.take("·")) left = m("mrow", left, m("mo", "·"), this.power());
      else if (this.take("/")) left = m("mfrac", left, this.power());
      else if (this.take("x")) left = m("mrow", left, m("mo", "×"), this.power());
      else if (this.peek() === "|" ? !this.inBars : this.peek() !== undefined && !/^[-+=<>,;:)\]}]|^[<>]=$/.test(this.peek())) left = m("mrow", left, m("mspace"), this.power());
      else return left;
    }
  }
  power() {
    const base = this.unit();
    return this.take("^") ? m("msup", base, this.power()) : base;
  }
  // What stands in brackets behind a number: its unit, upright.
  unitOf() {
    let text = "";
    while (this.peek() !== undefined && !this.take("]")) { const word = this.list[this.at++]; text += /\w$/.test(text) && /^\w/.test(word) ? ` ${word}` : word; }
    return text;
  }
  unit() {
    const word = this.list[this.at++];
    if (word === undefined) throw new Error("ends early");
    if (word === "-" || word === "+") return m("mrow", m("mo", word === "-" ? "−" : "+"), this.power());
    if (word === "(" || word === "[") {
      const inside = this.sum();
      if (!this.take(word === "(" ? ")" : "]")) throw new Error("not closed");
      return m("mrow", m("mo", word), inside, m("mo", word === "(" ? ")" : "]"));
    }
    if (word === "|") {
      this.inBars++;
      const inside = this.sum();
      this.inBars--;
      if (!this.take("|")) throw new Error("not closed");
      return m("mrow", m("mo", "|"), inside, m("mo", "|"));
    }
    if (/^\d/.test(word)) return this.take("[") ? m("mrow", m("mn", word), m("mtext", `\u2009${this.unitOf()}`)) : m("mn", word);
    if (!/^[A-Za-zα-ωΑ-Ω]/.test(word)) throw new Error(word);
    if (this.peek() === "(") {
      this.at++;
      const inside = this.sum();
      if (!this.take(")")) throw new Error("not closed");
      if (word === "sqrt") return m("msqrt", inside);
      if (word === "abs" || word === "norm") return m("mrow", m("mo", word === "abs" ? "|" : "‖"), inside, m("mo", word === "abs" ? "|" : "‖"));
      return m("mrow", m("mi", word), m("mo", "("), inside, m("mo", ")"));
    }
    return name(word);
  }
}

// As an equation where it is one, else as the words that it is.
export function equation(text) {
  const place = document.createElement("div");
  place.className = "equation";
  // A long one scrolls, also by the keyboard.
  place.tabIndex = 0;
  place.setAttribute("role", "group");
  place.setAttribute("aria-label", "Equation");
  try {
    const reader = new Reader(text);
    const all = reader.sum();
    if (reader.peek() !== undefined) throw new Error("words");
    const math = m("math", all);
    math.setAttribute("display", "block");
    math.setAttribute("aria-label", text);
    math.style.textAlign = "left";
    place.append(math);
  } catch {
    const code = document.createElement("code");
    code.textContent = text;
    place.append(code);
  }
  return place;
}
