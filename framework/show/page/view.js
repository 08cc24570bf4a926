// One robot in one pane: MeshCat's viewer, the robot's nodes, and labels that follow points of the scene.

const FILLED = 0.85, RIM = 30; // the share of the picture that bodies fill; pixels beyond all else

class View {
  constructor(element, content) {
    this.content = content;
    this.element = element;
    this.pane = element.appendChild(document.createElement("div"));
    this.pane.className = "pane";
    this.viewer = new MeshCat.Viewer(this.pane);
    this.labels = [];
    this.extra = []; // points that have to be in sight beside the bodies, such as the tips of arrows
    this.turned = false; // by hand: then the camera stays where it was put
    this.fit();
    this.nodes = [];
    this.robot = new THREE.Group();
    this.robot.name = "robot";
    for (let j = 0; j < content.joints; j++) {
      const node = new THREE.Group();
      node.name = `node ${j}`;
      this.robot.add(node);
      this.nodes.push(node);
    }
    for (const shape of content.shapes) this.nodes[shape.node].add(solid(shape));
    this.motors = content.motors.map((motor) => this.motor(motor));
    this.springs = content.line_springs.map((ends) => ({ ends, coil: new LineSpring(this.length) }));
    for (const { coil } of this.springs) this.robot.add(coil.object);
    this.viewer.scene.add(this.robot);
    this.surroundings();
    this.poses = decoded(content.poses);
    this.setPoses(this.poses, 0);
    new ResizeObserver(() => this.resize()).observe(element);
    const render = this.viewer.render.bind(this.viewer);
    this.viewer.render = () => { render(); this.placeLabels(); };
  }

  get length() { return this.content.length; }

  // MeshCat sizes its pane by the window; here the pane has its own size.
  fit() {
    const size = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => {
      const { clientWidth, clientHeight } = this.element;
      if (clientWidth && clientHeight) size(clientWidth, clientHeight);
    };
  }

  resize() {
    this.viewer.set_3d_pane_size();
    if (!this.turned) this.frame();
  }

  // On paper a picture of the scene stands for it: what a browser prints of the scene itself may be empty.
  onPaper(isPrinted) {
    this.resize();
    this.viewer.render();
    if (this.picture) this.picture.remove();
    if (!isPrinted) return;
    this.picture = this.pane.appendChild(new Image());
    this.picture.src = this.pane.querySelector("canvas").toDataURL();
    this.picture.alt = "";
  }

  surroundings() {
    const { center, radius, lowest, flat } = this.content.view;
    const viewer = this.viewer;
    for (const name of ["Grid", "Axes"]) viewer.set_property([name], "visible", false);
    viewer.hide_background();
    viewer.camera.fov = flat ? 20 : 36; // a planar robot nearly without perspective
    viewer.controls.addEventListener("start", () => { this.turned = true; });
    const step = Math.pow(10, Math.floor(Math.log10(radius)));
    const cells = 2 * Math.ceil((2.4 * radius) / step);
    const grid = new THREE.GridHelper(cells * step, cells, ink("axis"), ink("line"));
    grid.rotateX(Math.PI / 2);
    grid.position.set(center[0], center[1], lowest - 0.05 * radius);
    grid.material.transparent = true;
    grid.material.opacity = 0.6;
    viewer.scene.add(grid);
    const tools = this.element.appendChild(document.createElement("div"));
    tools.className = "tools";
    tools.append(`cells of ${Number(step.toPrecision(1))} m`);
    for (const [sign, title, act] of [["+", "zoom in", () => this.zoom(0.8)], ["−", "zoom out", () => this.zoom(1.25)], ["⤢", "fit the robot into the picture", () => this.frame()]]) {
      const button = tools.appendChild(document.createElement("button"));
      Object.assign(button, { type: "button", textContent: sign, title, onclick: act });
      button.setAttribute("aria-label", title);
    }
  }

  // What the picture is, for those who do not see it.
  name(text) {
    const canvas = this.pane.querySelector("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", text.replace(/_/g, " "));
  }

  zoom(factor) {
    const { camera, controls } = this.viewer;
    this.turned = true;
    camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    controls.update();
    this.viewer.set_dirty();
  }

  // Corners of all bodies in some frames of the motion.
  inSight(frames = 25) {
    const found = [], placed = new THREE.Matrix4();
    const count = this.poses.length / (7 * this.content.joints), last = Math.min(frames, count) - 1;
    for (let f = 0; f <= last; f++) {
      this.setPoses(this.poses, last ? Math.round((f * (count - 1)) / last) : 0);
      this.robot.updateMatrixWorld(true);
      const toRobot = this.robot.matrixWorld.clone().invert();
      this.robot.traverse((mesh) => {
        if (!mesh.geometry) return;
        if (!mesh.geometry.boundingBox) mesh.geometry.computeBoundingBox();
        placed.multiplyMatrices(toRobot, mesh.matrixWorld);
        found.push(...corners(mesh.geometry.boundingBox).map((corner) => corner.applyMatrix4(placed)));
      });
    }
    return found;
  }

  // Stands the camera, in the given direction, so near that bodies fill three quarters of the picture, or less if
  // what is to be seen beside them needs the room.
  frame() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    if (!this.cloud) this.cloud = this.inSight();
    const { camera, controls } = this.viewer, slope = Math.tan((camera.fov * Math.PI) / 360);
    const inCamera = ({ x, y, z }) => new THREE.Vector3(x, z, -y); // the camera lives in a frame whose y is up
    const ahead = inCamera(new THREE.Vector3(...this.content.view.from)).negate();
    const right = ahead.clone().cross(new THREE.Vector3(0, 1, 0)).normalize(), up = right.clone().cross(ahead);
    const placed = (points) => points.map(inCamera).map((point) => [point.dot(right), point.dot(up), point.dot(ahead)]);
    const bodies = placed(this.cloud), rim = Math.min(RIM, 0.08 * Math.min(width, height));
    const lots = [[bodies, FILLED, FILLED], [placed(this.extra), 1 - 2 * rim / width, 1 - 2 * rim / height]];
    // |x - x0| <= a (z - z0) for all points of a lot: x0 is above x - a z + a z0, and below x + a z - a z0
    const bounds = (i, ratio) => lots.map(([points, ...shares]) => {
      const a = slope * ratio * shares[i];
      return points.reduce((least, point) => ({
        a, above: Math.max(least.above, point[i] - a * point[2]), below: Math.min(least.below, point[i] + a * point[2]),
      }), { a, above: -Infinity, below: Infinity });
    });
    const sides = [bounds(0, width / height), bounds(1, 1)];
    const depth = Math.min(...sides.flatMap((side) => side.flatMap((one) => side.map((other) => (one.below - other.above) / (one.a + other.a)))));
    const [x, y] = sides.map((side) => 0.5 * (Math.max(...side.map(({ a, above }) => above + a * depth)) + Math.min(...side.map(({ a, below }) => below - a * depth))));
    const middle = bodies.reduce((sum, point) => sum + point[2], 0) / bodies.length;
    camera.position.set(0, 0, 0).addScaledVector(right, x).addScaledVector(up, y).addScaledVector(ahead, depth);
    controls.target.copy(camera.position).addScaledVector(ahead, middle - depth);
    camera.near = (middle - depth) / 100;
    camera.far = 60 * (middle - depth);
    camera.updateProjectionMatrix();
    controls.update();
    this.turned = false;
    this.viewer.set_dirty();
  }

  motor(motor) {
    const material = new THREE.MeshPhongMaterial({ color: ink("idle"), shininess: 15 });
    const mesh = new THREE.Mesh(solidGeometry(motor), material);
    mesh.applyMatrix4(matrix(motor.placement));
    this.nodes[motor.node].add(mesh);
    return material;
  }

  setMotor(k, share) {
    this.motors[k].color.copy(heat(share));
  }

  // Poses of frame k, and of the way to the next one.
  setPoses(poses, k, part = 0) {
    const row = 7 * this.content.joints;
    this.nodes.forEach((node, j) => {
      const a = k * row + 7 * j, b = part > 0 ? a + row : a;
      const mix = (i) => poses[a + i] + part * (poses[b + i] - poses[a + i]);
      node.position.set(mix(0), mix(1), mix(2));
      // along the chord: of frames this near the arc differs by less, and slerp() gives up below 1e-3 rad in single precision
      node.quaternion.set(mix(3), mix(4), mix(5), mix(6)).normalize();
    });
    for (const { ends, coil } of this.springs) {
      coil.set(...ends.map(({ node, place }) => {
        const { position, quaternion } = this.nodes[node];
        return new THREE.Vector3(...place).applyQuaternion(quaternion).add(position);
      }));
    }
    this.viewer.set_dirty();
  }

  add(object) {
    if (object) this.viewer.scene.add(object);
    return object;
  }

  addLocus(locus) {
    if (!locus) return;
    if (locus.kind === "patch") {
      this.add(patch(decoded(locus.points), locus.count, ink("locus")));
    } else {
      for (const curve of locus.curves) {
        const line = points(decoded(curve));
        this.add(tube(line, 0.0075 * this.length, ink("locus")));
        const hidden = this.add(tube(line, 0.004 * this.length, ink("locus"), 0.45)); // seen through the bodies before it
        if (hidden) hidden.material.depthTest = hidden.material.depthWrite = false;
      }
    }
  }

  // A label that follows `place`, a function that gives a point or null; `aside` gives how far from it the
  // label stands, in pixels, and `leader` draws a line between.
  label(html, color, place, aside = () => [0, 0], leader = false) {
    const element = this.element.appendChild(document.createElement("div"));
    element.className = "label";
    element.setAttribute("aria-hidden", "true"); // the curves and the caption say it
    element.style.color = color;
    element.innerHTML = html;
    const line = leader ? this.element.appendChild(document.createElement("div")) : null;
    if (line) line.className = "leader";
    this.labels.push({ element, place, aside, line });
    return element;
  }

  // Where a point of the scene is in the pane, in pixels.
  onScreen(point) {
    const { clientWidth, clientHeight } = this.element;
    const seen = point.clone().applyMatrix4(this.viewer.scene.matrixWorld).project(this.viewer.camera);
    return { x: (0.5 + 0.5 * seen.x) * clientWidth, y: (0.5 - 0.5 * seen.y) * clientHeight };
  }

  placeLabels() {
    const { clientWidth, clientHeight } = this.element, taken = [];
    for (const { element, place, aside, line } of this.labels) {
      const point = place();
      for (const part of [element, line]) if (part) part.style.display = point ? "" : "none";
      if (!point) continue;
      const at = this.onScreen(point), [right, down] = aside(at);
      const half = 0.5 * element.offsetWidth + 3, high = 0.5 * element.offsetHeight;
      const inside = (value, rim, size) => Math.min(Math.max(value, rim), size - rim);
      const wanted = { x: inside(at.x + right, half, clientWidth), y: inside(at.y + down, high, clientHeight) };
      const free = ({ x, y }) => taken.every((other) => Math.abs(other.x - x) > other.half + half || Math.abs(other.y - y) > other.high + high);
      const tried = [0, 1, -1, 2, -2, 3, -3].map((step) => ({ x: wanted.x, y: inside(wanted.y + 0.9 * high * step, high, clientHeight) }));
      const { x, y } = tried.find(free) || wanted;
      taken.push({ x, y, half, high });
      element.style.left = `${x}px`;
      element.style.top = `${y}px`;
      if (!line) continue;
      // to the nearer edge of the label
      const across = x - at.x, along = y - Math.sign(y - at.y) * 9 - at.y;
      line.style.left = `${at.x}px`;
      line.style.top = `${at.y}px`;
      line.style.width = `${Math.hypot(across, along)}px`;
      line.style.transform = `rotate(${Math.atan2(along, across)}rad)`;
    }
  }
}
