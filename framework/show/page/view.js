// One robot in one pane: MeshCat's viewer, the robot's nodes, and labels that follow points of the scene.

class View {
  constructor(element, content) {
    this.content = content;
    this.element = element;
    this.pane = element.appendChild(document.createElement("div"));
    this.pane.className = "pane";
    this.viewer = new MeshCat.Viewer(this.pane);
    this.labels = [];
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
  }

  surroundings() {
    const { center, radius, from, lowest, flat } = this.content.view;
    const viewer = this.viewer;
    for (const name of ["Grid", "Axes"]) viewer.set_property([name], "visible", false);
    viewer.hide_background();
    viewer.camera.fov = 36;
    viewer.camera.near = radius / 100;
    viewer.camera.far = 60 * radius;
    const { clientWidth, clientHeight } = this.element;
    const far = (flat ? 2.45 : 2.75) * radius / Math.min(1, clientWidth / clientHeight || 1);
    // the camera lives in a frame whose y is up
    const inCamera = (x, y, z) => new THREE.Vector3(x, z, -y);
    viewer.controls.target.copy(inCamera(...center));
    viewer.camera.position.copy(inCamera(...center.map((value, k) => value + far * from[k])));
    viewer.camera.updateProjectionMatrix();
    viewer.controls.update();
    const step = Math.pow(10, Math.floor(Math.log10(radius)));
    const cells = 2 * Math.ceil((2.4 * radius) / step);
    const grid = new THREE.GridHelper(cells * step, cells, 0xb9c2cc, 0xdde2e8);
    grid.rotateX(Math.PI / 2);
    grid.position.set(center[0], center[1], lowest - 0.05 * radius);
    grid.material.transparent = true;
    grid.material.opacity = 0.6;
    viewer.scene.add(grid);
  }

  motor(motor) {
    const size = motor.radius;
    const geometry = motor.slides
      ? new THREE.BoxGeometry(1.1 * size, 1.1 * size, 1.8 * size)
      : new THREE.CylinderGeometry(size, size, 1.3 * size, 40).rotateX(Math.PI / 2);
    const material = new THREE.MeshPhongMaterial({ color: 0xd4d7db, shininess: 15 });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.applyMatrix4(matrix(motor.placement));
    this.nodes[motor.node].add(mesh);
    return material;
  }

  setMotor(k, share) {
    this.motors[k].color.setRGB(...heat(share));
  }

  // Poses of frame k, and of the way to the next one.
  setPoses(poses, k, part = 0) {
    const row = 7 * this.content.joints, turn = new THREE.Quaternion();
    this.nodes.forEach((node, j) => {
      const a = k * row + 7 * j, b = part > 0 ? a + row : a;
      const mix = (i) => poses[a + i] + part * (poses[b + i] - poses[a + i]);
      node.position.set(mix(0), mix(1), mix(2));
      node.quaternion.set(poses[a + 3], poses[a + 4], poses[a + 5], poses[a + 6]);
      if (part > 0) node.quaternion.slerp(turn.set(poses[b + 3], poses[b + 4], poses[b + 5], poses[b + 6]), part);
    });
    this.viewer.set_dirty();
  }

  add(object) {
    if (object) this.viewer.scene.add(object);
    return object;
  }

  addLocus(locus) {
    if (!locus) return;
    if (locus.kind === "patch") {
      this.add(patch(decoded(locus.points), locus.count, COLORS.locus));
    } else {
      for (const curve of locus.curves) this.add(tube(points(decoded(curve)), 0.0075 * this.length, COLORS.locus));
    }
  }

  // A label that follows `place`, a function that gives a point or null; `aside` gives how far from it the
  // label stands, in pixels, and `leader` draws a line between.
  label(html, color, place, aside = () => [0, 0], leader = false) {
    const element = this.element.appendChild(document.createElement("div"));
    element.className = "label";
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
    const { clientWidth, clientHeight } = this.element;
    for (const { element, place, aside, line } of this.labels) {
      const point = place();
      element.style.display = point ? "" : "none";
      if (!point) continue;
      const at = this.onScreen(point), [right, down] = aside(at);
      const half = 0.5 * element.offsetWidth + 3;
      const x = Math.min(Math.max(at.x + right, half), clientWidth - half), y = Math.min(at.y + down, clientHeight - 12);
      element.style.left = `${x}px`;
      element.style.top = `${y}px`;
      if (!line) continue;
      // to the upper edge of the label
      const across = x - at.x, along = y - 9 - at.y;
      line.style.left = `${at.x}px`;
      line.style.top = `${at.y}px`;
      line.style.width = `${Math.hypot(across, along)}px`;
      line.style.transform = `rotate(${Math.atan2(along, across)}rad)`;
    }
  }
}
