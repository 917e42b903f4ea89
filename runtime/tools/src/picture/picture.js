const root = document.getElementById(id);
const svg = root.querySelector("svg");
const reading = root.querySelector(".smpl-reading");
const xmlns = "http://www.w3.org/2000/svg";
const timed = data.panels.filter((panel) => !panel.overSpace);
const whole = timed.length ? timed[0].x : [0, 1];
let seen = whole.slice();
let dragged = null;
const most = 12;

function element(name, attributes, parent) {
  const made = document.createElementNS(xmlns, name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  parent.appendChild(made);
  return made;
}

const cursors = data.panels.map((panel) => {
  const [x, y, , height] = panel.frame;
  return element("line", { x1: x, x2: x, y1: y, y2: y + height, stroke: "#333", "stroke-width": 0.8, visibility: "hidden" }, svg);
});
const shade = element("rect", { fill: "#56b4e9", "fill-opacity": 0.3, visibility: "hidden" }, svg);

function range(panel) {
  return panel.overSpace ? panel.x : seen;
}
function valueAt(panel, x) {
  const [low, high] = range(panel);
  return low + ((x - panel.frame[0]) / panel.frame[2]) * (high - low);
}
function placeOf(panel, value) {
  const [low, high] = range(panel);
  return panel.frame[0] + ((value - low) / (high - low)) * panel.frame[2];
}
function number(x) {
  if (x === null || x === undefined) return "\u2013";
  return String(Number(x.toPrecision(5))).replace("-", "\u2212");
}

function pointer(event) {
  const box = svg.getBoundingClientRect();
  return [((event.clientX - box.left) / box.width) * data.width, ((event.clientY - box.top) / box.height) * data.height];
}
function panelAt([x, y]) {
  return data.panels.find((p) => x >= p.frame[0] && x <= p.frame[0] + p.frame[2] && y >= p.frame[1] && y <= p.frame[1] + p.frame[3]);
}

// The value of a curve: between its points along a line, at a jump what holds after it.
function read(series, x) {
  const at = series.x;
  let low = 0, high = at.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (at[middle] <= x) low = middle + 1; else high = middle;
  }
  const before = low - 1;
  if (before < 0) return at.length && at[0] - x < 1e-9 ? series.y[0] : null;
  if (before + 1 >= at.length) return series.y[before];
  const [x0, x1, y0, y1] = [at[before], at[before + 1], series.y[before], series.y[before + 1]];
  if (series.dots) return x - x0 < x1 - x ? y0 : y1;
  if (y0 === null || y1 === null) return y0;
  return x1 > x0 ? y0 + ((x - x0) / (x1 - x0)) * (y1 - y0) : y1;
}

function lines(panel, x, y) {
  if (panel.map) {
    const { labels, columns, values } = panel.map;
    const share = (x - panel.x[0]) / (panel.x[1] - panel.x[0]);
    const column = Math.min(columns - 1, Math.max(0, Math.floor(share * columns)));
    const up = 1 - (y - panel.frame[1]) / panel.frame[3];
    const row = Math.min(labels.length - 1, Math.max(0, Math.floor(up * labels.length)));
    return [[labels[row], "#333", values[row * columns + column]]];
  }
  return panel.series.map((series) => [series.label, series.colour, read(series, x)]);
}

function show(panel, place, event) {
  const x = valueAt(panel, place[0]);
  reading.textContent = "";
  const head = document.createElement("div");
  const [name, unit] = panel.coordinate;
  head.textContent = panel.overSpace ? [name, unit && "=", number(x), unit].filter(Boolean).join(" ") : number(x) + " " + data.timeUnit;
  reading.appendChild(head);
  // Of more curves than can be read those nearest to the pointer.
  const aim = panel.y[1] - ((place[1] - panel.frame[1]) / panel.frame[3]) * (panel.y[1] - panel.y[0]);
  const near = (line) => (line[2] === null ? Infinity : Math.abs(line[2] - aim));
  let all = lines(panel, x, place[1]);
  if (all.length > most) all = all.sort((a, b) => near(a) - near(b)).slice(0, most);
  for (const [label, colour, value] of all) {
    const line = document.createElement("div");
    const name = document.createElement("b");
    name.textContent = (label || panel.name) + " ";
    name.style.color = colour;
    line.appendChild(name);
    line.appendChild(document.createTextNode(number(value === null ? value : value / panel.factor) + " " + panel.unit));
    reading.appendChild(line);
  }
  reading.hidden = false;
  const box = root.getBoundingClientRect();
  const left = event.clientX - box.left + 14;
  const wide = reading.offsetWidth;
  reading.style.left = (left + wide > box.width ? left - wide - 28 : left) + "px";
  reading.style.top = event.clientY - box.top + 14 + "px";
  data.panels.forEach((other, i) => {
    const shared = other === panel || (!other.overSpace && !panel.overSpace);
    const at = placeOf(other, x);
    cursors[i].setAttribute("visibility", shared ? "visible" : "hidden");
    cursors[i].setAttribute("x1", at);
    cursors[i].setAttribute("x2", at);
  });
}
function hide() {
  reading.hidden = true;
  cursors.forEach((cursor) => cursor.setAttribute("visibility", "hidden"));
}

function step(least) {
  const power = Math.pow(10, Math.floor(Math.log10(least)));
  return [1, 2, 5, 10].map((m) => m * power).find((s) => s >= least * (1 - 1e-9));
}
function ticks(group, panel) {
  group.textContent = "";
  const [low, high] = seen;
  const size = step((high - low) / Math.max(2, Math.floor(panel.frame[2] / 55)));
  const decimals = Math.max(0, Math.ceil(-Math.log10(size) - 1e-9));
  const bottom = panel.frame[1] + panel.frame[3];
  for (let k = Math.ceil(low / size - 1e-9); k * size <= high + 1e-9 * size; k++) {
    const x = placeOf(panel, k * size);
    element("line", { x1: x, x2: x, y1: bottom, y2: bottom + 3, stroke: "#8c8c8c", "stroke-width": 0.8 }, group);
    const label = element("text", { x, y: bottom + 14, "font-size": 9, fill: "#696969", "text-anchor": "middle" }, group);
    label.textContent = (k * size).toFixed(decimals).replace("-", "\u2212");
  }
}

// Curves, bands and marks are stretched as they are; letters keep their shape and go where their band is.
function stretch(low, high) {
  seen = [low, high];
  const factor = (whole[1] - whole[0]) / (high - low);
  for (const group of svg.querySelectorAll("g.curves")) {
    const panel = data.panels[Number(group.dataset.panel)];
    if (panel.overSpace) continue;
    const shift = placeOf(panel, whole[0]) - panel.frame[0] * factor;
    group.setAttribute("transform", `matrix(${factor} 0 0 1 ${shift} 0)`);
    for (const text of group.querySelectorAll("text")) {
      const x = Number(text.getAttribute("x"));
      text.setAttribute("transform", `translate(${x} 0) scale(${1 / factor} 1) translate(${-x} 0)`);
    }
  }
  for (const group of svg.querySelectorAll("g.ticks")) {
    const panel = data.panels[Number(group.dataset.panel)];
    if (!panel.overSpace) ticks(group, panel);
  }
}

svg.addEventListener("pointermove", (event) => {
  const place = pointer(event);
  if (dragged) {
    const [left, right] = [dragged.x, place[0]].sort((a, b) => a - b);
    const [x, y, width, height] = dragged.panel.frame;
    shade.setAttribute("x", Math.max(x, left));
    shade.setAttribute("width", Math.max(0, Math.min(x + width, right) - Math.max(x, left)));
    shade.setAttribute("y", y);
    shade.setAttribute("height", height);
    shade.setAttribute("visibility", "visible");
    return;
  }
  const panel = panelAt(place);
  if (panel) show(panel, place, event); else hide();
});
svg.addEventListener("pointerleave", hide);
svg.addEventListener("pointerdown", (event) => {
  const place = pointer(event), panel = panelAt(place);
  if (!panel || panel.overSpace || event.button) return;
  dragged = { panel, x: place[0] };
  hide();
  svg.setPointerCapture(event.pointerId);
});
svg.addEventListener("pointerup", (event) => {
  if (!dragged) return;
  const { panel, x } = dragged;
  dragged = null;
  shade.setAttribute("visibility", "hidden");
  const [a, b] = [x, pointer(event)[0]].map((p) => Math.min(panel.frame[0] + panel.frame[2], Math.max(panel.frame[0], p)));
  if (Math.abs(b - a) < 4) return;
  stretch(...[valueAt(panel, a), valueAt(panel, b)].sort((p, q) => p - q));
});
svg.addEventListener("dblclick", () => stretch(whole[0], whole[1]));
