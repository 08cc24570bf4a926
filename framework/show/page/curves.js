// Curves over time beside the scene, in SVG, with a mark that moves.

const PALETTE = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];

function svg(name, attributes, parent) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.appendChild(element);
  return element;
}

// Round values from low to high: as few as possible, but three.
function ticks(low, high) {
  const power = Math.pow(10, Math.floor(Math.log10(high - low)));
  for (const part of [5, 2, 1, 0.5, 0.2, 0.1]) {
    const step = part * power, found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-9); k++) found.push(k * step);
    if (found.length >= 3) return found;
  }
  return [low, high];
}

function rounded(value) {
  if (value === 0 || Math.abs(value) < 1e-12) return "0";
  return Number(value.toPrecision(3)).toString().replace("-", "−");
}

class Chart {
  // series: [{values, color, dash}], each on `time`; `limit` clips them.
  constructor(parent, { title, time, series, limit, events, seek, note, height = 150 }) {
    Object.assign(this, { time, series });
    const width = 460, left = 52, right = 10, top = 22, bottom = 20;
    const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "chart", role: "img" }, parent);
    const duration = time[time.length - 1];
    let largest = limit;
    if (largest === undefined) {
      largest = 0;
      for (const { values } of series) for (const value of values) if (isFinite(value)) largest = Math.max(largest, Math.abs(value));
    }
    largest = 1.08 * largest || 1;
    let low = -largest;
    const high = largest;
    if (series.every(({ values }) => values.every((value) => value >= 0))) low = 0;
    this.x = (t) => left + (t / duration) * (width - left - right);
    this.y = (value) => top + ((high - Math.min(high, Math.max(low, value))) / (high - low)) * (height - top - bottom);
    for (const value of ticks(low, high)) {
      svg("line", { x1: left, x2: width - right, y1: this.y(value), y2: this.y(value), class: value ? "grid" : "axis" }, root);
      svg("text", { x: left - 5, y: this.y(value) + 4, "text-anchor": "end" }, root).textContent = rounded(value);
    }
    for (const t of ticks(0, duration)) {
      if (this.x(t) > width - right - 62) continue; // there stands the unit
      svg("text", { x: this.x(t), y: height - 5, "text-anchor": "middle" }, root).textContent = rounded(t);
    }
    svg("text", { x: width - right, y: height - 5, "text-anchor": "end" }, root).textContent = "time [s]";
    svg("text", { x: 4, y: 13, class: "title" }, root).textContent = title;
    if (note) svg("text", { x: width - right, y: 13, "text-anchor": "end", style: "fill:#b3261e;font-weight:600" }, root).textContent = note;
    for (const t of events) svg("line", { x1: this.x(t), x2: this.x(t), y1: top, y2: height - bottom, class: "event" }, root);
    series.forEach(({ values, color, dash }) => {
      svg("path", { d: this.outline(values), fill: "none", stroke: color, "stroke-width": 2, "stroke-dasharray": dash || "" }, root);
    });
    this.line = svg("line", { y1: top, y2: height - bottom, class: "mark" }, root);
    this.dots = series.map(({ color }) => svg("circle", { r: 4, fill: color, stroke: "#fff" }, root));
    const at = (event) => {
      const box = root.getBoundingClientRect();
      seek(((event.clientX - box.left) / box.width * width - left) / (width - left - right) * duration);
    };
    root.addEventListener("pointerdown", (event) => { root.setPointerCapture(event.pointerId); at(event); });
    root.addEventListener("pointermove", (event) => { if (event.buttons) at(event); });
    this.mark(0, 0, 0);
  }

  outline(values) {
    let text = "";
    for (let k = 0; k < values.length; k++) {
      if (!isFinite(values[k])) continue;
      text += `${text ? "L" : "M"}${this.x(this.time[k]).toFixed(1)} ${this.y(values[k]).toFixed(2)}`;
    }
    return text;
  }

  mark(t, k, part) {
    const x = this.x(t);
    this.line.setAttribute("x1", x);
    this.line.setAttribute("x2", x);
    this.series.forEach(({ values }, i) => {
      const value = between(values, k, part);
      this.dots[i].setAttribute("cx", x);
      this.dots[i].setAttribute("cy", this.y(isFinite(value) ? value : 0));
    });
  }
}

function between(values, k, part) {
  return part > 0 ? values[k] + part * (values[k + 1] - values[k]) : values[k];
}
