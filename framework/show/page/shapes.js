// What stands in the scene: solids, tubes, arrows, coils. Sizes in metres, z up.

const THREE = MeshCat.THREE;

function points(values) {
  const found = [];
  for (let k = 0; k + 2 < values.length; k += 3) found.push(new THREE.Vector3(values[k], values[k + 1], values[k + 2]));
  return found;
}

function matrix(placement) {
  return new THREE.Matrix4().fromArray(placement);
}

function corners({ min, max }) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => new THREE.Vector3((k & 1 ? max : min).x, (k & 2 ? max : min).y, (k & 4 ? max : min).z));
}

function solidGeometry(shape) {
  const size = shape.size;
  if (shape.kind === "box") return new THREE.BoxGeometry(size[0], size[1], size[2]);
  if (shape.kind === "sphere") return new THREE.SphereGeometry(size[0], 28, 18);
  if (shape.kind === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], size[1], 40).rotateX(Math.PI / 2);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(decoded(shape.vertices), 3));
  geometry.setIndex(new THREE.BufferAttribute(decoded(shape.faces, Uint32Array), 1));
  geometry.computeVertexNormals();
  return geometry;
}

function solid(shape) {
  const [r, g, b, a] = shape.color;
  const material = new THREE.MeshPhongMaterial({
    color: new THREE.Color(r, g, b), opacity: a, transparent: a < 1, shininess: 25,
    flatShading: shape.kind === "mesh", side: THREE.DoubleSide,
  });
  const mesh = new THREE.Mesh(solidGeometry(shape), material);
  mesh.applyMatrix4(matrix(shape.placement));
  return mesh;
}

function tube(line, radius, color, opacity = 1) {
  const apart = [line[0]];
  for (const point of line) if (point.distanceTo(apart[apart.length - 1]) > 0.6 * radius) apart.push(point);
  if (apart.length < 2) return null;
  const curve = new THREE.CatmullRomCurve3(apart);
  const geometry = new THREE.TubeGeometry(curve, Math.min(400, 4 * apart.length), radius, 8);
  const material = new THREE.MeshBasicMaterial({ color, opacity, transparent: opacity < 1 });
  return new THREE.Mesh(geometry, material);
}

function patch(values, count, color) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(values, 3));
  const faces = [];
  for (let i = 0; i + 1 < count; i++) for (let j = 0; j + 1 < count; j++) {
    const a = i * count + j;
    faces.push(a, a + 1, a + count, a + 1, a + count + 1, a + count);
  }
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  const material = new THREE.MeshPhongMaterial({
    color, opacity: 0.45, transparent: true, side: THREE.DoubleSide, depthWrite: false,
  });
  return new THREE.Mesh(geometry, material);
}

// An arrow drawn over everything else; `turning` adds the ring that tells a turn from a shift.
class Arrow {
  constructor(color, radius, { bothWays = false, turning = false } = {}) {
    this.object = new THREE.Group();
    this.material = new THREE.MeshBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true });
    this.rim = new THREE.MeshBasicMaterial({ color: ink("paper"), depthTest: false, depthWrite: false, transparent: true });
    this.radius = radius;
    this.bothWays = bothWays;
    this.shaft = this.part(new THREE.CylinderGeometry(radius, radius, 1, 16));
    this.heads = [1, -1].slice(0, bothWays ? 2 : 1).map((side) => {
      const head = this.part(new THREE.ConeGeometry(3 * radius, 8 * radius, 20));
      if (side < 0) head.rotation.z = Math.PI;
      return head;
    });
    if (turning) {
      this.ring = this.part(new THREE.TorusGeometry(9 * radius, radius, 10, 40, 1.6 * Math.PI));
      this.ring.rotation.x = Math.PI / 2;
    }
    this.tip = new THREE.Vector3();
  }

  part(geometry) {
    const mesh = new THREE.Mesh(geometry, this.material);
    mesh.renderOrder = 10;
    this.object.add(mesh);
    if (geometry.type === "TorusGeometry") return mesh;
    // a white rim tells it from what is dark behind it
    const rim = new THREE.Mesh(geometry, this.rim);
    rim.scale.set(1.35, 1.02, 1.35);
    rim.renderOrder = 9;
    mesh.add(rim);
    return mesh;
  }

  set(origin, vector, opacity = 1) {
    const length = vector.length(), head = 8 * this.radius;
    this.object.visible = length > 1e-3 * head;
    this.tip.copy(origin).add(vector);
    if (!this.object.visible) return;
    this.material.opacity = this.rim.opacity = opacity;
    this.object.position.copy(origin);
    this.object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), vector.clone().normalize());
    const shrink = Math.min(1, length / (1.5 * head));
    const end = length - 0.5 * head * shrink, start = this.bothWays ? -end : 0;
    this.shaft.scale.set(shrink, Math.max(end - start, 1e-9), shrink);
    this.shaft.position.y = 0.5 * (start + end);
    this.heads.forEach((mesh, k) => {
      mesh.scale.setScalar(shrink);
      mesh.position.y = k ? -end : end;
    });
    if (this.ring) this.ring.position.y = 0.5 * length;
  }
}

// The sign of a right angle between two directions, drawn over everything else.
class RightAngle {
  constructor(color, radius, size) {
    this.size = size;
    this.object = new THREE.Group();
    const material = new THREE.MeshBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true });
    this.edges = [0, 1].map(() => {
      const edge = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, size, 10), material);
      edge.renderOrder = 11;
      this.object.add(edge);
      return edge;
    });
  }

  set(origin, first, second) {
    const ends = [first, second].map((vector) => vector.clone().normalize());
    this.object.position.copy(origin);
    this.edges.forEach((edge, k) => {
      const [along, beside] = [ends[k], ends[1 - k]];
      edge.position.copy(along).multiplyScalar(0.5).add(beside).multiplyScalar(this.size);
      edge.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
    });
  }
}

// A spring: a helix along z that stretches, or one that turns a needle against a fixed one.
class Coil {
  constructor(coil, length, factor) {
    this.slides = coil.slides;
    this.length = length;
    this.factor = factor;
    this.object = new THREE.Group();
    this.object.applyMatrix4(matrix(coil.placement));
    const material = new THREE.MeshPhongMaterial({ color: ink("ink"), shininess: 60 });
    const turns = this.slides ? 7 : 4, radius = this.slides ? 0.13 * length : 0.3 * length;
    const height = this.slides ? 1 : 0.3 * length;
    const helix = [];
    for (let k = 0; k <= 24 * turns; k++) {
      const angle = (k / 24) * 2 * Math.PI;
      helix.push(new THREE.Vector3(radius * Math.cos(angle), radius * Math.sin(angle), height * (k / (24 * turns) - (this.slides ? 0 : 0.5))));
    }
    const wire = 0.022 * length;
    // a stretching coil is built at its length, then scaled along z
    if (this.slides) helix.forEach((point) => { point.z *= length; });
    const mesh = new THREE.Mesh(new THREE.TubeGeometry(new THREE.CatmullRomCurve3(helix), 24 * turns, wire, 7), material);
    this.moving = new THREE.Group();
    this.moving.add(mesh);
    if (!this.slides) {
      const needle = (color) => new THREE.Mesh(
        new THREE.CylinderGeometry(wire, wire, 0.75 * length, 8).translate(0, 0.375 * length, 0),
        new THREE.MeshPhongMaterial({ color }));
      this.moving.add(needle(ink("ink")));
      this.object.add(needle(ink("path")));
    }
    this.object.add(this.moving);
    this.set(0);
  }

  set(deflection) {
    const shown = this.factor * deflection;
    if (this.slides) {
      this.moving.position.z = -this.length;
      this.moving.scale.z = Math.max(0.1, 1 + shown / this.length);
    } else {
      this.moving.rotation.z = shown;
    }
  }
}

// A spring between two points: a helix with straight ends that stretches from one to the other.
class LineSpring {
  constructor(length) {
    this.object = new THREE.Group();
    const turns = 9, radius = 0.022 * length, wire = 0.0035 * length;
    const line = [[0, 0, 0], [0, 0, 0.1]];
    for (let k = 0; k <= 16 * turns; k++) {
      const angle = (k / 16) * 2 * Math.PI, wide = radius * Math.min(1, k / 8, (16 * turns - k) / 8);
      line.push([wide * Math.cos(angle), wide * Math.sin(angle), 0.2 + (0.6 * k) / (16 * turns)]);
    }
    line.push([0, 0, 0.9], [0, 0, 1]);
    // built at the length of the picture, then scaled along z
    this.length = length;
    const curve = new THREE.CatmullRomCurve3(line.map(([x, y, z]) => new THREE.Vector3(x, y, length * z)));
    const material = new THREE.MeshPhongMaterial({ color: ink("ink"), shininess: 60 });
    this.object.add(new THREE.Mesh(new THREE.TubeGeometry(curve, 24 * turns, wire, 7), material));
  }

  set(start, end) {
    const along = end.clone().sub(start), distance = along.length();
    this.object.visible = distance > 1e-9 * this.length; // where its ends meet it has no direction
    if (!this.object.visible) return;
    this.object.position.copy(start);
    this.object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.normalize());
    this.object.scale.z = distance / this.length;
  }
}

// The colour of a motor by its share of the largest torque: from idle to busy, and the alarm beyond it.
const [IDLE, BUSY, ALARM] = ["idle", "busy", "alarm"].map((name) => new THREE.Color(ink(name)));
function heat(share) {
  return share > 1.001 ? ALARM : IDLE.clone().lerp(BUSY, Math.max(0, share));
}
