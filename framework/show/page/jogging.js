// A robot moved by hand: sliders ask the Python behind the page, which closes the loops.

class Hand {
  constructor(section, content) {
    this.content = content;
    section.innerHTML = `<h2>${plain(content.robot).replace(/_/g, " ")}, moved by hand <span class="subtitle">${plain(content.about)}</span></h2>
      <div class="inside"><div class="left"><div class="legend"></div><div class="view"></div><div class="now" role="status"></div></div><div class="side sliders"></div></div>`;
    this.view = new View(section.querySelector(".view"), content);
    this.view.name(`${content.robot}, moved by hand`);
    this.now = section.querySelector(".now");
    this.side = section.querySelector(".side");
    const L = content.length;
    this.view.addLocus(content.locus);
    this.spot = this.view.add(new THREE.Mesh(new THREE.SphereGeometry(0.02 * L, 24, 16), new THREE.MeshBasicMaterial()));
    this.arrows = {
      linear: new Arrow(ink("twist"), 0.007 * L, { bothWays: true }),
      angular: new Arrow(ink("twist"), 0.005 * L, { bothWays: true, turning: true }),
    };
    for (const arrow of Object.values(this.arrows)) this.view.add(arrow.object);
    this.view.label("t<sub>s</sub>", "var(--twist)", () => {
      const { linear, angular } = this.arrows;
      return linear.object.visible ? linear.tip : angular.object.visible ? angular.tip : null;
    });
    this.lines = new Lines(ink("given"), 0.6 * L, content.motors.length);
    this.view.add(this.lines.object);
    section.querySelector(".legend").innerHTML = this.legend();
    this.build();
    if (content.drag) this.takePlatform();
    this.waiting = null;
    this.busy = false;
    this.usual = Math.abs(content.start.g || 1);
    this.put(content.start);
  }

  legend() {
    const { locus, start, turning, no_figure } = this.content, turns = turning.every(Boolean);
    if (start.g === null) return "";
    const key = (color, text) => `<div><span class="key" style="background:${color}"></span>${text}</div>`;
    const given = `<div><span class="key given"></span>${turns ? "torques" : "forces"} that equal motors can give</div>`;
    return [
      locus ? key("var(--locus)", `singular locus${locus.whole ? "" : " (platform not turned)"}`) : "",
      key("var(--twist)", "t<sub>s</sub>: uncontrolled motion"),
      start.sides ? given : no_figure ? `<div>what motors can give: ${plain(no_figure)}</div>` : "",
      this.content.lines ? key("var(--given)", `${turns ? "axes of the motors’ torques" : "lines of the motors’ forces"}, near a Type 2 singularity`) : "",
    ].join("");
  }

  build() {
    const { sliders, free_motors } = this.content;
    this.side.innerHTML = `<div class="class"></div>
      <dl class="readings"><dt>singularity measure g (0 on the locus)</dt><dd class="g"></dd>
      <dt>smallest singular value σ<sub>min</sub></dt><dd class="smallest"></dd></dl>
      <div class="hold"></div>
      ${this.content.drag ? '<p class="hint">Drag the platform, or a slider.</p>' : ""}<p class="stop" role="status"></p><div class="all"></div>
      <p><button type="button" class="back">Back to the start</button></p>`;
    this.inputs = { platform: [], motor: [] };
    const all = this.side.querySelector(".all");
    const group = (part, title) => {
      all.insertAdjacentHTML("beforeend", `<h3>${title}</h3>`);
      sliders[part].forEach(({ name, unit, low, high }, index) => {
        const label = document.createElement("label");
        label.innerHTML = `<span>${plain(name).replace(/_/g, " ")}</span><output aria-live="off"></output>
          <input type="range" min="${low}" max="${high}" step="${(high - low) / 1000}" data-part="${part}" data-index="${index}"
            aria-label="${part === "motor" ? "" : "platform "}${plain(name).replace(/_/g, " ")}">`;
        all.appendChild(label);
        const input = label.querySelector("input");
        input.addEventListener("input", () => this.ask({ part, index, value: Number(input.value) }));
        input.addEventListener("change", () => { this.settle = true; if (!this.busy) this.put(this.state); });
        this.inputs[part].push({ input, output: label.querySelector("output") });
      });
    };
    group("platform", "Platform: the motors follow");
    if (free_motors) group("motor", "Motors: the platform follows");
    else all.insertAdjacentHTML("beforeend", "<p>The motors of this robot depend on one another: none can move while the others rest.</p>");
    this.side.querySelector(".back").addEventListener("click", () => this.put(this.content.start));
  }

  // Bars of the motor torques that hold a push along t_s; and, on a planar robot, what such motors can give.
  holds(state) {
    const { push, motors, length: L } = this.content, box = this.side.querySelector(".hold");
    const start = this.content.start;
    if (start.torques) {
      this.full = this.full || 6 * Math.max(...start.torques, 1e-9);
      const rows = motors.map(({ name, unit }, k) => {
        const value = state.torques ? (state.torques[k] < 1e-9 * Math.max(...state.torques) ? 0 : state.torques[k]) : Infinity, share = Math.min(1, value / this.full);
        const text = isFinite(value) ? `${rounded(value)} ${unit}` : "no bound";
        return `<div><span>${plain(name).replace(/_/g, " ")}</span><output aria-live="off">${text}</output><i><b style="width:${100 * share}%"></b></i></div>`;
      });
      box.innerHTML = `<h3>Motor torque against ${symbols(push)}</h3>${rows.join("")}`;
    }
    this.lines.object.visible = Boolean(state.lines);
    if (state.lines) this.lines.set(state.lines.map(([place, way]) => [new THREE.Vector3(...place).add(this.spot.position), new THREE.Vector3(...way)]), 1);
    if (!state.sides) { if (this.polytope) this.polytope.object.visible = false; return; }
    if (!this.polytope) {
      this.polytope = this.content.flat ? new Polygon(ink("given"), 0.5 * L, motors.length) : new Parallelepiped(ink("given"));
      this.view.add(this.polytope.object);
      const edges = state.sides.map((side) => new THREE.Vector3(...side));
      this.reach = (0.3 * L) / (this.content.flat ? Math.max(...edges.map((edge) => edge.length())) : farthestCorner(edges));
    }
    this.polytope.object.visible = true;
    const sides = state.sides.map((side) => new THREE.Vector3(...side).multiplyScalar(this.reach));
    this.polytope.set(this.spot.position, new THREE.Vector3(), sides);
  }

  // On the locus the platform wobbles along t_s: from one end of the way to the other and back, all the time.
  wobble() {
    const { wobble } = this.state;
    if (!wobble || this.wobbling || matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.wobbling = true;
    const step = (now) => {
      const { wobble: way } = this.state;
      if (!way || this.held) { this.wobbling = false; this.stand(); return; }
      if (this.told !== way) [this.told, this.from, this.loose] = [way, now, { poses: decoded(way.poses), places: decoded(way.places) }];
      const at = (way.count - 1) * (0.5 + 0.5 * Math.sin((now - this.from) / 250)), k = Math.min(way.count - 2, Math.floor(at));
      this.view.setPoses(this.loose.poses, k, at - k);
      this.spot.position.copy(vectorAt(this.loose.places, k, at - k));
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Where it was brought.
  stand() {
    this.view.setPoses(this.view.poses, 0);
    this.spot.position.set(...this.state.origin);
  }

  // The platform in the mouse: it is led in its own plane, or across the sight.
  takePlatform() {
    const { view, content } = this, { camera, controls, scene } = view.viewer;
    const shifts = ["x", "y", "z"].map((axis) => content.axes.includes(axis));
    let held = null;
    const placed = (event) => {
      const edges = view.element.getBoundingClientRect();
      const at = new THREE.Vector2(((event.clientX - edges.left) / edges.width) * 2 - 1, 1 - ((event.clientY - edges.top) / edges.height) * 2);
      const ray = new THREE.Raycaster();
      scene.updateMatrixWorld(true);
      ray.setFromCamera(at, camera);
      ray.ray.applyMatrix4(scene.matrixWorld.clone().invert());
      return ray.ray.intersectPlane(held.plane, new THREE.Vector3());
    };
    const near = (event) => {
      const edges = view.element.getBoundingClientRect(), { x, y } = view.onScreen(this.spot.position);
      return Math.hypot(event.clientX - edges.left - x, event.clientY - edges.top - y) < 26;
    };
    // before the camera's own controls see it
    view.pane.addEventListener("pointerdown", (event) => {
      if (!near(event)) return;
      event.stopPropagation();
      event.preventDefault();
      const flat = shifts.filter(Boolean).length === 2;
      const across = new THREE.Vector3(...shifts.map((free) => (flat && !free ? 1 : 0)));
      if (!flat) camera.getWorldDirection(across).applyMatrix4(new THREE.Matrix4().extractRotation(scene.matrixWorld.clone().invert()));
      this.held = true;
      this.stand();
      held = { plane: new THREE.Plane().setFromNormalAndCoplanarPoint(across.normalize(), this.spot.position) };
      view.pane.setPointerCapture(event.pointerId);
      view.element.classList.add("held");
    }, true);
    view.pane.addEventListener("pointermove", (event) => {
      if (!held) { view.pane.style.cursor = near(event) ? "grab" : ""; return; }
      event.stopPropagation();
      const place = placed(event);
      if (place) this.ask({ part: "drag", place: place.toArray() });
    }, true);
    const release = () => {
      if (!held) return;
      held = null;
      this.held = false;
      this.settle = true;
      if (!this.busy) this.put(this.state);
    };
    for (const end of ["pointerup", "pointercancel"]) view.pane.addEventListener(end, release, true);
    controls.enablePan = false;
  }

  // One question at a time, and of those that come meanwhile only the last.
  async ask(movement) {
    this.settle = false;
    if (this.busy) { this.waiting = movement; return; }
    this.busy = true;
    try {
      const reply = await fetch("api/move", {
        method: "POST", headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ ...movement, q: this.state.q }),
      });
      const found = await reply.json();
      if (reply.ok) this.put(found, movement);
      else this.side.querySelector(".stop").textContent = found.error;
    } catch (error) {
      this.side.querySelector(".stop").textContent = "The program behind this page has ended; start it again to move the robot.";
    }
    this.busy = false;
    const next = this.waiting;
    this.waiting = null;
    if (next) this.ask(next);
    else if (this.settle) this.put(this.state);
  }

  put(state, held) {
    this.state = state;
    const L = this.content.length;
    this.view.poses = decoded(state.poses); // what is fitted into the picture when one asks for it
    this.view.cloud = null;
    this.view.setPoses(this.view.poses, 0);
    const origin = new THREE.Vector3(...state.origin);
    this.spot.position.copy(origin);
    this.spot.material.color.set(ink({ regular: "good", near: "warning", singular: "locus" }[state.level]));
    const [linear, angular] = state.t_s.map((part) => new THREE.Vector3(...part));
    const nearness = state.g === null ? 0 : 1 - Math.min(1, Math.abs(state.g) / this.usual);
    const size = linear.length() || 1;
    this.arrows.linear.set(origin, linear.multiplyScalar(0.3 * L / size), 0.15 + 0.85 * nearness);
    this.arrows.angular.set(origin, angular.multiplyScalar(0.22 * L / (angular.length() || 1)), 0.15 + 0.85 * nearness);
    this.view.extra = Object.values(this.arrows).filter(({ object }) => object.visible).flatMap(({ tip }) =>
      [tip.clone(), origin.clone().multiplyScalar(2).sub(tip)]); // the arrow has to be in sight, too
    for (const part of ["platform", "motor"]) {
      this.inputs[part].forEach(({ input, output }, index) => {
        const isOf = (movement) => movement && movement.part === part && movement.index === index;
        const dragged = isOf(this.waiting) || (isOf(held) && !this.settle); // a held key asks on while one waits
        if (!dragged) input.value = state[part][index];
        output.textContent = `${state[part][index].toFixed(4).replace(/^-(?=[0.]*$)/, "").replace("-", "−")} ${this.content.sliders[part][index].unit}`;
        input.setAttribute("aria-valuetext", output.textContent);
      });
    }
    this.holds(state);
    const badge = this.side.querySelector(".class");
    badge.className = `class ${state.level}`;
    badge.innerHTML = symbols(state.verdict);
    this.side.querySelector(".g").textContent = state.g === null ? "none" : rounded(state.g, 4);
    this.side.querySelector(".smallest").textContent = state.smallest === null ? "none" : rounded(state.smallest, 4);
    this.side.querySelector(".stop").textContent = state.stopped;
    this.view.element.className = `view ${state.level}`;
    const end = state.words.indexOf(".") + 1;
    const loose = state.wobble ? ` ${state.wobble.words}` : "";
    const words = `<b>${plain(state.words.slice(0, end))}</b>${symbols(state.words.slice(end) + loose)}`;
    if (this.words !== words) this.now.innerHTML = this.words = words; // not said again
    this.view.viewer.set_dirty();
    if (!this.held) this.wobble();
  }
}
