// Curves with their values on hover, drawn by uPlot. A chart is {label, unit, time, x, limits, span, logarithmic, events,
// series}; a series is {label, values, half, texts}: half is the width of the band to each side, texts what is read off.
function showCharts(root, charts) {
  const color = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const DASHES = [[], [8, 4], [8, 3, 2, 3], [2, 3]], made = [];

  function range(chart, low, high) {
    if (chart.limits) {
      const room = 0.03 * (chart.limits[1] - chart.limits[0]);
      return [chart.limits[0] - room, chart.limits[1] + room];
    }
    if (low === null) return [0, 1];
    // What is less looks as small as it is.
    const least = Math.max(chart.span * Math.max(Math.abs(low), Math.abs(high)), 1e-12), middle = 0.5 * (low + high);
    const half = 0.54 * Math.max(high - low, least);
    return [middle - half, middle + half];
  }

  function drawEvents(plot, chart) {
    const {ctx, bbox} = plot, ratio = devicePixelRatio;
    ctx.save();
    for (const [, begin, end] of chart.events) {
      const left = plot.valToPos(begin, "x", true), right = plot.valToPos(end, "x", true);
      if (left < bbox.left || left > bbox.left + bbox.width) continue;
      ctx.fillStyle = ctx.strokeStyle = color("--faint");
      ctx.globalAlpha = 0.18;
      ctx.fillRect(left, bbox.top, Math.max(right - left, 0), bbox.height);
      ctx.globalAlpha = 1;
      ctx.fillRect(left, bbox.top, ratio, bbox.height);
    }
    ctx.restore();
  }

  // Over the curves, and below each other where they are near.
  function nameEvents(plot, chart) {
    const {ctx, bbox} = plot, ratio = devicePixelRatio, named = [];
    ctx.save();
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    for (const [words, begin, end] of chart.events) {
      const left = plot.valToPos(begin, "x", true), at = end > begin ? left + 11 * ratio : left - 4 * ratio;
      if (left < bbox.left || left > bbox.left + bbox.width) continue;
      const length = ctx.measureText(words).width;
      let top = bbox.top + 4 * ratio;
      for (const one of named) if (Math.abs(one.at - at) < 13 * ratio) top = Math.max(top, one.foot + 8 * ratio);
      named.push({at, foot: top + length});
      ctx.fillStyle = color("--faint");
      ctx.translate(at, top);
      ctx.rotate(-Math.PI / 2);
      ctx.textAlign = "right";
      ctx.lineWidth = 3 * ratio;
      ctx.strokeStyle = color("--paper");
      ctx.strokeText(words, 0, 0);
      ctx.fillText(words, 0, 0);
      ctx.setTransform(1, 0, 0, 1, 0, 0);
    }
    ctx.restore();
  }

  function drawBand(plot, chart, number) {
    const {half, values} = chart.series[number - 1], {ctx, bbox} = plot;
    if (!half) return;
    const known = chart.x.map((_, k) => k).filter(k => values[k] !== null && half[k] !== null);
    const [low, high] = chart.limits || [-Infinity, Infinity];
    const at = (k, sign) => [plot.valToPos(chart.x[k], "x", true),
      plot.valToPos(Math.max(low, Math.min(high, values[k] + sign * half[k])), "y", true)];
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.beginPath();
    for (const k of known) ctx.lineTo(...at(k, 1));
    for (const k of known.reverse()) ctx.lineTo(...at(k, -1));
    ctx.globalAlpha = 0.18;
    ctx.fillStyle = color(`--curve-${(number - 1) % 7}`);
    ctx.fill();
    ctx.restore();
  }

  root.querySelectorAll(".chart").forEach((place, which) => {
    const chart = charts[which], last = chart.x.length - 1, ink = () => color("--ink"), edge = () => color("--edge");
    const axis = {stroke: ink, grid: {stroke: edge, width: 1}, ticks: {stroke: edge, width: 1}};
    const plot = new uPlot({
      width: place.clientWidth || 400, height: 230,
      cursor: {sync: {key: "run"}, y: false, drag: {x: true, y: false}, focus: {prox: -1}},
      scales: {x: {time: false, distr: chart.logarithmic ? 3 : 1}, y: {range: (_, low, high) => range(chart, low, high)}},
      axes: [{...axis, label: chart.time, labelSize: 22, size: 34}, {...axis, size: 62}],
      series: [{label: chart.time, value: (_, value) => value === null ? "" : `${+value.toPrecision(4)}`},
        ...chart.series.map((one, k) => ({
          label: one.label || chart.label, stroke: () => color(`--curve-${k % 7}`), width: 1.8, dash: DASHES[k % 4],
          points: {show: chart.x.length < 60, size: 5}, spanGaps: false,
          value: (_, value, __, at) => at === null || value === null ? "–" : `${one.texts[at]}${chart.unit && ` ${chart.unit}`}`,
        }))],
      hooks: {
        drawClear: [self => drawEvents(self, chart)],
        draw: [self => nameEvents(self, chart)],
        drawSeries: [(self, number) => drawBand(self, chart, number)],
        setCursor: [self => { if (self.cursor.idx === null || self.cursor.left < 0) self.setLegend({idx: last}); }],
      },
    }, [chart.x, ...chart.series.map(one => one.values)], place);
    plot.setLegend({idx: last});
    place.tabIndex = 0;
    place.setAttribute("role", "img");
    place.setAttribute("aria-label", `${chart.label} over time; arrow keys read values`);
    let at = last;
    place.addEventListener("keydown", event => {
      const step = {ArrowLeft: -1, ArrowRight: 1, Home: -last, End: last}[event.key];
      if (!step) return;
      event.preventDefault();
      at = Math.max(0, Math.min(last, at + step));
      plot.setCursor({left: plot.valToPos(chart.x[at], "x"), top: 10});
    });
    new ResizeObserver(() => {
      if (place.clientWidth) plot.setSize({width: place.clientWidth, height: 230});
    }).observe(place);
    made.push(plot);
  });

  const redraw = () => made.forEach(plot => plot.redraw(false, true));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  for (const [event, printed] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(event, () => {
      document.documentElement.classList.toggle("printed", printed);
      redraw();
    });
  }
}
