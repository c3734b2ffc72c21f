(async () => {
const root = document.currentScript.closest(".race");
const find = (name) => root.querySelector(name), whole = document.body.dataset.race === "whole";
const packed = Uint8Array.from(atob(find(".race-data").textContent), (c) => c.charCodeAt(0));
const D = JSON.parse(await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text());
const sums = (list, unit) => { let sum = 0; return list.map((own) => (sum += own) * unit); };
const N = D.names.length, SIZE = 300;

// Where the arm is: a list of strokes, and the points that pass the waypoints.
const times = (A, B) => [0, 4, 8].flatMap((r) => [0, 1, 2, 3].map((c) =>
  A[r] * B[c] + A[r + 1] * B[c + 4] + A[r + 2] * B[c + 8] + (c === 3 ? A[r + 3] : 0)));
const at = (A, [x, y, z]) => [0, 4, 8].map((r) => A[r] * x + A[r + 1] * y + A[r + 2] * z + A[r + 3]);
const moved = ([x, y, z], q, slides) => {  // Rodrigues' formula
  if (slides) return [1, 0, 0, x * q, 0, 1, 0, y * q, 0, 0, 1, z * q];
  const c = Math.cos(q), s = Math.sin(q), v = 1 - c;
  return [c + x * x * v, x * y * v - z * s, x * z * v + y * s, 0, x * y * v + z * s, c + y * y * v, y * z * v - x * s, 0,
    x * z * v - y * s, y * z * v + x * s, c + z * z * v, 0];
};
const ZERO = [0, 0, 0], L = D.chain, cols = Math.ceil(Math.sqrt(N)), cell = SIZE / cols;
const scale = L ? SIZE / Math.max(L.box[2] - L.box[0], L.box[3] - L.box[1]) : 1;
const width = L ? (L.box[2] - L.box[0]) * scale : SIZE, height = L ? (L.box[3] - L.box[1]) * scale : cell * Math.ceil(N / cols);
const seen = (p) => L.view.map((row, i) => (row[0] * p[0] + row[1] * p[1] + row[2] * p[2] - L.box[i]) * scale);
const arm = (q) => {
  let P = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
  const line = [ZERO], joints = [];
  q.forEach((own, j) => {
    if (L.corners[j]) line.push(at(P, L.corners[j]));
    P = times(P, L.origins[j]);
    joints.push(at(P, ZERO));
    P = times(P, moved(L.axes[j], own, L.slides[j]));
    line.push(joints[j]);
    if (L.slides[j]) line.push(at(P, ZERO));
  });
  line.push(at(times(P, L.tool), ZERO));
  return { strokes: [line.map(seen)], joints: joints.map(seen), tips: [seen(line.at(-1))] };
};
const dials = (q) => {  // an angle as a clock's hand
  const middle = q.map((_, j) => [(j % cols + .5) * cell, (Math.floor(j / cols) + .5) * cell]);
  const tips = middle.map(([x, y], j) => [x + .38 * cell * Math.sin(q[j]), y - .38 * cell * Math.cos(q[j])]);
  return { strokes: middle.map((m, j) => [m, tips[j]]), joints: middle, tips };
};
const shape = L ? arm : dials;

// A motion between its samples.
const start = (m) => {
  m.t = sums(m.t, D.tick); m.q = m.q.map((own) => sums(own, D.step)); m.u = m.u.map((own) => sums(own, 1));
};
const where = (m, t) => {
  let low = 0, high = m.t.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (m.t[middle] <= t) low = middle; else high = middle; }
  const length = m.t[high] - m.t[low];
  return [low, high, length > 0 ? Math.min(1, Math.max(0, (t - m.t[low]) / length)) : 1];
};
const between = (list, [low, high, share]) => list.map((own) => own[low] + share * (own[high] - own[low]));

// One lane: what stands still is drawn once.
const svg = (parent, tag, name) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  made.setAttribute("class", name);
  parent.append(made);
  return made;
};
const put = (line, points) => line.setAttribute("points", points.map((p) => p.map((v) => v.toFixed(1)).join()).join(" "));
const move = (disc, [x, y], r) => { disc.setAttribute("cx", x.toFixed(1)); disc.setAttribute("cy", y.toFixed(1)); disc.setAttribute("r", r); };
const lane = (m, box) => {
  const picture = svg(box.querySelector(".race-arm"), "svg", "");
  picture.setAttribute("viewBox", `0 0 ${width.toFixed(1)} ${height.toFixed(1)}`);
  const stands = D.waypoints.map(shape);
  if (L) stands.forEach((own) => put(svg(picture, "polyline", "ghost"), own.strokes[0]));
  else stands[0].joints.forEach((p) => move(svg(picture, "circle", "ghost"), p, .38 * cell));
  if (L) put(svg(picture, "polyline", "post"), [seen([0, 0, L.ground]), seen(ZERO)]);
  const trail = L && svg(picture, "polyline", "trail"), links = stands[0].strokes.map(() => svg(picture, "polyline", "link"));
  const joints = stands[0].joints.map(() => svg(picture, "circle", "joint"));
  const discs = stands.map((own) => own.tips.map((p) => { const made = svg(picture, "circle", "disc"); move(made, p, 4.5); return made; }));
  const bars = box.querySelector(".race-bars"), cells = [];
  bars.style.gridTemplateColumns = `minmax(1.2em, max-content) repeat(${D.kinds.length}, minmax(0, 1fr))`;
  const add = (text, name = "span") => { const made = document.createElement("span"); made.className = name; made.textContent = text; bars.append(made); return made; };
  add("");
  D.kinds.forEach((kind) => add(kind.name));
  const rows = [...new Set(D.kinds.flatMap((kind) => kind.joints))].sort((a, b) => a - b);
  let first = 0;
  const place = D.kinds.map((kind) => { const own = first; first += kind.joints.length; return own; });
  rows.forEach((j) => {
    add(j < 0 ? "all" : `${j + 1}`).title = D.names[j] ?? "all joints";
    D.kinds.forEach((kind, k) => {
      const n = kind.joints.indexOf(j), made = add("", n < 0 ? "" : "race-bar");
      if (n >= 0) { made.append(document.createElement("i")); cells[place[k] + n] = [made, kind.ratio]; }
    });
  });
  const line = box.querySelector(".race-status"), items = [...box.querySelectorAll("li")];
  const past = [];
  m.t.forEach((t, k) => past.push([t, shape(m.q.map((own) => own[k])).tips[0]]));
  return (t) => {
    const done = t >= m.duration - 1e-9, own = where(m, Math.min(t, m.duration)), now = shape(between(m.q, own));
    links.forEach((link, i) => put(link, now.strokes[i]));
    joints.forEach((joint, i) => move(joint, now.joints[i], L ? 3 : 2.5));
    if (trail) put(trail, [...past.filter(([when]) => when <= t).map(([, p]) => p), now.tips[0]]);
    let passed = 0;
    m.passed.forEach((when, i) => {
      const is = t >= when - 1e-9;
      passed += is;
      items[i].classList.toggle("passed", is);
      discs[i].forEach((disc) => disc.classList.toggle("passed", is));
    });
    let hardest = 0;
    between(m.u, own).forEach((use, i) => {
      const [cell, ratio] = cells[i], shown = done && ratio ? 0 : use;
      if (ratio) hardest = Math.max(hardest, shown);
      cell.firstChild.style.width = `${Math.min(100, shown)}%`;
      cell.classList.toggle("full", shown >= 99.5);
    });
    const above = 100 * (m.duration / D.goal.duration - 1);
    line.textContent = !done ? `Hardest used limit ${Math.round(hardest)}\u00a0%, waypoint ${passed} of ${D.waypoints.length}`
      : `Arrived${above > .05 ? `, ${above.toFixed(1)}\u00a0% above ${D.goal.name}` : ""}`;
  };
};
D.motions.forEach(start);
const boxes = [...root.querySelectorAll(".race-lane")], lanes = D.motions.map((m, i) => lane(m, boxes[i]));
let last = Math.max(...D.motions.map((m) => m.duration));
const slider = find(".race-time"), button = find(".race-play"), said = find(".race-said");
slider.max = Math.ceil(last * 100) / 100;
let now = 0, before = 0, on = false;
const show = (t) => {
  now = Math.min(t, last);
  lanes.forEach((draw) => draw(now));
  slider.value = now >= last ? slider.max : now;
  const text = `${now.toFixed(2)} s`;
  slider.setAttribute("aria-valuetext", text);
  find(".race-now").textContent = text;
};
const stop = (text) => { on = false; button.textContent = text; };
const step = (when) => {
  if (!on) return;
  show(now + (when - before) / 1000 * find(".race-speed").value);
  before = when;
  if (now < last) { requestAnimationFrame(step); return; }
  stop("Again");
  said.textContent = `All have arrived: ${D.motions.map((m) => `${m.name} ${m.duration.toFixed(2)} s`).join(", ")}.`;
};
button.onclick = () => {
  if (on) { stop("Play"); return; }
  if (now >= last) now = 0;
  on = true;
  button.textContent = "Pause";
  said.textContent = "";
  before = performance.now();
  requestAnimationFrame(step);
};
slider.oninput = () => { stop("Play"); show(Number(slider.value)); };
find(".race-controls").hidden = false;
{{ yours }}
// A still picture tells most shortly before the first arrives.
const still = .8 * Math.min(...D.motions.map((m) => m.duration)), asked = whole ? parseFloat(location.hash.slice(1)) : NaN;
show(asked >= 0 ? asked : still);
root.dataset.ready = "1";
if (whole && !(asked >= 0) && !matchMedia("(prefers-reduced-motion: reduce)").matches) { now = 0; button.click(); }
})();
