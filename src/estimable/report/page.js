"use strict";
(function () {
  const page = JSON.parse(document.getElementById("data").textContent);
  const times = Float64Array.from(atob(page.times), c => c.charCodeAt(0));
  const x = new Float64Array(Uint8Array.from(times).buffer);
  const ends = [x[0], x[x.length - 1]].map(value => page.logAxis ? Math.log10(value) : value);
  const narrow = () => window.innerWidth < 620;
  const charts = page.charts.map((chart, i) => [document.getElementById("chart" + i), chart]);

  function layout(chart) {
    const axis = { showline: true, linecolor: "#767676", ticks: "outside", tickcolor: "#767676", gridcolor: "#e2e2e2",
                   zeroline: false, automargin: true };
    const size = narrow() ? 13 : 15;
    const font = { family: 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif', size: size, color: "#1a1a1a" };
    const y = Object.assign({}, axis, chart.layout.yaxis);
    const time = { type: page.logAxis ? "log" : "linear", title: { text: page.timeAxis }, range: ends.slice() };
    return Object.assign({ hovermode: "x unified" }, chart.layout, {
      autosize: true, font: font, showlegend: false, dragmode: "zoom",
      paper_bgcolor: "#fff", plot_bgcolor: "#fff", hoverlabel: { font: font },
      margin: { l: narrow() ? 68 : 86, r: 12, t: 10, b: 48 },
      xaxis: Object.assign({}, axis, chart.layout.xaxis || time),
      yaxis: y
    });
  }

  const config = { responsive: true, displaylogo: false, displayModeBar: false, doubleClick: "reset" };
  let linking = false;
  for (const [place, chart] of charts) {
    const traces = chart.traces.map(trace => Object.assign({ type: "scatter" }, chart.layout.xaxis ? {} : { x: x }, trace));
    Plotly.newPlot(place, traces, layout(chart), config);
    if (chart.layout.xaxis) continue;
    place.on("plotly_relayout", change => {
      const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
      if (linking || (from === undefined && !change["xaxis.autorange"])) return;
      linking = true;
      const range = from === undefined ? ends.slice() : [from, to];
      Promise.all(charts.filter(other => other[0] !== place && !other[1].layout.xaxis).map(other => Plotly.relayout(other[0], { "xaxis.range": range.slice() })))
        .then(() => { linking = false; });
    });
  }
  window.addEventListener("beforeprint", () => charts.forEach(([place]) => Plotly.relayout(place, { width: place.classList.contains("square") ? 420 : 670, height: place.classList.contains("square") ? 380 : 205 })));
  window.addEventListener("afterprint", () => charts.forEach(([place]) => Plotly.relayout(place, { autosize: true, width: null, height: null })));
})();
