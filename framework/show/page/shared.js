// What all pages share: their data, names as text, numbers as words, SVG, and the width that they are laid out for.

const byId = (id) => document.getElementById(id);
const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(); // of framework/show/style.py
const data = JSON.parse(byId("document").textContent);

function decoded(text, Kind = Float32Array) {
  return new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
}

// Names come from robot files: text, never HTML.
function plain(text) {
  return String(text).replace(/[&<>"']/g, (sign) => `&#${sign.charCodeAt(0)};`);
}

// Numbers that no line's end parts from their units, in HTML.
const unparted = (html) => html.replace(/\d[\d.,eE+−-]* (N m|N|m|s|rad)(?![\w/])/g, '<span class="whole">$&</span>');

function symbols(text) {
  return unparted(plain(text)).replace(/\bt_s\b/g, "t<sub>s</sub>").replace(/\bW_p\b/g, "W<sub>p</sub>");
}

function rounded(value, digits = 3) {
  if (!Number.isFinite(value)) return "∞";
  const size = Math.abs(value);
  if (size < 1e-12) return "0";
  if (size < 1e5 && size >= 1e-3) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const [factor, power] = value.toExponential(digits - 1).split("e");
  const raised = [...power.replace("+", "")].map((sign) => (sign === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(sign)])).join("");
  return `${Number(factor)}·10${raised}`.replace("-", "−");
}

// Round values from low to high: as few as possible, but three.
function ticks(low, high) {
  const power = Math.pow(10, Math.floor(Math.log10(high - low)));
  for (const part of [5, 2, 1, 0.5, 0.2, 0.1]) {
    const step = part * power, found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    if (found.length >= 3) return found;
  }
  return [low, high];
}

function svg(name, attributes, parent) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.appendChild(element);
  return element;
}

// Lays the page out anew for another window, and for paper, on which it is as wide as the page.
function onNewWidth(lay, onPaper = () => {}) {
  const printing = (isPrinted) => () => {
    document.body.classList.toggle("printing", isPrinted);
    lay();
    onPaper(isPrinted);
  };
  addEventListener("resize", lay);
  addEventListener("beforeprint", printing(true));
  addEventListener("afterprint", printing(false));
}
const isOnPaper = () => document.body.classList.contains("printing");
