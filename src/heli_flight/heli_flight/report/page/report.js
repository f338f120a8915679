"use strict";
(() => {
  const { figures, arrays, bands } = JSON.parse(document.getElementById("charts").textContent);
  const palette = JSON.parse(document.getElementById("palette").textContent);
  const root = document.documentElement;
  const button = document.getElementById("theme");
  const linked = document.getElementById("linked");
  const all = document.getElementById("all");
  const folds = [...document.querySelectorAll("details.section")];
  const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
  const coarse = window.matchMedia("(pointer: coarse)").matches;
  const font = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
  const drawn = new Map();
  // No policy of a page can forbid windows of other sites: this one opens none.
  window.open = () => null;
  // On paper: A4 and Letter have room for so many pixels between the margins of the style sheet.
  const PAPER_PX = 700;
  const STRIP_PX = 6;
  let narrow = false;
  let paper = false;
  let following = false;
  let chosen = null;
  let round = 0;
  let drawing = 0;

  for (const figure of figures) {
    figure.bands = bands[figure.bands];
    for (const trace of figure.data) for (const axis of ["x", "y"]) trace[axis] = arrays[trace[axis]];
  }

  const dark = () => !paper && root.dataset.theme === "dark";
  const colour = (role) => palette[role][dark() ? 1 : 0];
  const faded = (hex, alpha) => {
    const value = parseInt(hex.slice(1), 16);
    return `rgba(${value >> 16}, ${(value >> 8) & 255}, ${value & 255}, ${alpha})`;
  };

  function paintedData(figure) {
    const painted = figure.data.map((trace) => {
      const paint = colour(trace.meta.role);
      const copy = { ...trace, line: { ...trace.line, color: paint } };
      if (trace.marker) copy.marker = { ...trace.marker, color: paint };
      if (trace.meta.fill) copy.fillcolor = faded(paint, dark() ? 0.26 : 0.18);
      return copy;
    });
    return figure.bands.length ? [...painted, ...tellers(figure)] : painted;
  }

  function numbers(array) {
    const bytes = Uint8Array.from(atob(array.bdata), (c) => c.charCodeAt(0));
    return array.dtype === "f8" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
  }

  // In each panel an invisible line whose points tell the bands that they are in.
  function tellers(figure) {
    figure.tellers ??= timePanels(figure).map((panel) => {
      const own = figure.data.filter((trace) => trace.xaxis === panel.x && trace.hoverinfo !== "skip");
      const longest = own.reduce((best, t) => (!best || t.x.bdata.length > best.x.bdata.length ? t : best), null);
      if (!longest) return null;
      const [x, y, text] = [[], [], []];
      const [times, values] = [numbers(longest.x), numbers(longest.y)];
      times.forEach((time, i) => {
        const now = figure.bands.filter((band) => band.start_s <= time && time < Math.max(band.end_s, band.start_s + 1e-3));
        if (!now.length || !Number.isFinite(values[i])) return;
        x.push(time);
        y.push(values[i]);
        text.push(now.map(words).join("<br>"));
      });
      return {
        type: "scatter", mode: "lines", xaxis: panel.x, yaxis: panel.y, x, y, text, meta: { role: "muted" },
        hovertemplate: "%{text}<extra></extra>", showlegend: false, line: { width: 0, color: "rgba(0,0,0,0)" },
      };
    }).filter(Boolean);
    return figure.tellers;
  }

  const safe = (text) => text.replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);
  const words = (band) => safe(
    band.kind === "health" ? `${band.name}: ${band.detail}`
      : `${band.kind}: ${band.name}${band.kind === "mode" ? "" : `, ${band.start_s.toFixed(2)} to ${band.end_s.toFixed(2)} s`}`,
  );

  // Panels over flight time, by the names of their axes in traces.
  function timePanels(figure) {
    return Object.keys(figure.layout).filter((name) => figure.time && /^xaxis/.test(name))
      .map((name) => ({ x: `x${name.slice(5)}`, y: `y${name.slice(5)}` }));
  }

  function bandShapes(figure) {
    const shapes = [];
    for (const panel of timePanels(figure)) {
      for (const band of figure.bands) {
        const paint = colour(band.role);
        const shape = { type: "rect", xref: panel.x, yref: `${panel.y} domain`, x0: band.start_s, x1: band.end_s, y0: 0, y1: 1, layer: "below", line: { width: 0 } };
        if (band.kind === "mode" || band.kind === "health") {
          const at = band.kind === "mode" ? { yanchor: 1, y0: 0, y1: -STRIP_PX } : { yanchor: 0, y0: 0, y1: STRIP_PX };
          Object.assign(shape, at, { ysizemode: "pixel", fillcolor: faded(paint, 0.85), layer: "above" });
        } else if (band.end_s - band.start_s < 0.005) {
          Object.assign(shape, { type: "line", line: { width: 2, color: paint } });
        } else {
          Object.assign(shape, { fillcolor: faded(paint, dark() ? 0.2 : 0.15), line: { width: 1, color: faded(paint, 0.6) } });
        }
        shapes.push(shape);
      }
    }
    return shapes;
  }

  function height(figure, width) {
    if (figure.height) return figure.height;
    if (figure.square) return Math.min(width, paper ? 330 : 620) + (narrow ? 130 : 80);
    const each = paper ? 78 : narrow ? 150 : 175;
    const sum = figure.panels.reduce((total, share) => total + share, 0);
    return Math.round(each * sum + (paper ? 14 : 26) * (figure.panels.length - 1) + (narrow ? 120 : 90));
  }

  function paintedLayout(figure, width, zoom) {
    const ink = dark() ? "#d5dade" : "#2a2f34";
    const grid = dark() ? "#2f363c" : "#e3e7eb";
    const layout = {
      ...figure.layout,
      height: height(figure, width),
      width,
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: font, size: paper ? 9.5 : narrow ? 11 : 12.5, color: ink },
      // A square chart leaves room beside it; above it the legend would meet the buttons.
      modebar: { orientation: figure.square ? "v" : "h", bgcolor: "rgba(0,0,0,0)", color: dark() ? "#6d7780" : "#a9b1b8", activecolor: ink },
      margin: { l: narrow ? 50 : 64, r: narrow ? 8 : figure.square && !paper ? 44 : 14, t: paper ? 26 : 34, b: paper ? 34 : 44, pad: 0 },
      hoverlabel: { bgcolor: dark() ? "#20262b" : "#ffffff", bordercolor: grid, font: { color: ink, size: 12 } },
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1, yanchor: "bottom", font: { size: paper ? 9.5 : narrow ? 10.5 : 12 }, bgcolor: "rgba(0,0,0,0)", itemwidth: 30 },
      dragmode: coarse ? false : "zoom",
      uirevision: "kept",
    };
    for (const name of Object.keys(layout)) {
      if (!/^[xy]axis/.test(name)) continue;
      layout[name] = {
        gridcolor: grid, linecolor: ink, zerolinecolor: dark() ? "#4a545c" : "#c2c9cf", zerolinewidth: 1,
        showline: true, ticks: "outside", tickcolor: ink, ticklen: 4, automargin: name[0] === "y",
        mirror: true, ...layout[name],
      };
      if (zoom && zoom[name]) layout[name].range = zoom[name];
    }
    const spans = figure.layout.shapes.map((shape) => ({ ...shape, fillcolor: dark() ? "rgba(255,255,255,0.06)" : "rgba(0,0,0,0.045)" }));
    layout.shapes = [...spans, ...bandShapes(figure)];
    return layout;
  }

  function config(figure) {
    return {
      responsive: false, displaylogo: false, scrollZoom: false,
      displayModeBar: coarse || figure.height ? false : "hover",
      showSendToCloud: false, plotlyServerURL: "", showLink: false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { format: "svg", filename: figure.key },
    };
  }

  const placeOf = (figure) => document.getElementById(`chart-${figure.key}`);
  const widthOf = (figure) => {
    if (!paper) return placeOf(figure).clientWidth;
    return figure.height ? PAPER_PX / 2 - 12 : PAPER_PX;
  };
  // A chart in a section that is folded is drawn when that is opened.
  const isShown = (figure) => !placeOf(figure).closest("details:not([open])");

  async function draw(figure) {
    const place = placeOf(figure);
    const width = widthOf(figure);
    figure.round = round;
    // Plotly draws before it answers; the answer is that fonts and all else have settled.
    const settled = Plotly.react(place, paintedData(figure), paintedLayout(figure, width), config(figure));
    if (!drawn.has(figure.key)) {
      drawn.set(figure.key, place);
      if (figure.time) place.on("plotly_relayout", (change) => follow(figure, change));
    }
    await settled;
    // A chart is a picture with a name: the buttons above it are the pointer's, no stops of the Tab key.
    for (const button of place.querySelectorAll(".modebar-btn")) button.tabIndex = -1;
  }

  function follow(source, change) {
    if (following || !linked.checked) return;
    const keys = Object.keys(change);
    const reset = keys.some((key) => /^xaxis\d*\.autorange$/.test(key));
    const from = keys.find((key) => /^xaxis\d*\.range(\[0\])?$/.test(key));
    if (!reset && !from) return;
    const axis = from ? from.split(".")[0] : "xaxis";
    if (from && !tied(source, axis)) return;
    const whole = from ? change[`${axis}.range`] : null;
    const range = from ? whole || [change[`${axis}.range[0]`], change[`${axis}.range[1]`]] : null;
    following = true;
    const others = figures.filter((figure) => figure.time && figure !== source && drawn.has(figure.key));
    Promise.all(others.map((figure) => Plotly.relayout(
      drawn.get(figure.key), range ? { "xaxis.range": range.slice() } : { "xaxis.autorange": true },
    ))).finally(() => { following = false; });
  }

  function tied(figure, axis) {
    return axis === "xaxis" || figure.layout[axis].matches === "x";
  }

  // A table that is wider than the page says so, and can be scrolled by keys; no other is a stop.
  function hintTables() {
    for (const box of document.querySelectorAll(".scroll")) {
      const more = box.scrollWidth > box.clientWidth;
      box.classList.toggle("more", more);
      if (more) {
        box.tabIndex = 0;
        box.setAttribute("role", "region");
        box.setAttribute("aria-label", "Table, scrolls sideways");
      } else {
        for (const name of ["tabindex", "role", "aria-label"]) box.removeAttribute(name);
      }
      box.previousElementSibling.hidden = !more;
    }
  }

  // How far a chart is from what is looked at, px; 0 in the window.
  function away(figure) {
    const { top, bottom } = placeOf(figure).getBoundingClientRect();
    return Math.max(0, top - window.innerHeight, -bottom);
  }

  // Opens the section that an anchor is in; the anchor's element.
  function unfold() {
    const wanted = location.hash && document.getElementById(location.hash.slice(1));
    const fold = wanted && (wanted.closest("details.section") || wanted.querySelector(":scope > details.section"));
    if (fold) fold.open = true;
    return wanted;
  }

  // So that nothing moves when charts come in, and an anchor leads where it should.
  function reserve() {
    for (const figure of figures.filter(isShown)) {
      placeOf(figure).style.minHeight = `${height(figure, widthOf(figure))}px`;
    }
  }

  // Draws what can be seen of the page, the nearest first; afresh: all of it again.
  async function drawAll(afresh = true) {
    if (!afresh && drawing === round) return;
    if (afresh) round += 1;
    const mine = round;
    drawing = mine;
    narrow = !paper && window.innerWidth < 640;
    const wanted = mine === 1 && unfold();
    delete root.dataset.ready;
    hintTables();
    reserve();
    if (wanted) wanted.scrollIntoView({ behavior: "instant" });
    const left = () => figures.filter((figure) => isShown(figure) && figure.round !== mine);
    for (let rest = left(); rest.length && round === mine; rest = left()) {
      const next = rest.reduce((best, figure) => (away(figure) < away(best) ? figure : best));
      if (away(next) > 0) root.dataset.view = "true";
      await draw(next);
      await new Promise((resume) => setTimeout(resume, 0));
    }
    if (round !== mine) return;
    drawing = 0;
    root.dataset.view = "true";
    root.dataset.ready = "true";
  }

  function applyTheme() {
    root.dataset.theme = chosen || (prefersDark.matches ? "dark" : "light");
    button.textContent = dark() ? "Light" : "Dark";
  }

  // Everything as it stands on paper, before the printer's picture of the page is taken.
  function print(begins) {
    if (paper === begins) return;
    paper = begins;
    round += 1;
    for (const fold of folds) {
      if (paper) {
        fold.dataset.was = fold.open;
        fold.open = true;
      } else {
        fold.open = fold.dataset.was === "true";
      }
    }
    root.dataset.theme = paper ? "light" : chosen || (prefersDark.matches ? "dark" : "light");
    if (!paper) {
      drawAll();
      return;
    }
    narrow = false;
    for (const figure of figures.filter(isShown)) {
      placeOf(figure).style.minHeight = "0";
      draw(figure);
    }
  }

  button.addEventListener("click", () => {
    chosen = dark() ? "light" : "dark";
    applyTheme();
    drawAll();
  });
  prefersDark.addEventListener("change", () => { applyTheme(); drawAll(); });
  for (const details of document.querySelectorAll("details")) {
    details.addEventListener("toggle", () => {
      hintTables();
      if (paper || !details.open) return;
      reserve();
      drawAll(false);
    });
  }
  window.addEventListener("hashchange", () => unfold()?.scrollIntoView({ behavior: "instant" }));
  all?.addEventListener("click", () => {
    const open = folds.some((fold) => !fold.open);
    for (const fold of folds) fold.open = open;
    all.textContent = open ? "Fold all" : "Open all";
    drawAll();
  });
  // Where a server shows the page, what lies beside it is not served.
  if (location.protocol !== "file:") {
    for (const link of document.querySelectorAll(".links a")) link.replaceWith(link.textContent);
  }
  let pending = 0;
  let lastWidth = window.innerWidth;
  window.addEventListener("resize", () => {
    if (paper || window.innerWidth === lastWidth) return;
    lastWidth = window.innerWidth;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(drawAll);
  });
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
  applyTheme();
  drawAll();
})();
