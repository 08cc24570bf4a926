// A map of a robot: colours on a canvas, curves on top, and the values of the pose under the pointer.
const doc = JSON.parse(document.getElementById("document").textContent);
const numbers = (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float32Array(bytes.buffer);
};
const [rows, columns] = doc.shape; // first axis, to the right; second axis, upwards
const values = Object.fromEntries(doc.quantities.map((one) => [one.key, numbers(one.values)]));
const codes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const reasons = codes(doc.reason), modes = codes(doc.assembly);
const loads = doc.load ? codes(doc.load) : null; // 0: the load is carried
const canvas = document.getElementById("map"), select = document.getElementById("quantity");
const MARGIN = { left: 58, right: 10, top: 8, bottom: 40 };
let chosen = doc.quantities[0], cursor = null, picture = null;

const share = (one, value) => {
  const [low, high] = one.range;
  const way = one.decades ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.min(Math.max(way, 0), 1);
};
const colour = (one, value) => one.colours[Math.round(share(one, value) * (one.colours.length - 1))];
const short = (value) => {
  if (!Number.isFinite(value)) return "∞";
  const size = Math.abs(value);
  if (value === 0) return "0";
  if (size < 1e5 && size >= 1e-3) return String(Number(value.toPrecision(4))).replace("-", "−");
  const [digits, power] = value.toExponential(2).split("e");
  const raised = [...power.replace("+", "")].map((sign) => (sign === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(sign)])).join("");
  return `${Number(digits)}·10${raised}`.replace("-", "−");
};

function paint() {
  document.getElementById("reading").textContent = chosen.reading;
  picture = document.createElement("canvas");
  picture.width = rows;
  picture.height = columns;
  const pen = picture.getContext("2d"), image = pen.createImageData(rows, columns);
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const value = values[chosen.key][i * columns + j];
      const lost = chosen.loaded && !reasons[i * columns + j] ? doc.not_carried : doc.unreached;
      const [r, g, b] = Number.isNaN(value) ? lost : colour(chosen, value);
      image.data.set([r, g, b, 255], 4 * ((columns - 1 - j) * rows + i));
    }
  }
  pen.putImageData(image, 0, 0);
  paintScale();
  draw();
}

function paintScale() {
  const strip = document.getElementById("scale"), count = chosen.colours.length;
  strip.width = count;
  const pen = strip.getContext("2d");
  chosen.colours.forEach(([r, g, b], k) => { pen.fillStyle = `rgb(${r},${g},${b})`; pen.fillRect(k, 0, 1, 14); });
  const ticks = document.getElementById("ticks");
  ticks.replaceChildren(...ticksOf(...chosen.range, chosen.decades, 5).map((value) => {
    const label = document.createElement("span");
    label.textContent = short(value);
    label.style.left = `${100 * share(chosen, value)}%`;
    return label;
  }));
}

function ticksOf(low, high, decades, count) {
  if (decades) {
    const found = [];
    for (let k = Math.ceil(Math.log10(low) - 1e-9); k <= Math.log10(high) + 1e-9; k++) found.push(10 ** k);
    return found.length > 1 ? found : [low, high];
  }
  const rough = (high - low) / count, size = 10 ** Math.floor(Math.log10(rough));
  const step = size * [1, 2, 5, 10].find((factor) => factor * size >= rough), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

function frame() {
  const wide = canvas.clientWidth, inside = wide - MARGIN.left - MARGIN.right;
  const [[x0, x1], [y0, y1]] = doc.edges;
  const aspect = doc.to_scale ? (y1 - y0) / (x1 - x0) : 0.8;
  const high = Math.min(inside * aspect, Math.max(0.72 * window.innerHeight, 240));
  const across = doc.to_scale ? Math.min(inside, high / aspect) : inside;
  return { left: MARGIN.left, top: MARGIN.top, across, high, x0, x1, y0, y1,
    x: (value) => MARGIN.left + (value - x0) / (x1 - x0) * across,
    y: (value) => MARGIN.top + (y1 - value) / (y1 - y0) * high };
}

function draw() {
  const f = frame(), scale = window.devicePixelRatio || 1;
  canvas.style.height = `${f.high + MARGIN.top + MARGIN.bottom}px`;
  canvas.width = canvas.clientWidth * scale;
  canvas.height = (f.high + MARGIN.top + MARGIN.bottom) * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(picture, f.left, f.top, f.across, f.high);
  pen.strokeStyle = "#5c6876";
  pen.lineWidth = 1;
  pen.strokeRect(f.left + 0.5, f.top + 0.5, f.across - 1, f.high - 1);
  pen.fillStyle = "#5c6876";
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  for (const value of ticksOf(f.x0, f.x1, false, Math.max(2, f.across / 90))) {
    pen.fillRect(f.x(value), f.top + f.high, 1, 4);
    pen.fillText(short(Math.abs(value) < 1e-12 ? 0 : value), f.x(value), f.top + f.high + 17);
  }
  pen.fillText(doc.axes[0], f.left + f.across / 2, f.top + f.high + 34);
  pen.textAlign = "right";
  for (const value of ticksOf(f.y0, f.y1, false, Math.max(2, f.high / 70))) {
    pen.fillRect(f.left - 4, f.y(value), 4, 1);
    pen.fillText(short(Math.abs(value) < 1e-12 ? 0 : value), f.left - 7, f.y(value) + 4);
  }
  pen.save();
  pen.translate(12, f.top + f.high / 2);
  pen.rotate(-Math.PI / 2);
  pen.textAlign = "center";
  pen.fillText(doc.axes[1], 0, 0);
  pen.restore();
  pen.save();
  pen.beginPath();
  pen.rect(f.left, f.top, f.across, f.high);
  pen.clip();
  for (const curve of doc.curves) {
    for (const [style, width] of [["#ffffff", curve.width + 2], [curve.colour, curve.width]]) {
      pen.beginPath();
      curve.points.forEach(([x, y], k) => (k ? pen.lineTo : pen.moveTo).call(pen, f.x(x), f.y(y)));
      pen.strokeStyle = style;
      pen.lineWidth = width;
      pen.setLineDash(style === "#ffffff" ? [] : curve.dash);
      pen.stroke();
    }
  }
  pen.setLineDash([]);
  pen.font = "13px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.fillStyle = "#7b3fa6";
  for (const [x, y] of doc.crosses) pen.fillText("×", f.x(x), f.y(y) + 4);
  for (const [x, y] of doc.marks) {
    pen.beginPath();
    pen.arc(f.x(x), f.y(y), 4, 0, 2 * Math.PI);
    pen.fillStyle = "#14181d";
    pen.fill();
    pen.strokeStyle = "#ffffff";
    pen.lineWidth = 1.5;
    pen.stroke();
  }
  if (cursor) {
    const [i, j] = cursor;
    const x = f.left + (i + 0.5) / rows * f.across, y = f.top + (1 - (j + 0.5) / columns) * f.high;
    for (const [style, width] of [["#ffffff", 3], ["#14181d", 1]]) {
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
  const table = document.getElementById("values");
  const rowsOf = [];
  if (cursor) {
    const [i, j] = cursor, at = i * columns + j;
    const pose = [doc.spans[0][i], doc.spans[1][j]];
    rowsOf.push([doc.axes[0], short(pose[0])], [doc.axes[1], short(pose[1])]);
    if (reasons[at]) rowsOf.push(["pose", doc.reasons[reasons[at]]]);
    else {
      for (const one of doc.quantities) {
        const text = one.loaded && loads[at] ? doc.loads[loads[at]] : short(values[one.key][at]);
        rowsOf.push([`${one.name} [${one.unit}]`, text, one === chosen]);
      }
      if (doc.has_sides) rowsOf.push(["side of the locus (sign of the assembly mode)", modes[at] === 1 ? "+" : modes[at] === 255 ? "−" : "on it"]);
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
  document.getElementById("spoken").textContent = rowsOf.map(([name, value]) => `${name} ${value}`).join(", ");
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
for (const one of doc.quantities) {
  const option = document.createElement("option");
  option.value = one.key;
  option.textContent = `${one.name} [${one.unit}]`;
  select.append(option);
}
select.addEventListener("change", () => { chosen = doc.quantities.find((one) => one.key === select.value); paint(); tell(); });
document.getElementById("legend").replaceChildren(...doc.legend.map(([name, style, area]) => {
  const entry = document.createElement("div"), key = document.createElement("i");
  if (area) { key.className = "area"; key.style.background = style; } else key.style.borderColor = style;
  entry.append(key, name);
  return entry;
}));
window.addEventListener("resize", draw);
paint();
window.crossing = { map: { frame, values, move } };
