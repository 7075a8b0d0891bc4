// One toss, measured and simulated, as boxes seen from the side; and the switches of the data's corrections.

const SVG = "http://www.w3.org/2000/svg";
const held = document.getElementById("toss-data");

function rotated([w, x, y, z], [a, b, c]) {
  const u = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [
    a + w * u[0] + y * u[2] - z * u[1],
    b + w * u[1] + z * u[0] - x * u[2],
    c + w * u[2] + x * u[1] - y * u[0],
  ];
}

// Edges of a cube whose corners differ in one sign.
const CORNERS = Array.from({length: 8}, (_, i) => [i & 4 ? 1 : -1, i & 2 ? 1 : -1, i & 1 ? 1 : -1]);
const EDGES = [];
for (let i = 0; i < 8; i++) for (const bit of [1, 2, 4]) if (!(i & bit)) EDGES.push([i, i | bit]);

function startToss() {
  const {halfWidth, period, poses} = JSON.parse(held.textContent);
  const svg = document.getElementById("toss"), time = document.getElementById("toss-time");
  const choice = document.getElementById("toss-setting"), words = document.getElementById("toss-words");
  const names = Object.keys(poses).filter(name => name !== "measured");
  for (const name of names) choice.append(new Option(name, name));
  const frames = poses.measured, first = frames[0], last = frames[frames.length - 1];
  const way = Math.hypot(last[0] - first[0], last[1] - first[1]) || 1;
  const along = [(last[0] - first[0]) / way, (last[1] - first[1]) / way];
  time.max = frames.length - 1;
  const WIDTH = 900, HEIGHT = 300, scale = 900;  // px for 1 m
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);

  // Seen from the side of the throw, a little from above.
  function point([x, y, z]) {
    const forward = (x - first[0]) * along[0] + (y - first[1]) * along[1];
    const aside = (y - first[1]) * along[0] - (x - first[0]) * along[1];
    return [120 + scale * forward, HEIGHT - 40 - scale * (z + 0.25 * aside)];
  }

  function box(pose, kind) {
    const corners = CORNERS.map(c => {
      const turned = rotated(pose.slice(3), c.map(v => v * halfWidth));
      return point([pose[0] + turned[0], pose[1] + turned[1], pose[2] + turned[2]]);
    });
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("class", kind);
    path.setAttribute("d", EDGES.map(([i, j]) => `M${corners[i].join(" ")}L${corners[j].join(" ")}`).join(""));
    return path;
  }

  function drawToss() {
    const i = Number(time.value), simulated = poses[choice.value];
    const ground = document.createElementNS(SVG, "line");
    for (const [key, value] of Object.entries({x1: 0, x2: WIDTH, y1: HEIGHT - 40, y2: HEIGHT - 40, class: "grid"})) {
      ground.setAttribute(key, value);
    }
    svg.replaceChildren(ground, box(simulated[i], "simulated"), box(frames[i], "measured"));
    const away = Math.hypot(...[0, 1, 2].map(k => simulated[i][k] - frames[i][k]));
    const share = (50 * away / halfWidth).toFixed(0);
    words.textContent = `${(1e3 * i * period).toFixed(0)} ms: the simulated centre is ${(1e3 * away).toFixed(0)} mm away, ${share} % of a width.`;
  }
  time.addEventListener("input", drawToss);
  choice.addEventListener("change", drawToss);
  choice.value = names.find(name => name.startsWith("plug-in")) ?? names[0];
  document.getElementById("toss-player").hidden = false;
  drawToss();
}

// Each table of a set says in data-on which corrections it has; the switches choose the one that is shown.
function startSwitches(place) {
  const boxes = [...place.querySelectorAll("input[type=checkbox]")];
  const tables = [...place.querySelectorAll("[data-on]")];
  const show = () => {
    const on = boxes.filter(b => b.checked).map(b => b.value).sort().join("|");
    for (const table of tables) table.hidden = table.dataset.on.split("|").filter(Boolean).sort().join("|") !== on;
  };
  place.querySelector(".boxes").hidden = false;
  for (const each of boxes) each.addEventListener("change", show);
  show();
}

if (held) startToss();
for (const place of document.querySelectorAll(".switches")) startSwitches(place);
