// The answer to what is chosen at the top: as `hcbench tune` gave it, or made here for any α.

const KINDS = {exact: "Plug-in", settings: "Settings only", constant: "One e"};
const FLAGS = {exact: "--plugin", settings: "--settings", constant: "--constant"};

// An error of e as every line, page and figure writes it.
function errorText(error) {
  if (!Number.isFinite(error)) return "–";
  const size = Math.max(error, 1e-7);
  if (size >= 1e-4) return String(Number(size.toPrecision(2)));
  return size.toExponential(size >= 1e-5 ? 1 : 0).replace(".0e", "e");
}

const bandText = ([low, high]) => `from ${digits3(low)} to ${digits3(high)} m/s`;
const digits3 = value => String(Number(value.toPrecision(3)));
const isHere = what => what.engine === state.engine && what.step === state.step && what.gravity === state.gravity;
const near = (one, other) => Math.abs(one - other) < 1e-9 * Math.max(one, other);

function answerNow() {
  const here = data.answers.filter(isHere);
  if (state.e !== null) return here.length ? constantAnswer(here) : undefined;
  const known = state.band === "" && here.find(answer => answer.alpha === alphaNow());
  return known || (here.length && data.errors?.length ? madeAnswer(here) : undefined);
}

function choiceNow() {
  const choices = answerNow()?.choices ?? [];
  return choices.find(choice => choice.kind === state.kind) ?? choices[0];
}

// What the table has of an α, of settings and of one e: the setting, its error and whether it was run; null for
// no such choice; the errors at the nearest α where its own is not known.
function rowAt({rows, names}, alpha) {
  const same = rows.find(row => near(row[0], alpha));
  if (same) return [1, 2].map(kind => same[kind] && {setting: names[same[kind][0]], error: same[kind][1], ran: true});
  const i = rows.findIndex((row, at) => at + 1 < rows.length && row[0] < alpha && alpha < rows[at + 1][0]);
  if (i < 0) return [{}, {}];
  const share = Math.log(alpha / rows[i][0]) / Math.log(rows[i + 1][0] / rows[i][0]), line = rows[i][3];
  return [1, 2].map(kind => {
    if (rows.every(row => !row[kind])) return null;
    if (kind === 2 && line) return {setting: names[line[0]], error: line[1] * (line[2] / line[1]) ** share};
    return {nearby: rows.slice(Math.max(0, i - 1), i + 3).map(row => row[kind]?.[1] ?? null)};
  });
}

// Errors at the nearest α, where that of α is not known.
function nearbyText(errors) {
  const known = errors?.filter(error => error !== null) ?? [];
  if (!errors) return "no error known here";
  if (!known.length) return "none to advise at the nearest α";
  const [low, high] = [Math.min(...known), Math.max(...known)].map(errorText);
  return `${low === high ? low : `${low} … ${high}`} at the nearest α${known.length < errors.length ? ", or none" : ""}`;
}

// Errors that a row tells of a kind: its own, those at the nearest α, or none.
const errorsOf = told => !told ? undefined : told.setting ? [told.error] : told.nearby;

// For an α or a band that no answer is of: the plug-in's text, and errors of the rest from the table.
function madeAnswer(here) {
  const alpha = alphaNow(), table = data.errors.find(each => isHere(each) && each.band.join() === state.band);
  const row = table ? rowAt(table, alpha) : [{}, {}], low = table?.lows.find(([most]) => alpha <= most)?.[1];
  const usual = here[0].choices.find(choice => choice.kind !== "exact")?.band ?? here[0].choices[0].band;
  const band = table?.band.length ? [Math.max(table.band[0], usual[0]), table.band[1]] : usual;
  const stock = stockHere();
  const shown = stock ? [keyOf(stock)] : [];
  const made = (kind, setting, error, words, more, text, over = band) => ({kind, setting, error, band: over, shown, more, text,
    say: `${kind === "exact" ? "Attach" : "Set"} ${setting}: e within ${words} ${bandText(over)}.`});
  const unnamed = (kind, known) => ({kind, setting: "", error: NaN, band, shown, text: asked(kind), known,
    say: `Ask for it: this command finds ${kind === "settings" ? "settings" : "one e"} of ${engineTitle()}.`,
    more: ["Errors of settings differ from α to α: the command measures that of yours."]});
  const asked = kind => `${tuneLine()} --speeds "${digits3(band[0])}:${digits3(band[1])} m/s" ${FLAGS[kind]}`;
  // The table's settings are without friction: with it another may serve, and its error is larger.
  const frictionless = state.friction === 0 || here.every(answer => answer.choices.every(choice => Number.isNaN(frictionIn(choice.text))));
  const choices = ["settings", "constant"].flatMap((kind, i) => {
    if (!frictionless) return [unnamed(kind, `${nearbyText(errorsOf(row[i]))} without friction`)];
    const told = row[i];
    if (!told) return [];
    const {setting, error, ran, nearby} = told;
    if (!setting) return [unnamed(kind, nearbyText(nearby))];
    const more = [ran ? "The command finds its numbers." : "≈ lies between α that were run; the command finds the numbers and measures the error."];
    return [made(kind, setting, error, ran ? errorText(error) : `≈ ${errorText(error)}`, more, asked(kind))];
  });
  const known = here.flatMap(answer => answer.choices.filter(choice => choice.kind === "exact").map(choice => ({answer, choice})))[0];
  if (known && low < band[1]) {
    const {answer, choice} = known, text = withAlpha(choice.text, answer.alpha, alpha);
    const more = choice.more.filter(line => line.startsWith("It needs"));
    const above = low > band[0] ? [`Slower impacts than ${digits3(low)} m/s may come to rest.`] : [];
    choices.unshift(made("exact", choice.setting, choice.error, errorText(choice.error), [...more, ...above], text, [Math.max(low, band[0]), band[1]]));
  }
  return {choices};
}

// The plug-in's text for another α: in full where it acts, in six digits where hcbench notes what it wrote.
function withAlpha(text, was, now) {
  const note = alpha => `alpha ${Number(alpha.toPrecision(6))} s/m`;
  return text.replaceAll(String(was), String(now)).replaceAll(note(was), note(now));
}

// The plug-in's text for one e at all speeds, as `hcbench tune --restitution` prints it.
function withConstant(text, was, e) {
  const reading = /<config key="alpha" value="[^"]*" \/>\n\s*<config key="reading" value="law" \/>/;
  return withAlpha(text, was, was).replace(reading, `<config key="restitution" value="${e}" />`)
    .replace(/"restitution alpha=[^"]*"/, `"restitution restitution=${e}"`).replace(/; alpha [^;]* s\/m;/, `; restitution ${e};`);
}

// For the one e of a pair of materials: the plug-in's text, and the command that finds settings.
function constantAnswer(here) {
  const stock = stockHere(), shown = stock ? [keyOf(stock)] : [], {e} = state;
  const say = `Ask for it: this command finds settings of ${engineTitle()} for e = ${e}.`;
  const settings = {kind: "settings", setting: "", error: NaN, band: data.band, shown, text: `${tuneLine()} --settings`, say, more: []};
  const known = here.flatMap(answer => answer.choices.filter(choice => choice.kind === "exact").map(choice => ({answer, choice})))[0];
  if (!known) return {choices: [settings]};
  const {answer, choice} = known, text = withConstant(choice.text, answer.alpha, e);
  const told = `Attach ${choice.setting}: e within ${errorText(choice.error)} ${bandText(choice.band)}.`;
  const exact = {...choice, shown, text, say: told, more: choice.more.filter(line => line.startsWith("It needs"))};
  return {choices: [exact, settings]};
}

const engineTitle = () => data.engines.find(([, key]) => key === state.engine)[0];

function tuneLine() {
  const target = state.e === null ? `--alpha "${Number(alphaNow().toPrecision(6))} s/m"` : `--restitution ${state.e}`;
  return `hcbench tune ${state.engine} ${target} --timestep "${Number(state.step.toPrecision(9))} s"`
    + ` --gravity ${state.gravity}${state.friction === null ? "" : ` --friction ${state.friction}`} --pair "${state.first},${state.second}"`;
}

// What happens with nothing set, which no α changes.
const stockHere = () => data.runs.find(run => isHere(run) && run.kind === "stock" && (sameAlpha(run) || state.own !== null || state.e !== null));

function nothingSet() {
  const run = stockHere();
  if (!run) return [];
  const errors = run.v.flatMap((v, i) => run.e[i] === null ? [] : [run.low[i], run.high[i]].map(e => Math.abs(e - targetAt(v))));
  const highest = Math.max(...run.high), words = highest > 0 ? `e up to ${digits3(highest)}` : "no bounce";
  return [element("b", "Nothing set"), `${words}: wrong by at most ${errorText(Math.max(...errors))}`];
}

function showAnswer() {
  if (!at("say")) return;
  const choice = withFriction(choiceNow()), names = {ball: state.first, plate: state.second};
  const {say, more, text: words} = choice ?? {
    say: `Not asked here: ${engineTitle()} at ${stepName(state.step)} for ${state.e === null ? `α = ${text(alphaNow())} s/m` : `e = ${state.e}`}.`,
    more: ["This command finds a setting."], text: tuneLine(),
  };
  at("say").textContent = said(say);
  at("more").replaceChildren(...more.map(line => withCode("p", said(line))));
  const pasted = words.startsWith("hcbench tune ") ? words : words.replace(/\b(ball|plate)\b/g, name => names[name]);
  at("paste-text").textContent = pasted;
  const published = materialOf(state.material)?.label;
  const kept = `At 1 m/s a ball of this material keeps ${Math.round(100 * targetAt(1))} % of its speed.`;
  at("plain").textContent = state.e === null ? [published && `${published}.`, kept].filter(Boolean).join(" ") : `${published}. One number is published: e at other speeds is not known.`;
  at("nothing").replaceChildren(...nothingSet());
  showKinds(choice);
  at("copied").textContent = "";
}

// A sentence, with what stands between backticks as code.
function withCode(name, words) {
  const made = document.createElement(name);
  made.append(...words.split("`").map((part, i) => i % 2 ? element("code", part) : part));
  return made;
}

// Speeds as people say them: 32 mm/s to 0.5 m/s, rounded to the inside of the band.
function said(words) {
  const round = (value, way) => {
    const ten = 10 ** (Math.floor(Math.log10(value)) - 1);
    return Number((way(Number((value / ten).toPrecision(12))) * ten).toPrecision(2));
  };
  const spoken = value => value < 0.1 ? `${Number((1e3 * value).toPrecision(2))} mm/s` : `${value} m/s`;
  return words.replace(/from ([\d.e-]+) to ([\d.e-]+) m\/s/g, (_, low, high) => {
    const ends = [round(Number(low), Math.ceil), round(Number(high), Math.floor)];
    return ends[0] < 0.1 ? `from ${spoken(ends[0])} to ${spoken(ends[1])}` : `from ${ends[0]} to ${ends[1]} m/s`;
  });
}

// Coulomb's coefficient that a text writes; NaN where it leaves that to the user's model.
const frictionIn = text => Number(text.match(/\bfriction="(\S+) /)?.[1] ?? NaN);

// A text with another friction than the chosen one gives way to the command that finds it.
function withFriction(choice) {
  if (!choice?.kind || choice.text.startsWith("hcbench tune ")) return choice;
  const written = frictionIn(choice.text);
  if (Number.isNaN(written)) return {...choice, more: ["Friction stays as your model has it.", ...choice.more]};
  if (state.friction === null) return {...choice, more: [`It has friction ${written}, as two bodies of ${engineTitle()} have with nothing set: write yours above for another.`, ...choice.more]};
  if (state.friction === written) return choice;
  const band = choice.band.map(digits3).join(":");
  return {...choice, text: `${tuneLine()} --speeds "${band} m/s" ${FLAGS[choice.kind]}`, more: ["The command finds its numbers with your friction.", ...choice.more],
    say: `Ask for it: this command finds ${choice.setting} with friction ${state.friction}.`};
}

function showKinds(choice) {
  const choices = answerNow()?.choices ?? [];
  at("kinds").replaceChildren(...Object.keys(KINDS).flatMap(kind => {
    const other = choices.find(each => each.kind === kind);
    if (!other) return [];
    const within = other.known ?? other.say.match(/e within .*(?=\.$)/)?.[0] ?? "no error known here";
    const tab = Object.assign(document.createElement("button"), {type: "button", value: kind, id: `explorer-kind-${kind}`});
    tab.append(Object.assign(document.createElement("b"), {textContent: KINDS[kind]}), said(within));
    tab.setAttribute("role", "tab");
    tab.setAttribute("aria-controls", "explorer-paste");
    tab.setAttribute("aria-selected", kind === choice.kind);
    tab.tabIndex = kind === choice.kind ? 0 : -1;
    return [tab];
  }));
}

function chooseKind(kind) {
  change({kind, setting: ""});
  at(`kind-${kind}`).focus();
}

// Left and right among the kinds, as among any tabs.
function switchKind(event) {
  const kinds = [...at("kinds").children].map(tab => tab.value), move = {ArrowLeft: -1, ArrowRight: 1}[event.key];
  if (!move) return;
  chooseKind(kinds[(kinds.indexOf(choiceNow().kind) + move + kinds.length) % kinds.length]);
}

async function copy() {
  try {
    await navigator.clipboard.writeText(at("paste-text").textContent);
    at("copied").textContent = "Copied.";
  } catch {
    getSelection().selectAllChildren(at("paste-text"));
    at("copied").textContent = "Selected: copy it with the keyboard.";
  }
}
