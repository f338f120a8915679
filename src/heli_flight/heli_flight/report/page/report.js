"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("charts").textContent);
  const palette = JSON.parse(document.getElementById("palette").textContent);
  const root = document.documentElement;
  const button = document.getElementById("theme");
  const linked = document.getElementById("linked");
  const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");
  const coarse = window.matchMedia("(pointer: coarse)").matches;
  const font = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
  const drawn = new Map();
  // No policy of a page can forbid windows of other sites: this one opens none.
  window.open = () => null;
  let narrow = false;
  let following = false;
  let chosen = null;

  const dark = () => root.dataset.theme === "dark";
  const colour = (role) => palette[role][dark() ? 1 : 0];
  const faded = (hex, alpha) => {
    const value = parseInt(hex.slice(1), 16);
    return `rgba(${value >> 16}, ${(value >> 8) & 255}, ${value & 255}, ${alpha})`;
  };

  function paintedData(figure) {
    return figure.data.map((trace) => {
      const paint = colour(trace.meta.role);
      const copy = { ...trace, line: { ...trace.line, color: paint } };
      if (trace.marker) copy.marker = { ...trace.marker, color: paint };
      if (trace.meta.fill) copy.fillcolor = faded(paint, dark() ? 0.26 : 0.18);
      return copy;
    });
  }

  function height(figure, width) {
    if (figure.square) return Math.min(width, 620) + (narrow ? 130 : 80);
    const each = narrow ? 150 : 175;
    const sum = figure.panels.reduce((total, share) => total + share, 0);
    return Math.round(each * sum + 26 * (figure.panels.length - 1) + (narrow ? 120 : 90));
  }

  function paintedLayout(figure, width, zoom) {
    const ink = dark() ? "#d5dade" : "#2a2f34";
    const grid = dark() ? "#2f363c" : "#e3e7eb";
    const layout = {
      ...figure.layout,
      height: height(figure, width),
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: font, size: narrow ? 11 : 12.5, color: ink },
      // A square chart leaves room beside it; above it the legend would meet the buttons.
      modebar: { orientation: figure.square ? "v" : "h", bgcolor: "rgba(0,0,0,0)", color: dark() ? "#6d7780" : "#a9b1b8", activecolor: ink },
      margin: { l: narrow ? 50 : 64, r: narrow ? 8 : figure.square ? 44 : 14, t: 34, b: 44, pad: 0 },
      hoverlabel: { bgcolor: dark() ? "#20262b" : "#ffffff", bordercolor: grid, font: { color: ink, size: 12 } },
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1, yanchor: "bottom", font: { size: narrow ? 10.5 : 12 }, bgcolor: "rgba(0,0,0,0)", itemwidth: 30 },
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
    layout.shapes = (figure.layout.shapes ?? []).map((shape) => ({ ...shape, fillcolor: dark() ? "rgba(255,255,255,0.06)" : "rgba(0,0,0,0.045)" }));
    return layout;
  }

  function config(figure) {
    return {
      responsive: false, displaylogo: false, scrollZoom: false,
      displayModeBar: coarse ? false : "hover",
      showSendToCloud: false, plotlyServerURL: "", showLink: false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { format: "svg", filename: figure.key },
    };
  }

  async function draw(figure) {
    const place = document.getElementById(`chart-${figure.key}`);
    const width = place.clientWidth;
    await Plotly.react(place, paintedData(figure), paintedLayout(figure, width), config(figure));
    // A chart is a picture with a name: the buttons above it are the pointer's, no stops of the Tab key.
    for (const button of place.querySelectorAll(".modebar-btn")) button.tabIndex = -1;
    if (drawn.has(figure.key)) return;
    drawn.set(figure.key, place);
    if (figure.time) place.on("plotly_relayout", (change) => follow(figure, change));
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

  async function drawAll() {
    narrow = window.innerWidth < 640;
    hintTables();
    for (const figure of figures) {
      await draw(figure);
      await new Promise((resume) => setTimeout(resume, 0));
    }
    root.dataset.ready = "true";
  }

  function applyTheme() {
    root.dataset.theme = chosen || (prefersDark.matches ? "dark" : "light");
    button.textContent = dark() ? "Light" : "Dark";
  }

  button.addEventListener("click", () => {
    chosen = dark() ? "light" : "dark";
    applyTheme();
    drawAll();
  });
  prefersDark.addEventListener("change", () => { applyTheme(); drawAll(); });
  for (const details of document.querySelectorAll("details")) details.addEventListener("toggle", hintTables);
  let pending = 0;
  let lastWidth = window.innerWidth;
  window.addEventListener("resize", () => {
    if (window.innerWidth === lastWidth) return;
    lastWidth = window.innerWidth;
    cancelAnimationFrame(pending);
    pending = requestAnimationFrame(drawAll);
  });
  applyTheme();
  drawAll();
})();
