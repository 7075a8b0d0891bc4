// Plots as SVG: axes, lines and bands in a box as wide as its place on the page.

const SVG = "http://www.w3.org/2000/svg";

function node(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// A number as people read it: three digits, powers of ten for what is very small or large.
function text(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size > 0 && (size < 1e-3 || size >= 1e5)) {
    const [digits, power] = value.toExponential(1).split("e");
    return `${digits.replace("-", "−")}·${powerOfTen(Number(power))}`;
  }
  return String(Number(value.toPrecision(3))).replace("-", "−");
}

function powerOfTen(exponent) {
  return `10${[...String(exponent)].map(c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
}

function stepName(h) {
  if (Math.abs(h * 240 - 1) < 1e-9) return "1/240 s";
  return h >= 1e-3 ? `${text(h * 1e3)} ms` : `${text(h * 1e6)} µs`;
}

// Round numbers from low to high, about `count` of them; powers of ten where `log`.
function ticks(low, high, count, log) {
  const found = [];
  if (log) {
    const every = Math.ceil((Math.log10(high) - Math.log10(low) + 1e-9) / count) || 1;
    for (let e = Math.ceil(Math.log10(low) - 1e-9); e <= Math.log10(high) + 1e-9; e += every) found.push(10 ** e);
    return found;
  }
  const rough = (high - low) / count, ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(f => f * ten).find(s => s >= rough * 0.999);
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) found.push(i * step);
  return found;
}

// Marks of settings, of size 1, by the letters that figures have for them.
const MARKS = {
  o: "M-1 0A1 1 0 1 1 1 0A1 1 0 1 1 -1 0Z", s: "M-.9 -.9H.9V.9H-.9Z", "^": "M0 -1.1L1 .8H-1Z", v: "M0 1.1L1 -.8H-1Z",
  "<": "M-1.1 0L.8 -1V1Z", ">": "M1.1 0L-.8 -1V1Z", D: "M0 -1.3L1.3 0L0 1.3L-1.3 0Z", d: "M0 -1.3L.8 0L0 1.3L-.8 0Z",
  X: "M-1 -.6L-.6 -1L0 -.4L.6 -1L1 -.6L.4 0L1 .6L.6 1L0 .4L-.6 1L-1 .6L-.4 0Z",
  P: "M-.35 -1H.35V-.35H1V.35H.35V1H-.35V.35H-1V-.35H-.35Z",
  "*": "M0 -1.3L.35 -.4L1.25 -.4L.55 .15L.8 1.05L0 .5L-.8 1.05L-.55 .15L-1.25 -.4L-.35 -.4Z",
};

class Plot {
  static paper = false;  // whether it is drawn to be printed

  // x, y: {low, high, label, log, name, only, upper, strip}; name writes a tick, `only` says which there are;
  // upper: {label, scale}, a second axis on top; strip: what is up to there has a strip below the rest.
  constructor(svg, x, y, {height = 300, right = 12} = {}) {
    const width = Plot.width(svg);
    if (Plot.paper) height *= 0.75;
    this.svg = svg;
    this.x = x;
    this.y = y;
    this.box = {left: 50, top: x.upper ? 34 : 12, right: width - right, bottom: height - 38};
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.setAttribute("height", height);
    const clip = `${svg.id}-clip`, {left, top, bottom} = this.box;
    const inside = node("rect", {x: left, y: top - 4, width: this.box.right - left + 5, height: bottom - top + 8});
    this.axes = node("g", {"aria-hidden": "true"});
    this.lines = node("g", {"clip-path": `url(#${clip})`});
    this.labels = node("g");
    svg.replaceChildren(node("clipPath", {id: clip}, inside), this.axes, this.lines, this.labels);
    this.drawAxes();
  }

  // The width of a plot: that of its place, less what surrounds it.
  static width(svg) {
    const place = svg.parentElement, style = getComputedStyle(place);
    if (Plot.paper) return {"explorer-curve": 700, "explorer-steps": 700}[svg.id] ?? 340;
    return Math.max(120, Math.round(place.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight)));  // 0: hidden
  }

  static share(axis, value) {
    const {strip} = axis;
    if (strip && value <= strip) return 0.14 * (0.15 + 0.85 * value / strip);
    if (strip) return 0.2 + 0.8 * (value - axis.low) / (axis.high - axis.low);
    if (!axis.log) return (value - axis.low) / (axis.high - axis.low);
    return Math.log(Math.max(value, axis.low) / axis.low) / Math.log(axis.high / axis.low);
  }

  px(value) { return this.box.left + Plot.share(this.x, value) * (this.box.right - this.box.left); }

  py(value) { return this.box.bottom - Plot.share(this.y, value) * (this.box.bottom - this.box.top); }

  drawAxes() {
    const {left, top, right, bottom} = this.box, add = (...made) => this.axes.append(...made);
    const name = (axis, value) => (axis.name ?? text)(value);
    for (const value of this.x.only ?? ticks(this.x.low, this.x.high, Math.max(2, (right - left) / 75), this.x.log)) {
      const at = this.px(value);
      add(node("line", {class: "grid", x1: at, x2: at, y1: top, y2: bottom}));
      add(node("text", {x: at, y: bottom + 15, "text-anchor": "middle"}, name(this.x, value)));
    }
    const below = this.y.strip ? [0] : [];
    for (const value of [...below, ...ticks(this.y.low, this.y.high, Math.max(2, (bottom - top) / 40), this.y.log)]) {
      const at = this.py(value);
      add(node("line", {class: "grid", x1: left, x2: right, y1: at, y2: at}));
      add(node("text", {x: left - 6, y: at + 4, "text-anchor": "end"}, name(this.y, value)));
    }
    if (this.y.strip) {  // the axis is broken here
      const cut = bottom - 0.17 * (bottom - top);
      for (const y of [cut - 3, cut + 3]) add(node("path", {class: "break", d: `M${left - 6} ${y + 3}L${left + 6} ${y - 3}M${right - 6} ${y + 3}L${right + 6} ${y - 3}`}));
    }
    const centre = (left + right) / 2;
    add(node("text", {class: "title", x: centre, y: bottom + 32, "text-anchor": "middle"}, this.x.label));
    add(node("text", {
      class: "title", "text-anchor": "middle", transform: `translate(11 ${(top + bottom) / 2}) rotate(-90)`,
    }, this.y.label));
    if (!this.x.upper) return;
    const {label, scale} = this.x.upper;
    for (const value of ticks(this.x.low / scale, this.x.high / scale, Math.max(2, (right - left) / 75))) {
      add(node("text", {x: this.px(value * scale), y: top - 5, "text-anchor": "middle"}, text(value)));
    }
    add(node("text", {class: "title", x: centre, y: top - 20, "text-anchor": "middle"}, label));
  }

  // Points of two arrays as a path; a gap where a value is missing.
  path(xs, ys) {
    let out = "", broken = true;
    xs.forEach((x, i) => {
      if (ys[i] === null || x === null) broken = true;
      else {
        out += `${broken ? "M" : "L"}${this.px(x).toFixed(1)} ${this.py(ys[i]).toFixed(1)}`;
        broken = false;
      }
    });
    return out;
  }

  law(xs, ys) { this.lines.append(node("path", {class: "law", d: this.path(xs, ys)})); }

  line(style, xs, ys) {
    this.lines.append(node("path", {class: "line", style: `--colour: ${style.colour}`, d: this.path(xs, ys), "stroke-dasharray": style.dashes}));
  }

  band(style, xs, low, high) {
    const known = xs.map((_, i) => i).filter(i => low[i] !== null);
    const there = this.path(known.map(i => xs[i]), known.map(i => high[i]));
    const back = this.path(known.reverse().map(i => xs[i]), known.map(i => low[i])).replace("M", "L");
    if (there) this.lines.append(node("path", {class: "band", style: `--colour: ${style.colour}`, d: `${there}${back}Z`}));
  }

  dots(style, xs, ys, radius = 3) {
    xs.forEach((x, i) => {
      if (ys[i] === null) return;
      const place = `translate(${this.px(x).toFixed(1)} ${this.py(ys[i]).toFixed(1)}) scale(${radius})`;
      this.lines.append(node("path", {class: "dot", style: `--colour: ${style.colour}`, d: MARKS[style.marker] ?? MARKS.o, transform: place}));
    });
  }

  ring(x, y, name) {
    const ring = node("circle", {class: name, cx: this.px(x), cy: this.py(y), r: 7});
    this.labels.append(ring);
    return ring;
  }

  // How much room names beside the ends of lines take, in a plot so wide.
  static room(names, svg) {
    return Plot.width(svg) > 440 ? 16 + 7.3 * Math.max(...names.map(name => name.length)) : 12;
  }

  // Names beside the ends of lines, moved apart: {name, style, y}.
  names(items) {
    const gap = 15, places = items.map(item => ({...item, at: this.py(item.y)})).sort((a, b) => a.at - b.at);
    places.forEach((place, i) => {
      place.at = Math.max(place.at, this.box.top + 4, i ? places[i - 1].at + gap : 0);
    });
    for (let i = places.length - 1, most = this.box.bottom; i >= 0; i--, most = places[i + 1]?.at - gap) {
      places[i].at = Math.min(places[i].at, most);
    }
    for (const {name, style, at} of places) {
      const name_ = {class: "name", style: `--colour: ${style?.colour ?? "var(--soft)"}`, x: this.box.right + 8, y: at + 4};
      this.labels.append(node("text", name_, name));
    }
  }
}
