// A map of a robot: colours on a canvas, curves on top, and the values of the pose under the pointer.
const [rows, columns] = data.shape; // first axis, to the right; second axis, upwards
const values = Object.fromEntries(data.quantities.map((one) => [one.key, decoded(one.values)]));
const reasons = decoded(data.reason, Uint8Array), modes = decoded(data.assembly, Uint8Array);
const loads = data.load ? decoded(data.load, Uint8Array) : null; // 0: the load is carried
const canvas = byId("map"), select = byId("quantity");
const MARGIN = { left: 58, right: 10, top: 8, bottom: 40 };
let chosen = data.quantities[0], cursor = null, picture = null;

const share = (one, value) => {
  const [low, high] = one.range;
  const way = one.decades ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.min(Math.max(way, 0), 1);
};
const colour = (one, value) => one.colours[Math.round(share(one, value) * (one.colours.length - 1))];
const short = (value) => rounded(value, 4);

// A quantity as a picture, a pixel for each pose.
function pictureOf(one) {
  const drawn = document.createElement("canvas");
  drawn.width = rows;
  drawn.height = columns;
  const pen = drawn.getContext("2d"), image = pen.createImageData(rows, columns);
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const value = values[one.key][i * columns + j];
      const lost = one.loaded && !reasons[i * columns + j] ? data.not_carried : data.unreached;
      const [r, g, b] = Number.isNaN(value) ? lost : colour(one, value);
      image.data.set([r, g, b, 255], 4 * ((columns - 1 - j) * rows + i));
    }
  }
  pen.putImageData(image, 0, 0);
  return drawn;
}

function choose(one) {
  chosen = one;
  select.value = one.key;
  byId("reading").textContent = one.reading;
  picture = pictureOf(one);
  for (const button of byId("others").children) button.setAttribute("aria-pressed", String(button.dataset.key === one.key));
  paintScale();
  draw();
  tell();
}

function paintScale() {
  const strip = byId("scale"), count = chosen.colours.length;
  strip.width = count;
  const pen = strip.getContext("2d");
  chosen.colours.forEach(([r, g, b], k) => { pen.fillStyle = `rgb(${r},${g},${b})`; pen.fillRect(k, 0, 1, 14); });
  byId("ticks").replaceChildren(...scaleTicks(chosen.range, chosen.decades).map((value) => {
    const label = document.createElement("span");
    label.textContent = short(value);
    label.style.left = `${100 * share(chosen, value)}%`;
    return label;
  }));
}

// Powers of ten where the scale has decades.
function scaleTicks([low, high], decades) {
  if (!decades) return ticks(low, high);
  const found = [];
  for (let k = Math.ceil(Math.log10(low) - 1e-9); k <= Math.log10(high) + 1e-9; k++) found.push(10 ** k);
  return found.length > 1 ? found : [low, high];
}

// Where the map is on its canvas: as large as the width, or what the window leaves of its height, lets it be.
function frame() {
  const inside = canvas.clientWidth - MARGIN.left - MARGIN.right, [[x0, x1], [y0, y1]] = data.edges;
  const aspect = data.to_scale ? (y1 - y0) / (x1 - x0) : 0.8, high = Math.min(inside * aspect, room());
  const across = data.to_scale ? high / aspect : inside;
  return { left: MARGIN.left, top: MARGIN.top, across, high, x0, x1, y0, y1,
    x: (value) => MARGIN.left + (value - x0) / (x1 - x0) * across,
    y: (value) => MARGIN.top + (y1 - value) / (y1 - y0) * high };
}

function room() {
  const around = canvas.getBoundingClientRect().top + scrollY + MARGIN.top + MARGIN.bottom;
  const below = byId("legend").getBoundingClientRect().bottom - canvas.getBoundingClientRect().bottom + 26;
  return isOnPaper() ? 400 : Math.max(innerHeight - around - below, 300);
}

function draw() {
  if (data.to_scale) { // a card no wider than its map
    const [[x0, x1], [y0, y1]] = data.edges;
    canvas.parentNode.style.maxWidth = `${Math.max(420, room() * (x1 - x0) / (y1 - y0) + MARGIN.left + MARGIN.right + 26)}px`;
  }
  const f = frame(), scale = window.devicePixelRatio || 1;
  canvas.style.height = `${f.high + MARGIN.top + MARGIN.bottom}px`;
  canvas.width = canvas.clientWidth * scale;
  canvas.height = (f.high + MARGIN.top + MARGIN.bottom) * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(picture, f.left, f.top, f.across, f.high);
  pen.strokeStyle = ink("soft");
  pen.lineWidth = 1;
  pen.strokeRect(f.left + 0.5, f.top + 0.5, f.across - 1, f.high - 1);
  pen.fillStyle = ink("soft");
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const value of ticks(f.x0, f.x1)) {
    pen.fillRect(f.x(value), f.top + f.high, 1, 4);
    pen.fillText(short(value), f.x(value), f.top + f.high + 17);
  }
  pen.fillText(data.axes[0], f.left + f.across / 2, f.top + f.high + 34);
  pen.textAlign = "right";
  for (const value of ticks(f.y0, f.y1)) {
    pen.fillRect(f.left - 4, f.y(value), 4, 1);
    pen.fillText(short(value), f.left - 7, f.y(value) + 4);
  }
  pen.save();
  pen.translate(12, f.top + f.high / 2);
  pen.rotate(-Math.PI / 2);
  pen.textAlign = "center";
  pen.fillText(data.axes[1], 0, 0);
  pen.restore();
  pen.save();
  pen.beginPath();
  pen.rect(f.left, f.top, f.across, f.high);
  pen.clip();
  for (const curve of data.curves) {
    for (const [style, width] of [[ink("paper"), curve.width + 2], [curve.colour, curve.width]]) {
      pen.beginPath();
      curve.points.forEach(([x, y], k) => (k ? pen.lineTo : pen.moveTo).call(pen, f.x(x), f.y(y)));
      pen.strokeStyle = style;
      pen.lineWidth = width;
      pen.setLineDash(style === ink("paper") ? [] : curve.dash);
      pen.stroke();
    }
  }
  pen.setLineDash([]);
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillStyle = ink("locus");
  for (const [x, y] of data.crosses) pen.fillText("×", f.x(x), f.y(y) + 4);
  for (const [x, y] of data.marks) {
    pen.beginPath();
    pen.arc(f.x(x), f.y(y), 4, 0, 2 * Math.PI);
    pen.fillStyle = ink("twist");
    pen.fill();
    pen.strokeStyle = ink("paper");
    pen.lineWidth = 1.5;
    pen.stroke();
  }
  if (cursor) {
    const [i, j] = cursor;
    const x = f.left + (i + 0.5) / rows * f.across, y = f.top + (1 - (j + 0.5) / columns) * f.high;
    for (const [style, width] of [[ink("paper"), 3], [ink("twist"), 1]]) {
      pen.strokeStyle = style;
      pen.lineWidth = width;
      pen.beginPath();
      pen.moveTo(f.left, y); pen.lineTo(f.left + f.across, y);
      pen.moveTo(x, f.top); pen.lineTo(x, f.top + f.high);
      pen.stroke();
    }
  }
  pen.restore();
}

function tell() {
  const table = byId("values");
  const rowsOf = [];
  if (cursor) {
    const [i, j] = cursor, at = i * columns + j;
    const pose = [data.spans[0][i], data.spans[1][j]];
    rowsOf.push([data.axes[0], short(pose[0])], [data.axes[1], short(pose[1])]);
    if (reasons[at]) rowsOf.push(["pose", data.reasons[reasons[at]]]);
    else {
      for (const one of data.quantities) {
        const text = one.loaded && loads[at] ? data.loads[loads[at]] : short(values[one.key][at]);
        rowsOf.push([`${one.name} [${one.unit}]`, text, one === chosen]);
      }
      if (data.has_sides) rowsOf.push(["side of the locus (sign of the assembly mode)", modes[at] === 1 ? "+" : modes[at] === 255 ? "−" : "on it"]);
    }
  }
  table.replaceChildren(...rowsOf.map(([name, value, shown]) => {
    const row = document.createElement("tr"), head = document.createElement("th"), cell = document.createElement("td");
    head.textContent = name;
    cell.textContent = value;
    if (shown) row.className = "shown";
    row.append(head, cell);
    return row;
  }));
  byId("spoken").textContent = rowsOf.map(([name, value]) => `${name} ${value}`).join(", ");
}

function point(event) {
  const f = frame(), box = canvas.getBoundingClientRect();
  const i = Math.floor((event.clientX - box.left - f.left) / f.across * rows);
  const j = Math.floor((1 - (event.clientY - box.top - f.top) / f.high) * columns);
  move(i >= 0 && i < rows && j >= 0 && j < columns ? [i, j] : null);
}

function move(to) {
  cursor = to;
  draw();
  tell();
}

canvas.addEventListener("pointermove", point);
canvas.addEventListener("pointerdown", point);
canvas.addEventListener("keydown", (event) => {
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (!way) return;
  event.preventDefault();
  const [i, j] = cursor || [rows >> 1, columns >> 1], step = event.shiftKey ? 10 : 1;
  move([Math.min(Math.max(i + step * way[0], 0), rows - 1), Math.min(Math.max(j + step * way[1], 0), columns - 1)]);
});
for (const one of data.quantities) {
  const option = document.createElement("option");
  option.value = one.key;
  option.textContent = `${one.name} [${one.unit}]`;
  select.append(option);
}
select.addEventListener("change", () => choose(data.quantities.find((one) => one.key === select.value)));
// all of them in small, where the screen has room beside the map
byId("others_card").hidden = data.quantities.length < 2;
for (const one of data.quantities) {
  const button = document.createElement("button"), small = pictureOf(one), [[x0, x1], [y0, y1]] = data.edges;
  button.type = "button";
  button.dataset.key = one.key;
  small.style.aspectRatio = data.to_scale ? (x1 - x0) / (y1 - y0) : 1.25;
  small.setAttribute("aria-hidden", "true");
  button.append(small, `${one.name} [${one.unit}]`);
  button.addEventListener("click", () => choose(one));
  byId("others").append(button);
}
byId("legend").innerHTML = data.legend.map(([name, style, area]) =>
  `<div><span class="key${area ? " area" : ""}" style="background:${style}"></span>${plain(name)}</div>`).join("");
// at first where the dot is
const nearest = ([low, high], count, value) => Math.floor((value - low) / (high - low) * count);
const start = data.marks.map(([x, y]) => [nearest(data.edges[0], rows, x), nearest(data.edges[1], columns, y)])
  .filter(([i, j]) => i >= 0 && i < rows && j >= 0 && j < columns);
choose(chosen);
move(start[0] || null);
onNewWidth(draw);
window.crossing = { map: { frame, values, move } };
