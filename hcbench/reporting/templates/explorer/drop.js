// A drop, bounce after bounce: heights over time, with the balls on their curves.

const clock = {time: 0, end: 1, running: 0, last: 0};
const still = matchMedia("(prefers-reduced-motion: reduce)");
let dropPlot, falling = [], balls = [];  // {name, style, drop}
const FLOOR = 118;  // of the three balls, in pixels from the top

// Height at a time, m; null beyond what was followed.
function heightAt({touch, parting, height, ended}, time) {
  const first = touch[0] ?? Infinity;
  if (time < first) return Math.max(0, data.dropHeight - data.dropGravity * time * time / 2);
  let i = parting.findLastIndex(t => t <= time);
  if (i < 0 || time >= (touch[i + 1] ?? Infinity)) return 0;
  const flight = 2 * Math.sqrt(2 * height[i] / data.dropGravity), until = touch[i + 1] ?? parting[i] + flight;
  const share = (time - parting[i]) / (until - parting[i]);
  if (share > 1) return ended ? 0 : null;
  return 4 * height[i] * share * (1 - share);
}

function drawDrop() {
  if (!at("fall")) return;
  for (const name of ["fall", "heights"]) at(name).hidden = data.dropHeight === null;
  if (data.dropHeight === null) return;
  const law = targetDrop();
  const dropOf = run => data.drops.find(d => keyOf(d) === keyOf(run) && d.step === run.step && (d.alpha === run.alpha || run.kind === "stock"));
  const drops = shownRuns().map(run => ({name: nameOf(run), style: run, drop: dropOf(run)}));
  falling = [{name: targetName(), style: LAW_STYLE, drop: law}, ...drops.filter(({drop}) => drop)];
  clock.end = law.touch.at(-1);
  at("time").max = clock.end;
  at("time").step = clock.end / 500;
  const time = {low: 0, high: clock.end, label: "time, s"};
  dropPlot = new Plot(at("drop"), time, {low: 0, high: 1.06e3 * data.dropHeight, label: "height, mm"}, {height: 250});
  const points = Array.from({length: 601}, (_, i) => clock.end * i / 600);
  for (const {name, style, drop} of falling) {
    const heights = points.map(t => heightAt(drop, t)).map(h => h === null ? null : 1e3 * h);
    if (drop === law) dropPlot.law(points, heights);
    else dropPlot.line(style, points, heights);
  }
  const missing = drops.filter(({drop}) => !drop).map(({name}) => name);
  at("drop-words").textContent = `From ${text(1e3 * data.dropHeight)} mm under gravity.`;
  legend(at("drop-legend"), falling.slice(1).map(({name, style}) => ({title: name, colour: style.colour})));
  at("lag").textContent = lag(law) + (missing.length ? ` Not dropped here: ${missing.join(", ")}.` : "");
  drawBalls(law, dropOf);
  moveTo(Math.min(clock.time, clock.end));
}

// A drop that bounces as the law, or as the one e, which says nothing of how long a contact lasts.
function targetDrop() {
  if (state.e === null) return lawDrop(data.body, alphaNow(), data.dropHeight, data.dropGravity);
  const drop = {touch: [], parting: [], height: []};
  let time = Math.sqrt(2 * data.dropHeight / data.dropGravity), speed = data.dropGravity * time;
  for (let i = 0; i < 10; i++) {
    speed *= state.e;
    drop.touch.push(time);
    drop.parting.push(time);
    drop.height.push(speed * speed / (2 * data.dropGravity));
    time += 2 * speed / data.dropGravity;
  }
  return drop;
}

// Three balls side by side: the law, the engine as it is, and the engine with the printed text. The plug-in keeps e
// for any α, so that where it was not run it is drawn as the law.
function drawBalls(law, dropOf) {
  const choice = choiceNow(), stock = stockHere();
  const run = runsHere().find(one => keyOf(one) === choice?.shown[0] && one !== stock);
  const promised = choice?.kind === "exact" ? law : undefined;
  balls = [
    {name: targetName(), drop: law, colour: LAW_STYLE.colour},
    {name: `${engineTitle()} as it is`, drop: stock && dropOf(stock), colour: stock?.colour},
    {name: "with what we print", drop: (run && dropOf(run)) ?? promised, colour: data.hues[choice?.kind]},
  ];
  const width = Plot.width(at("balls"));
  at("balls").setAttribute("viewBox", `0 0 ${width} 160`);
  at("balls").setAttribute("height", 160);
  balls.forEach((ball, i) => { ball.x = width * (i + 0.5) / balls.length; });
  const names = balls.map(({name, x}) => node("text", {x, y: FLOOR + 18, "text-anchor": "middle"}, name));
  const absent = balls.filter(({drop}) => !drop).map(({x}) => node("text", {class: "title", x, y: FLOOR - 8, "text-anchor": "middle"}, "not dropped here"));
  at("balls").replaceChildren(node("line", {class: "break", x1: 0, x2: width, y1: FLOOR, y2: FLOOR}), ...names, ...absent);
}

function moveBalls(time) {
  for (const old of [...at("balls").querySelectorAll(".ball")]) old.remove();
  for (const {drop, x, colour} of balls) {
    const height = drop && heightAt(drop, time);
    if (height === undefined || height === null) continue;
    const cy = FLOOR - 10 - (FLOOR - 24) * height / data.dropHeight;
    at("balls").append(node("circle", {class: "ball", style: `--colour: ${colour}`, cx: x, cy, r: 10}));
  }
}

// How far the chosen setting's last touch lies behind the law's, and why.
function lag(law) {
  const {name, drop: own} = falling.find(({style}) => keyOf(style) === choiceNow()?.shown[0] && style.kind !== "stock") ?? {};
  const count = own ? Math.min(own.touch.length, law.touch.length) : 0;
  if (count < 2) return "";
  const late = own.touch[count - 1] - law.touch[count - 1];
  const contact = drop => drop.parting.slice(0, count - 1).reduce((sum, t, i) => sum + t - drop.touch[i], 0) / (count - 1);
  return `Bounce ${count} of ${name} comes ${text(1e3 * Math.abs(late))} ms ${late < 0 ? "before" : "after"} the law's: a contact lasts ${text(1e3 * contact(own))} ms`
    + ` where the law's lasts ${text(1e3 * contact(law))} ms, as an engine acts once a step of ${stepName(state.step)}.`;
}

function moveTo(time) {
  clock.time = time;
  moveBalls(time);
  const {px, box} = {px: dropPlot.px(time), box: dropPlot.box};
  dropPlot.labels.replaceChildren(node("line", {class: "here", x1: px, x2: px, y1: box.top, y2: box.bottom}));
  const words = falling.map(({name, style, drop}) => {
    const height = heightAt(drop, time);
    if (height === null) return `${name} not simulated so long`;
    const place = {cx: px, cy: dropPlot.py(1e3 * height) - 6, r: 6};
    dropPlot.labels.append(node("circle", {class: "ball", style: `--colour: ${style.colour}`, ...place}));
    return `${name} ${(1e3 * height).toFixed(1)} mm`;
  });
  at("time").value = time;
  at("time").setAttribute("aria-valuetext", `${time.toFixed(3)} s: ${words.join(", ")}`);
  at("drop").setAttribute("aria-label", `Heights of dropped balls at ${time.toFixed(3)} s: ${words.join(", ")}`);
}

// The next touch or apex of the law's ball: where Play stops when the reader wants no motion.
function nextMoment() {
  const {touch, parting} = falling[0].drop;
  const moments = touch.flatMap((t, i) => i ? [(parting[i - 1] + t) / 2, t] : [t]);
  return moments.find(t => t > clock.time + 1e-6) ?? 0;
}

function play() {
  if (still.matches) return moveTo(nextMoment());
  if (clock.running) return pause();
  if (clock.time >= clock.end) clock.time = 0;
  clock.last = performance.now();
  at("play").textContent = "Pause";
  clock.running = requestAnimationFrame(frame);
}

function pause() {
  cancelAnimationFrame(clock.running);
  clock.running = 0;
  at("play").textContent = "Play";
}

function frame(now) {
  const time = Math.min(clock.end, clock.time + Math.max(0, now - clock.last) / 1e3 * Number(at("rate").value));
  clock.last = now;
  moveTo(time);
  if (time >= clock.end) pause();
  else clock.running = requestAnimationFrame(frame);
}
