// One problem's panel, built when it is opened. A part of script.js: it uses its names.
const figure = (panel, title, caption) => {
  const own = make("figure"), text = make("figcaption"), chart = make("div", "", { class: "chart" });
  text.append(make("b", `${title} `), caption);
  own.append(text, chart);
  panel.append(own);
  return chart;
};
const short = (label) => {  // two lines of a chart's margin at most
  const parts = label.split(/(?<=[:,])/), lines = [""];
  for (const part of parts) (lines.at(-1) + part).length > 24 ? lines.push(part) : lines[lines.length - 1] += part;
  return lines.length > 2 ? `${lines[0]}<br>${lines[1]}…` : lines.join("<br>");
};

const drawDurations = (chart, p, found) => {
  const own = rows.filter((r) => r.problem === p).reverse();
  const traces = own.map((row) => {
    const some = row.trials.filter((i) => trials.certified_duration[i] !== null);
    const k = row.planner;
    return {
      ...look(k), mode: "markers", x: some.map((i) => trials.certified_duration[i]), y: some.map(() => planners[k].label),
      customdata: some.map((i) => [trials.id[i], trials.seed[i], trials.gap[i] === null ? "" : `, gap ${trials.gap[i] < 0 ? "" : "+"}${signed(100 * trials.gap[i], 4)} %`]),
      marker: { symbol: some.map((i) => planners[k].symbol + (data.kept[i] ? "" : "-open")), size: 9, color: planners[k].colour, opacity: 0.8, line: { width: 1.5, color: planners[k].colour } },
      hovertemplate: "%{x:.6f} s%{customdata[2]}<br>seed %{customdata[1]}<extra>%{y}</extra>",
    };
  });
  const lost = own.filter((r) => r.trials.every((i) => trials.certified_duration[i] === null));
  const notes = lost.map((r) => {
    const i = r.trials[0], bound = trials.lower_bound[i];
    return { x: 0, xref: "paper", xanchor: "left", y: planners[r.planner].label, showarrow: false, font: { size: 11, color: "#595959" },
      text: bound === null ? `no answer: ${trials.status[i]}` : `no answer, lower bound ${bound.toFixed(4)} s` };
  });
  const order = own.map((r) => planners[r.planner].label);
  const i = own.flatMap((r) => r.trials).find((t) => trials.gap[t] !== null);
  const reference = i === undefined ? [] : [{ type: "line", x0: trials.certified_duration[i] / (1 + trials.gap[i]), x1: trials.certified_duration[i] / (1 + trials.gap[i]), y0: 0, y1: 1, yref: "paper", line: { color: "#b00020", width: 1, dash: "4px,2px" } }];
  draw(chart, traces, {
    height: 100 + 31 * own.length, shapes: reference, annotations: notes,
    xaxis: axis("certified duration (s)", { rangemode: "tozero" }),
    yaxis: axis("", { type: "category", categoryorder: "array", categoryarray: order, tickvals: order, ticktext: order.map(short), tickfont: { size: 11 } }),
  });
  chart.on("plotly_click", (event) => { location.hash = `trial-${event.points[0].customdata[0]}`; });
};

const drawMotions = (chart, found, joint) => {
  const traces = [], shapes = [], layout = { height: 130 + 165 * found.quantities.length, hovermode: "closest" };
  found.quantities.forEach(([name, unit], row) => {
    const suffix = row ? String(row + 1) : "", span = 1 / found.quantities.length;
    layout[`yaxis${suffix}`] = axis(`${name}<br>(${unit})`, { domain: [1 - (row + 1) * span + 0.025, 1 - row * span], nticks: 6 });
    for (const motion of found.motions) traces.push({ ...look(motion.planner, { width: 1.6 }), x: motion.t, y: motion.values[row][joint], mode: "lines", xaxis: "x", yaxis: `y${suffix}`, customdata: motion.t.map(() => motion.trial) });
    for (const limit of found.limits[name][joint]) if (limit !== null) shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: `y${suffix}`, y0: limit, y1: limit, line: { color: "#b00020", width: 1, dash: "4px,2px" } });
  });
  for (const motion of found.motions) traces.push({ ...look(motion.planner), mode: "markers", x: motion.passed, y: found.waypoints.map((w) => w[joint]), marker: { symbol: `${planners[motion.planner].symbol}-open`, size: 7, color: planners[motion.planner].colour }, hoverinfo: "skip", xaxis: "x", yaxis: "y" });
  layout.xaxis = axis("time (s)", { anchor: `y${found.quantities.length}`, rangemode: "tozero" });
  draw(chart, traces, { ...layout, shapes });
  chart.removeAllListeners("plotly_click");
  chart.on("plotly_click", (event) => { location.hash = `trial-${event.points[0].customdata}`; });
};

const drawUse = (chart, note, found, motion) => {
  const names = [], use = [];
  for (let joint = 0; joint < found.joints; joint += 1) {
    found.quantities.forEach(([name], order) => {
      const [low, high] = found.limits[name][joint], values = motion.values[order][joint];
      if (order === 0 || low === null || high === null || !values.some((v) => v)) return;
      names.push(`joint ${joint + 1} ${name.slice(0, 3)}${name.length > 4 ? "." : "k"}`);
      use.push(values.map((v) => Math.min(1, Math.max(v / high, v / low))));
    });
  }
  draw(chart, [{ type: "heatmap", x: motion.t, y: names, z: use, zmin: 0, zmax: 1, colorscale: "Cividis", xgap: 0, ygap: 1,
    colorbar: { title: { text: "use", side: "right" }, thickness: 12, tickformat: ".0%" }, hovertemplate: "%{y}: %{z:.1%} of the limit at %{x:.3f} s<extra></extra>" }], {
    height: 90 + 17 * names.length, xaxis: axis("time (s)"), yaxis: axis("", { autorange: "reversed", tickfont: { size: 11 }, showgrid: false }) });
  const held = motion.held.map(([joint, limit, start, end]) => `${limit} of joint ${joint + 1}, ${start.toFixed(2)}–${end.toFixed(2)} s`);
  note.textContent = `Some joint is at a limit (99 % or more) for ${(100 * motion.busy).toFixed(0)} % of the time${held.length ? `; the longest stretches: ${held.join("; ")}` : ""}.`;
};

const limitTable = (found) => {
  const table = make("table", "", { class: "limits" }), head = make("tr"), scroll = make("div", "", { class: "scroll" });
  const limited = found.quantities.filter(([name]) => found.limits[name].some((pair) => pair.some((v) => v !== null)));
  head.append(make("th", "joint"), ...limited.map(([name, unit]) => make("th", `${name} (${unit})`, { class: "n" })));
  table.append(make("thead"), make("tbody"));
  table.tHead.append(head);
  for (let j = 0; j < found.joints; j += 1) {
    const row = make("tr"), value = (v) => (v === null ? "none" : signed(v, 3));
    row.append(make("td", String(j + 1)), ...limited.map(([name]) => {
      const [low, high] = found.limits[name][j];
      const text = low === null && high === null ? "none" : low === -high ? `± ${value(high)}` : `${value(low)} to ${value(high)}`;
      return make("td", text, { class: "n" });
    }));
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
  drawDurations(figure(pair, "Certified durations.", "A mark per run, open where it had to be slowed down; dashed red: the reference. Click a mark for its trial."), p, found);
  if (found.convergence.length) {
    const chart = figure(pair, "Convergence.", "Best duration found by so many evaluations, as certified: median and quartiles over seeds.");
    const best = found.best === null ? [] : [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: found.best, y1: found.best, line: { width: 1, dash: "4px,2px" } }];
    draw(chart, found.convergence.flatMap((c) => band(c)), { xaxis: axis("evaluations", LOG), yaxis: axis("best duration (s)", LOG), shapes: best });
  }
  if (!found.motions.length) {
    panel.append(make("p", "Its trajectories are not in this page.", { class: "note" }));
    return;
  }
  panel.append(make("h3", "Trajectories"));
  const joints = select(panel, "Joint", [...Array(found.joints).keys()].map((j) => [j + 1, j]));
  panel.append(Object.assign($("legend").cloneNode(true), { id: "" }));
  const motions = figure(panel, "Median runs.", "Certified trajectories of each planner’s median run; dashed red: limits; marks: waypoints. Click a curve for its trial.");
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
