// What a chosen impact looked like, its error at other steps, the numbers, and how it was set.

const PANELS = {loop: drawLoop, steps: drawSteps, numbers: fillTable, text: showText};
const TABS = Object.fromEntries(Object.entries(PANELS).filter(([name]) => at(`tab-${name}`)));
const APART = 4;  // a contact so many times larger than the law's has scales of its own

function drawTab() {
  for (const name of Object.keys(TABS)) {
    const open = name === state.tab;
    at(`tab-${name}`).setAttribute("aria-selected", open);
    at(`tab-${name}`).tabIndex = open ? 0 : -1;
    at(`panel-${name}`).hidden = !open;
  }
  TABS[state.tab]();
}

function switchTab(event) {
  const names = Object.keys(TABS), i = names.indexOf(state.tab), move = {ArrowLeft: -1, ArrowRight: 1}[event.key];
  if (!move) return;
  state.tab = names[(i + move + names.length) % names.length];
  drawTab();
  at(`tab-${state.tab}`).focus();
  save();
}

// The loop of the chosen impact

const largest = values => Math.max(...values.map(Math.abs)) || 1;

// Forces act for a whole step: where every step was kept, force over time is drawn so.
function stairs(t, f, step) {
  const out = {t: [t[0]], f: [0]};
  t.forEach((from, i) => {
    out.t.push(from, t[i + 1] ?? from + step);
    out.f.push(f[i], f[i]);
  });
  return {t: [...out.t, out.t.at(-1)], f: [...out.f, 0]};
}

function drawLoop() {
  if (state.e !== null) {
    at("loops").hidden = true;
    at("loop-words").textContent = "One e says nothing of force over penetration: choose an α.";
    return;
  }
  const point = chosen(), loop = point && data.loops[point.run.loops[point.i]];
  at("loops").hidden = !loop;
  if (!loop) {
    at("loop-words").textContent = point ? "No loop of this impact was kept." : "No body of the shown settings came back.";
    return;
  }
  const {run, i} = point, law = lawLoop(data.body, alphaNow(), run.v[i]), [t, x, f] = loop;
  const own = f.length === run.samples[i] ? stairs(t, f, run.step) : {t: [t[0], ...t, t.at(-1)], f: [0, ...f, 0]};
  const sizes = {x: largest(x), f: largest(f), t: own.t.at(-1) || run.step}, lawSizes = {x: largest(law.x), f: largest(law.f), t: law.t.at(-1)};
  const ratio = name => sizes[name] / lawSizes[name];
  const apart = ["x", "f", "t"].some(name => ratio(name) > APART || ratio(name) < 1 / APART);
  const over = (values, by) => values.map(value => value / by);
  const unit = (name, si) => apart ? [sizes[name], lawSizes[name]] : [si, si];
  const deep = Math.max(sizes.x, lawSizes.x) >= 1e-3 ? [1e-3, "mm"] : [1e-6, "µm"];
  const [ux, lx] = unit("x", deep[0]), [uf, lf] = unit("f", 1), [ut, lt] = unit("t", 1e-6);
  const ownX = [x[0], ...x, x.at(-1)], ownF = [0, ...f, 0];
  const draw = (id, label, xs, ys, lawXs, lawYs) => {
    const low = values => 1.05 * Math.min(0, ...values), high = values => 1.05 * Math.max(...values);
    const plot = new Plot(at(id), {low: low([...xs, ...lawXs]), high: high([...xs, ...lawXs]), label},
      {low: low(ys), high: high([...ys, ...lawYs]), label: apart ? "force over its largest" : "force, N"}, {height: 290});
    plot.law(lawXs, lawYs);
    plot.line(run, xs, ys);
    if (f.length < 20) plot.dots(run, over(id === "loop" ? x : t, id === "loop" ? ux : ut), over(f, uf), 2.5);
  };
  draw("loop", apart ? "penetration over its largest" : `penetration, ${deep[1]}`, over(ownX, ux), over(ownF, uf), over(law.x, lx), over(law.f, lf));
  draw("force", apart ? "time over its contact's" : "time since touch, µs", over(own.t, ut), over(own.f, uf), over(law.t, lt), over(law.f, lf));
  const times = (name, what) => `${text(ratio(name))} times the law's ${what}`;
  const lone = f.length === 1 ? "The whole bounce happens in one step. " : "";
  at("loop-words").textContent = `${run.title} at ${text(run.v[i])} m/s, touched ${text(100 * run.phase)} % into a step. ${lone}`
    + `${text(sizes.x / deep[0])} ${deep[1]} deep, ${times("x", "depth")}; at most ${text(sizes.f)} N, ${times("f", "force")}; `
    + `in contact for ${text(sizes.t * 1e3)} ms, ${times("t", "time")}.`
    + (apart ? " Their sizes differ too much for one scale: each loop is scaled by its own largest." : "");
  at("loop").setAttribute("aria-label", `Force over penetration. ${at("loop-words").textContent}`);
  at("force").setAttribute("aria-label", `Force over time. ${at("loop-words").textContent}`);
}

// Error over step

function stepErrors(run, speed) {
  const found = new Map();
  const nearest = (values, most) => {
    const far = values.map(v => Math.abs(v - speed)), i = far.indexOf(Math.min(...far));
    return far[i] <= most ? i : -1;
  };
  for (const scan of data.scans) {
    if (keyOf(scan) !== keyOf(run) || scan.alpha !== run.alpha || run.gravity || Math.abs(scan.v - speed) > 1e-3) continue;
    scan.steps.forEach((h, i) => found.set(h, scan.error[i]));
  }
  for (const other of data.runs) {
    if (keyOf(other) !== keyOf(run) || other.alpha !== run.alpha || other.gravity !== run.gravity) continue;
    const i = nearest(other.v, 0.03 * speed + 1e-3);
    if (i >= 0) found.set(other.step, other.error[i]);
  }
  const steps = [...found.keys()].filter(h => found.get(h) !== null).sort((a, b) => a - b);
  return {steps, errors: steps.map(h => Math.max(found.get(h), 1e-7))};
}

function drawSteps() {
  const point = chosen(), speed = point ? point.run.v[point.i] : 0;
  const lines = shownRuns().map(run => ({run, ...stepErrors(run, speed)})).filter(line => line.steps.length);
  at("steps").hidden = !lines.length;
  if (!lines.length) {
    at("steps-words").textContent = "No shown setting ran at this speed.";
    return;
  }
  const steps = lines.flatMap(line => line.steps), errors = lines.flatMap(line => line.errors);
  const name = value => `${value < 1.01e-7 ? "≤ " : ""}${powerOfTen(Math.round(Math.log10(value)))}`;
  const decade = (value, round) => 10 ** round(Math.log10(value));
  const right = Plot.room(lines.map(line => nameOf(line.run)), at("steps"));
  const few = new Set(steps).size < 5 ? [...new Set(steps)] : undefined;
  const x = {low: Math.min(...steps) / 1.3, high: Math.max(...steps) * 1.3, label: "time step", only: few};
  const y = {low: decade(Math.min(...errors), Math.floor), high: Math.max(1, ...errors), label: "largest error of e"};
  const plot = new Plot(at("steps"), {...x, log: true, name: stepName}, {...y, log: true, name},
    {height: 290, right});
  const here = plot.px(state.step);
  plot.axes.append(node("line", {class: "here", x1: here, x2: here, y1: plot.box.top, y2: plot.box.bottom}));
  for (const {run, steps: xs, errors: ys} of lines) {
    plot.line(run, xs, ys);
    plot.dots(run, xs, ys);
  }
  if (right > 12) plot.names(lines.map(line => ({name: nameOf(line.run), style: line.run, y: line.errors.at(-1)})));
  const largestHere = lines.map(line => `${line.run.title} ${line.steps.map((h, i) => `${errorText(line.errors[i])} at ${stepName(h)}`).join(", ")}`);
  at("steps-words").textContent = `Largest error of e against the law at ${text(speed)} m/s over all places in a step where the contact starts;`
    + " the dashed line is the step chosen above.";
  at("steps").setAttribute("aria-label", `Error over time step at ${text(speed)} m/s. ${largestHere.join("; ")}`);
}

// The numbers, and how the chosen setting was set

function showText() {
  const point = chosen(), about = point && data.how[keyOf(point.run)];
  at("how").textContent = about ? `${point.run.title}, ${stepName(state.step)}, α = ${text(alphaNow())} s/m. ${about.summary}` : "Nothing ran for this material: the first screen has its answer.";
  const pasted = about ? data.texts[point.run.text] : "";
  at("how-text").hidden = !pasted;
  at("how-text").textContent = pasted;
  // What ran had none; the answers on the first screen have it.
  const lacks = pasted?.includes('condim="1"') && Number.isNaN(frictionIn(pasted)) ? ["This text has no friction, as it ran: that of the first screen has."] : [];
  at("how-notes").replaceChildren(...[...lacks, ...(about?.notes ?? [])].map(note => withCode("p", note)));
}

function row(...cells) {
  const made = document.createElement("tr");
  made.append(...cells);
  return made;
}

function element(name, words, className = "") {
  return Object.assign(document.createElement(name), {textContent: words, className});
}

function fillTable() {
  const runs = shownRuns(), speeds = [...new Set(runs.flatMap(run => run.asked))].sort((a, b) => a - b);
  const cell = (name, words) => element(name, words, "number");
  const head = ["speed, m/s", "in/s", targetName(), ...runs.map(run => run.title)].map(words => Object.assign(cell("th", words), {scope: "col"}));
  at("numbers-head").replaceChildren(row(...head));
  at("numbers-body").replaceChildren(...speeds.map(v => {
    const cells = runs.map(run => {
      const i = run.asked.indexOf(v);
      if (i < 0 || run.e[i] === null) return cell("td", "–");
      return cell("td", run.high[i] - run.low[i] > 5e-5 ? `${run.low[i].toFixed(4)} … ${run.high[i].toFixed(4)}` : run.e[i].toFixed(4));
    });
    const law = targetAt(v).toFixed(4);
    return row(Object.assign(cell("th", text(v)), {scope: "row"}), cell("td", text(v / INCH)), cell("td", law), ...cells);
  }));
}
