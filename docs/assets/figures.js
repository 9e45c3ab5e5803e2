// Draws the figures of the page, each from the JSON next to it.
for (const figure of document.querySelectorAll("figure.drawn")) {
  const { data, layout } = JSON.parse(figure.querySelector("script").textContent);
  Plotly.newPlot(figure.querySelector("div"), data, layout, { responsive: true, displaylogo: false, displayModeBar: false });
}
