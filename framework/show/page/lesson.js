// Condition (8) by hand: all numbers are Chebyshev series in the share s of the path, evaluated here.
const doc = JSON.parse(document.getElementById("document").textContent);
const MOTORS = doc.motors.length, CROSSING = doc.crossing;
const SAMPLES = 600; // of sigma, for curves and peaks
const HANDLES = [0.12, 0.25, 0.38, 0.5, 0.62, 0.75, 0.88]; // in sigma, of the speed that is bent
const SNAP = 0.05; // of the largest force along t_s: a miss that is taken for a hit, and made one
const CLEAR = 2e-4; // in s beside the crossing, where quotients by g lose digits
const COLOURS = ["var(--first)", "var(--second)"];
const byId = (id) => document.getElementById(id);

// ---- what the framework computed ------------------------------------------------------------------------
function series(coefficients, x) { // Clenshaw
  let b1 = 0, b2 = 0;
  for (let k = coefficients.length - 1; k > 0; k--) [b1, b2] = [2 * x * b1 - b2 + coefficients[k], b1];
  return x * b1 - b2 + coefficients[0];
}
function slope(coefficients, x) { // of a series along x
  const derivative = new Array(Math.max(1, coefficients.length - 1)).fill(0);
  for (let k = coefficients.length - 1; k > 0; k--) derivative[k - 1] = (k + 1 < derivative.length ? derivative[k + 1] : 0) + 2 * k * coefficients[k];
  derivative[0] /= 2;
  return series(derivative, x);
}
const along = (key, s) => doc.series.slice(...doc.slices[key]).map((each) => series(each, 2 * s - 1));

// Motor torques and t_s . W_p at s of a motion with ds/dt = v, d2s/dt2 = a.
function torques(s, v, a, gravity) {
  const [g] = along("g", s), parts = along(`torque_${gravity}`, s);
  return Array.from({ length: MOTORS }, (_, k) => (parts[k] + parts[MOTORS + k] * v * v + parts[2 * MOTORS + k] * a) / g);
}
function power(s, v, a, gravity) {
  const [c0, cz, cu] = along(`power_${gravity}`, s);
  return c0 + cz * v * v + cu * a;
}
// The largest force along t_s that motors within their limit can give.
function reach(s, limit) {
  const G = along("motor_speed", s), t = along("t_s", s);
  let sum = 0;
  for (let k = 0; k < MOTORS; k++) sum += Math.abs(G[2 * k] * t[0] + G[2 * k + 1] * t[1]);
  return limit * sum;
}

// ---- laws: s = phi(sigma), z(sigma) = (d sigma/dt)^2 ------------------------------------------------------
const phi = (x) => x * x * x * (10 - 15 * x + 6 * x * x);
const phi1 = (x) => 30 * x * x * (1 - x) * (1 - x);
const phi2 = (x) => 60 * x * (1 - x) * (1 - 2 * x);
function inverse(s) {
  let low = 0, high = 1;
  for (let k = 0; k < 60; k++) { const middle = 0.5 * (low + high); if (phi(middle) < s) low = middle; else high = middle; }
  return 0.5 * (low + high);
}
const SIGMA_C = inverse(CROSSING);
const SIGMA = Array.from({ length: SAMPLES }, (_, k) => (k + 0.5) / SAMPLES);

// A natural cubic spline through values at the handles and, level, at both ends.
function spline(values) {
  const x = [0, ...HANDLES, 1], y = [values[0], ...values, values[values.length - 1]], n = x.length;
  const m = new Array(n).fill(0), upper = new Array(n).fill(0), right = new Array(n).fill(0);
  for (let i = 1; i < n - 1; i++) {
    const h = x[i] - x[i - 1], k = x[i + 1] - x[i], pivot = 2 * (h + k) - h * upper[i - 1];
    upper[i] = k / pivot;
    right[i] = (6 * ((y[i + 1] - y[i]) / k - (y[i] - y[i - 1]) / h) - h * right[i - 1]) / pivot;
  }
  for (let i = n - 2; i > 0; i--) m[i] = right[i] - upper[i] * m[i + 1];
  return (at) => {
    let i = 0;
    while (i < n - 2 && at > x[i + 1]) i++;
    const h = x[i + 1] - x[i], a = (x[i + 1] - at) / h, b = 1 - a;
    return {
      value: a * y[i] + b * y[i + 1] + ((a ** 3 - a) * m[i] + (b ** 3 - b) * m[i + 1]) * h * h / 6,
      slope: (y[i + 1] - y[i]) / h + ((1 - 3 * a * a) * m[i] + (3 * b * b - 1) * m[i + 1]) * h / 6,
    };
  };
}
// The law through relative speeds at the handles (logarithms, so that it never turns back), in the duration.
function bentLaw(logarithms) {
  const bend = spline(logarithms);
  let twist = 0, scale = 1;
  const z = (x) => {
    const { value, slope: rate } = bend(x), d = x - SIGMA_C, bell = Math.exp(-(d * d) / 0.02);
    const exponent = value + twist * d * bell, z0 = scale * Math.exp(2 * exponent);
    return { z: z0, u: z0 * (rate + twist * bell * (1 - d * d / 0.01)) };
  };
  const fit = () => {
    let time = 0;
    for (const x of SIGMA) time += 1 / (SAMPLES * Math.sqrt(z(x).z));
    scale *= (time / doc.duration) ** 2;
  };
  fit();
  return { z, twist: (value) => { twist = value; fit(); } };
}
function bestLaw(gravity) {
  const coefficients = doc.best[gravity].squared_speed;
  return { z: (x) => ({ z: series(coefficients, 2 * x - 1), u: slope(coefficients, 2 * x - 1) }) };
}
// What a law asks for at sigma: s, ds/dt, d2s/dt2.
function motion(law, x) {
  const { z, u } = law.z(x);
  return { s: phi(x), v: phi1(x) * Math.sqrt(z), a: phi1(x) * u + phi2(x) * z };
}

// ---- the state ---------------------------------------------------------------------------------------------
const LEVEL = HANDLES.map(() => 0);
const state = { step: 0, gravity: "off", logarithms: [...LEVEL], best: false, s: 0, push: [0, 0], playing: false };
let now = null; // the law and its curves

function missOf(law, gravity) {
  const { s, v, a } = motion(law, SIGMA_C);
  return power(s, v, a, gravity);
}
// All curves of the state; a near miss becomes a hit by a bend of the speed about the crossing.
function curves() {
  const { gravity } = state, law = state.best ? bestLaw(gravity) : bentLaw(state.logarithms);
  const limit = doc.best[gravity].limit;
  const powers = () => SIGMA.map((x) => { const { s, v, a } = motion(law, x); return power(s, v, a, gravity); });
  let wrench = powers(), largest = Math.max(...wrench.map(Math.abs)), miss = missOf(law, gravity);
  if (!state.best && state.step > 1 && Math.abs(miss) < SNAP * largest) {
    const { z } = law.z(SIGMA_C), [, , cu] = along(`power_${gravity}`, CROSSING);
    let last = 0, twist = -miss / (cu * phi1(SIGMA_C) * z);
    for (let k = 0; k < 40 && Math.abs(miss) > 1e-14 * largest && twist !== last; k++) { // by secants
      law.twist(twist);
      const before = miss;
      miss = missOf(law, gravity);
      [last, twist] = [twist, miss === before ? twist : twist - (miss * (twist - last)) / (miss - before)];
    }
    wrench = powers();
    largest = Math.max(...wrench.map(Math.abs));
  }
  const threads = Math.abs(miss) < 1e-9 * largest;
  const asked = SIGMA.map((x) => motion(law, x));
  const torque = asked.map(({ s, v, a }) => (threads && Math.abs(s - CROSSING) < CLEAR ? null : torques(s, v, a, gravity)));
  const peak = threads ? Math.max(...torque.filter(Boolean).flat().map(Math.abs)) : Infinity;
  const time = [];
  SIGMA.reduce((sum, x, k) => (time[k] = sum + 1 / (SAMPLES * Math.sqrt(law.z(x).z))), 0);
  now = { law, limit, wrench, largest, miss, threads, asked, torque, peak, time, band: asked.map(({ s }) => reach(s, limit)) };
}

// ---- drawing -------------------------------------------------------------------------------------------------
function element(name, attributes, parent) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (parent) parent.appendChild(made);
  return made;
}
function rounded(value) {
  return value === 0 ? "0" : Number(value.toPrecision(3)).toString().replace("-", "−");
}
const line = (points) => points.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");

class Plot {
  constructor(id, title) {
    this.root = byId(id);
    this.title = title;
  }

  begin(low, high) {
    [this.width, this.height] = [Math.max(280, this.root.clientWidth), Math.max(120, this.root.clientHeight)];
    this.root.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    this.root.replaceChildren();
    Object.assign(this, { low, high });
    element("text", { x: 48, y: 13, class: "title" }, this.root).textContent = this.title;
    for (const value of [low, 0, high].filter((each, k, all) => all.indexOf(each) === k && each >= low)) {
      element("line", { x1: 48, x2: this.width - 8, y1: this.y(value), y2: this.y(value), class: value ? "grid" : "axis" }, this.root);
      element("text", { x: 44, y: this.y(value) + 4, "text-anchor": "end" }, this.root).textContent = rounded(value);
    }
    element("line", { x1: this.x(CROSSING), x2: this.x(CROSSING), y1: 20, y2: this.height - 8, class: "crossing" }, this.root);
    const clip = element("clipPath", { id: `${this.root.id}-clip` }, this.root);
    element("rect", { x: 48, y: 20, width: this.width - 56, height: this.height - 28 }, clip);
    this.inside = element("g", { "clip-path": `url(#${this.root.id}-clip)` }, this.root);
  }

  x(s) { return 48 + s * (this.width - 56); }
  y(value) { return 20 + ((this.high - value) / (this.high - this.low)) * (this.height - 28); }
  value(y) { return this.high - ((y - 20) / (this.height - 28)) * (this.high - this.low); }

  curve(values, colour, dash = "") {
    const far = 20 * (this.high - this.low), kept = values.map((value, k) => [now.asked[k].s, value]).filter(([, value]) => value !== null && isFinite(value));
    const pieces = [[]];
    kept.forEach(([s, value], k) => { // a pole is no line from one side to the other
      if (k && !now.threads && (kept[k - 1][0] < CROSSING) !== (s < CROSSING)) pieces.push([]);
      pieces[pieces.length - 1].push([this.x(s), this.y(Math.min(Math.max(value, -far), far))]);
    });
    for (const piece of pieces) element("path", { d: line(piece), class: "curve", style: `stroke:${colour}`, "stroke-dasharray": dash }, this.inside);
  }

  mark(s) { element("line", { x1: this.x(s), x2: this.x(s), y1: 20, y2: this.height - 8, class: "mark" }, this.root); }
}
const plots = {
  speed: new Plot("speed", "speed along the path ds/dt [1/s]"),
  needle: new Plot("needle", "force along tₛ: asked for (pink), and what the motors can give (blue) [N]"),
  torque: new Plot("torque", `motor torques [${doc.unit}]: ${doc.motors[0]} ━  ${doc.motors[1]} ┄`),
};

function drawCurves() {
  const { speed, needle, torque } = plots, { step } = state, best = doc.best[state.gravity];
  const speeds = now.asked.map(({ v }) => v);
  speed.begin(0, 1.25 * Math.max(...speeds, 2.2 / doc.duration));
  speed.curve(speeds, "var(--ink)");
  if (step > 1 && !state.best) HANDLES.forEach((x, k) => handle(k, motion(now.law, x)));
  const high = now.largest;
  needle.begin(-1.2 * high, 1.2 * high);
  const edge = (sign) => now.asked.map(({ s }, k) => [needle.x(s), needle.y(sign * Math.min(now.band[k], 3 * high))]);
  element("path", { d: `${line([...edge(1), ...edge(-1).reverse()])}Z`, class: "band" }, needle.inside);
  needle.curve(now.wrench, "var(--wrench)");
  element("circle", { cx: needle.x(CROSSING), cy: needle.y(Math.max(-1.2 * high, Math.min(1.2 * high, now.miss))), r: 5, fill: now.threads ? "var(--good)" : "var(--alarm)" }, needle.root);
  const top = 2 * best.limit;
  torque.begin(-top, top);
  for (const sign of [-1, 1]) element("line", { x1: 48, x2: torque.width - 8, y1: torque.y(sign * best.limit), y2: torque.y(sign * best.limit), class: "limit" }, torque.root);
  for (let k = 0; k < MOTORS; k++) torque.curve(now.torque.map((each) => each && each[k]), COLOURS[k % 2], k ? "7 4" : "");
  for (const plot of Object.values(plots)) plot.mark(state.s);
  score();
}

function score() {
  const best = doc.best[state.gravity];
  const hit = now.threads
    ? `<span class="good">Through the eye</span>: no force along tₛ is asked for at the singular point. Peak torque <b>${rounded(now.peak)} ${doc.unit}</b>`
    : `<span class="alarm">Misses the eye by ${rounded(Math.abs(now.miss))} N</span>: no torque is large enough at the singular point`;
  const above = Math.round(100 * (now.peak / best.peak - 1));
  const compared = state.best ? ", of the best law" : now.threads && state.step > 2 ? `, ${above} % above the best law's ${rounded(best.peak)} ${doc.unit}` : "";
  byId("score").innerHTML = state.step ? `${hit}${compared}. ${doc.duration} s in all.` : "";
}

function handle(k, { s, v }) {
  const { speed } = plots;
  const knob = element("circle", {
    cx: speed.x(s), cy: speed.y(v), r: 8, class: "handle", tabindex: 0, role: "slider",
    "aria-label": `speed at ${Math.round(100 * s)} % of the path`, "aria-valuenow": v.toPrecision(3), "data-handle": k,
  }, speed.root);
  if (state.focus === k) knob.focus();
}
// Bend the speed so that handle k has it, as near as the duration allows.
function bendTo(k, wanted) {
  for (let pass = 0; pass < 12; pass++) {
    const { v } = motion(bentLaw(state.logarithms), HANDLES[k]);
    state.logarithms[k] = Math.min(3, Math.max(-3, state.logarithms[k] + Math.log(Math.max(wanted, 0.02) / v)));
  }
  update();
}
byId("speed").addEventListener("pointerdown", (event) => {
  const k = event.target.dataset.handle;
  if (k === undefined) return;
  event.preventDefault();
  state.focus = Number(k);
  const root = byId("speed");
  root.setPointerCapture(event.pointerId);
  const { low, high } = plots.speed;
  const move = (each) => {
    const box = root.getBoundingClientRect(), y = ((each.clientY - box.top) / box.height) * plots.speed.height;
    bendTo(state.focus, high - ((y - 20) / (plots.speed.height - 28)) * (high - low));
  };
  root.onpointermove = move;
  root.onpointerup = root.onpointercancel = () => { root.onpointermove = null; };
});
byId("speed").addEventListener("keydown", (event) => {
  const k = event.target.dataset.handle, way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
  if (k === undefined || !way) return;
  event.preventDefault();
  state.focus = Number(k);
  bendTo(state.focus, motion(now.law, HANDLES[k]).v * (1 + 0.03 * way * (event.shiftKey ? 5 : 1)));
});

// ---- the robot -----------------------------------------------------------------------------------------------
const view = (() => {
  const points = [0, 0.25, 0.5, 0.75, 1].flatMap((s) => placed(s, [0, 0]).flatMap(({ outline }) => outline));
  const [low, high] = [Math.min, Math.max].map((pick) => [pick(...points.map(([x]) => x)), pick(...points.map(([, y]) => y))]);
  return { low, high, size: Math.max(high[0] - low[0], high[1] - low[1]) };
})();
// Outlines of all bodies at s, the platform displaced by `shift` on the paper.
function placed(s, shift) {
  const poses = along("poses", s), rates = along("pose_rates", s), count = poses.length;
  const moved = poses.map((value, k) => value + rates[k] * shift[0] + rates[count + k] * shift[1]);
  return doc.shapes.map(({ node, points, colour }) => {
    let [x, y, c, d] = node ? moved.slice(4 * (node - 1), 4 * node) : [0, 0, 1, 0];
    const size = Math.hypot(c, d);
    [c, d] = [c / size, d / size];
    return { colour, outline: points.map(([a, b]) => [x + c * a - d * b, y + d * a + c * b]) };
  });
}
// How far locked motors give way to a push, and the torques that hold it, as shares of the motors' limit.
function held(s, push) {
  const [g] = along("g", s), T = along("torque_of_force", s), far = Math.hypot(...push);
  const torque = [0, 1].map((k) => (T[2 * k] * push[0] + T[2 * k + 1] * push[1]) / g);
  const [g0] = along("g", 0), T0 = along("torque_of_force", 0), stiffness = 40 * Math.max(...T0.map((value) => (value / g0) ** 2));
  const shift = [0, 1].map((j) => ((T[j] * torque[0] + T[2 + j] * torque[1]) / g) / stiffness);
  const size = Math.hypot(...shift), share = size > far ? far / size : 1;
  return { shift: shift.map((value) => value * share), torque, gives: size > 0.5 * far && far > 0 };
}
function drawRobot() {
  const root = byId("robot"), { low, high, size } = view, rim = 0.06 * size, across = high[0] - low[0] + 2 * rim;
  root.replaceChildren();
  root.setAttribute("viewBox", `${low[0] - rim} ${-high[1] - rim} ${across} ${high[1] - low[1] + 2 * rim}`);
  const flip = element("g", { transform: "scale(1,-1)" }, root), width = size / 160;
  for (const curve of doc.locus) element("path", { d: line5(curve), fill: "none", stroke: "var(--locus)", "stroke-width": 1.6 * width }, flip);
  const { shift, torque, gives } = held(state.s, state.push);
  for (const { colour, outline } of placed(state.s, shift)) {
    element("path", { d: `${line5(outline)}Z`, fill: `rgb(${colour.slice(0, 3).map((c) => Math.round(255 * c)).join(",")})`, stroke: "#0004", "stroke-width": 0.2 * width }, flip);
  }
  element("path", { d: line5(Array.from({ length: 41 }, (_, k) => along("place", k / 40))), fill: "none", stroke: "var(--path)", "stroke-width": width, "stroke-dasharray": `${2 * width}` }, flip);
  const place = along("place", state.s), t = along("t_s", state.s), unit = 0.16 * size / Math.hypot(...t);
  const near = Math.exp(-(((state.s - CROSSING) / 0.12) ** 2));
  element("path", { d: line5([-1, 1].map((way) => [0, 1].map((k) => place[k] + way * unit * t[k]))), stroke: "var(--ink)", "stroke-width": 1.4 * width, opacity: near }, flip);
  const at = [0, 1].map((k) => place[k] + shift[k]);
  if (Math.hypot(...state.push)) element("path", { d: line5([at, [0, 1].map((k) => place[k] + state.push[k])]), stroke: "var(--wrench)", "stroke-width": 1.4 * width }, flip);
  const knob = element("circle", { cx: at[0], cy: at[1], r: 3.2 * width, class: "platform" }, flip);
  if (!state.step) for (const [name, value] of Object.entries({ tabindex: 0, role: "application", "aria-label": "platform: push it by the arrow keys, or drag it" })) knob.setAttribute(name, value);
  if (state.holding && !state.step) knob.focus();
  if (!state.step) {
    const large = torque.map((value) => Math.abs(value) * (doc.best.off.limit / usualTorque()));
    const bounded = large.every((value) => value < 1e4 * doc.best.off.limit);
    const needed = bounded ? `It takes ${large.map((value) => `${rounded(value)} ${doc.unit}`).join(" and ")}.` : "No torque is large enough.";
    byId("score").innerHTML = Math.hypot(...state.push)
      ? `${gives ? '<span class="alarm">It gives way.</span>' : '<span class="good">The motors hold it.</span>'} ${needed}`
      : "Push the platform: drag it, or focus it and use the arrow keys.";
  }
}
// Torque against a push of the usual size where the robot starts.
function usualTorque() {
  const [g0] = along("g", 0);
  return Math.max(...along("torque_of_force", 0).map((value) => Math.abs(value / g0))) * 0.15 * doc.length;
}
const line5 = (points) => points.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(5)} ${y.toFixed(5)}`).join("");
function onPaper(event) {
  const root = byId("robot"), point = new DOMPoint(event.clientX, event.clientY).matrixTransform(root.getScreenCTM().inverse());
  return [point.x, -point.y];
}
byId("robot").addEventListener("pointerdown", (event) => {
  if (state.step || !event.target.classList.contains("platform")) return;
  event.preventDefault();
  byId("robot").setPointerCapture(event.pointerId);
  const root = byId("robot");
  root.onpointermove = (each) => {
    const at = onPaper(each), place = along("place", state.s), far = Math.hypot(at[0] - place[0], at[1] - place[1]);
    const share = Math.min(1, 0.15 * doc.length / (far || 1));
    state.push = [0, 1].map((k) => (at[k] - place[k]) * share);
    drawRobot();
  };
  root.onpointerup = root.onpointercancel = () => { root.onpointermove = null; state.push = [0, 0]; drawRobot(); };
});
byId("robot").addEventListener("keydown", (event) => {
  const way = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0], Escape: [0, 0] }[event.key];
  if (!way || state.step) return;
  event.preventDefault();
  state.push = way.map((value) => value * 0.15 * doc.length);
  state.holding = true;
  drawRobot();
});
byId("robot").addEventListener("keyup", () => { state.push = [0, 0]; drawRobot(); state.holding = false; });

// ---- the lesson ----------------------------------------------------------------------------------------------
const STEPS = [
  ["Push", "The motors are locked. Push the platform about, then lead it along its path with the slider. On the purple curve <b>it gives way along t<sub>s</sub></b>, however strong the motors. WHY"],
  ["Go through", "Now drive along the path. At the purple curve this motion asks for a force along t<sub>s</sub> that the motors cannot give: the pink curve misses the point to which the blue region closes, <b>and the torque has no bound</b>. Press Play."],
  ["Thread the needle", "Bend the speed with the circles until <b>the pink curve passes through the eye</b>. Faster or slower does not matter: at the purple line the speed must change by just what lets the platform coast (t<sub>s</sub> · W<sub>p</sub> = 0). Watch the torques come back."],
  ["With gravity", "Stand the robot upright. Coasting no longer does: at the purple line the platform must fall freely along t<sub>s</sub>. <b>Go slowly, sprint across, and go slowly on.</b>"],
  ["Beat the best", "Keep through the eye, and bring the largest torque down. The best law of the same duration needs <b>BEST</b>. Can you come within 5 %?"],
];
function choose(step) {
  Object.assign(state, { step, best: false, push: [0, 0], focus: undefined, playing: false });
  const gravity = step === 3 ? "on" : "off";
  if (step < 2 || gravity !== state.gravity) state.logarithms = [...LEVEL];
  state.gravity = gravity;
  if (step > 0) state.s = 0;
  update();
}
function update() {
  curves();
  const best = doc.best[state.gravity];
  byId("task").innerHTML = STEPS[state.step][1].replace("BEST", `${rounded(best.peak)} ${doc.unit}`).replace("WHY", doc.why);
  byId("steps").querySelectorAll("button").forEach((button, k) => (k === state.step ? button.setAttribute("aria-current", "step") : button.removeAttribute("aria-current")));
  document.querySelector(".curves").hidden = state.step === 0;
  byId("play").hidden = state.step === 0;
  const choices = byId("choices");
  choices.replaceChildren();
  const choice = (text, act) => { const button = choices.appendChild(document.createElement("button")); Object.assign(button, { type: "button", textContent: text, onclick: act }); };
  if (state.step > 1) {
    choice(state.best ? "Back to mine" : "Show the best law", () => { state.best = !state.best; update(); });
    choice("Start over", () => { state.logarithms = [...LEVEL]; state.best = false; state.focus = undefined; update(); });
  }
  if (state.step < STEPS.length - 1) choice(`Next: ${STEPS[state.step + 1][0]}`, () => choose(state.step + 1));
  if (state.step) drawCurves();
  drawRobot();
  byId("place").value = state.s;
  byId("place").setAttribute("aria-valuetext", `${Math.round(100 * state.s)} % of the path`);
}
function lead(s) {
  state.s = s;
  byId("place").value = s;
  if (state.step) drawCurves();
  drawRobot();
}
byId("place").addEventListener("input", () => { state.playing = false; lead(Math.abs(byId("place").value - CROSSING) < 0.006 ? CROSSING : Number(byId("place").value)); });
byId("play").addEventListener("click", () => {
  state.playing = !state.playing;
  const began = performance.now(), scene = now;
  const step = (at) => {
    if (!state.playing || scene !== now) { byId("play").textContent = "▶ Play"; state.playing = false; return; }
    const t = (at - began) / 2000; // at half the speed
    let k = scene.time.findIndex((each) => each > t);
    if (k < 0) k = SAMPLES - 1;
    const s = scene.asked[k].s;
    if (!scene.threads && s > CROSSING) { lead(CROSSING); state.playing = false; } // nobody gets beyond
    else lead(s);
    if (k === SAMPLES - 1) state.playing = false;
    requestAnimationFrame(step);
  };
  if (state.playing) { byId("play").textContent = "❚❚ Pause"; requestAnimationFrame(step); }
});
STEPS.forEach(([title], k) => {
  const button = byId("steps").appendChild(document.createElement("button"));
  Object.assign(button, { type: "button", textContent: `${k + 1}. ${title}`, onclick: () => choose(k) });
});
addEventListener("resize", update);
choose(0);
window.crossing = { lesson: { torques, power, along, state, choose, update, bendTo, curves: () => now } };
