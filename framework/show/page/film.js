// One film: a view, what moves in it, the curves beside it, and what is to be said about this instant.

function symbols(text) {
  return plain(text).replace(/t_s/g, "t<sub>s</sub>").replace(/W_p/g, "W<sub>p</sub>");
}

class Film {
  constructor(section, content, seek) {
    this.content = content;
    this.duration = content.duration;
    this.time = decoded(content.time);
    const n = content.motors.length;
    const torque = decoded(content.torque);
    this.torque = content.motors.map((_, k) => Float32Array.from(this.time, (_, f) => torque[f * n + k]));
    this.power = decoded(content.power);
    this.g = content.g && decoded(content.g);
    this.law = decoded(content.law);
    this.platform = decoded(content.platform);
    this.vectors = Object.fromEntries(["t_s", "W_p"].map((name) => {
      const { linear, angular, largest } = content[name];
      return [name, { linear: decoded(linear), angular: decoded(angular), largest }];
    }));
    this.largestG = this.g ? Math.max(...this.g.map(Math.abs)) : 1;

    const badge = content.proved ? '<span class="badge proved">finite torque, proven</span>' : '<span class="badge unproved">unbounded torque</span>';
    section.innerHTML = `<h2>${plain(content.title)}${badge}</h2>
      <div class="inside"><div class="left"><div class="legend"></div><div class="view"></div><div class="now"></div></div><div class="side"></div></div>`;
    this.view = new View(section.querySelector(".view"), content);
    this.furnish();
    this.caption = section.querySelector(".now");
    this.legend(document.getElementById("legend"), section.querySelector(".legend"));
    this.charts(section.querySelector(".side"), seek);
  }

  furnish() {
    const { view, content } = this, L = content.length;
    view.addLocus(content.locus);
    const track = points(this.platform);
    view.add(tube(track, 0.0035 * L, COLORS.path));
    this.trace = view.add(tube(track, 0.0065 * L, COLORS.trace));
    const way = [0];
    for (let k = 1; k < track.length; k++) way.push(way[k - 1] + track[k].distanceTo(track[k - 1]));
    this.way = way.map((value) => value / (way[way.length - 1] || 1));
    this.spot = view.add(new THREE.Mesh(new THREE.SphereGeometry(0.014 * L, 24, 16), new THREE.MeshBasicMaterial({ color: COLORS.trace })));
    this.arrows = {};
    for (const [name, color] of [["t_s", COLORS.twist], ["W_p", COLORS.wrench]]) {
      const bothWays = name === "t_s";
      this.arrows[name] = {
        linear: new Arrow(color, 0.007 * L, { bothWays }),
        angular: new Arrow(color, 0.005 * L, { bothWays, turning: true }),
      };
      for (const arrow of Object.values(this.arrows[name])) view.add(arrow.object);
    }
    this.corner = new RightAngle(0x1d2530, 0.004 * L, 0.06 * L);
    view.add(this.corner.object);
    const tip = (name) => () => {
      const { linear, angular } = this.arrows[name];
      return linear.object.visible ? linear.tip : angular.object.visible ? angular.tip : null;
    };
    view.label("t<sub>s</sub>", "#d55e00", tip("t_s"));
    view.label("W<sub>p</sub>", "#0072b2", tip("W_p"));
    content.motors.forEach((motor, k) => {
      if (content.motors.length > 4) return;
      const node = view.nodes[motor.node], place = new THREE.Vector3().setFromMatrixPosition(matrix(motor.placement));
      place.y -= 0.12 * L;
      const label = view.label("", "#1d2530", () => place.clone().applyMatrix4(node.matrix));
      label.dataset.motor = k;
    });
    this.motorLabels = view.labels.filter(({ element }) => element.dataset.motor !== undefined).map(({ element }) => element);
    for (const instant of content.instants) {
      const spot = new THREE.Mesh(new THREE.SphereGeometry(0.017 * L, 24, 16), new THREE.MeshBasicMaterial({ color: COLORS.locus }));
      spot.position.set(...instant.place);
      view.add(spot);
      const label = content.proved ? "crossed" : "met";
      view.label(`${label} at ${rounded(instant.time)} s`, "#7c3576", () => spot.position.clone().add(new THREE.Vector3(0, -0.08 * L, 0))).classList.add("minor");
    }
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

  // What the colours mean: above the scene, or once above several of them.
  legend(shared, own) {
    const { content } = this, lines = [];
    const key = (color, text) => lines.push(`<div><span class="key" style="background:${color}"></span>${text}</div>`);
    if (content.locus) {
      const where = content.locus.kind === "patch" ? " (a piece, platform not turned)" : content.locus.whole ? "" : " (platform not turned)";
      key("var(--locus)", `singular locus${where}: motors lose hold`);
    }
    else if (content.instants.length) key("var(--locus)", "singular pose: motors lose hold");
    if (this.g) key("var(--twist)", "t<sub>s</sub>: the motion they cannot hold there");
    key("var(--wrench)", "W<sub>p</sub>: the force it takes to move as planned");
    if (this.trace) key("var(--trace)", "way of the platform");
    const limit = content.shared_limit;
    lines.push(`<div>motor torque 0<span class="scale"></span>${rounded(limit)} ${content.motors[0].unit}</div>`);
    if (content.springs) {
      const { factors, coils } = content.springs, said = [];
      if (coils.some((coil) => coil.slides)) said.push(`stretch × ${factors.slide}`);
      if (coils.some((coil) => !coil.slides)) said.push(`twist × ${factors.turn}`);
      lines.push(`<div>springs: ${said.join(", ")}</div>`);
    }
    const box = shared.dataset.columns > 1 ? shared : own;
    if (lines.length > box.children.length) box.innerHTML = lines.join("");
  }

  charts(side, seek) {
    const { content } = this;
    const events = content.instants.map(({ time }) => time);
    const units = [...new Set(content.motors.map(({ unit }) => unit))].join(", ");
    const dashes = ["", "7 4", "2 3", "9 3 2 3"];
    side.insertAdjacentHTML("beforeend", `<p class="summary">${symbols(content.summary)}</p>`);
    if (content.refusal) side.insertAdjacentHTML("beforeend", `<p class="summary refusal">The planner: ${symbols(content.refusal)}</p>`);
    const force = content.turning.every(Boolean) ? "N m" : "N";
    this.panels = [new Chart(side, {
      title: `motor torque [${units}]`, time: this.time, events, seek, limit: content.shared_limit, height: 185,
      series: this.torque.map((values, k) => ({ values, color: PALETTE[k % 6], dash: dashes[k % 4] })),
      note: content.proved ? "" : "clipped: no bound at the dashed line",
    })];
    side.insertAdjacentHTML("beforeend", `<p class="names">${content.motors.map(({ name }, k) =>
      `<span style="color:${PALETTE[k % 6]}">${dashes[k % 4] ? "┄" : "━"} ${plain(name).replace(/_/g, " ")}</span>`).join("&ensp; ")}</p>`);
    if (!this.g) return;
    this.panels.push(new Chart(side, {
      title: `${content.turning.every(Boolean) ? "torque asked for about" : "force asked for along"} tₛ: tₛ · Wₚ [${force}]`, time: this.time, events, seek,
      series: [{ values: this.power, color: "#0072b2" }],
    }));
    this.panels.push(new Chart(side, {
      title: "distance from the locus: g (0 on it)", time: this.time, events, seek,
      series: [{ values: this.g, color: "#a0489a" }],
    }));
  }

  vector(values, k, part) {
    return new THREE.Vector3(...[0, 1, 2].map((i) => {
      const a = values[3 * k + i];
      return part > 0 ? a + part * (values[3 * k + 3 + i] - a) : a;
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
    const origin = this.vector(this.platform, k, part);
    this.spot.position.copy(origin);
    const g = this.g ? between(this.g, k, part) : 1;
    const near = 1 - Math.min(1, Math.abs(g) / (0.5 * this.largestG));
    for (const name of ["t_s", "W_p"]) {
      const { linear, angular, largest } = this.vectors[name];
      const opacity = name === "t_s" ? 0.25 + 0.75 * near : 1;
      const scale = (size) => (size > 1e-9 * (largest[0] + largest[1]) ? (name === "t_s" ? 0.32 : 0.45) * L / size : 0);
      this.arrows[name].linear.set(origin, this.vector(linear, k, part).multiplyScalar(scale(largest[0])), opacity);
      this.arrows[name].angular.set(origin, this.vector(angular, k, part).multiplyScalar(0.8 * scale(largest[1])), opacity);
    }
    this.square(at, origin);
    this.torque.forEach((values, m) => {
      const value = between(values, k, part);
      view.setMotor(m, isFinite(value) ? Math.abs(value) / content.shared_limit : 1);
      const label = this.motorLabels[m];
      if (label) label.textContent = Math.abs(value) > content.shared_limit * 1.001 || !isFinite(value) ? "off the scale" : `${rounded(value)} ${content.motors[m].unit}`;
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
    const wrench = this.vector(this.vectors.W_p.linear, k, part).length() / (this.vectors.W_p.largest[0] || 1);
    this.say(at, g, between(this.power, k, part), wrench);
    view.viewer.set_dirty();
  }

  // The sign of the right angle, where the arrows stand at one as the locus is crossed.
  square(t, origin) {
    const { content, arrows } = this;
    const near = content.instants.some(({ time }) => Math.abs(time - t) < 0.02 * this.duration);
    const [twist, wrench] = ["t_s", "W_p"].map((name) => arrows[name].linear.tip.clone().sub(origin));
    const seen = Math.min(twist.length(), wrench.length()) > 0.03 * content.length;
    const flat = !content.turning.some(Boolean) && Math.abs(twist.dot(wrench)) < 0.1 * twist.length() * wrench.length();
    this.corner.object.visible = near && seen && flat;
    if (this.corner.object.visible) this.corner.set(origin, twist, wrench);
  }

  say(t, g, power, wrench) {
    const { content } = this;
    const force = content.turning.every(Boolean) ? "N m" : "N";
    const instant = content.instants.find(({ time }) => Math.abs(time - t) < 0.006 * this.duration);
    let state = "", text;
    if (!this.g) {
      text = "<b>Every joint has a motor.</b> This robot has no Type 2 singularity.";
    } else if (instant && content.proved) {
      state = "singular";
      text = `<b>Singular now.</b> The motors cannot push along t<sub>s</sub> at all, and they need not: t<sub>s</sub> · W<sub>p</sub> = 0, ${this.how(wrench)}. The torque stays finite.`;
    } else if (instant) {
      state = "unbounded";
      text = `<b>Singular now.</b> The motion asks for ${rounded(Math.abs(instant.wrench))} ${force} along t<sub>s</sub>, where the motors have no hold: no torque is large enough.`;
    } else if (Math.abs(g) < 0.25 * this.largestG && content.instants.length) {
      text = `<b>Near the locus.</b> Along t<sub>s</sub> the motors have little hold: what the motion asks for there (${rounded(power)} ${force}) ${content.proved ? "goes to zero in time" : "does not go to zero in time"}.`;
    } else if (content.instants.length) {
      text = "<b>Away from the locus.</b> The motors hold the platform in every direction.";
    } else {
      text = "<b>No singularity on this way.</b> The motors hold the platform in every direction.";
    }
    this.caption.className = `now ${state}`;
    this.caption.innerHTML = text;
  }

  // How t_s . W_p comes to be zero: the right angle can be seen where nothing turns.
  how(wrench) {
    if (this.content.turning.some(Boolean)) return "the wrench does no work along t<sub>s</sub>";
    if (wrench < 0.02) return "the motion asks for no force at all for an instant (W<sub>p</sub> = 0)";
    return "W<sub>p</sub> stands at a right angle to t<sub>s</sub>";
  }
}
