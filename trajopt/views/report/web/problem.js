// One problem's panel, built when it is opened. A part of script.js: it uses its names.
const figure = (panel, title, caption) => {
  const own = make("figure"), text = make("figcaption"), chart = make("div", "", { class: "chart", role: "group", "aria-label": title });
  text.append(make("b", `${title} `), caption);
  own.append(text, chart);
  panel.append(own);
  return chart;
};
const short = (label) => {  // two lines of a chart's margin at most
  const parts = label.split(/(?<=[:,])/).flatMap((part) => part.match(/.{1,24}/gsu) ?? []), lines = [""];
  for (const part of parts) (lines.at(-1) + part).length > 24 ? lines.push(part) : lines[lines.length - 1] += part;
  const shown = lines.map(plain);
  return shown.length > 2 ? `${shown[0]}<br>${shown[1]}…` : shown.join("<br>");
};

const durations = (p) => {
  const own = rows.filter((r) => r.problem === p).reverse();
  const traces = own.map((row) => {
    const some = row.trials.filter((i) => trials.certified_duration[i] !== null);
    const k = row.planner;
    return {
      ...look(k), mode: "markers", x: some.map((i) => trials.certified_duration[i]), y: some.map(() => k),
      customdata: some.map((i) => [trials.id[i], trials.seed[i], trials.gap[i] === null ? "" : `, gap ${trials.gap[i] < 0 ? "" : "+"}${signed(100 * trials.gap[i], 4)} %`]),
      marker: { symbol: some.map((i) => planners[k].symbol + (data.kept[i] ? "" : "-open")), size: 9, color: inked(planners[k].colour), opacity: 0.8, line: { width: 1.5, color: inked(planners[k].colour) } },
      hovertemplate: `%{x:.6f} s%{customdata[2]}<br>seed %{customdata[1]}<extra>${plain(planners[k].label)}</extra>`,
    };
  });
  const lost = own.filter((r) => r.trials.every((i) => trials.certified_duration[i] === null));
  const notes = lost.map((r) => {
    const i = r.trials[0], bound = trials.lower_bound[i];
    return { x: 0, xref: "paper", xanchor: "left", y: own.indexOf(r), showarrow: false, bgcolor: tone("ground"), font: { size: 11, color: tone("soft") },
      text: bound === null ? `no answer: ${trials.status[i]}` : `no answer, lower bound ${bound.toFixed(4)} s` };
  });
  const order = own.map((r) => r.planner), names = order.map((k) => short(planners[k].label));
  const i = own.flatMap((r) => r.trials).find((t) => trials.gap[t] !== null);
  const best = i === undefined ? null : trials.certified_duration[i] / (1 + trials.gap[i]);
  return [traces, {
    height: 100 + 31 * own.length, annotations: notes,
    shapes: best === null ? [] : [reference({ x0: best, x1: best, y0: 0, y1: 1, yref: "paper" })],
    xaxis: axis("certified duration (s)", { rangemode: "tozero" }),
    yaxis: axis("", { type: "category", categoryorder: "array", categoryarray: order, tickvals: order, ticktext: names, tickfont: { size: 11 }, range: [-0.6, order.length - 0.4] }),
  }];
};
const drawDurations = (chart, p) => {
  draw(chart, () => durations(p));
  chart.on("plotly_click", (event) => { location.hash = `trial-${event.points[0].customdata[0]}`; });
};

const motionsOf = (found, joint) => {
  const traces = [], shapes = [], layout = { height: 130 + 165 * found.quantities.length, hovermode: "closest" };
  found.quantities.forEach(([name], row) => {
    const suffix = row ? String(row + 1) : "", span = 1 / found.quantities.length;
    layout[`yaxis${suffix}`] = axis(`${name}<br>(${found.units[joint][row]})`, { domain: [1 - (row + 1) * span + 0.025, 1 - row * span], nticks: 6 });
    for (const motion of found.motions) traces.push({ ...look(motion.planner, { width: 1.6 }), x: motion.t, y: motion.values[row][joint], mode: "lines", xaxis: "x", yaxis: `y${suffix}`, customdata: motion.t.map(() => motion.trial) });
    if (found.segments[name]) {  // from waypoint to waypoint of each motion
      for (const motion of found.motions) found.segments[name].forEach((pairs, k) => {
        for (const limit of pairs[joint]) if (limit !== null) shapes.push(reference({ x0: motion.passed[k], x1: motion.passed[k + 1], xref: "x", yref: `y${suffix}`, y0: limit, y1: limit }));
      });
    } else for (const limit of found.limits[name][joint]) if (limit !== null) shapes.push(reference({ xref: "paper", x0: 0, x1: 1, yref: `y${suffix}`, y0: limit, y1: limit }));
  });
  const numbers = new Map();  // the waypoints, counted from 1, at each coordinate
  found.waypoints.forEach((w, n) => numbers.set(w[joint], [...(numbers.get(w[joint]) ?? []), n + 1]));
  const labelled = found.waypoints.length <= 8;
  layout.annotations = [];
  for (const [y, own] of numbers) {
    shapes.push({ type: "line", layer: "below", xref: "paper", x0: 0, x1: 1, yref: "y", y0: y, y1: y, line: { color: tone("faint"), width: 1, dash: "1px,3px" } });
    if (labelled) layout.annotations.push({ text: own.join(", "), xref: "paper", x: 1, xanchor: "left", yref: "y", y, showarrow: false, font: { size: 10, color: tone("soft") } });
  }
  for (const motion of found.motions) traces.push({
    ...look(motion.planner), mode: "markers", x: motion.passed, y: found.waypoints.map((w) => w[joint]),
    marker: { symbol: planners[motion.planner].symbol, size: 8, color: tone("ground"), line: { width: 1.6, color: inked(planners[motion.planner].colour) } },
    text: found.waypoints.map((w, n) => `waypoint ${n + 1}`), customdata: motion.passed.map(() => motion.trial),
    hovertemplate: `%{text}: %{y:.4f} ${found.units[joint][0]} at %{x:.4f} s<extra>${plain(planners[motion.planner].label)}</extra>`, xaxis: "x", yaxis: "y",
  });
  layout.margin = { l: 55, r: 34, t: 28, b: 45 };
  layout.xaxis = axis("time (s)", { anchor: `y${found.quantities.length}`, rangemode: "tozero" });
  return [traces, { ...layout, shapes }];
};
const drawMotions = (chart, found, joint) => {
  draw(chart, () => motionsOf(found, joint));
  chart.removeAllListeners("plotly_click");
  chart.on("plotly_click", (event) => { location.hash = `trial-${event.points[0].customdata}`; });
};

const drawUse = (chart, note, found, motion) => {
  const names = [], use = [];
  for (let joint = 0; joint < found.joints; joint += 1) {
    found.quantities.forEach(([name], order) => {
      const [low, high] = found.limits[name][joint], values = motion.values[order][joint];
      const own = (i) => found.segments[name][Math.max(motion.passed.findLastIndex((t) => t <= motion.t[i]), 0)] ?? found.segments[name].at(-1);
      if (order === 0 || low === null || high === null || !values.some((v) => v)) return;
      names.push(`${found.names[joint]} ${name.slice(0, 3)}${name.length > 4 ? "." : "k"}`);
      use.push(values.map((v, i) => {
        const [least, most] = found.segments[name] ? own(i)[joint] : [low, high];
        return Math.min(1, Math.max(v / (most ?? Infinity), v / (least ?? -Infinity)));
      }));
    });
  }
  for (const [name, values] of motion.uses) names.push(name), use.push(values.map((v) => Math.min(1, v)));
  draw(chart, () => [[{ type: "heatmap", x: motion.t, y: names, z: use, zmin: 0, zmax: 1, colorscale: "Cividis", xgap: 0, ygap: 1,
    colorbar: { title: { text: "use", side: "right" }, thickness: 12, tickformat: ".0%" }, hovertemplate: "%{y}: %{z:.1%} of the limit at %{x:.3f} s<extra></extra>" }], {
    height: 90 + 17 * names.length, xaxis: axis("time (s)"), yaxis: axis("", { autorange: "reversed", tickfont: { size: 11 }, showgrid: false }) }]);
  const held = motion.held.map(([joint, limit, start, end]) => `${limit.replaceAll("_", " ")}${joint === null ? "" : ` of ${found.names[joint]}`}, ${start.toFixed(2)}–${end.toFixed(2)} s`);
  note.textContent = `Some joint is at a limit (99 % or more) for ${(100 * motion.busy).toFixed(0)} % of the time${held.length ? `; the longest stretches: ${held.join("; ")}` : ""}.`;
};

const limitTable = (found) => {
  const table = make("table", "", { class: "limits" }), head = make("tr"), scroll = make("div", "", { class: "scroll" });
  const limited = found.quantities.filter(([name]) => found.limits[name].some((pair) => pair.some((v) => v !== null)));
  head.append(make("th", "joint"), ...limited.map(([name, unit]) => make("th", `${name} (${unit})`, { class: "n" })),
    ...found.others.map(([name]) => make("th", name, { class: "n" })));
  table.append(make("thead"), make("tbody"));
  table.tHead.append(head);
  scrolls.observe(scroll);
  for (let j = 0; j < found.joints; j += 1) {
    const row = make("tr"), value = (v) => (v === null ? "none" : signed(v, 3));
    row.append(make("td", found.names[j].replace(/^joint /, "")), ...limited.map(([name]) => {
      const [low, high] = found.limits[name][j];
      const text = found.spans[name] ? found.spans[name][j] : low === null && high === null ? "none" : low === -high ? `± ${value(high)}` : `${value(low)} to ${value(high)}`;
      return make("td", text, { class: "n" });
    }), ...found.others.map(([, cells]) => make("td", cells[j], { class: "n" })));
    table.tBodies[0].append(row);
  }
  scroll.append(table);
  return scroll;
};

const select = (panel, label, options) => {
  const line = make("p", "", { class: "controls" }), name = make("label", `${label} `), choice = make("select");
  options.forEach(([text, value]) => choice.append(option(text, value)));
  name.append(choice);
  line.append(name);
  panel.append(line);
  return choice;
};
const download = (name, text) => {
  const link = make("a", `save ${name}`, { download: name, href: `data:text/plain;charset=utf-8,${encodeURIComponent(text)}` });
  return link;
};

const fill = async (details) => {
  const panel = details.querySelector(".panel");
  if (panel.dataset.filled) return;
  panel.dataset.filled = "1";
  const p = Number(details.dataset.problem), found = JSON.parse(await unpack(`problem-${p}`));
  if (found.source) panel.append(make("p", `Source: ${found.source}`, { class: "note" }));
  panel.append(limitTable(found));
  const own = data.problems[p];
  if (own.toml) { const line = make("p"); line.append(download(own.file, own.toml)); panel.append(line); }
  const pair = make("div", "", { class: "grid" });
  panel.append(pair);
  const runs = figure(pair, "Certified durations.", "A mark per run, open where it had to be slowed down; dashed: the reference. Click a mark for its trial.");
  const searched = found.convergence.length
    ? figure(pair, "Convergence.", "Best certified duration by so many evaluations: median and quartiles over seeds; dashed: the best 3-5-3.") : null;
  drawDurations(runs, p);  // both are there first: a chart is as wide as its column
  if (searched) {
    const best = () => (found.best === null ? [] : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: found.best, y1: found.best, line: { color: tone("ink"), width: 1, dash: "4px,2px" } }]);
    draw(searched, () => [bands(found.convergence), { xaxis: evaluations(), yaxis: axis("best certified duration (s)", LOG), shapes: best() }]);
  }
  if (!found.motions.length) {
    panel.append(make("p", "Its trajectories are not in this page.", { class: "note" }));
    return;
  }
  panel.append(make("h3", "Trajectories"));
  const joints = select(panel, "Joint", found.names.map((name, j) => [name.replace(/^joint /, ""), j]));
  panel.append(Object.assign($("legend").cloneNode(true), { id: "" }));
  settle(panel.querySelector(".legend"));
  const motions = figure(panel, "Median runs.", "Certified trajectories of each planner’s median run; dashed: limits; marks and dotted lines, with their numbers: waypoints. Click a curve for its trial.");
  const redraw = () => drawMotions(motions, found, Number(joints.value));
  const travel = (j) => found.waypoints.slice(1).reduce((sum, w, n) => sum + Math.abs(w[j] - found.waypoints[n][j]), 0) / found.limits.velocity[j][1];
  joints.value = [...Array(found.joints).keys()].sort((a, b) => travel(b) - travel(a))[0];
  joints.onchange = redraw;
  redraw();
  panel.append(make("h3", "Use of the limits"));
  const whose = select(panel, "Planner", found.motions.map((m, i) => [planners[m.planner].label, i]));
  const note = make("p", "", { class: "use" });
  panel.append(note);
  const use = figure(panel, "Use of every limit.", "1 is at the limit; where all are below it, time is wasted.");
  const again = () => drawUse(use, note, found, found.motions[whose.value]);
  whose.onchange = again;
  again();
};
for (const details of all("details.problem")) details.addEventListener("toggle", () => { if (details.open) fill(details).catch(broken); });
