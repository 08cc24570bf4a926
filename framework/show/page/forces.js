// What the motors can give: their forces all together, a polygon or a parallelepiped, and the line of each.

// All sums of plus or minus some vectors of a plane: a polygon, that is the forces which motors can give, as
// far as it lies within a disc. Flat it is a line.
class Polygon {
  constructor(color, radius, count) {
    this.radius = radius;
    this.rim = 48;
    const corners = 2 * count + this.rim;
    this.place = new THREE.BufferAttribute(new Float32Array(3 * corners), 3);
    this.object = new THREE.Group();
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", this.place);
    geometry.setIndex(Array.from({ length: corners - 2 }, (_, k) => [0, k + 1, k + 2]).flat());
    const fill = new THREE.MeshBasicMaterial({ color, opacity: 0.22, transparent: true, side: THREE.DoubleSide, depthWrite: false });
    const inside = new THREE.Mesh(geometry, fill);
    inside.frustumCulled = false;
    this.object.add(inside);
    const ink = new THREE.MeshBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true });
    this.edges = Array.from({ length: 2 * count }, () => {
      const edge = new THREE.Mesh(new THREE.CylinderGeometry(0.006 * radius, 0.006 * radius, 1, 8), ink);
      edge.renderOrder = 7;
      this.object.add(edge);
      return edge;
    });
  }

  // About `center`, seen from `origin`, the centre of the disc.
  set(origin, center, sides) {
    const [across, along] = this.plane || (this.plane = axesOf(sides));
    const flat = sides.map((side) => [side.dot(across), side.dot(along)]).map(([x, y]) => (y < 0 || (y === 0 && x < 0) ? [-x, -y] : [x, y]));
    flat.sort((a, b) => Math.atan2(a[1], a[0]) - Math.atan2(b[1], b[0]));
    let at = [center.dot(across), center.dot(along)].map((value, i) => value - flat.reduce((sum, side) => sum + side[i], 0));
    const half = [];
    for (const turn of [1, -1]) for (const [x, y] of flat) { half.push(at); at = [at[0] + 2 * turn * x, at[1] + 2 * turn * y]; }
    const seen = withinDisc(half, this.radius, this.rim);
    const placed = ([x, y]) => origin.clone().addScaledVector(across, x).addScaledVector(along, y);
    for (let k = 0; k < this.place.count; k++) {
      const { x, y, z } = seen.length ? placed(seen[Math.min(k, seen.length - 1)]) : origin;
      this.place.setXYZ(k, x, y, z);
    }
    // its own sides, not the rim of the disc
    const sideways = seen.map((corner, k) => [corner, seen[(k + 1) % seen.length]]).filter(([a, b]) =>
      Math.hypot(a[0] + b[0], a[1] + b[1]) < 1.99 * this.radius && Math.hypot(a[0] - b[0], a[1] - b[1]) > 1e-6 * this.radius);
    this.edges.forEach((edge, k) => {
      edge.visible = k < sideways.length;
      if (!edge.visible) return;
      const [from, to] = sideways[k].map(placed), way = to.clone().sub(from);
      edge.position.copy(from).addScaledVector(way, 0.5);
      edge.scale.y = way.length();
      edge.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
    });
    this.place.needsUpdate = true;
    this.corners = half;
  }
}

// Two directions at right angles that span what all vectors span.
function axesOf(vectors) {
  const across = vectors[0].clone().normalize();
  const rests = vectors.map((vector) => vector.clone().addScaledVector(across, -vector.dot(across)));
  return [across, rests.reduce((best, rest) => (rest.length() > best.length() ? rest : best)).normalize()];
}

// A convex polygon, counter-clockwise, as far as it lies within a regular one of `rim` corners about the origin.
function withinDisc(corners, radius, rim) {
  let left = corners;
  for (let k = 0; k < rim && left.length; k++) {
    const angle = (2 * Math.PI * k) / rim, out = ([x, y]) => x * Math.cos(angle) + y * Math.sin(angle) - radius;
    left = left.flatMap((corner, i) => {
      const before = left[(i + left.length - 1) % left.length], a = out(before), b = out(corner);
      const cut = a * b < 0 ? [[before[0] + (a / (a - b)) * (corner[0] - before[0]), before[1] + (a / (a - b)) * (corner[1] - before[1])]] : [];
      return b <= 0 ? [...cut, corner] : cut;
    });
  }
  return left;
}

// All sums of plus or minus three vectors: a parallelepiped. Where they lie in one plane it is flat.
class Parallelepiped {
  constructor(color) {
    const box = new THREE.BoxGeometry(2, 2, 2);
    const fill = new THREE.MeshBasicMaterial({ color, opacity: 0.16, transparent: true, side: THREE.DoubleSide, depthWrite: false });
    const ink = new THREE.LineBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true });
    this.object = new THREE.Group();
    this.object.add(new THREE.Mesh(box, fill), new THREE.LineSegments(new THREE.EdgesGeometry(box), ink));
    for (const part of this.object.children) part.frustumCulled = false;
    this.object.matrixAutoUpdate = false;
  }

  set(origin, center, sides) {
    this.object.matrix.makeBasis(...sides).setPosition(origin.clone().add(center));
    this.object.matrixWorldNeedsUpdate = true;
    this.corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) =>
      sides.reduce((sum, side, i) => sum.addScaledVector(side, k & (1 << i) ? 1 : -1), center.clone()).toArray());
  }
}

// Thin lines through bodies, `length` to either side: along them the motors' forces act.
class Lines {
  constructor(color, length, count) {
    this.length = length;
    this.object = new THREE.Group();
    this.material = new THREE.MeshBasicMaterial({ color, depthTest: false, depthWrite: false, transparent: true });
    this.rods = Array.from({ length: count }, () => {
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(0.005 * length, 0.005 * length, 2 * length, 8), this.material);
      rod.renderOrder = 8;
      this.object.add(rod);
      return rod;
    });
  }

  // `lines` are [point, direction]; they fade in with `opacity`, up to 1.
  set(lines, opacity) {
    this.object.visible = opacity > 0;
    this.material.opacity = opacity;
    lines.forEach(([point, way], k) => {
      this.rods[k].position.copy(point);
      this.rods[k].quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.clone().normalize());
    });
  }
}
