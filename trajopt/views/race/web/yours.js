// A motion of the reader's own: its polynomials, their exact peaks, and what cannot be said here.
const CLOSE = 1e-6;  // a waypoint is passed within so much, rad or m; at rest below this share of a limit
const ROUNDING = 1e-6;  // of a peak, relative: of the digits of samples a millisecond apart
const UNIT = { rad: 1, deg: Math.PI / 180, m: 1, mm: .001 };
const value = (p, u) => p.reduceRight((sum, c) => sum * u + c, 0);
const slope = (p) => p.slice(1).map((c, k) => c * (k + 1));
const zeros = (p) => {  // in (0, 1), between those of the derivative
  while (p.length && p.at(-1) === 0) p = p.slice(0, -1);
  if (p.length < 2) return [];
  const ends = [0, ...zeros(slope(p)), 1], found = [];
  for (let i = 0; i + 1 < ends.length; i += 1) {
    let [low, high] = [ends[i], ends[i + 1]];
    const sign = Math.sign(value(p, low));
    if (sign * value(p, high) > 0) continue;
    for (let k = 0; k < 60; k += 1) { const middle = (low + high) / 2; if (sign * value(p, middle) > 0) low = middle; else high = middle; }
    found.push(low);
  }
  return found;
};
const read = (text) => {
  const rows = text.trim().split(/\r?\n/).map((row) => row.split(",").map((cell) => cell.trim()));
  const heads = rows[0].map((head) => /^(.*?)\s*\[(s|(rad|deg|mm|m)(\/s(?:\^2|²)?)?)\]$/.exec(head));
  if (heads.some((head) => !head) || heads[0][2] !== "s") throw "its header is not “time [s], joint [rad], …, joint [rad/s], …”";
  const numbers = rows.slice(1).map((row) => row.map((cell) => (cell === "" ? NaN : Number(cell))));
  if (numbers.length < 2 || numbers.some((row) => row.length !== heads.length || !row.every(Number.isFinite))) throw "a row is not one finite number per column";
  const tables = ["", "/s", "/s^2"].map((rate) => heads.map((head, c) => [head, c]).filter(([head, c]) => c && (head[4] ?? "").replace("²", "^2") === rate));
  const filled = tables.filter((own) => own.length);
  if (!tables[0].length || (tables[2].length && !tables[1].length) || filled.some((own) => own.length !== N)) throw `it has not a column per joint (${N})`;
  const bare = (name) => name.replace(/[_.\s](position|velocity|acceleration)$/, "");
  const order = filled.map((own) => {
    const names = own.map(([head]) => bare(head[1]));
    return D.names.every((name) => names.includes(name)) ? D.names.map((name) => own[names.indexOf(name)]) : own;
  });
  const t = numbers.map((row) => row[0]), T = t.map((own) => own - t[0]);
  if (T.some((own, k) => k && !(own > T[k - 1]))) throw "its times do not increase";
  return [T, ...order.map((own) => numbers.map((row) => own.map(([head, c]) => row[c] * UNIT[head[3]])))];
};
// As a controller joins the samples: lines, cubic or quintic pieces, of u from 0 to 1.
const pieces = ([t, q, v, a]) => t.slice(1).map((end, k) => {
  const T = end - t[k];
  return { at: t[k], T, p: q[k].map((q0, j) => {
    const h = q[k + 1][j] - q0;
    if (!v) return [q0, h];
    const v0 = v[k][j] * T, v1 = v[k + 1][j] * T;
    if (!a) return [q0, v0, 3 * h - 2 * v0 - v1, v0 + v1 - 2 * h];
    const a0 = a[k][j] * T * T, a1 = a[k + 1][j] * T * T;
    return [q0, v0, a0 / 2, 10 * h - 6 * v0 - 4 * v1 - (3 * a0 - a1) / 2, -15 * h + 8 * v0 + 7 * v1 + (3 * a0 - 2 * a1) / 2, 6 * h - 3 * (v0 + v1) + (a1 - a0) / 2];
  }) };
});
const rate = (p, order, T) => { let own = p; for (let k = 0; k < order; k += 1) own = slope(own).map((c) => c / T); return own.length ? own : [0]; };
const used = (x, [low, high], ratio) => {
  if (ratio) return Math.max(low === null ? 0 : x / low, high === null ? 0 : x / high);
  return low === null || high === null ? 0 : Math.abs(2 * x - low - high) / (high - low);
};
const worst = (parts) => D.bounds.map(({ kind, order, ratio, pairs }) => {
  let found = { use: -1 };
  for (const { at, T, p } of parts) p.forEach((own, j) => {
    const r = rate(own, order, T);
    for (const u of [0, 1, ...zeros(slope(r))]) {
      const use = used(value(r, u), pairs[j], ratio);
      if (use > found.use) found = { use, joint: j, time: at + u * T, name: D.kinds[kind].name, order };
    }
  });
  return found;
});
const passing = (parts) => {  // the first time after the last one at which each waypoint is nearest
  let from = 0;
  return D.waypoints.map((w, n) => {
    let best = [Infinity, 0];
    for (const { at, T, p } of parts) {
      if (at + T < from) continue;
      const reach = Math.max(...p.map((own) => own.slice(1).reduce((sum, c) => sum + Math.abs(c), 0)));
      if (Math.max(...p.map((own, j) => Math.abs(own[0] - w[j]))) > reach + Math.min(best[0], 1)) continue;
      const square = Array(2 * p[0].length - 1).fill(0);
      p.forEach((own, j) => own.forEach((c, i) => own.forEach((d, k) => { square[i + k] += (i ? c : c - w[j]) * (k ? d : d - w[j]); })));
      for (const u of [0, 1, ...zeros(slope(square))]) {
        const miss = Math.max(...p.map((own, j) => Math.abs(value(own, u) - w[j]))), time = at + u * T;
        if (time >= from && (n > 0 || time === 0) && miss < best[0] - 1e-12 && !(best[0] < CLOSE)) best = [miss, time];
      }
    }
    const end = parts.at(-1), last = end.at + end.T;
    if (n === D.waypoints.length - 1) best = [Math.max(...end.p.map((own, j) => Math.abs(value(own, 1) - w[j]))), last];
    from = best[1];
    return best;
  });
};
const percent = (share) => `${(100 * share).toFixed(2)}\u00a0%`;
const judged = (name, samples) => {
  const parts = pieces(samples), peaks = worst(parts), passed = passing(parts), duration = samples[0].at(-1);
  const again = ` Not certified here: run trajopt judge ${name} ${D.problem}`;
  const missed = passed.findIndex(([miss]) => !(miss < CLOSE)), over = peaks.filter(({ use }) => use > 1 + ROUNDING);
  const speed = (k, u) => Math.max(...parts.at(k).p.map((own, j) => Math.abs(value(rate(own, 1, parts.at(k).T), u))));
  const fast = D.bounds.find(({ order }) => order === 1), slowest = fast ? Math.min(...fast.pairs.map(([, high]) => high)) : 1;
  const kind = ["straight lines, whose velocity jumps", "cubic pieces, whose acceleration jumps", "quintic pieces"][samples.length - 2];
  const more = duration / D.goal.duration - 1;
  let said = `${name}: ${duration.toFixed(4)} s, ${percent(Math.abs(more))} ${more < 0 ? "below" : "above"} ${D.goal.name}.`;
  if (missed >= 0) return { said: `${said} It misses waypoint ${missed + 1} by ${passed[missed][0].toPrecision(2)} ${D.units[0]}.${again}`, passed, parts };
  if (samples.length - 2 < D.smooth) return { said: `${said} A controller joins its samples with ${kind}.${again}`, passed, parts };
  if (Math.max(speed(0, 0), speed(-1, 1)) > CLOSE * slowest) return { said: `${said} It does not begin and end at rest.${again}`, passed, parts };
  if (over.length) {
    const most = over.sort((a, b) => b.use - a.use)[0], slower = Math.max(...over.map(({ use, order }) => (order ? use ** (1 / order) : Infinity)));
    said += ` It uses ${percent(most.use)} of the ${most.name} limit of ${D.names[most.joint]}, at ${most.time.toFixed(3)} s.`;
    if (Number.isFinite(slower)) said += ` Slowed down ${slower.toFixed(4)} times, to ${(slower * duration).toFixed(4)} s, its peaks are within these limits.`;
    return { said: said + again, passed, parts };
  }
  const most = peaks.filter(({ order }) => order).sort((a, b) => b.use - a.use)[0];
  said += ` Its ${kind} keep every limit that this page knows: exact peak ${percent(most.use)}, ${most.name} of ${D.names[most.joint]} at ${most.time.toFixed(3)} s. It passes every waypoint within ${Math.max(...passed.map(([miss]) => miss)).toExponential(0)} ${D.units[0]}.`;
  return { said: said + (D.left_out.length ? ` This page does not know ${D.left_out.join(", ")}.${again}` : ` trajopt judge ${name} ${D.problem} certifies it.`), passed, parts };
};
const take = (name, text) => {
  let samples;
  try { samples = read(text); } catch (reason) {
    if (typeof reason !== "string") throw reason;
    said.textContent = `${name} is not read here: ${reason}. Not certified here: run trajopt judge ${name} ${D.problem}`;
    return;
  }
  const found = judged(name, samples), duration = samples[0].at(-1);
  const t = [...Array(301).keys()].map((k) => (k * duration) / 300);
  const part = (when) => { const k = samples[0].findLastIndex((own) => own <= when); return found.parts[Math.min(Math.max(k, 0), found.parts.length - 1)]; };
  const at = (when, j, order) => { const { at: from, T, p } = part(when); return value(rate(p[j], order, T), (when - from) / T); };
  const uses = D.kinds.flatMap((kind, k) => kind.joints.map((j) => {
    const own = D.bounds.find((bound) => bound.kind === k);
    return t.map((when) => (own ? 100 * used(at(when, j, own.order), own.pairs[j], own.ratio) : 0));
  }));
  const m = { name, duration, passed: found.passed.map(([, time]) => time), t, q: D.names.map((_, j) => t.map((when) => at(when, j, 0))), u: uses };
  const box = boxes[0].cloneNode(true), [, why] = box.querySelectorAll("p");
  for (const own of [".race-arm", ".race-bars"]) box.querySelector(own).replaceChildren();
  box.querySelector("b").textContent = name;
  box.querySelector("figcaption span").textContent = `${duration.toFixed(2)} s`;
  box.style.setProperty("--own", "currentColor");
  why.textContent = "Yours, read in this page.";
  box.querySelectorAll("li").forEach((item, n) => { item.textContent = m.passed[n].toFixed(2); });
  box.querySelector("ol").setAttribute("aria-label", `${name} passes the waypoints at, s`);
  find(".race-lanes").append(box);
  D.motions.push(m);
  lanes.push(lane(m, box));
  last = Math.max(last, duration);
  slider.max = Math.ceil(last * 100) / 100;
  said.textContent = found.said;
  stop("Play");
  show(now);
};
const own = find(".race-yours");
own.hidden = false;
own.querySelector("input").onchange = async ({ target }) => { for (const file of target.files) take(file.name, await file.text()); };
root.ondragover = (event) => event.preventDefault();
root.ondrop = async (event) => { event.preventDefault(); for (const file of event.dataTransfer.files) take(file.name, await file.text()); };
