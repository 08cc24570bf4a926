// Condition (8) by hand: all numbers are Chebyshev series in the share s of the path, evaluated here.
const MOTORS = data.motors.length, CROSSING = data.crossing;
const SAMPLES = 600; // of sigma, for curves and peaks
const HANDLES = [0.12, 0.25, 0.38, 0.5, 0.62, 0.75, 0.88]; // in sigma, of the speed that is bent
const SNAP = 0.05; // of the largest force along t_s: a miss that is taken for a hit, and made one
const HARDEST = 0.1 * data.length; // push on the platform, a length on the paper
const YIELD = 1e-6; // squared, of motors to a push: of torques that do the same, the least are given
const SEEN = 0.01; // of a push: what gives way less stands still on the paper
const CLEAR = 2e-4; // in s beside the crossing, where quotients by g lose digits

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
const along = (key, s) => data.series.slice(...data.slices[key]).map((each) => series(each, 2 * s - 1));

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
    scale *= (time / data.duration) ** 2;
  };
  fit();
  return { z, twist: (value) => { twist = value; fit(); } };
}
function bestLaw(gravity) {
  const coefficients = data.best[gravity].squared_speed;
  let twist = 0; // takes away what the series leaves of condition (8)
  const z = (x) => {
    const d = x - SIGMA_C, bell = Math.exp(-(d * d) / 0.02), bent = Math.exp(2 * twist * d * bell);
    const value = series(coefficients, 2 * x - 1) * bent;
    return { z: value, u: slope(coefficients, 2 * x - 1) * bent + value * twist * bell * (1 - d * d / 0.01) };
  };
  return { z, twist: (value) => { twist = value; } };
}
// What a law asks for at sigma: s, ds/dt, d2s/dt2.
function motion(law, x) {
  const { z, u } = law.z(x);
  return { s: phi(x), v: phi1(x) * Math.sqrt(z), a: phi1(x) * u + phi2(x) * z };
}

// ---- the state ---------------------------------------------------------------------------------------------
const LEVEL = HANDLES.map(() => 0);
const state = { step: 0, gravity: "off", logarithms: [...LEVEL], best: false, s: 0, push: [0, 0], playing: false, held: false };
let now = null; // the law and its curves
let fastest = 1; // of the speed's curve, the same while one bends it

function missOf(law, gravity) {
  const { s, v, a } = motion(law, SIGMA_C);
  return power(s, v, a, gravity);
}
// All curves of the state; a near miss becomes a hit by a bend of the speed about the crossing.
function curves() {
  const { gravity } = state, law = state.best ? bestLaw(gravity) : bentLaw(state.logarithms);
  const limit = data.best[gravity].limit;
  const powers = () => SIGMA.map((x) => { const { s, v, a } = motion(law, x); return power(s, v, a, gravity); });
  let wrench = powers(), largest = Math.max(...wrench.map(Math.abs)), miss = missOf(law, gravity);
  if (state.step > 1 && Math.abs(miss) < SNAP * largest) {
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
  const torque = asked.map(({ s, v, a }) => torques(s, v, a, gravity));
  if (threads) asked.forEach(({ s }, k) => { // at most one sample is that near
    if (Math.abs(s - CROSSING) < CLEAR) torque[k] = torque[k].map((_, m) => 0.5 * (torque[k - 1][m] + torque[k + 1][m]));
  });
  const peak = threads ? Math.max(...torque.flat().map(Math.abs)) : Infinity;
  const time = [];
  SIGMA.reduce((sum, x, k) => (time[k] = sum + 1 / (SAMPLES * Math.sqrt(law.z(x).z))), 0);
  now = { law, limit, wrench, largest, miss, threads, asked, shares: asked.map(({ s }) => s), torque, peak, time, band: asked.map(({ s }) => reach(s, limit)) };
}

// ---- drawing -------------------------------------------------------------------------------------------------
const line = (points) => points.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(5)} ${y.toFixed(5)}`).join("");
const names = data.motors.map((name) => name.replace(/_/g, " "));
const charts = {};

function drawCurves() {
  const { threads, miss, largest, band, limit } = now, { best } = data;
  const speeds = now.asked.map(({ v }) => v), reached = band.map((value) => Math.min(value, 3 * largest));
  if (!state.held) fastest = 1.15 * Math.max(...speeds, 2.2 / data.duration);
  const drawn = {
    speed: { title: "speed along the path ds/dt [1/s]", limit: fastest, series: [{ values: speeds, color: "var(--ink)" }], events: [{ time: CROSSING }] },
    needle: {
      title: "force along tₛ [N]", limit: 1.1 * largest, series: [{ values: now.wrench, color: "var(--wrench)", name: "asked for" }],
      band: reached.flatMap((value) => [-value, value]), bandName: "what motors can give",
      events: [{ time: CROSSING, value: miss, alarm: !threads, said: threads ? "through the eye" : `misses the eye by ${rounded(Math.abs(miss))} N` }],
    },
    torque: {
      title: `motor torque [${data.unit}]`, limit: 1.9 * best[state.gravity].limit, levels: [-limit, limit], levelName: "limit",
      series: names.map((name, k) => ({ values: now.torque.map((each) => each[k]), color: PALETTE[k], dash: k ? "7 4" : "", name })),
      events: [{ time: CROSSING, alarm: !threads, said: threads ? "" : "no bound" }],
    },
  };
  const scale = parseFloat(getComputedStyle(document.documentElement).fontSize) / 14;
  for (const [id, content] of Object.entries(drawn)) {
    const box = byId(id), before = box.querySelector(".chart"), isFocused = before === document.activeElement;
    if (before) before.remove();
    charts[id] = new Chart(box, { time: now.shares, along: "place on the path s", tell: (s) => `${Math.round(100 * s)} % of the path`, seek: goTo, height: box.clientHeight / scale, ...content });
    if (isFocused) charts[id].root.focus({ preventScroll: true });
  }
  mark();
  placeHandles();
  score();
}
// Where the robot is, on all curves.
function mark() {
  const next = now.shares.findIndex((s) => s > state.s), k = next < 0 ? SAMPLES - 2 : Math.max(0, next - 1);
  const part = Math.min(1, Math.max(0, (state.s - now.shares[k]) / (now.shares[k + 1] - now.shares[k])));
  for (const chart of Object.values(charts)) chart.mark(state.s, k, part);
}

function score() {
  const best = data.best[state.gravity];
  const hit = now.threads
    ? `<span class="good">Through the eye</span>: no force along t<sub>s</sub> is asked for at the singular point. Peak torque <b>${rounded(now.peak)} ${data.unit}</b>`
    : `<span class="alarm">Misses the eye by ${rounded(Math.abs(now.miss))} N</span>: no torque is large enough at the singular point`;
  const above = Math.round(100 * (now.peak / best.peak - 1));
  const compared = state.best ? ", of the best law" : now.threads && state.step > 2 ? `, ${above} % above the best law's ${rounded(best.peak)} ${data.unit}` : "";
  tell("score", `${hit}${compared}. ${data.duration} s in all.`);
}
// Writes what is new: what stands there already is not said again.
function tell(id, text) {
  if (byId(id).told !== text) byId(id).innerHTML = unparted(byId(id).told = text);
}

// ---- the speed, bent by its handles ----------------------------------------------------------------------------
const overlay = svg("svg", { class: "handles", role: "group", "aria-label": "the speed, to be bent" }, byId("speed"));
const handles = HANDLES.map((x, k) => svg("circle", { r: 9, tabindex: 0, role: "slider", "aria-valuemin": 0, "aria-label": `speed at ${Math.round(100 * phi(x))} % of the path`, "data-handle": k }, overlay));
function placeHandles() {
  const { speed } = charts;
  overlay.style.display = state.step < 2 || state.best ? "none" : "";
  overlay.setAttribute("viewBox", speed.root.getAttribute("viewBox"));
  handles.forEach((knob, k) => {
    const { s, v } = motion(now.law, HANDLES[k]);
    const placed = { cx: speed.x(s), cy: speed.height(v), "aria-valuenow": v.toPrecision(3), "aria-valuemax": fastest.toPrecision(3), "aria-valuetext": `${rounded(v)} per second` };
    for (const [name, value] of Object.entries(placed)) knob.setAttribute(name, value);
  });
}
// Bend the speed so that handle k has it, as near as the duration allows.
function bendTo(k, wanted) {
  for (let pass = 0; pass < 12; pass++) {
    const { v } = motion(bentLaw(state.logarithms), HANDLES[k]);
    state.logarithms[k] = Math.min(3, Math.max(-3, state.logarithms[k] + Math.log(Math.max(wanted, 0.02) / v)));
  }
  update();
}
// A finger on it does not scroll the page; browsers do not heed touch-action on a circle.
const holdFinger = (element, isHeld) => element.addEventListener("touchstart", (event) => { if (isHeld()) event.preventDefault(); }, { passive: false });
handles.forEach((knob, k) => {
  holdFinger(knob, () => true);
  knob.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    knob.focus({ preventScroll: true });
    knob.setPointerCapture(event.pointerId);
    state.held = true;
    knob.onpointermove = (each) => bendTo(k, charts.speed.value(new DOMPoint(each.clientX, each.clientY).matrixTransform(overlay.getScreenCTM().inverse()).y));
    knob.onpointerup = knob.onpointercancel = () => { knob.onpointermove = null; state.held = false; update(); };
  });
  knob.addEventListener("keydown", (event) => {
    const way = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    if (!way) return;
    event.preventDefault();
    bendTo(k, motion(now.law, HANDLES[k]).v * (1 + 0.03 * way * (event.shiftKey ? 5 : 1)));
  });
});

// ---- the robot -----------------------------------------------------------------------------------------------
const view = (() => {
  const points = [0, 0.25, 0.5, 0.75, 1].flatMap((s) => placed(s, [0, 0]).flatMap(({ outline }) => outline));
  const [low, high] = [Math.min, Math.max].map((pick) => [pick(...points.map(([x]) => x)), pick(...points.map(([, y]) => y))]);
  const size = Math.max(high[0] - low[0], high[1] - low[1]), isNear = (point) => point.every((value, j) => value > low[j] - 0.25 * size && value < high[j] + 0.25 * size);
  const all = [low, high, ...data.locus.filter((curve) => curve.every(isNear)).flat()];
  const [least, most] = [Math.min, Math.max].map((pick) => [0, 1].map((j) => pick(...all.map((point) => point[j]))));
  return { low: least, high: most, size };
})();
// Outlines of all bodies at s, the platform displaced by `shift` on the paper: to first order, so that joints stay
// joined, and bodies that turn grow a little.
function placed(s, shift) {
  const poses = along("poses", s), rates = along("pose_rates", s), count = poses.length;
  const moved = poses.map((value, k) => value + rates[k] * shift[0] + rates[count + k] * shift[1]);
  return data.shapes.map(({ node, points, colour }) => {
    const [x, y, c, d] = node ? moved.slice(4 * (node - 1), 4 * node) : [0, 0, 1, 0];
    return { colour, outline: points.map(([a, b]) => [x + c * a - d * b, y + d * a + c * b]) };
  });
}
// What motors within their limit leave of a push (a displacement: a HARDEST takes half the limit where the robot starts).
// They give the force that comes nearest to it: so all of it is held that they can hold, and along t_s nothing of it
// at the singular point.
function held(s, push) {
  const limit = data.best.off.limit, force = 0.5 * limit / (hardest() * HARDEST), G = along("motor_speed", s);
  const [g] = along("g", s), needed = timesTwo(along("torque_of_force", s), push).map((value) => force * value / g);
  const asked = push.map((value) => force * value), left = (torque) => asked.map((value, j) => value - G[j] * torque[0] - G[2 + j] * torque[1]);
  const size = ([x, y]) => x * x + y * y, soft = YIELD * size([Math.hypot(G[0], G[1]), Math.hypot(G[2], G[3])]);
  const cost = (torque) => size(left(torque)) + soft * size(torque);
  // least squares without limits, and with one motor at its limit
  const [a, b, c] = [size([G[0], G[1]]) + soft, G[0] * G[2] + G[1] * G[3], size([G[2], G[3]]) + soft];
  const [d, e] = timesTwo(G, asked), free = [c * d - b * e, a * e - b * d].map((value) => value / (a * c - b * b));
  const within = (value) => Math.min(limit, Math.max(-limit, value));
  const edges = [-limit, limit].flatMap((full) => [[full, within((e - b * full) / c)], [within((d - b * full) / a), full]]);
  const torque = free.every((value) => Math.abs(value) <= limit) ? free : edges.reduce((best, each) => (cost(each) < cost(best) ? each : best));
  const shift = left(torque).map((value) => value / force);
  return { shift, torque, needed, gives: Math.hypot(...shift) > SEEN * Math.hypot(...push) };
}
const timesTwo = (matrix, [x, y]) => [matrix[0] * x + matrix[1] * y, matrix[2] * x + matrix[3] * y];
// The torque that a force of 1 N takes at most where the robot starts.
function hardest() {
  const [g] = along("g", 0);
  return Math.max(...along("torque_of_force", 0).map((value) => Math.abs(value / g)));
}
const knob = (() => {
  const { low, high, size } = view, rim = 0.06 * size, across = high[0] - low[0] + 2 * rim, root = byId("robot");
  root.setAttribute("viewBox", `${low[0] - rim} ${-high[1] - rim} ${across} ${high[1] - low[1] + 2 * rim}`);
  const flip = svg("g", { transform: "scale(1,-1)" }, root);
  return svg("circle", { r: size / 50, class: "platform", role: "application", "aria-label": "platform: hold an arrow key to push it" }, flip);
})();
function drawRobot() {
  const flip = knob.parentNode, { size } = view, width = size / 160;
  while (flip.firstChild !== knob) flip.firstChild.remove();
  const draw = (name, attributes) => flip.insertBefore(svg(name, attributes), knob);
  const stroke = (points, color, wide, more = {}) => draw("path", { d: line(points), fill: "none", stroke: color, "stroke-width": wide * width, ...more });
  for (const curve of data.locus) stroke(curve, "var(--locus)", 1.6);
  const { shift, torque, needed, gives } = held(state.s, state.push);
  for (const { colour, outline } of placed(state.s, shift)) {
    draw("path", { d: `${line(outline)}Z`, fill: `rgb(${colour.slice(0, 3).map((c) => Math.round(255 * c)).join(",")})`, stroke: "rgba(0, 0, 0, 0.27)", "stroke-width": 0.2 * width });
  }
  stroke(Array.from({ length: 41 }, (_, k) => along("place", k / 40)), "var(--path)", 1, { "stroke-dasharray": 2 * width });
  const place = along("place", state.s), t = along("t_s", state.s), unit = (0.16 * size) / Math.hypot(...t);
  const near = Math.exp(-(((state.s - CROSSING) / 0.12) ** 2));
  const tip = (way, back = 0, aside = 0) => [0, 1].map((k) => place[k] + (way * (1 - back) * t[k] + aside * (k ? t[0] : -t[1])) * unit);
  for (const way of [-1, 1]) stroke([tip(-way), tip(way), tip(way, 0.15, 0.1), tip(way), tip(way, 0.15, -0.1)], "var(--ink)", 0.9, { opacity: near });
  const [x, y] = tip(1, -0.05, 0.2);
  draw("text", { x, y: -y, transform: "scale(1,-1)", "font-size": 5.5 * width, opacity: near, "font-weight": 600, fill: "var(--ink)" }).textContent = "tₛ";
  if (state.gravity === "on") { // down the page
    const head = [view.low[0], view.high[1]], foot = [head[0], head[1] - 0.16 * size], wing = 0.025 * size;
    stroke([head, foot, [foot[0] - wing, foot[1] + wing], foot, [foot[0] + wing, foot[1] + wing]], "var(--soft)", 1.1);
    const beside = { x: foot[0] + 2 * wing, y: -foot[1], transform: "scale(1,-1)", "font-size": 5.5 * width, fill: "var(--soft)" };
    draw("text", beside).textContent = "gravity";
  }
  const at = [0, 1].map((k) => place[k] + shift[k]), isPushed = Math.hypot(...state.push) > 0;
  if (isPushed) stroke([at, [0, 1].map((k) => place[k] + state.push[k])], "var(--wrench)", 1.4);
  knob.setAttribute("cx", at[0]);
  knob.setAttribute("cy", at[1]);
  if (state.step) return;
  const told = (torque) => torque.map((value) => `${rounded(Math.abs(value))} ${data.unit}`).join(" and ");
  const tooMuch = state.s === CROSSING ? "No torque is large enough." : `To hold it takes ${told(needed)}, more than the motors' ${rounded(data.best.off.limit)} ${data.unit}.`;
  tell("score", isPushed
    ? gives ? `<span class="alarm">It gives way.</span> ${tooMuch}` : `<span class="good">The motors hold it.</span> It takes ${told(torque)}.`
    : "Push the platform: drag the dot on it, or press Tab until the dot is marked and hold an arrow key.");
}
function push(way) {
  state.push = way.map((value) => value * HARDEST);
  drawRobot();
}
holdFinger(knob, () => state.step === 0);
knob.addEventListener("pointerdown", (event) => {
  if (state.step) return;
  event.preventDefault();
  knob.focus({ preventScroll: true });
  knob.setPointerCapture(event.pointerId);
  knob.onpointermove = (each) => {
    const at = new DOMPoint(each.clientX, each.clientY).matrixTransform(knob.getScreenCTM().inverse()), [x, y] = along("place", state.s);
    const far = Math.max(HARDEST, Math.hypot(at.x - x, at.y - y));
    push([(at.x - x) / far, (at.y - y) / far]);
  };
  knob.onpointerup = knob.onpointercancel = () => { knob.onpointermove = null; push([0, 0]); };
});
knob.addEventListener("keydown", (event) => {
  const way = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
  if (!way || state.step) return;
  event.preventDefault();
  push(way);
});
for (const end of ["keyup", "blur"]) knob.addEventListener(end, () => push([0, 0]));

// ---- the lesson ----------------------------------------------------------------------------------------------
const LEFT_OUT = data.upright ? " This robot stands upright: <b>its weight is left out</b>, but for the step With gravity." : "";
const STEPS = [
  ["Push", `The motors are locked, each by up to ${rounded(data.best.off.limit)} ${data.unit}. Push the platform about, then lead it along its path with the slider and push again. On the purple curve <b>it gives way along t<sub>s</sub></b>, the uncontrolled motion, however strong the motors. ${symbols(data.why)}`],
  ["Go through", "Now the robot drives along its path. At the purple curve this motion asks for a force along t<sub>s</sub> that the motors cannot give: the curve of the force misses the <b>eye</b>, the point to which the blue region closes, and <b>the torque has no bound</b>. Press Play." + LEFT_OUT],
  ["Thread the needle", "Bend the speed: pull its circles up or down until <b>the curve of the force passes through the eye</b>. Faster or slower does not matter: at the purple line the speed must change by just what lets the platform coast (t<sub>s</sub> · W<sub>p</sub> = 0). Watch the torques come back."],
  ["With gravity", "Stand the robot upright. Coasting no longer does: at the purple line the platform must fall freely along t<sub>s</sub>. <b>Go slowly, sprint across, and go slowly on.</b>"],
  ["Beat the best", `Keep through the eye, and bring the largest torque down. The best law of the same duration needs <b>${rounded(data.best.off.peak)} ${data.unit}</b>. Can you come within 5 %?${data.upright ? " Without its weight again." : ""}`],
];
function choose(step) {
  const gravity = step === 3 ? "on" : "off";
  if (step < 2 || gravity !== state.gravity) state.logarithms = [...LEVEL];
  Object.assign(state, { step, gravity, best: false, push: [0, 0], playing: false });
  if (step > 0) state.s = 0;
  update();
}
function update() {
  const { step, best } = state, last = step === STEPS.length - 1;
  curves();
  tell("task", STEPS[step][1]);
  byId("steps").querySelectorAll("button").forEach((button, k) => (k === step ? button.setAttribute("aria-current", "step") : button.removeAttribute("aria-current")));
  document.querySelector(".curves").hidden = byId("play").hidden = step === 0;
  byId("best").hidden = byId("over").hidden = step < 2;
  byId("best").textContent = best ? "Back to mine" : "Show the best law";
  byId("next").textContent = last ? `Once more: ${STEPS[0][0]}` : `Next: ${STEPS[step + 1][0]}`;
  knob.classList.toggle("held", step === 0);
  knob.setAttribute("tabindex", step ? -1 : 0);
  if (step) drawCurves();
  lead(state.s);
}
function lead(s) {
  state.s = s;
  byId("place").value = s;
  byId("place").setAttribute("aria-valuetext", `${Math.round(100 * s)} % of the path`);
  if (state.step) mark();
  drawRobot();
}
// What a hand leads to: a place, or the singular one that it means.
function goTo(s) {
  state.playing = false;
  lead(Math.abs(s - CROSSING) < 0.006 ? CROSSING : Math.min(1, Math.max(0, s)));
}
byId("place").addEventListener("input", () => goTo(Number(byId("place").value)));
byId("best").addEventListener("click", () => { state.best = !state.best; update(); });
byId("over").addEventListener("click", () => { Object.assign(state, { logarithms: [...LEVEL], best: false }); update(); });
byId("next").addEventListener("click", () => choose((state.step + 1) % STEPS.length));
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
  button.type = "button";
  button.innerHTML = `${k + 1}<span>. ${title}</span>`;
  button.addEventListener("click", () => choose(k));
});
onNewWidth(update);
choose(0);
window.crossing = { lesson: { data, torques, power, reach, along, state, choose, update, bendTo, curves: () => now } };
