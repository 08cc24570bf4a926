// What the motors can give: their forces all together, a polygon or a parallelepiped, and the line of each.

// All sums of plus or minus some vectors of a plane: a polygon, that is the forces which motors can give. It fades
// out towards a circle, where the picture ends and not what the motors give. Flat it is a line.
class Polygon {
  constructor(color, radius, count) {
    this.radius = radius;
    this.count = 2 * count; // of corners, and of edges
    this.object = new THREE.Group();
    const look = { color, alphaMap: fading(), transparent: true, side: THREE.DoubleSide, depthWrite: false };
    this.inside = this.surface(this.count, Array.from({ length: this.count - 2 }, (_, k) => [0, k + 1, k + 2]).flat(),
      new THREE.MeshBasicMaterial({ ...look, opacity: 0.3 }));
    this.edges = this.surface(4 * this.count, Array.from({ length: this.count }, (_, k) => [0, 1, 2, 0, 2, 3].map((corner) => 4 * k + corner)).flat(),
      new THREE.MeshBasicMaterial({ ...look, depthTest: false }), 7);
  }

  surface(count, faces, material, order = 0) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(2 * count), 2));
    geometry.setIndex(faces);
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    mesh.renderOrder = order;
    this.object.add(mesh);
    return geometry.attributes;
  }

  // About `center`, seen from `origin`, the centre of the circle.
  set(origin, center, sides) {
    const [across, along] = this.plane || (this.plane = axesOf(sides));
    const flat = sides.map((side) => [side.dot(across), side.dot(along)]).map(([x, y]) => (y < 0 || (y === 0 && x < 0) ? [-x, -y] : [x, y]));
    flat.sort((a, b) => Math.atan2(a[1], a[0]) - Math.atan2(b[1], b[0]));
    let at = [center.dot(across), center.dot(along)].map((value, i) => value - flat.reduce((sum, side) => sum + side[i], 0));
    const corners = [];
    for (const turn of [1, -1]) for (const [x, y] of flat) { corners.push(at); at = [at[0] + 2 * turn * x, at[1] + 2 * turn * y]; }
    const put = ({ position, uv }, places) => {
      places.forEach(([x, y], k) => {
        const { x: a, y: b, z: c } = origin.clone().addScaledVector(across, x).addScaledVector(along, y);
        position.setXYZ(k, a, b, c);
        uv.setXY(k, 0.5 + (0.5 * x) / this.radius, 0.5 + (0.5 * y) / this.radius);
      });
      position.needsUpdate = uv.needsUpdate = true;
    };
    put(this.inside, corners);
    put(this.edges, corners.flatMap(([x, y], k) => { // a strip along each edge
      const [u, v] = corners[(k + 1) % this.count], wide = (0.006 * this.radius) / (Math.hypot(u - x, v - y) || 1), [a, b] = [wide * (y - v), wide * (u - x)];
      return [[x + a, y + b], [u + a, v + b], [u - a, v - b], [x - a, y - b]];
    }));
    this.corners = corners;
  }
}

// Opaque in the middle of a square, and nothing of it left at the circle that fills it.
function fading(size = 128) {
  const canvas = Object.assign(document.createElement("canvas"), { width: size, height: size }), pen = canvas.getContext("2d");
  const shade = pen.createRadialGradient(size / 2, size / 2, 0.25 * size, size / 2, size / 2, 0.48 * size);
  shade.addColorStop(0, "white");
  shade.addColorStop(1, "black");
  pen.fillStyle = shade;
  pen.fillRect(0, 0, size, size);
  return new THREE.CanvasTexture(canvas);
}

// Two directions at right angles that span what all vectors span.
function axesOf(vectors) {
  const across = vectors[0].clone().normalize();
  const rests = vectors.map((vector) => vector.clone().addScaledVector(across, -vector.dot(across)));
  return [across, rests.reduce((best, rest) => (rest.length() > best.length() ? rest : best)).normalize()];
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
