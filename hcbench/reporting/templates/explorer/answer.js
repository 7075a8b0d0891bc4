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
  const asked = kind => `${tuneLine()} --speeds "${digits3(band[0])}:${digits3(band[1])} m/s" ${FLAGS[kind]}`;
  const choices = ["settings", "constant"].flatMap((kind, i) => {
    const told = row[i];
    if (!told) return [];
    const {setting, error, ran, nearby} = told;
    if (!setting) {
      const say = `Ask for it: this command finds ${kind === "settings" ? "settings" : "one e"} of ${engineTitle()}.`;
      const known = nearbyText(nearby), more = ["Errors of settings differ from α to α: the command measures that of yours."];
      return [{kind, setting: "", error: NaN, band, shown, more, text: asked(kind), say, known}];
    }
    const more = [ran ? "The command finds its numbers." : "≈ lies between α that were run; the command finds the numbers and measures the error."];
    return [made(kind, setting, error, ran ? errorText(error) : `≈ ${errorText(error)}`, more, asked(kind))];
  });
  const known = here.flatMap(answer => answer.choices.filter(choice => choice.kind === "exact").map(choice => ({answer, choice})))[0];
  if (known && low < band[1]) {
    const {answer, choice} = known, text = choice.text.replaceAll(String(answer.alpha), String(alpha));
    const more = choice.more.filter(line => line.startsWith("It needs"));
    const above = low > band[0] ? [`Slower impacts than ${digits3(low)} m/s may come to rest.`] : [];
    choices.push(made("exact", choice.setting, choice.error, errorText(choice.error), [...more, ...above], text, [Math.max(low, band[0]), band[1]]));
  }
  return {choices};
}

const engineTitle = () => data.engines.find(([, key]) => key === state.engine)[0];

function tuneLine() {
  return `hcbench tune ${state.engine} --alpha "${Number(alphaNow().toPrecision(6))} s/m" --timestep "${Number(state.step.toPrecision(9))} s"`
    + ` --gravity ${state.gravity} --friction 0 --pair "${state.first},${state.second}"`;
}

// What happens with nothing set, which no α changes.
const stockHere = () => data.runs.find(run => isHere(run) && run.kind === "stock" && (sameAlpha(run) || state.own !== null));

function nothingSet() {
  const run = stockHere();
  if (!run) return [];
  const errors = run.v.flatMap((v, i) => run.e[i] === null ? [] : [run.low[i], run.high[i]].map(e => Math.abs(e - lawRestitution(alphaNow(), v))));
  const highest = Math.max(...run.high), words = highest > 0 ? `e up to ${digits3(highest)}` : "no bounce";
  return [element("b", "Nothing set"), `${words}: wrong by at most ${errorText(Math.max(...errors))}`];
}

function showAnswer() {
  if (!at("say")) return;
  const choice = choiceNow(), names = {ball: state.first, plate: state.second};
  const {say, more, text: words} = choice ?? {
    say: `Not asked here: ${engineTitle()} at ${stepName(state.step)} for α = ${text(alphaNow())} s/m.`,
    more: ["This command finds a setting."], text: tuneLine(),
  };
  at("say").textContent = say;
  at("more").replaceChildren(...more.map(line => Object.assign(document.createElement("p"), {textContent: line})));
  const pasted = words.startsWith("hcbench tune ") ? words : words.replace(/\b(ball|plate)\b/g, name => names[name]);
  at("paste-text").textContent = pasted;
  const kept = Math.round(100 * lawRestitution(alphaNow(), 1));
  at("plain").textContent = `At 1 m/s a ball of this material keeps ${kept} % of its speed.`;
  at("nothing").replaceChildren(...nothingSet());
  showKinds(choice);
  at("copied").textContent = "";
}

function showKinds(choice) {
  const choices = answerNow()?.choices ?? [];
  at("kinds").replaceChildren(...Object.keys(KINDS).flatMap(kind => {
    const other = choices.find(each => each.kind === kind);
    if (!other) return [];
    const within = other.known ?? other.say.match(/e within .*(?=\.$)/)?.[0] ?? "no error known here";
    const tab = Object.assign(document.createElement("button"), {type: "button", value: kind, id: `explorer-kind-${kind}`});
    tab.append(Object.assign(document.createElement("b"), {textContent: KINDS[kind]}), within);
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
