// The page's behaviour. problem.js is included below, by the template engine, into one scope.
"use strict";
(async () => {
  const $ = (id) => document.getElementById(id);
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const unpack = async (id) => {
    const bytes = Uint8Array.from(atob($(`blob-${id}`).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  const make = (tag, text = "", attributes = {}) => {
    const element = document.createElement(tag);
    element.textContent = text;
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };
  const option = (text, value) => make("option", text, { value });
  const signed = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "−");
  const broken = (error) => { $("broken").hidden = false; $("broken").textContent = `This page is incomplete: ${error}`; };

  if (typeof DecompressionStream === "undefined") {
    broken("charts and trials need a browser from 2023 or later; the tables are whole.");
    return;
  }
  // An open document within it keeps the page loading: who takes a picture once it has loaded has the charts.
  const loading = document.body.appendChild(make("iframe", "", { hidden: "" }));
  loading.contentDocument.open();
  const data = JSON.parse(await unpack("data"));
  const library = make("script", await unpack("plotly"));
  document.head.append(library);
  const { planners, rows, trials } = data;
  const hidden = new Set();

  // ---- tables: sort, filter, hide planners -------------------------------------------------
  const SHOWN = matchMedia("(max-width: 640px)").matches ? 30 : 100;
  const body = $("result-table").tBodies[0];
  let limit = SHOWN;

  const apply = () => {
    const text = $("search").value.trim().toLowerCase();
    const planner = $("by-planner").value, status = $("by-status").value;
    const problems = new Set();
    let matching = 0;
    for (const row of body.rows) {
      const own = row.dataset;
      const matches = !hidden.has(Number(own.planner))
        && (planner === "" || own.planner === planner) && (status === "" || (status[0] === "!" ? own.status !== status.slice(1) : own.status === status))
        && (text === "" || row.cells[0].textContent.toLowerCase().includes(text)
          || planners[own.planner].label.toLowerCase().includes(text));
      if (matches) { matching += 1; problems.add(own.problem); }
      row.classList.toggle("out", !matches);
      row.classList.toggle("beyond", matches && matching > limit);
    }
    $("shown").textContent = `${Math.min(matching, limit)} of ${body.rows.length} rows`;
    $("more").hidden = matching <= limit;
    $("more").textContent = `show all ${matching}`;
    for (const panel of all("details.problem")) panel.classList.toggle("out", text !== "" && !problems.has(panel.dataset.problem));
    settle(body.parentNode);
  };

  // ---- every table is sorted by its headings -------------------------------------------------
  const key = (row, column) => {
    const cell = row.cells[column];
    const stated = cell.dataset.value, text = cell.textContent.trim();
    if (stated !== undefined) return stated === "" ? null : Number(stated);
    if (text === "" || text === "–") return null;
    if (/^(∞|none)/.test(text)) return Infinity;
    const number = text.replaceAll("\u202f", "").replaceAll("−", "-").match(/^[+×<≥ ]*(-?[\d.]+)/);
    return cell.classList.contains("n") && number ? Number(number[1]) : text.toLowerCase();
  };
  const compareKeys = (sign) => ([a], [b]) => {
    if (a === null || b === null) return (a === null) - (b === null);  // none comes last, either way
    return sign * (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(b, undefined, { numeric: true }));
  };
  const sort = (header, column) => {
    const sign = header.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of header.parentNode.cells) other.setAttribute("aria-sort", "none");
    header.setAttribute("aria-sort", sign === 1 ? "ascending" : "descending");
    const rows = header.closest("table").tBodies[0];
    const groups = [];  // a row, and those that follow it
    for (const row of rows.rows) row.dataset.of ? groups.at(-1)[1].push(row) : groups.push([key(row, column), [row]]);
    rows.append(...groups.sort(compareKeys(sign)).flatMap(([, own]) => own));
    if (rows === body) apply();
  };
  // What scrolls sideways is reached by the keyboard.
  const scrolls = new ResizeObserver((boxes) => boxes.forEach(({ target }) => {
    if (target.scrollWidth > target.clientWidth) target.tabIndex = 0; else target.removeAttribute("tabindex");
  }));
  all(".scroll").forEach((box) => scrolls.observe(box));
  for (const table of all("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((header, column) => {
      const button = make("button", header.textContent);
      button.onclick = () => sort(header, column);
      header.setAttribute("aria-sort", "none");
      header.replaceChildren(button);
    });
  }
  for (const id of ["search", "by-planner", "by-status"]) $(id).oninput = () => { limit = SHOWN; apply(); };
  $("more").onclick = () => { limit = Infinity; apply(); };

  // ---- one tab stop a table or legend; arrow keys move within it ------------------------------
  const ARROWS = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
  const ROVING = "table.sortable, .legend";
  const stops = (box) => (box.rows ? [...box.rows] : [box]).filter((row) => row.checkVisibility())
    .map((row) => all("a, button, summary", row)).filter((own) => own.length);
  const settle = (box) => {  // what is hidden is no stop
    if (all('[tabindex="0"]', box).some((own) => own.checkVisibility())) return;
    all("a, button, summary", box).forEach((own) => { own.tabIndex = -1; });
    const [first] = stops(box);
    if (first) first[0].tabIndex = 0;
  };
  document.addEventListener("keydown", (event) => {
    const box = event.target.closest(ROVING), move = ARROWS[event.key];
    if (!box || !move) return;
    const found = stops(box), row = found.findIndex((own) => own.includes(event.target));
    const next = found[row + move[0]], column = found[row]?.indexOf(event.target) + move[1];
    if (row < 0 || !next || column < 0 || (move[1] && column >= next.length)) return;
    event.preventDefault();
    event.target.tabIndex = -1;
    const to = next[Math.min(column, next.length - 1)];
    to.tabIndex = 0;
    to.focus();
  });

  // ---- charts ------------------------------------------------------------------------------
  const FAMILY = "system-ui, 'Segoe UI', Roboto, 'Liberation Sans', Arial, sans-serif";
  const BLACK = "#000000";
  const CONFIG = { responsive: false, displaylogo: false, modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]] };
  const tone = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const inked = (colour) => (colour === BLACK ? tone("ink") : colour);  // black is ink: light on dark
  const plain = (name) => name.replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);  // Plotly reads HTML
  const axis = (title, more = {}) => ({
    title: { text: title, standoff: 8 }, showline: true, linecolor: tone("ink"), tickcolor: tone("ink"), ticks: "outside",
    ticklen: 4, gridcolor: tone("grid"), zeroline: false, automargin: true, ...more,
  });
  const reference = (more) => ({ type: "line", line: { color: tone("soft"), width: 1, dash: "4px,2px" }, ...more });
  const look = (k, more = {}) => ({
    mode: "lines+markers", name: plain(planners[k].label),
    marker: { symbol: planners[k].symbol, size: 7, maxdisplayed: 6 }, meta: k, visible: !hidden.has(k),
    line: { color: inked(planners[k].colour), dash: planners[k].dash, width: 1.9, ...more },
  });
  const HEIGHT = 350;
  const drawn = new Map();  // a chart's element, and what makes its traces and layout anew
  // A chart is as wide as its column, whatever comes beside it later.
  const fitted = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      if (contentRect.width && target.layout?.autosize && Math.abs(target.layout.width - contentRect.width) > 1) Plotly.relayout(target, { width: contentRect.width, autosize: true });
    }
  });
  const draw = (element, make) => {
    const [traces, layout] = make();
    const height = layout.height ?? HEIGHT;
    drawn.set(element, make);
    element.style.height = element.style.minHeight = `${height}px`;
    const whole = {
      font: { family: FAMILY, size: 12, color: tone("ink") }, showlegend: false, hovermode: "closest",
      margin: { l: 55, r: 12, t: 28, b: 45 }, paper_bgcolor: "#0000", plot_bgcolor: "#0000",
      modebar: { bgcolor: "#0000", color: tone("soft"), activecolor: tone("ink") },
      hoverlabel: { namelength: -1, bgcolor: tone("ground"), font: { color: tone("ink") } },
      autosize: true, height, width: element.clientWidth || undefined, ...layout,
    };
    fitted.observe(element);
    Plotly.react(element, traces, whole, CONFIG);
    for (const button of all(".modebar-btn", element)) button.tabIndex = -1;  // a mouse zooms
    for (const picture of all(".main-svg", element)) picture.setAttribute("aria-hidden", true);  // its name says it
  };
  const redraw = () => { for (const [element, make] of drawn) draw(element, make); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  const bands = (curves) => {
    const top = Math.max(...curves.flatMap((curve) => [...curve.low, ...curve.middle, ...curve.high]));
    return curves.flatMap((curve) => {
      const k = curve.planner, whole = { meta: k, visible: !hidden.has(k), hoverinfo: "skip" };
      const from = Math.max(0, curve.middle.findIndex((v) => v !== null));  // half have no answer before
      const edge = { mode: "lines", line: { width: 0, shape: "hv" }, x: curve.x.slice(from) };
      const high = curve.high.slice(from).map((v) => v ?? top);  // endless where a quarter has none
      return [
        { ...edge, y: curve.low.slice(from), ...whole },
        { ...edge, y: high, fill: "tonexty", fillcolor: `${inked(planners[k].colour)}22`, ...whole },
        { ...look(k, { shape: "hv" }), x: curve.x, y: curve.middle },
      ];
    });
  };
  const steps = (curve) => ({ ...look(curve.planner, { shape: "hv" }), x: curve.x, y: curve.y });
  const share = () => axis("share", { range: [-0.02, 1.03], tickformat: ".0%" });
  const LOG = { type: "log", exponentformat: "none", nticks: 8 };
  const TIMES = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 1e4, 1e5];
  const times = (curves) => (Math.max(...curves.flatMap((curve) => curve.x)) > 3 ? { tickvals: TIMES } : {});
  const evaluations = () => axis("evaluations", { type: "log", exponentformat: "none", dtick: 1 });

  const whole = () => data.suites[$("suite").value];
  const drawSuite = () => {
    const suite = whole();
    const partly = Object.entries(suite.partly).map(([name, n]) => `${name} (${n} of ${suite.problems})`);
    const counted = Object.entries(suite.counted).map(([name, said]) => `${name} (${said})`);
    const kinds = Object.entries(suite.kinds).map(([kind, n]) => `${n} to ${kind === "lower bound" ? "a lower bound" : kind === "relaxed" ? "the best known without some of the limits" : kind === "exact" ? "the exact optimum" : kind === "best known" ? "the best known" : "refined collocation"}`);
    $("suite-note").textContent = `${suite.problems} problem${suite.problems > 1 ? "s" : ""}; gaps: ${[...kinds, ...(suite.unknown ? [`${suite.unknown} unknown`] : [])].join(", ")}.`
      + (partly.length ? ` Not run on all of them, so left out of the first two charts: ${partly.join(", ")}.` : "")
      + (counted.length ? ` Planners that refuse some problems plan on: ${counted.join(", ")}.` : "")
      + (suite.convergence.length ? ` Running times and convergence: of the ${suite.searched} whose best 3-5-3 is known.` : "");
    draw($("profile"), () => [whole().profile.map(steps), { xaxis: axis("times the shortest of all answers", { ...LOG, nticks: 6, ...times(whole().profile) }), yaxis: share() }]);
    draw($("ecdf"), () => [whole().ecdf.map(steps), { xaxis: axis("gap (%)", { ...LOG, dtick: 1 }), yaxis: share() }]);
    for (const figure of all(".searches")) figure.hidden = !suite.convergence.length;
    if (!suite.convergence.length) return;
    draw($("times"), () => [whole().times.map(steps), { xaxis: evaluations(), yaxis: share() }]);
    draw($("convergence"), () => [bands(whole().convergence), { xaxis: evaluations(), yaxis: axis("duration over the best 3-5-3", LOG) }]);
  };

  // ---- tables of a suite: what a search costs, and planners against one of them --------------
  const write = (cell, [text, small]) => cell.querySelector("a").replaceChildren(text, ...(small ? [" ", make("small", small)] : []));
  const writeRows = (table, lines, more = () => {}) => {
    for (const row of $(table).tBodies[0].rows) {
      const k = Number(row.dataset.planner), part = row.dataset.of;
      const line = part ? lines[k]?.[part] : lines[k];
      row.classList.toggle("out", hidden.has(k) || !line);
      if (!line) continue;
      (line.cells ?? line).forEach((found, i) => { if (row.cells[i + 1].querySelector("a")) write(row.cells[i + 1], found); });
      more(row, line);
    }
    settle($(table));
  };
  const judged = (row, line) => {
    ["--at", "--low", "--high"].forEach((name, i) => row.querySelector(".whisker")?.style.setProperty(name, line.whisker[i]));
    row.classList.toggle("sure", line.real === "yes" || line.real === "proved");
    row.querySelector(".real").textContent = line.real;
  };
  const compare = () => {
    const suite = whole(), against = $("against").value;
    $("rival").textContent = planners[against].label;
    $("rival-suite").textContent = `${suite.name} (${suite.problems})`;
    writeRows("ert-table", suite.ert);
    writeRows("paired-table", suite.paired[against], judged);
    if (!data.seeds.length) return;
    const own = data.seeds[$("seed-problem").value];
    const met = Object.keys(own.paired[against]).length ? against : own.first;
    $("seeds").querySelector(".rival").textContent = planners[met].label;
    $("no-rival").hidden = met === against;
    $("no-rival").querySelector(".chosen").textContent = planners[against].label;
    writeRows("seed-table", own.paired[met], judged);
  };
  if (data.seeds.length) $("seed-problem").onchange = compare;
  $("against").onchange = compare;
  for (const box of all(".suite")) {
    data.suites.forEach((suite, i) => box.append(option(`${suite.name} (${suite.problems})`, i)));
    box.onchange = () => {
      for (const other of all(".suite")) other.value = box.value;
      drawSuite();
      compare();
    };
  }

  const toggle = (k) => {
    hidden.has(k) ? hidden.delete(k) : hidden.add(k);
    const shown = !hidden.has(k);
    all(`.toggle[data-planner="${k}"]`).forEach((b) => b.setAttribute("aria-pressed", shown));
    apply();
    compare();
    for (const element of drawn.keys()) {
      const own = element.data.map((t, i) => (t.meta === k ? i : -1)).filter((i) => i >= 0);
      if (own.length) Plotly.restyle(element, { visible: shown }, own);
    }
  };
  document.addEventListener("click", (event) => {
    const button = event.target.closest(".toggle");
    if (button) toggle(Number(button.dataset.planner));
  });

  // ---- one problem -------------------------------------------------------------------------
  {% include "problem.js" %}

  // ---- trials behind a number --------------------------------------------------------------
  const COLUMNS = [
    ["seed", "seed", String], ["status", "status", String], ["claimed (s)", "claimed_duration", 6], ["certified (s)", "certified_duration", 6],
    ["gap (%)", "gap", (v) => (v < 0 ? "" : "+") + signed(100 * v, 4)], ["dilation", "dilation", 6],
    ["∫ jerk²", "jerk_integral", (v) => v.toPrecision(4)], ["evaluations", "evaluations", 0],
    ["time (s)", "solve_time", 4], ["library (s)", "library_time", 6], ["setup (s)", "setup_time", 4], ["lower bound (s)", "lower_bound", 6],
  ];
  const SOURCE = { median: "certified_duration", quartiles: "certified_duration", gap: "gap", dilation: "dilation", jerk_integral: "jerk_integral", evaluations: "evaluations", solve_time: "solve_time", library_time: "library_time" };
  const shown = (value, form) => (value === null ? "–" : typeof form === "number" ? signed(value, form) : form(value));

  const sources = (own, column) => {  // the trials in the middle, of those that have the number
    const name = SOURCE[column];
    if (!name) return column === "status" ? own.filter((i) => trials.status[i] !== "solved").slice(0, 1) : own;
    const kept = own.filter((i) => trials[name][i] !== null && !(column === "dilation" && data.kept[i]));
    if (column === "quartiles") return kept;
    kept.sort((a, b) => trials[name][a] - trials[name][b]);
    return kept.slice(Math.ceil(kept.length / 2) - 1, Math.floor(kept.length / 2) + 1);
  };

  // not broken at the hyphens within its words
  const command = (text) => {
    const code = make("code", "", { class: "command" });
    for (const word of text.split(" ")) code.append(make("span", word), " ");
    return code;
  };

  const showTrial = (i, row) => {
    all("#trial-table tr").forEach((r) => r.classList.toggle("chosen", r.dataset.trial === String(i)));
    const own = $("trial"), file = `trials/${trials.id[i]}.json`, problem = data.problems[row.problem];
    const options = Object.entries(planners[row.planner].options).map(([name, value]) => `${name}=${value}`).join(", ");
    const stored = make("p"), again = make("p", row.instead || "Run it again:");
    stored.append("Trial ", make("code", trials.id[i]), ...(data.files ? [", stored in ", make("a", file, { href: file })] : [", stored in the results file"]));
    if (row.spec) again.append(command(`${row.spec} --seed ${trials.seed[i]}`));
    if (problem.toml) again.append(download(problem.file, problem.toml));
    own.replaceChildren(make("h3", `Seed ${trials.seed[i]}: ${trials.status[i]}`), stored, again, make("p", `Options: ${options || "none"}`, { class: "note" }));
    const message = data.messages[data.message[i]];
    if (message) own.append(make("pre", message));
  };

  const showTrials = (r, column, chosen) => {
    const row = rows[r], from = new Set(chosen === undefined ? sources(row.trials, column) : []);
    $("trials-title").textContent = `${planners[row.planner].label} on ${data.problems[row.problem].name}`;
    $("trials-note").textContent = `${row.trials.length} trial${row.trials.length > 1 ? "s" : ""}${from.size ? "; what the number comes from is bold" : ""}. Choose one for its file, its command and its message.`;
    const head = make("tr");
    head.append(...COLUMNS.map(([title, , form]) => make("th", title, { class: form === String ? "" : "n" })));
    $("trial-table").createTHead().replaceChildren(head);
    $("trial-table").tBodies[0].replaceChildren(...row.trials.map((i) => {
      const line = make("tr", "", { "data-trial": i, id: `trial-${trials.id[i]}`, tabindex: 0 });
      line.append(...COLUMNS.map(([, name, form]) => {
        const value = trials[name][i];
        const bold = from.has(i) && (SOURCE[column] === name || !SOURCE[column]);
        return make("td", shown(value, form), { class: `${form === String ? "" : "n"}${bold ? " from" : ""}`, "data-value": value ?? "" });
      }));
      line.onclick = () => showTrial(i, row);
      line.onkeydown = (event) => { if (event.key === "Enter") showTrial(i, row); };
      return line;
    }));
    showTrial(chosen ?? [...from][0] ?? row.trials[0], row);
    if (!$("trials").open) $("trials").showModal();
  };
  $("trials").addEventListener("close", () => history.replaceState(null, "", location.pathname + location.search));
  $("trials").addEventListener("click", (event) => { if (event.target === $("trials")) $("trials").close(); });

  const follow = () => {
    const [, kind, rest = "", column] = location.hash.match(/^#(row|trial|problem|planner)-([^-]+)-?(.*)$/) ?? [];
    if (kind === "row" && rows[rest]) showTrials(Number(rest), column);
    if (kind === "trial") {
      const i = trials.id.indexOf(rest), r = rows.findIndex((row) => row.trials.includes(i));
      if (r >= 0) showTrials(r, "", i);
    }
    if (kind === "problem" && $(`problem-${rest}`)) { $(`problem-${rest}`).open = true; $(`problem-${rest}`).scrollIntoView(); }
    if (kind === "planner" && planners[rest]) {
      $("by-planner").value = rest;
      if (hidden.has(Number(rest))) toggle(Number(rest));
      apply();
      $("results").scrollIntoView();
    }
  };
  window.addEventListener("hashchange", follow);

  // ---- paper -------------------------------------------------------------------------------
  const PAPER = 660;  // px between the margins of A4
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("paper");  // black on white
    redraw();
    for (const element of drawn.keys()) {
      const half = element.closest(".grid") !== null;
      Plotly.relayout(element, { width: half ? PAPER / 2 - 10 : PAPER, autosize: false });
    }
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("paper");
    redraw();
  });

  apply();
  drawSuite();
  compare();
  for (const box of all(ROVING)) settle(box);
  const first = $("problem-0");
  if (first) {
    first.classList.add("unasked");  // not printed
    first.querySelector("summary").addEventListener("click", () => first.classList.remove("unasked"));
    first.open = true;
    await fill(first);
  }
  follow();
  document.documentElement.dataset.ready = "1";
  loading.remove();
})().catch((error) => {
  const box = document.getElementById("broken");
  box.hidden = false;
  box.textContent = `This page is incomplete: ${error}`;
  throw error;
});
