// Every setting at the chosen step and gravity: a box to show it, a name to see its text.

function drawRanking() {
  const rows = data.ranking.filter(one => one.step === state.step && one.gravity === state.gravity);
  const column = head => Object.assign(element("th", head), {scope: "col"});
  const alphas = data.alphas.map(alpha => [alpha, String(Number(alpha.toPrecision(9)))]);
  const heads = data.heads[String(state.gravity)] ?? data.heads[state.gravity.toFixed(1)];
  at("where").textContent = `at ${stepName(state.step)}, ${state.gravity ? "under" : "without"} gravity`;
  const names = ["setting", ...alphas.map(([alpha]) => `α = ${text(alpha)} s/m`), "chance", ...heads, "verdict"];
  at("ranking-head").replaceChildren(row(...names.map(column)));
  const line = data.constants.find(one => one.step === state.step && one.gravity === state.gravity);
  const best = row(Object.assign(element("th", "best constant e"), {scope: "row"}), ...alphas.map(([, key]) => element("td", line?.errors[key] ?? "–", "number")),
    ...names.slice(alphas.length + 1).map(() => element("td", "")));
  best.className = "line";
  at("ranking-body").replaceChildren(...(rows.length ? [best] : []), ...rows.map(one => rankingRow(one, alphas)));
}

function rankingRow(one, alphas) {
  const run = runsHere().find(each => keyOf(each) === keyOf(one));
  const head = Object.assign(document.createElement("th"), {scope: "row"});
  const box = Object.assign(document.createElement("input"), {type: "checkbox", checked: Boolean(run) && isShown(run), disabled: !run, value: keyOf(one)});
  box.setAttribute("aria-label", `show ${one.title}`);
  const name = Object.assign(element("button", one.title, "key"), {type: "button", value: keyOf(one), disabled: !run});
  name.style.setProperty("--colour", run?.colour ?? "var(--law-ink)");
  const pick = element("span", "", "pick");
  pick.append(box, name);
  head.append(pick);
  const cells = alphas.map(([, key]) => {
    const [words, mark, grade] = one.errors[key] ?? ["–", "", "none"];
    return element("td", `${words} ${mark}`, `number ${grade}`);
  });
  const verdict = element("td", "");
  verdict.append(element("b", one.verdict, `${one.grade}-text`), one.also && `; ${one.also}`);
  return row(head, ...cells, element("td", one.chance, "number"), ...one.cells.map(words => element("td", words, "number")), verdict);
}

function listenToRanking() {
  at("ranking-body").addEventListener("change", event => {
    const key = event.target.value;
    if (!state.toggled.delete(key)) state.toggled.add(key);
    drawCurve();
    drawDrop();
    save();
  });
  at("ranking-body").addEventListener("click", event => {
    const key = event.target.closest("button")?.value, run = key && runsHere().find(each => keyOf(each) === key);
    if (!run) return;
    if (!isShown(run)) state.toggled.has(key) ? state.toggled.delete(key) : state.toggled.add(key);
    change({setting: key, tab: "text"});
    at("tab-text").scrollIntoView();
  });
}
