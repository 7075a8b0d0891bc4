// The matrix of engines by condition: a table a step, sorted by a column, and what a cell opens to.

const data = JSON.parse(document.getElementById("field-data").textContent);
const at = id => document.getElementById(`field-${id}`);
const SIGNS = {good: "✓", even: "≈", bad: "✗", none: ""};
// Lines by kind: as the figures have them.
const KINDS = {
  "nothing set": {colour: "#26303a", marker: "X", dashes: ""}, "one e": {colour: "#4f6b57", marker: "o", dashes: ""},
  settings: {colour: "#a65400", marker: "s", dashes: ""}, "plug-in": {colour: "#0072b2", marker: "v", dashes: ""},
};
const heads = [...document.querySelectorAll(".matrix thead th[data-column]")];
const columns = heads.map(head => head.dataset.column), names = heads.map(head => head.textContent);
const opening = {step: 1e-3, gravity: 9.81, engine: "", column: "", sort: "settings", down: ""};
const state = {...opening};

const make = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
};

// Text with `code` in it.
const prose = line => line.split("`").map((part, i) => i % 2 ? make("code", {}, part) : part);

function tableNow() {
  const far = table => Math.abs(Math.log(table.step / state.step)) + (table.gravity === state.gravity ? 0 : 100);
  return data.tables.reduce((best, table) => far(table) < far(best) ? table : best);
}

function address(choice) {
  const parts = Object.entries({...state, ...choice}).filter(([name, value]) => value !== opening[name] || ["step", "gravity"].includes(name));
  return `#${new URLSearchParams(parts)}`;
}

// The rows as Python has them, the best first, then by a column: numbers before what has none.
function sortedRows(table) {
  if (!columns.includes(state.sort)) return table.rows;
  const i = columns.indexOf(state.sort), turn = state.down ? -1 : 1, numbers = !["files", "version"].includes(state.sort);
  return [...table.rows].sort(([, one], [, other]) => {
    if (!numbers) return turn * one[i][0].localeCompare(other[i][0]);
    const [a, b] = [one[i][3], other[i][3]];
    return a === null || b === null ? (a === null) - (b === null) : turn * (a - b);
  });
}

function cellNode(engine, column, name, [words, below, grade]) {
  const open = engine === state.engine && column === state.column;
  const link = make("a", {"data-label": name, href: address(open ? {engine: "", column: ""} : {engine, column})}, `${SIGNS[grade]} ${words}`);
  if (below) link.append(make("small", {}, below));
  const cell = make("td", {class: grade}, link);
  if (open) cell.setAttribute("aria-current", "true");
  return cell;
}

function drawMatrix() {
  const table = tableNow(), focused = document.activeElement?.closest?.(".matrix td") !== null;
  Object.assign(state, {step: table.step, gravity: table.gravity});
  for (const name of ["step", "gravity"]) {
    at(name).selectedIndex = [...at(name).options].findIndex(option => Number(option.value) === table[name]);
  }
  at("answer").textContent = table.sentences[0];
  at("more").textContent = table.sentences.slice(1).join(" ");
  at("band").textContent = table.band;
  at("constant").textContent = table.constant;
  heads.forEach(head => {
    if (head.dataset.column === state.sort) head.setAttribute("aria-sort", state.down ? "descending" : "ascending");
    else head.removeAttribute("aria-sort");
  });
  at("rows").replaceChildren(...sortedRows(table).flatMap(([engine, cells]) => {
    const row = make("tr", {}, make("th", {scope: "row"}, data.titles[engine]));
    row.append(...cells.map((cell, i) => cellNode(engine, columns[i], names[i], cell)));
    const chosen = engine === state.engine ? cells[columns.indexOf(state.column)] : undefined;
    return chosen ? [row, panel(engine, chosen)] : [row];
  }));
  drawPlots();
  if (focused) document.querySelector(".matrix [aria-current] a")?.focus({preventScroll: true});
}

// What a cell opens to, in the row below its own.
function panel(engine, [words, below, , , number, note]) {
  const one = data.cases[number], left = make("div"), right = make("div");
  const title = one?.title ?? `${data.titles[engine]}: ${names[columns.indexOf(state.column)]}`;
  left.append(make("h2", {}, title));
  const [summary, ...notes] = data.recipes[one?.recipe] ?? [];
  for (const line of [note, summary, ...(one?.lines ?? [])]) if (line) left.append(make("p", {}, ...prose(line)));
  if (!one) left.append(make("p", {}, [words, below].filter(Boolean).join(", ")), make("p", {class: "note"}, "Source: this run, ", make("a", {href: "scores.csv"}, "scores.csv"), ", and hcbench's adapter."));
  if (one) {
    left.append(...paste(one), ...source(one));
    if (notes.length) left.append(make("details", {}, make("summary", {}, "Where it holds"), make("ul", {}, ...notes.map(line => make("li", {}, ...prose(line))))));
    right.append(make("div", {class: "plot"}, node("svg", {id: "field-curve", "data-case": number, role: "img", "aria-label": spoken(one)})));
    right.append(make("p", {class: "note"}, "Pale: the law. Dots: the mean of the launches at a speed; shaded: all of them."));
  }
  const steps = errorsByStep(engine);
  if (one && steps.length) {
    right.append(make("div", {class: "plot"}, node("svg", {id: "field-steps", "data-engine": engine, role: "img", "aria-label": spokenSteps(steps)})));
    right.append(make("p", {class: "note"}, "Error of e over the time step, as far as each kind ran. Dashed: the best constant e. ",
      ...steps.flatMap(({name}) => [make("span", {class: "key", style: `--colour: ${KINDS[name].colour}`}, name), " "])));
  }
  left.append(make("p", {class: "note"}, make("a", {href: address({})}, "Link to this cell"), " · ", make("a", {href: address({engine: "", column: ""})}, "Close")));
  return make("tr", {class: "panel"}, make("td", {colspan: columns.length + 1}, make("div", {class: one ? "two" : ""}, left, right)));
}

function paste(one) {
  if (one.text === null) return [make("p", {class: "note"}, "Nothing to paste.")];
  const words = make("pre", {tabindex: 0}, data.texts[one.text]), button = make("button", {type: "button"}, "Copy");
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(words.textContent);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(words);
      button.textContent = "Selected: copy it with the keyboard";
    }
  });
  const lacks = words.textContent.includes('condim="1"') && !/\bfriction="/.test(words.textContent);
  const note = lacks ? [make("p", {class: "note"}, "This text has no friction, as it ran: the command below, without --friction 0, gives one that has.")] : [];
  return [make("p", {}, make("b", {}, "To paste "), button), words, ...note];
}

function source(one) {
  const link = make("a", {"data-label": name, href: "scores.csv"}, "scores.csv");
  if (!one.source) return [make("p", {class: "note"}, "Source: this run, ", link, ".")];
  return [make("p", {class: "note"}, "Source: this run, ", link, ". hcbench makes this setting by:"), make("pre", {tabindex: 0}, one.source)];
}

const spoken = one => one.speed.length
  ? `e over impact speed: ${one.speed.map((v, i) => `${text(one.mean[i])} at ${text(v)} m/s`).join(", ")}`
  : "No body came back.";

function drawCurve() {
  const place = at("curve"), one = data.cases[place?.dataset.case];
  if (!one) return;
  const top = Math.max(...one.speed, 0.5), speeds = Array.from({length: 61}, (_, i) => top * i / 60);
  const law = speeds.map(v => lawRestitution(data.alpha, v)), {speed, mean, low = mean, high = mean} = one;
  const least = Math.min(...law, ...low), most = Math.max(1, ...high), style = KINDS[names[columns.indexOf(state.column)]] ?? KINDS.settings;
  const y = {low: least < 0.5 ? 0 : Math.floor(20 * least - 0.2) / 20, high: most > 1 ? 1.02 * most : 1, label: "restitution e"};
  const plot = new Plot(place, {low: 0, high: top, label: "impact speed, m/s"}, y, {height: 250});
  plot.law(speeds, law);
  plot.band(style, speed, low, high);
  plot.line(style, speed, mean);
  plot.dots(style, speed, mean);
}

function drawPlots() {
  drawCurve();
  drawSteps();
}

// Of each kind of setting that ran at a step of this gravity: its errors, and what the line is called.
function errorsByStep(engine) {
  const tables = data.tables.filter(table => table.gravity === state.gravity);
  return ["constant", "settings", "plugin"].map(column => {
    const i = columns.indexOf(column), cells = tables.map(table => table.rows.find(([name]) => name === engine)?.[1][i]);
    return {name: names[i], steps: tables.map(({step}) => step), errors: cells.map(cell => cell?.[3] ?? null)};
  }).filter(({errors}) => errors.some(error => error !== null));
}

const spokenSteps = lines => lines.map(({name, steps, errors}) =>
  `${name}: ${steps.map((h, i) => errors[i] === null ? "" : `${text(errors[i])} at ${stepName(h)}`).filter(Boolean).join(", ")}`).join("; ");

function drawSteps() {
  const place = at("steps");
  if (!place) return;
  const lines = errorsByStep(place.dataset.engine), low = 1e-8, right = Plot.room(names, place);
  const known = data.tables.filter(table => table.gravity === state.gravity), steps = known.map(({step}) => step);
  const x = {low: steps[0] / 1.5, high: steps.at(-1) * 1.5, log: true, label: "time step", name: stepName, only: steps.slice(0, 4)};
  const plot = new Plot(place, x, {low, high: 2, log: true, label: "error of e", name: error => powerOfTen(Math.round(Math.log10(error)))}, {height: 220, right});
  plot.line({colour: "var(--soft)", dashes: "5 3"}, steps, known.map(({constant}) => Number(constant)));
  const ends = lines.map(({name, errors}) => {
    const style = KINDS[name];
    const shown = errors.map(error => error === null ? null : Math.max(error, low));
    plot.line(style, steps, shown);
    plot.dots(style, steps, shown);
    return {name, style, y: shown.findLast(error => error !== null)};
  });
  if (right > 12) plot.names(ends);
}

function change(update) {
  Object.assign(state, update);
  history.replaceState(null, "", address({}));
  drawMatrix();
}

function load() {
  const choice = new URLSearchParams(location.hash.slice(1));
  for (const name of ["engine", "column", "sort", "down"]) state[name] = choice.get(name) ?? opening[name];
  for (const name of ["step", "gravity"]) if (choice.has(name)) state[name] = Number(choice.get(name)) || (name === "gravity" ? 0 : opening.step);
  drawMatrix();
}

heads.forEach((head, i) => {
  const button = make("button", {type: "button"}, names[i]);
  button.addEventListener("click", () => change({sort: columns[i], down: state.sort === columns[i] && !state.down ? "yes" : ""}));
  head.replaceChildren(button);
});
at("choices").hidden = false;
at("choices").addEventListener("submit", event => event.preventDefault());
at("choices").addEventListener("change", () => change({step: Number(at("step").value), gravity: Number(at("gravity").value)}));
addEventListener("hashchange", load);
addEventListener("resize", drawPlots);
load();
