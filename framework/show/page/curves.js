// Curves over time, or along a path, in SVG, with a mark that moves.

const PALETTE = [0, 1, 2, 3, 4, 5].map((k) => ink(`series-${k}`));
const UNREAL = ink("unreal"); // what is drawn for comparison only
let frames = 0;

// A value that changes, to three digits of the largest that it takes: what cannot be seen there is 0.
function steady(value, largest) {
  const places = Math.min(12, 2 - Math.floor(Math.log10(largest || 1)));
  const text = places < 0 ? String(Math.round(value * 10 ** places) * 10 ** -places) : value.toFixed(places);
  return Number(text) === 0 ? "0" : text.replace("-", "−");
}

class Chart {
  // series: [{values, color, dash, name}], each on `time`; `limit` clips them; beyond the time `unreal` they are
  // grey, and begin anew. `band` has a least and a largest value for each time, `levels` are drawn across.
  // `along` is what time stands for, in a row of its own.
  // events: [{time, value, said, alarm}], a line each and, with a value, a ring on it. `tell` says a time.
  constructor(parent, { title, time, series, limit, events = [], unreal = Infinity, seek, height = 150, band, bandName, levels = [], levelName, along, tell = (t) => `${t.toFixed(3)} s` }) {
    Object.assign(this, { time, series, unreal, tell, breaks: events.filter(({ alarm }) => alarm).map((event) => event.time) });
    // drawn for letters of 14 px, and as much larger as those of the page are
    const scale = parseFloat(getComputedStyle(document.documentElement).fontSize) / 14;
    const { paddingLeft, paddingRight } = getComputedStyle(parent);
    const width = Math.max(300, (parent.clientWidth - parseFloat(paddingLeft) - parseFloat(paddingRight)) / scale), left = 52, right = 10, top = 22, bottom = along ? 32 : 20;
    const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "chart" }, parent);
    this.root = root;
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
    const box = { x: left, y: top, width: width - left - right, height: height - top - bottom };
    this.x = (t) => left + (t / duration) * box.width;
    this.value = (y) => high - ((y - top) / box.height) * (high - low);
    this.height = (value) => top + ((high - Math.min(9 * high, Math.max(-9 * high, value))) / (high - low)) * box.height;
    for (const value of ticks(low, high)) {
      svg("line", { x1: left, x2: width - right, y1: this.height(value), y2: this.height(value), class: value ? "grid" : "axis" }, root);
      svg("text", { x: left - 5, y: this.height(value) + 4, "text-anchor": "end" }, root).textContent = rounded(value);
    }
    const unit = "time [s]";
    for (const t of ticks(0, (1 + 1e-6) * duration)) { // samples may end that short
      const last = this.x(t) > width - right - 7.8 * unit.length; // there stands the unit
      if (along || !last) svg("text", { x: this.x(t), y: height - bottom + 15, "text-anchor": along && last ? "end" : "middle" }, root).textContent = rounded(t);
    }
    svg("text", { x: width - right, y: height - 5, "text-anchor": "end" }, root).textContent = along || unit;
    const head = svg("text", { x: 4, y: 13, class: "title" }, root);
    head.textContent = title;
    for (const { name, color, dash } of series.filter((each) => each.name)) {
      svg("tspan", { dx: 9, style: `fill:${color}` }, head).textContent = dash ? "┄ " : "━ ";
      svg("tspan", {}, head).textContent = name;
    }
    if (bandName) {
      svg("tspan", { dx: 9, style: "fill:var(--given)", opacity: 0.5 }, head).textContent = "█ ";
      svg("tspan", {}, head).textContent = bandName;
    }
    if (levelName) svg("tspan", { dx: 9 }, head).textContent = `┄ ${levelName}`;
    if (head.getComputedTextLength() > width - 8) for (const [name, value] of [["textLength", width - 8], ["lengthAdjust", "spacingAndGlyphs"]]) head.setAttribute(name, value);
    const frame = `frame${frames++}`;
    svg("rect", box, svg("clipPath", { id: frame }, root));
    const inside = svg("g", { "clip-path": `url(#${frame})` }, root);
    if (band) {
      const edge = (side) => Array.from(time, (t, k) => `${this.x(t).toFixed(1)} ${this.height(band[2 * k + side]).toFixed(2)}`);
      svg("polygon", { points: [...edge(0), ...edge(1).reverse()].join(" "), class: "band" }, inside);
    }
    for (const level of levels) svg("line", { x1: left, x2: width - right, y1: this.height(level), y2: this.height(level), class: "level" }, inside);
    for (const { time: t } of events) svg("line", { x1: this.x(t), x2: this.x(t), y1: top, y2: height - bottom, class: "event" }, inside);
    series.forEach(({ values, color, dash }) => {
      for (const [path, shade] of [[this.outline(values, -Infinity, unreal), color], [this.outline(values, unreal, Infinity), UNREAL]]) {
        if (path) svg("path", { d: path, fill: "none", stroke: shade, "stroke-width": 2, "stroke-dasharray": dash || "" }, inside);
      }
    });
    const taken = [];
    for (const { time: t, value, said, alarm } of events) {
      if (value !== undefined) svg("circle", { cx: this.x(t), cy: this.height(value), r: 4.5, class: `ring ${alarm ? "alarm" : ""}` }, root);
      if (said) this.write(said, this.x(t), value === undefined ? top + 6 : this.height(value), box, taken, alarm ? "said alarm" : "said", root);
    }
    this.line = svg("line", { y1: top, y2: height - bottom, class: "mark" }, root);
    this.dots = series.map(() => svg("circle", { r: 4, stroke: ink("paper") }, inside));
    const at = (event) => {
      const edges = root.getBoundingClientRect();
      seek(((event.clientX - edges.left) / edges.width * width - left) / box.width * duration);
    };
    root.addEventListener("pointerdown", (event) => { root.setPointerCapture(event.pointerId); at(event); });
    root.addEventListener("pointermove", (event) => { if (event.buttons) at(event); });
    // by keyboard as by hand
    const keys = { tabindex: 0, role: "slider", "aria-label": title, "aria-valuemin": 0, "aria-valuemax": duration };
    for (const [name, value] of Object.entries(keys)) root.setAttribute(name, value);
    root.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -0.01, ArrowDown: -0.01, ArrowRight: 0.01, ArrowUp: 0.01, Home: -Infinity, End: Infinity }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      seek(Math.min(Math.max(this.at + step * duration, 0), duration));
    });
    this.mark(0, 0, 0);
  }

  // Writes a text beside a point, as near as it can stand clear of the curves and of the texts before it.
  write(text, x, y, box, taken, kind, root) {
    const written = svg("text", { class: kind }, root);
    written.textContent = text;
    const width = written.getComputedTextLength(), up = 9, down = 3;
    const dots = this.series.flatMap(({ values }) => Array.from(values, (value, k) => [this.x(this.time[k]), this.height(value)])).filter(([, height]) => isFinite(height));
    const lines = dots.flatMap(([a, b], k) => { // the steep pieces of a curve, filled with dots
      const [c, d] = dots[k - 1] || [a, b], between = c < a ? Math.min(40, Math.floor(Math.abs(d - b) / 4)) : 0;
      return [[a, b], ...Array.from({ length: between }, (_, i) => [a + ((c - a) * (i + 1)) / (between + 1), b + ((d - b) * (i + 1)) / (between + 1)])];
    });
    const struck = ([left, base]) => lines.filter(([a, b]) => left - 3 < a && a < left + width + 3 && base - up - 3 < b && b < base + down + 3).length
      + 1000 * taken.filter((other) => left < other.right && other.left < left + width && base - up < other.base + down && other.base - up < base + down).length;
    let best = [Math.max(box.x, x - 9 - width), y - 7], least = Infinity;
    for (let aside = 0; aside < box.width && least > 0; aside += 24) {
      for (let away = 0; away < box.height && least > 0; away += 4) {
        for (const base of away ? [y + 4 - away, y + 4 + away] : [y + 4]) {
          for (const left of [x + 9 + aside, x - 9 - aside - width]) {
            if (left <= box.x || left + width >= box.x + box.width || base - up <= box.y || base + down >= box.y + box.height) continue;
            const hit = struck([left, base]);
            if (hit < least) [best, least] = [[left, base], hit];
          }
        }
      }
    }
    written.setAttribute("x", best[0]);
    written.setAttribute("y", best[1]);
    taken.push({ left: best[0], right: best[0] + width, base: best[1] });
  }

  // The curve strictly between two times, as far as it is finite.
  outline(values, from, to) {
    let text = "";
    for (let k = 0; k < values.length; k++) {
      if (!isFinite(values[k]) || this.time[k] <= from || this.time[k] >= to) continue;
      const broken = this.breaks.some((t) => this.time[k - 1] < t && t <= this.time[k]);
      text += `${text && !broken ? "L" : "M"}${this.x(this.time[k]).toFixed(1)} ${this.height(values[k]).toFixed(2)}`;
    }
    return text;
  }

  // The time and the values there, in words.
  told(t, k, part) {
    const values = this.series.map(({ values, name }) => `${name ? `${name} ` : ""}${rounded(between(values, k, part))}`);
    return `${this.tell(t)}: ${values.join(", ")}`;
  }

  mark(t, k, part) {
    this.at = t;
    this.root.setAttribute("aria-valuenow", t);
    this.root.setAttribute("aria-valuetext", this.told(t, k, part));
    const x = this.x(t);
    this.line.setAttribute("x1", x);
    this.line.setAttribute("x2", x);
    this.series.forEach(({ values, color }, i) => {
      const value = between(values, k, part);
      this.dots[i].setAttribute("cx", x);
      this.dots[i].setAttribute("cy", this.height(isFinite(value) ? value : 0));
      this.dots[i].setAttribute("visibility", isFinite(value) ? "visible" : "hidden");
      this.dots[i].setAttribute("fill", t > this.unreal ? UNREAL : color);
    });
  }
}

function between(values, k, part) {
  return part > 0 ? values[k] + part * (values[k + 1] - values[k]) : values[k];
}
