(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const places = [...document.querySelectorAll(".plot")];
  const drawn = new Set();
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const touch = matchMedia("(pointer: coarse)").matches;
  const phaseNames = {{ phase_names | tojson }};
  let ready = false, paper = false, window_ = {}, following = false;

  const colour = (name) => paper
    ? { ink: "#111", soft: "#444", grid: "#ddd", measured: "#111", nominal: "#d55e00", repaired: "#0072b2" }[name]
    : getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const style = { measured: ["solid", 2.4], nominal: ["dash", 1.7], repaired: ["solid", 1.5] };

  function dressed(figure, trial) {
    const data = figure.data.map((trace) => {
      const [dash, width] = style[trace.meta.role];
      return { ...trace, line: { color: colour(trace.meta.role), dash, width } };
    });
    const axis = { gridcolor: colour("grid"), linecolor: colour("soft"), zeroline: false, showline: true,
                   ticks: "outside", ticklen: 4, tickcolor: colour("soft") };
    const root = getComputedStyle(document.documentElement);
    const shapes = figure.layout.shapes.map((shape) => {
      const index = phaseNames.indexOf(shape.name);
      const tint = shape.name === "noise floor" ? "120,120,120" : index < 0 ? null : root.getPropertyValue("--p" + index).trim();
      const strength = shape.name === "noise floor" ? .3 : root.getPropertyValue("--shade").trim();
      return { ...shape, fillcolor: tint ? `rgba(${tint},${strength})` : "rgba(0,0,0,0)" };
    });
    const narrow = innerWidth < 640 && !paper;  // the legend goes below, out of the way of the buttons
    const layout = { ...figure.layout, shapes, height: narrow ? 380 : 390,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "x unified", dragmode: touch ? false : "zoom",
      hoverlabel: { bgcolor: paper ? "#fff" : colour("card"), font: { color: colour("ink") } },
      font: { color: colour("ink"), family: "system-ui, 'Segoe UI', Roboto, sans-serif", size: 12 },
      margin: { l: narrow ? 72 : 86, r: 12, t: 46, b: narrow ? 104 : 44 },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("ink") },
      legend: { orientation: "h", x: 0, xanchor: "left", y: narrow ? -0.29 : 1.085, yanchor: narrow ? "top" : "bottom", bgcolor: "rgba(0,0,0,0)" },
      annotations: figure.layout.annotations.map((a) => ({ ...a, font: { size: 10.5, color: colour("soft") } })),
      xaxis: { ...axis, ...figure.layout.xaxis, ...(window_[trial] ? { range: window_[trial] } : {}) },
      yaxis: { ...axis, ...figure.layout.yaxis } };
    if (figure.layout.yaxis2) layout.yaxis2 = { ...axis, ...figure.layout.yaxis2 };
    return [data, layout];
  }

  function draw(place) {
    const [data, layout] = dressed(figures[place.id], place.dataset.trial);
    Plotly.react(place, data, layout, { displaylogo: false, responsive: true, displayModeBar: touch ? true : "hover",
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"], toImageButtonOptions: { filename: place.dataset.channel, scale: 2 } });
    if (drawn.has(place)) return;
    drawn.add(place);
    place.textContent && place.querySelector(".waiting")?.remove();
    place.on("plotly_relayout", (change) => follow(place, change));
  }

  // A window chosen in one figure is the window of every figure of that trial.
  function follow(place, change) {
    if (following) return;
    const trial = place.dataset.trial;
    if ("xaxis.range[0]" in change) window_[trial] = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    else if (change["xaxis.autorange"]) delete window_[trial];
    else return;
    following = true;
    const others = [...drawn].filter((other) => other !== place && other.dataset.trial === trial);
    const range = window_[trial] || null;
    Promise.all(others.map((other) => Plotly.relayout(other,
      range ? { "xaxis.range": [...range] } : { "xaxis.range": [...figures[other.id].layout.xaxis.range] })))
      .finally(() => { following = false; });
  }

  async function load() {
    const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    ready = true;
    const seen = new IntersectionObserver((entries) => {
      for (const entry of entries) if (entry.isIntersecting) { seen.unobserve(entry.target); draw(entry.target); }
    }, { rootMargin: "500px" });
    places.forEach((place) => seen.observe(place));
    soon(rest);
  }

  // What is out of sight is drawn in idle moments, one figure at a time: a page that is captured whole has them all.
  const soon = (work) => window.requestIdleCallback ? requestIdleCallback(work, { timeout: 100 }) : setTimeout(work, 50);
  function rest() {
    const next = places.find((place) => !drawn.has(place) && !place.closest("details:not([open])"));
    if (next) { draw(next); soon(rest); }
  }

  function failed(fault) {
    for (const place of document.querySelectorAll(".waiting"))
      place.textContent = "This figure needs a browser of 2023 or later (Chrome 80, Firefox 113, Safari 16.4). " + (fault || "");
  }

  const again = () => drawn.forEach(draw);
  dark.addEventListener("change", again);
  addEventListener("beforeprint", () => {
    paper = true;
    document.querySelectorAll("details").forEach((d) => { d.dataset.was = d.open; d.open = true; });
    if (ready) places.forEach(draw);
  });
  addEventListener("afterprint", () => {
    paper = false;
    document.querySelectorAll("details").forEach((d) => { d.open = d.dataset.was === "true"; });
    again();
  });
  for (const details of document.querySelectorAll("details"))
    details.addEventListener("toggle", () => { if (ready && details.open) soon(rest); });
  if (places.length) requestAnimationFrame(() => setTimeout(() => load().catch(failed), 0));
})();
