// Puts the parts together when the page opens.

function listenToChoices() {
  at("choices").addEventListener("submit", event => event.preventDefault());
  at("engine").addEventListener("change", event => change({engine: event.target.value, setting: "", toggled: new Set()}));
  at("step").addEventListener("change", event => change({step: Number(event.target.value)}));
  at("gravity").addEventListener("change", event => change({gravity: Number(event.target.value)}));
  at("alpha").addEventListener("change", event => {
    const material = materialOf(event.target.value);
    if (material) return change({own: material.alpha, e: material.e, material: material.id});
    if (event.target.value !== "other") return change({alpha: Number(event.target.value), own: null, e: null, material: ""});
    change({own: alphaNow(), e: null, material: ""});
    at("own-alpha").focus();
  });
  at("own-alpha").addEventListener("input", event => change({own: event.target.value === "" ? NaN : Number(event.target.value)}));
  at("friction").addEventListener("input", event => change({friction: event.target.value === "" && !event.target.validity.badInput ? null : event.target.valueAsNumber}));
  for (const name of ["first", "second"]) at(`${name}-name`).addEventListener("input", event => change({[name]: event.target.value}));
  at("band").addEventListener("change", event => change({band: event.target.value}));
  at("kinds").addEventListener("click", event => {
    const tab = event.target.closest("button");
    if (tab) chooseKind(tab.value);
  });
  at("kinds").addEventListener("keydown", switchKind);
  at("copy").addEventListener("click", copy);
  listenToRanking();
  at("play").addEventListener("click", play);
  at("time").addEventListener("input", event => {
    pause();
    moveTo(Number(event.target.value));
  });
}

function start() {
  for (const name of ["wide", "body", "choices", "copy"]) if (at(name)) at(name).hidden = false;
  document.body.classList.toggle("embedded", self !== top);  // in a page that has a header of its own
  document.body.classList.add("explored");  // hides the still pictures that stand in for all this
  if (at("choices")) listenToChoices();
  at("curve").addEventListener("pointermove", hover);
  at("curve").addEventListener("pointerleave", showChosen);
  at("curve").addEventListener("click", event => {
    const point = nearest(event);
    if (point) choose(point);
  });
  at("curve").addEventListener("keydown", walk);
  for (const name of Object.keys(TABS)) {
    at(`tab-${name}`).addEventListener("click", () => {
      state.tab = name;
      drawTab();
      save();
    });
    at(`tab-${name}`).addEventListener("keydown", switchTab);
  }
  // As wide as its place; on paper as wide as that will be.
  let width = 0;
  const redraw = () => {
    if (mistake()) return;
    drawCurve();
    drawDrop();
    drawTab();
  };
  new ResizeObserver(([entry]) => {
    if (Math.abs(entry.contentRect.width - width) > 1 && !Plot.paper) {
      width = entry.contentRect.width;
      redraw();
    }
  }).observe(at("wide"));
  for (const [name, paper] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(name, () => {
      Plot.paper = paper;
      redraw();
    });
  }
  addEventListener("hashchange", () => {
    load();
    draw();
  });
  load();
  draw();
  if (at("play") && data.dropHeight && !still.matches && !mistake()) play();
}

start();
