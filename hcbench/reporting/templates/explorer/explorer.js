// The page's first screen: choices, their answer, e over speed, a drop, and what an impact looked like.
// Everything drawn is in the page's data; the law is computed (law.js).

const data = JSON.parse(document.getElementById("explorer-data").textContent);
// The page has each sentence once: choices have their numbers.
for (const {choices} of data.answers) for (const choice of choices) choice.more = choice.more?.map(number => data.sentences[number]);
const at = id => document.getElementById(`explorer-${id}`);
const INCH = 0.0254, LAW_STYLE = {colour: "var(--law-ink)", dashes: ""};
const state = {...data.start, own: null, e: null, material: "", band: "", kind: "", first: "ball", second: "plate", friction: null, setting: "", speed: NaN, toggled: new Set(), tab: "loop"};

// What is chosen

const sameAlpha = run => state.own === null && state.e === null && run.alpha === state.alpha;
const keyOf = run => `${run.engine} ${run.setting}`;
const alphaNow = () => state.own ?? state.alpha;
// What is aimed at: e of the law at a speed, or the one e of a pair of materials.
const targetAt = speed => state.e ?? lawRestitution(alphaNow(), speed);
const targetName = () => state.e === null ? "the law" : "the target";
const materialOf = id => (data.materials ?? []).find(material => material.id === id);
// What ran at this step and gravity for this α; with nothing set, for any.
function runsHere() {
  return data.runs.filter(run => run.gravity === state.gravity && run.step === state.step && (sameAlpha(run) || run === stockHere()));
}

function isShown(run) {
  const answer = answerNow(), all = answer ? answer.choices.flatMap(choice => choice.shown) : unanswered();
  return all.includes(keyOf(run)) !== state.toggled.has(keyOf(run));
}

// Where no answer is known: all that the study ran of this engine.
const unanswered = () => runsHere().filter(run => run.engine === state.engine).map(keyOf);

// The name of a run's line: with its engine where several are shown.
function nameOf(run) {
  return new Set(shownRuns().map(other => other.engine)).size > 1 ? run.title : run.label;
}

// The answer first, then the rest in the study's order.
function shownRuns() {
  const first = run => keyOf(run) !== choiceNow()?.shown[0];
  return runsHere().filter(isShown).sort((a, b) => first(a) - first(b));
}

// The chosen impact: its run, and which of its speeds.
function chosen() {
  const runs = shownRuns(), find = key => runs.find(run => keyOf(run) === key);
  const run = find(state.setting) ?? find(choiceNow()?.shown[0]) ?? runs[0];
  if (!run) return null;
  const wanted = Number.isFinite(state.speed) ? state.speed : 0.6 * Math.max(...run.v);
  const far = run.v.map((v, i) => run.e[i] === null ? Infinity : Math.abs(v - wanted));
  const i = far.indexOf(Math.min(...far));
  return Number.isFinite(far[i]) ? {run, i} : null;
}

function describe({run, i}) {
  const v = run.v[i], range = run.high[i] - run.low[i] > 5e-4;
  const chance = range ? ` (${run.low[i].toFixed(3)} to ${run.high[i].toFixed(3)} by chance of where in a step the contact starts)` : "";
  return `${run.title} at ${text(v)} m/s (${text(v / INCH)} in/s): e = ${run.e[i].toFixed(4)}${chance}; ${targetName()} ${targetAt(v).toFixed(4)}`;
}

// Choices

function fill(select, options, value) {
  select.replaceChildren(...options.map(([name, key]) => new Option(name, key, false, key === String(value))));
}

// Names that stand in an engine's text as they are: variables of Python in PyBullet's, attributes of XML in others.
const NAME = {pybullet: [/^[\p{L}_][\p{L}\p{N}_]{0,59}$/u, "a variable of your script: letters, digits and _"]};
const XML_NAME = [/^[\p{L}\p{N}_.:/-]([\p{L}\p{N}_.:/ -]{0,58}[\p{L}\p{N}_.:/-])?$/u, "letters, digits, spaces and _ . : / -"];

// What is wrong in a field, as a sentence; "" where nothing is.
function mistake() {
  const [legal, expected] = NAME[state.engine] ?? XML_NAME;
  for (const name of ["first", "second"]) if (!legal.test(state[name])) return `“${state[name]}” cannot stand in this text. Write ${expected}.`;
  if (state.own !== null && !(state.own >= 0 && state.own <= 100)) return `${Number.isNaN(state.own) ? "No α" : `α = ${state.own} s/m`}: write a number from 0 to 100, in s/m.`;
  if (state.friction !== null && !(state.friction >= 0 && state.friction <= 10)) return `Friction ${state.friction}: write a number from 0 to 10, or nothing.`;
  return "";
}

function showChoices() {
  const here = [...data.runs, ...data.answers].filter(one => one.engine === state.engine && one.gravity === state.gravity);
  const steps = [...new Set(here.map(one => one.step))].sort((a, b) => a - b);
  const [legal] = NAME[state.engine] ?? XML_NAME;
  for (const name of ["first", "second"]) {
    if (document.activeElement !== at(`${name}-name`)) at(`${name}-name`).value = state[name];
    at(`${name}-name`).setAttribute("aria-invalid", !legal.test(state[name]));
  }
  if (document.activeElement !== at("friction")) at("friction").value = state.friction ?? "";
  if (!steps.includes(state.step)) {
    const far = steps.map(h => Math.abs(Math.log(h / state.step)));
    state.step = steps[far.indexOf(Math.min(...far))];
  }
  fill(at("engine"), data.engines, state.engine);
  fill(at("step"), steps.map(h => [stepName(h), String(h)]), state.step);
  fill(at("gravity"), data.gravities.map(g => [g ? "under gravity" : "without gravity", String(g)]), state.gravity);
  const alphas = data.alphas.map(a => [`α = ${text(a)} s/m`, String(a)]);
  fill(at("alpha"), [...alphas, ["another α", "other"]], state.own === null ? state.alpha : "other");
  addMaterials();
  at("own").hidden = state.own === null || state.material !== "";
  showBands();
  if (state.own !== null && document.activeElement !== at("own-alpha")) at("own-alpha").value = state.own;
}

// Pairs of materials below the α, each with its number and the speeds that it was measured at.
function addMaterials() {
  const group = Object.assign(document.createElement("optgroup"), {label: "Published pairs of materials"});
  group.append(...data.materials.map(({id, label}) => new Option(label, id, false, id === state.material)));
  at("alpha").append(group);
}

function showBands() {
  const bands = data.errors.filter(isHere).map(each => each.band), usual = data.answers.find(isHere)?.choices.find(c => c.kind !== "exact")?.band;
  if (!bands.some(band => band.join() === state.band)) state.band = "";
  at("bands").hidden = bands.length < 2 || !usual;
  const spoken = band => said(bandText(band.length ? band : usual)).replace("from ", "");
  fill(at("band"), usual ? bands.map(band => [spoken(band), band.join()]) : [], state.band);
}

// e over speed

let curve, curvePoints = [];

// What lies far below the rest has a strip of its own at the bottom.
function split(runs, law) {
  const heights = runs.map(run => run.high.filter(e => e !== null)).map(high => Math.max(0, ...high));
  const isFar = i => heights[i] < 0.5 && heights[i] < Math.min(...law) - 0.2;
  const upper = runs.filter((_, i) => !isFar(i)), far = heights.filter((_, i) => isFar(i));
  const least = Math.min(...law, ...upper.flatMap(run => run.low.filter(e => e !== null)));
  const strip = Math.max(0.1, 1.3 * Math.max(0, ...far));
  return far.length && least > strip + 0.2 ? {least, strip} : {least: far.length ? 0 : least};
}

function drawCurve() {
  const runs = shownRuns(), choice = choiceNow(), top = Math.max(data.band[1], state.band ? choice?.band[1] ?? 0 : 0);
  const speeds = Array.from({length: 81}, (_, i) => top * i / 80), law = speeds.map(targetAt);
  const promised = runs.some(run => run.kind !== "stock") ? [] : (answerNow()?.choices ?? []).flatMap(promise);
  const {least, strip} = split(runs, [...law, ...promised.flatMap(({low}) => low)]);
  const most = Math.max(1, ...runs.flatMap(run => run.high));
  const low = least < 0.5 ? 0 : Math.floor(20 * least - 0.2) / 20;
  const last = run => run.e.findLast(e => e !== null) ?? low;
  const names = [{name: targetName(), y: law.at(-1)}, ...runs.map(run => ({name: nameOf(run), style: run, y: last(run)}))];
  names.push(...promised.map(each => ({name: each.name, style: each, y: each.low.at(-1)})));
  const right = Plot.room(names.map(({name}) => name), at("curve")), wide = right > 12;
  curve = new Plot(at("curve"), {low: 0, high: top, label: "impact speed, m/s", upper: {label: "in/s", scale: INCH}},
    {low, high: most > 1.005 ? 1.02 * most : 1, label: "restitution e", strip}, {height: wide ? 330 : 290, right});
  curve.law(speeds, law);
  promised.forEach(each => curve.band(each, each.v, each.low, each.high));
  promised.forEach(each => curve.line(each, each.v, each.low));
  runs.forEach(run => curve.band(run, run.v, run.low, run.high));
  runs.forEach(run => curve.line(run, run.v, run.e));
  runs.forEach(run => curve.dots(run, run.v, run.e, 4));
  curvePoints = runs.flatMap(run => run.v.flatMap((v, i) => run.e[i] === null ? [] : [{run, i, x: curve.px(v), y: curve.py(run.e[i])}]));
  if (wide) curve.names(names);
  legend(at("curve-legend"), wide ? [] : runs);
  showChosen();
}

// The law give or take the promised error, where nothing was run.
function promise({kind, setting, error, band: [from, to]}) {
  if (!Number.isFinite(error)) return [];
  const v = Array.from({length: 41}, (_, i) => from + (to - from) * i / 40), law = v.map(targetAt);
  const low = law.map(e => Math.max(0, e - error)), high = law.map(e => Math.min(1, e + error));
  return [{name: setting, colour: data.hues[kind], dashes: kind === "exact" ? "" : "2 3", v, low, high}];
}

function legend(place, runs) {
  place.replaceChildren(...[targetName(), ...runs].filter(() => runs.length).map(run => {
    const entry = Object.assign(document.createElement("span"), {className: "key", textContent: run.title ?? run});
    entry.style.setProperty("--colour", run.colour ?? "var(--law-ink)");
    return entry;
  }));
}

function showChosen() {
  const point = chosen(), slider = at("curve");
  slider.querySelector(".chosen")?.remove();
  const words = point ? describe(point) : "No body of the shown settings came back.";
  slider.setAttribute("aria-valuetext", words);
  slider.setAttribute("aria-valuemax", point ? point.run.v.length - 1 : 0);
  slider.setAttribute("aria-valuenow", point ? point.i : 0);
  if (point) curve.ring(point.run.v[point.i], point.run.e[point.i], "chosen");
  at("reading").textContent = words;
}

function nearest(event) {
  const box = at("curve").getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
  let best = null, least = 40;
  for (const point of curvePoints) {
    const far = Math.hypot(point.x - x, point.y - y);
    if (far < least) [best, least] = [point, far];
  }
  return best;
}

function hover(event) {
  at("curve").querySelector(".near")?.remove();
  const point = nearest(event);
  if (point) curve.ring(point.run.v[point.i], point.run.e[point.i], "near");
  const words = point ?? chosen();
  if (words) at("reading").textContent = describe(words);
}

function choose({run, i}) {
  Object.assign(state, {setting: keyOf(run), speed: run.v[i]});
  showChosen();
  drawTab();
  save();
}

function walk(event) {
  const point = chosen(), runs = shownRuns();
  if (!point) return;
  const turn = {ArrowUp: 1, ArrowDown: -1}[event.key], move = {ArrowLeft: -1, ArrowRight: 1, Home: -1e9, End: 1e9}[event.key];
  if (turn) {
    state.setting = keyOf(runs[(runs.indexOf(point.run) + turn + runs.length) % runs.length]);
    const next = chosen();
    if (next) choose(next);
  } else if (move) {
    const known = point.run.v.map((_, i) => i).filter(i => point.run.e[i] !== null);
    const to = Math.max(0, Math.min(known.length - 1, known.indexOf(point.i) + move));
    choose({run: point.run, i: known[to]});
  } else return;
  event.preventDefault();
}

// The choice in the address

function save() {
  const {engine, step, gravity, band, kind, first, second, setting, speed, toggled, tab} = state;
  const named = first === "ball" && second === "plate" ? {} : {first, second};
  const which = {setting, speed: Number.isFinite(speed) ? speed : "", toggled: [...toggled].join(","), tab};
  const target = state.material ? {material: state.material} : {alpha: alphaNow()};
  const choice = {engine, step, gravity, ...target, friction: state.friction ?? "", band, kind, ...named, ...which};
  const parts = Object.entries(choice).filter(([, value]) => value !== "");
  history.replaceState(null, "", `#${new URLSearchParams(parts)}`);
}

function load() {
  const choice = new URLSearchParams(location.hash.slice(1)), number = key => choice.has(key) ? Number(choice.get(key)) : NaN;
  if (!choice.has("engine")) return;
  if (data.engines.some(([, key]) => key === choice.get("engine"))) state.engine = choice.get("engine");
  if (number("step") > 0) state.step = number("step");
  if (data.gravities.includes(number("gravity"))) state.gravity = number("gravity");
  const alpha = number("alpha");
  if (data.alphas.includes(alpha)) Object.assign(state, {alpha, own: null});
  else if (alpha >= 0 && alpha <= 100) state.own = alpha;
  const material = materialOf(choice.get("material"));
  if (material) Object.assign(state, {own: material.alpha, e: material.e, material: material.id});
  if (number("friction") >= 0 && number("friction") <= 10) state.friction = number("friction");
  state.kind = choice.get("kind") ?? "";
  state.band = choice.get("band") ?? "";
  for (const name of ["first", "second"]) if ((NAME[state.engine] ?? XML_NAME)[0].test(choice.get(name) ?? "")) state[name] = choice.get(name);
  state.setting = choice.get("setting") ?? "";
  state.speed = number("speed");
  state.toggled = new Set((choice.get("toggled") ?? "").split(",").filter(Boolean));
  if (at(`tab-${choice.get("tab")}`)) state.tab = choice.get("tab");
}

function draw() {
  if (at("choices")) showChoices();
  // No answer to what is chosen: no older one may stand there.
  document.body.classList.toggle("mistaken", mistake() !== "");
  if (mistake()) {
    at("say").textContent = mistake();
    at("paste-text").textContent = "";
    return;
  }
  showAnswer();
  drawCurve();
  drawDrop();
  drawTab();
  if (at("ranking-body")) drawRanking();
}

function change(update) {
  Object.assign(state, update);
  draw();
  if (!mistake()) save();
}
