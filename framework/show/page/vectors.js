// t_s and W_p at the platform, and wrenches of the world where they act: arrows for forces and shifts, ringed
// ones for moments and turns; and what the motors can give: all their forces, and near the locus the line of each.

const RIGHT = Math.sin((0.5 * Math.PI) / 180); // within half a degree

// Entry k of points or vectors, row after row, and of the way to the next one.
function vectorAt(values, k, part) {
  return new THREE.Vector3(...[0, 1, 2].map((i) => {
    const a = values[3 * k + i];
    return part > 0 ? a + part * (values[3 * k + 3 + i] - a) : a;
  }));
}

// Of all parallelepipeds with these edges, three each, the farthest corner from the middle.
function farthestCorner(sides) {
  let farthest = 1e-12;
  for (let k = 0; k + 2 < sides.length; k += 3) for (const [b, c] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
    farthest = Math.max(farthest, sides[k].clone().addScaledVector(sides[k + 1], b).addScaledVector(sides[k + 2], c).length());
  }
  return farthest;
}

class Vectors {
  constructor(view, content) {
    const L = content.length;
    this.length = L;
    this.turning = content.turning;
    this.values = {};
    this.arrows = {};
    this.origins = {}; // where each begins
    // Shifts and turns of one robot would lie on one another: turns stand beside them, t_s on the left.
    const isMixed = this.turning.some(Boolean) && !this.turning.every(Boolean);
    const ahead = new THREE.Vector3(...content.view.from), up = Math.abs(ahead.z) > 0.99 * ahead.length() ? new THREE.Vector3(0, 1, 0) : new THREE.Vector3(0, 0, 1);
    this.beside = up.cross(ahead).normalize().multiplyScalar(isMixed ? 0.28 * L : 0);
    this.pair(view, "t_s", content.t_s, "twist", symbols("t_s"), { bothWays: true });
    this.pair(view, "W_p", content.W_p, "wrench", symbols("W_p"));
    content.world.forEach((wrench, k) => this.pair(view, `world ${k}`, wrench, "world", `on ${plain(wrench.frame)}`));
    if (content.polytope) {
      const { center, sides, count, flat } = content.polytope;
      this.given = { center: decoded(center), sides: decoded(sides), count };
      this.polytope = flat ? new Polygon(ink("given"), 0.5 * L, count) : new Parallelepiped(ink("given"));
      // a polygon is to the scale of W_p, and fades out where it is larger than the picture; a parallelepiped is drawn whole, to its own
      this.given.scale = flat ? (0.45 * L) / (this.values.W_p.largest[0] || 1) : (0.35 * L) / farthestCorner(points(this.given.sides));
      view.add(this.polytope.object);
    }
    if (content.lines) {
      const { place, way, count } = content.lines;
      this.lines = { place: decoded(place), way: decoded(way), count, drawn: new Lines(ink("given"), 0.6 * L, count) };
      view.add(this.lines.drawn.object);
    }
    this.corner = new RightAngle(ink("ink"), 0.004 * L, 0.06 * L);
    view.add(this.corner.object);
  }

  // The arrows of a twist or a wrench, in the colour of that name, and their label.
  pair(view, name, { linear, angular, largest, origin }, color, said, { bothWays = false } = {}) {
    const L = this.length;
    this.values[name] = { linear: decoded(linear), angular: decoded(angular), largest, origin: origin && decoded(origin) };
    const pair = this.arrows[name] = {
      linear: new Arrow(ink(color), 0.007 * L, { bothWays }),
      angular: new Arrow(ink(color), 0.005 * L, { bothWays, turning: true }),
    };
    for (const arrow of Object.values(pair)) view.add(arrow.object);
    pair.leader = view.add(new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: ink(color), depthTest: false, transparent: true })));
    view.label(said, `var(--${color})`, () => (pair.linear.object.visible ? pair.linear.tip : pair.angular.object.visible ? pair.angular.tip : null), (tip) => {
      // beyond the head of the arrow
      const from = view.onScreen(this.origins[name]), across = tip.x - from.x, down = tip.y - from.y, size = Math.hypot(across, down) || 1;
      return [(13 * across) / size, (13 * down) / size];
    });
  }

  at(name, part, k, way) {
    return vectorAt(this.values[name][part], k, way);
  }

  // Frame k and the way to the next; `near` from 0 to 1 is how near the locus is, `crossing` whether a
  // proven motion is just crossing it.
  set(origin, k, part, { near, crossing }) {
    this.origin = origin;
    for (const name of Object.keys(this.arrows)) {
      const { largest, origin: own } = this.values[name], from = own ? vectorAt(own, k, part) : origin;
      this.origins[name] = from;
      const opacity = name === "t_s" ? 0.25 + 0.75 * near : 1;
      const scale = (size) => (size > 1e-9 * (largest[0] + largest[1]) ? (name === "t_s" ? 0.32 : 0.45) * this.length / size : 0);
      this.arrows[name].linear.set(from, this.at(name, "linear", k, part).multiplyScalar(scale(largest[0])), opacity);
      const { angular, leader } = this.arrows[name], beside = from.clone().addScaledVector(this.beside, name === "t_s" ? -1 : 1);
      angular.set(beside, this.at(name, "angular", k, part).multiplyScalar(0.8 * scale(largest[1])), opacity);
      leader.visible = angular.object.visible && beside.distanceTo(from) > 0;
      leader.material.opacity = 0.6 * opacity;
      leader.geometry.setFromPoints([from, beside]);
    }
    const entry = (values, count, m) => { // of motor m; between two frames as all vectors are
      const at = vectorAt(values, count * k + m, 0);
      return part > 0 ? at.lerp(vectorAt(values, count * (k + 1) + m, 0), part) : at;
    };
    if (this.polytope) {
      const { center, sides, count, scale } = this.given;
      this.polytope.set(origin, vectorAt(center, k, part).multiplyScalar(scale), Array.from({ length: count }, (_, m) => entry(sides, count, m).multiplyScalar(scale)));
    }
    if (this.lines) {
      const { place, way, count, drawn } = this.lines;
      drawn.set(Array.from({ length: count }, (_, m) => [entry(place, count, m).add(origin), entry(way, count, m)]), Math.max(0, 4 * near - 3));
    }
    this.square(crossing);
  }

  // The sign of the right angle: on a platform that only shifts, or only turns, where the angle is one.
  square(crossing) {
    const kind = !this.turning.some(Boolean) ? "linear" : this.turning.every(Boolean) ? "angular" : null;
    this.corner.object.visible = false;
    if (!crossing || !kind) return;
    const [twist, wrench] = ["t_s", "W_p"].map((name) => this.arrows[name][kind].tip.clone().sub(this.origin));
    const least = Math.min(twist.length(), wrench.length());
    if (least < 0.03 * this.length || Math.abs(twist.dot(wrench)) > RIGHT * twist.length() * wrench.length()) return;
    this.corner.object.visible = true;
    this.corner.set(this.origin, twist, wrench);
  }

  // Both ends of all arrows that are seen, and the corners of a parallelepiped.
  get ends() {
    const corners = this.polytope instanceof Parallelepiped ? this.polytope.corners.map((corner) => new THREE.Vector3(...corner).add(this.origin)) : [];
    return corners.concat(Object.values(this.arrows).flatMap(({ linear, angular }) => [linear, angular]).filter(({ object }) => object.visible).flatMap(({ tip, object, bothWays }) =>
      (bothWays ? [tip.clone(), object.position.clone().multiplyScalar(2).sub(tip)] : [tip.clone()])));
  }
}
