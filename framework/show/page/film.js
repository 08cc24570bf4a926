// One film: a view, what moves in it, the curves beside it, and what is to be said about this instant.

const MAX_TALLER = 1.8; // times their least height: what curves alone beside a scene may take

class Film {
  constructor(section, content, seek) {
    this.content = content;
    this.duration = content.duration;
    this.time = decoded(content.time);
    const n = content.motors.length;
    const torque = decoded(content.torque);
    this.torque = content.motors.map((_, k) => Float32Array.from(this.time, (_, f) => torque[f * n + k]));
    this.power = decoded(content.power);
    this.band = decoded(content.band);
    this.g = content.g && decoded(content.g);
    this.law = decoded(content.law);
    this.platform = decoded(content.platform);
    this.largestG = this.g ? Math.max(...this.g.map(Math.abs)) : 1;

    // the singular instant that nobody gets beyond, of a motion without a proof
    this.end = content.proved ? Infinity : Math.min(...content.instants.map(({ time }) => time));
    const badge = content.proved ? `<span class="badge proved" title="${plain(content.proof)}">finite torque, proven</span>` : '<span class="badge unproved">unbounded torque</span>';
    section.innerHTML = `<h2>${plain(content.title)} ${badge} <span class="subtitle">${symbols(content.subtitle)}</span></h2>
      <div class="inside"><div class="left"><div class="legend"></div><div class="view"></div><div class="now"></div><div class="unseen" role="status"></div></div><div class="side"></div></div>`;
    this.view = new View(section.querySelector(".view"), content);
    section.setAttribute("aria-label", content.title || content.robot);
    this.view.name(`${content.robot}, ${content.title}: ${content.subtitle}`);
    this.live = section.querySelector(".unseen");
    this.furnish();
    this.caption = section.querySelector(".now");
    this.legend(byId("legend"), section.querySelector(".legend"));
    Object.assign(this, { side: section.querySelector(".side"), seek, panels: [] });
    this.view.extra.push(...this.tips());
    this.view.frame();
  }

  furnish() {
    const { view, content } = this, L = content.length;
    view.addLocus(content.locus);
    const track = points(this.platform);
    view.add(tube(track, 0.0035 * L, ink("path")));
    this.trace = view.add(tube(track, 0.0065 * L, ink("trace")));
    const way = [0];
    for (let k = 1; k < track.length; k++) way.push(way[k - 1] + track[k].distanceTo(track[k - 1]));
    this.way = way.map((value) => value / (way[way.length - 1] || 1));
    this.spot = view.add(new THREE.Mesh(new THREE.SphereGeometry(0.014 * L, 24, 16), new THREE.MeshBasicMaterial({ color: ink("trace") })));
    this.vectors = new Vectors(view, content);
    const few = content.motors.length > 4 ? [] : content.motors;
    const places = few.map(({ node, placement }) => {
      const place = new THREE.Vector3().setFromMatrixPosition(matrix(placement));
      return () => place.clone().applyMatrix4(view.nodes[node].matrix);
    });
    this.motorLabels = few.map((_, k) => view.label("", "var(--ink)", places[k], (at) => {
      // away from the other motors: to the side on which this one stands, or below
      const middle = places.reduce((sum, place) => sum + view.onScreen(place()).x / places.length, 0);
      if (Math.abs(at.x - middle) < 20) return [0, 36];
      const right = Math.sign(at.x - middle) * 70, room = Math.min(at.x + right, view.element.clientWidth - at.x - right);
      return [right, room > 42 ? 0 : 30];
    }));
    for (const label of this.motorLabels) label.classList.add("motor");
    const labels = []; // one for all instants of one place
    for (const instant of content.instants) {
      const place = new THREE.Vector3(...instant.place);
      const here = labels.find((label) => label.place.distanceTo(place) < 0.02 * L);
      if (here) { here.times.push(instant.time); continue; }
      labels.push({ place, instant, times: [instant.time] });
      view.add(new THREE.Mesh(new THREE.SphereGeometry(0.017 * L, 24, 16), new THREE.MeshBasicMaterial({ color: ink("locus") }))).position.copy(place);
    }
    labels.forEach(({ place, instant, times }, k) => {
      const said = `${content.proved ? "crossing" : "no bound"}: t = ${times.map((t) => `${rounded(t)} s`).join(", ")}`;
      view.label(said, "var(--locus)", () => place, () => this.besideArrow(instant, 22 * k), true).classList.add("minor");
    });
    if (content.springs) {
      const { coils, factors, length, deflection } = content.springs;
      this.deflection = decoded(deflection);
      this.coils = coils.map((coil) => {
        const made = new Coil(coil, length, coil.slides ? factors.slide : factors.turn);
        view.nodes[coil.node].add(made.object);
        return made;
      });
    }
  }

  // Where the label of a singular instant stands clear of the arrow t_s there, [right, down] in pixels.
  besideArrow(instant, lower) {
    const { view, content } = this, place = new THREE.Vector3(...instant.place);
    const k = this.time.reduce((best, t, i) => (Math.abs(t - instant.time) < Math.abs(this.time[best] - instant.time) ? i : best), 0);
    const tip = this.vectors.at("t_s", "linear", k, 0).multiplyScalar(content.length).add(place);
    const from = view.onScreen(place), to = view.onScreen(tip);
    const across = to.x - from.x, down = to.y - from.y, size = Math.hypot(across, down) || 1;
    const clear = ([x, y]) => Math.abs(x * down - y * across) / size > (60 * Math.abs(down) + 14 * Math.abs(across)) / size;
    const places = [[84, 36], [115, 24], [-84, 36], [-115, 24]].map(([x, y]) => [x, y + lower]);
    return places.find(clear) || places[0];
  }

  // What the colours mean: above the scene, or once above several of them.
  legend(shared, own) {
    const { content } = this, lines = [];
    const key = (color, text) => lines.push(`<div><span class="key" style="background:${color}"></span>${text}</div>`);
    if (content.locus) {
      const where = content.locus.kind === "patch" ? " (a piece, platform not turned)" : content.locus.whole ? "" : " (platform not turned)";
      key("var(--locus)", `singular locus${where}`);
    }
    else if (content.instants.length) key("var(--locus)", "singular place");
    if (this.g) key("var(--twist)", "t<sub>s</sub>: uncontrolled motion");
    key("var(--wrench)", "W<sub>p</sub>: force asked for");
    const kinds = ["force", "moment"].filter((_, part) => content.world.some((wrench) => decoded(wrench[["linear", "angular"][part]]).some(Boolean)));
    if (kinds.length) key("var(--world)", `${kinds.join(" and ")} of the world, to the scale of W<sub>p</sub>`);
    if (this.vectors.beside.lengthSq()) lines.push("<div>ringed arrows beside the platform: turns and moments</div>");
    if (this.g) {
      const solid = content.polytope ? (!content.polytope.flat ? " (solid: its own scale)" : shared.dataset.columns > 1 ? "" : " (fades where it goes on)") : "", none = content.no_figure ? ` (${plain(content.no_figure)})` : "";
      lines.push(`<div><span class="key given"></span>what ${plain(content.stated)} can give${solid}${none}</div>`);
    }
    if (content.lines) key("var(--given)", content.turning.every(Boolean) ? "axes of their torques" : "lines of their forces");
    if (this.trace) {
      lines.push('<div><span class="key" style="background:linear-gradient(90deg, var(--trace) 50%, var(--path) 50%)"></span>path: gone, ahead</div>');
    }
    const limit = content.shared_limit;
    lines.push(`<div>motor torque 0<span class="scale"></span><span class="unseen"> to </span>${rounded(limit)} ${content.motors[0].unit}</div>`);
    if (content.springs) {
      const { factors, coils } = content.springs, said = [];
      if (coils.some((coil) => coil.slides)) said.push(`stretch drawn × ${factors.slide}`);
      if (coils.some((coil) => !coil.slides)) said.push(`twist drawn × ${factors.turn}`);
      lines.push(`<div>springs: ${said.join(", ")}</div>`);
    }
    const box = shared.dataset.columns > 1 ? shared : own;
    if (lines.length > box.children.length) box.innerHTML = lines.join("");
  }

  // Words and curves, as wide as there is room, and as high beside one scene.
  layCurves() {
    const { content, time, side, seek, end: unreal } = this, beside = byId("legend").dataset.columns > 1 || isOnPaper();
    const alarm = !content.proved;
    const mark = (instant, value, said) => ({ time: instant.time, value, said, alarm });
    const units = [...new Set(content.motors.map(({ unit }) => unit))].join(", ");
    const dashes = ["", "7 4", "2 3", "9 3 2 3", "9 2 2 2 2 2", "14 5"];
    const names = content.motors.map(({ name }) => plain(name).replace(/_/g, " "));
    // beside the title of their curves, if all of them find room there
    const scale = parseFloat(getComputedStyle(document.documentElement).fontSize) / 14;
    const shortNames = names.reduce((sum, name) => sum + 6.4 * name.length + 24, 130) * scale < side.clientWidth;
    side.innerHTML = `<p class="summary">${symbols(content.summary)}</p>`;
    if (content.refusal) side.insertAdjacentHTML("beforeend", `<p class="summary refusal">The planner: ${symbols(content.refusal)}</p>`);
    // alone beside its scene, the curves take what height the words leave
    const written = [...side.children].reduce((sum, { offsetHeight }) => sum + offsetHeight + 12, 30 * !shortNames);
    const taller = beside ? 1 : Math.min(MAX_TALLER, Math.max(1, (side.clientHeight - written - 20) / (scale * (150 + 176 + 140))));
    this.panels = [new Chart(side, {
      title: `motor torque [${units}]`, time, seek, unreal, limit: content.shared_limit, height: beside ? 110 : 150 * taller,
      events: content.instants.map((instant) => mark(instant, undefined, alarm ? `${rounded(instant.time)} s: no bound` : "")),
      series: this.torque.map((values, k) => ({ values, color: PALETTE[k % 6], dash: dashes[k % 6], name: shortNames ? content.motors[k].name.replace(/_/g, " ") : "" })),
    })];
    if (!shortNames) side.insertAdjacentHTML("beforeend", `<p class="names">${names.map((name, k) =>
      `<span><b style="color:${PALETTE[k % 6]}">${dashes[k % 6] ? "┄" : "━"}</b> ${name}</span>`).join("&ensp; ")}</p>`);
    if (!this.g) return;
    this.panels.push(new Chart(side, {
      title: `${content.asked} tₛ, asked for (tₛ · Wₚ) and given [${content.unit}]`, time, seek, unreal, limit: content.shared_force, height: beside ? 97 : 176 * taller,
      events: content.instants.map((instant) => mark(instant, alarm ? instant.wrench : 0,
        alarm ? `asks for ${rounded(instant.wrench)} ${content.unit}, given: 0` : "asks for 0")),
      series: [{ values: this.power, color: ink("wrench") }], band: this.band,
    }));
    this.panels.push(new Chart(side, {
      title: `singularity measure g: 0 ${content.locus ? `on the purple ${content.locus.kind === "patch" ? "surface" : "curve"}` : "where singular"}`, time, seek, unreal,
      height: beside ? 97 : 140 * taller, events: content.instants.map((instant) => mark(instant, 0, "")),
      series: [{ values: this.g, color: ink("locus") }],
    }));
  }

  show(t) {
    const { view, content, time } = this, L = content.length;
    const at = Math.min(Math.max(t, 0), this.duration);
    let k = Math.min(time.length - 2, Math.floor((at / this.duration) * (time.length - 1)));
    while (k > 0 && time[k] > at) k--;
    while (k < time.length - 2 && time[k + 1] <= at) k++;
    const part = Math.min(1, Math.max(0, (at - time[k]) / (time[k + 1] - time[k])));
    view.setPoses(view.poses, k, part);
    const origin = vectorAt(this.platform, k, part);
    this.spot.position.copy(origin);
    const g = this.g ? between(this.g, k, part) : 1;
    this.vectors.set(origin, k, part, {
      near: 1 - Math.min(1, Math.abs(g) / (0.5 * this.largestG)),
      crossing: content.proved && content.instants.some(({ time }) => Math.abs(time - at) < 0.02 * this.duration),
    });
    this.torque.forEach((values, m) => {
      const value = between(values, k, part);
      view.setMotor(m, isFinite(value) ? Math.abs(value) / content.shared_limit : Infinity);
      const label = this.motorLabels[m];
      if (label) label.textContent = Math.abs(value) > content.shared_limit * 1.001 || !isFinite(value) ? "off the scale" : `${steady(value, content.shared_limit)} ${content.motors[m].unit}`;
    });
    if (this.coils) {
      const n = this.coils.length;
      content.springs.coils.forEach((coil, c) => {
        const a = this.deflection[k * n + c];
        this.coils[c].set(part > 0 ? a + part * (this.deflection[(k + 1) * n + c] - a) : a);
      });
    }
    if (this.trace) {
      const whole = this.trace.geometry.index.count, segments = whole / 48;
      this.trace.geometry.setDrawRange(0, 48 * Math.ceil(between(this.way, k, part) * segments));
    }
    this.panels.forEach((panel) => panel.mark(at, k, part));
    const { text, state } = spoken(this, at, g, between(this.power, k, part));
    this.caption.className = `now ${state}`;
    this.caption.innerHTML = text;
    view.element.className = `view ${{ singular: "crossing", unbounded: "unbounded", unreal: "unreal" }[state] || ""}`;
    this.shown = at;
    if (this.told !== text.split("</b>")[0]) { // not each number anew
      this.told = text.split("</b>")[0];
      this.live.innerHTML = text.replace(/<sub>/g, " <sub>"); // t s, not ts
    }
    view.viewer.set_dirty();
  }

  // Where the arrows end at times all along, and at the singular instants: that too has to be in sight.
  tips() {
    const times = Array.from({ length: 25 }, (_, k) => (k / 24) * this.duration);
    return [...times, ...this.content.instants.map(({ time }) => time)].flatMap((t) => { this.show(t); return this.vectors.ends; });
  }

  singular(instant, t) {
    return Boolean(instant) && Math.abs(instant.time - t) < 1e-9 * this.duration;
  }

  // Its own singular instant, if it has one.
  get tellingTime() {
    return this.content.instants.length ? this.content.instants[0].time : null;
  }

  // The most that its words ever need, so that the view keeps its size.
  get wordiest() {
    const times = this.content.instants.flatMap(({ time }) => [-0.03, 0, 0.03].map((beside) => time + beside * this.duration));
    this.caption.style.height = "auto";
    return Math.max(...[0, this.duration, ...times].map((t) => { this.show(t); return this.caption.offsetHeight; }));
  }
}
