"use strict";
// Plots over time with one cursor. Every replay has its colour; the cursor is the tick that the panes show.

const DASHES = [[], [6, 3], [2, 3]];
const PLOT_HEIGHT = 132;

const column = (values, k, width) => Float64Array.from({ length: values.length / width }, (_, i) => values[i * width + k]);
const micro = (values) => Float64Array.from(values, (v) => Math.max(v, 1) / 1000);

// What the times of the replays are: of one run each, the least of several, or nobody knows: tables of before do not tell.
function timesOf(replays) {
  const told = replays.map(({ runs }) => (!runs ? "runs not told" : runs === 1 ? "one run" : `least of ${runs} runs`));
  return [...new Set(told)].join("; ");
}

// title, unit, lines of one replay as [label, values, dash], and options of the panel.
const PANELS = [
  { title: "|F|", unit: "N", digits: 2, lines: (r) => [["", sizes(r.force_N), 0]] },
  { title: "Fx, Fy, Fz", unit: "N", digits: 2, note: "solid, dashed, dotted",
    lines: (r) => ["x", "y", "z"].map((axis, k) => [axis, column(r.force_N, k, 3), k]) },
  { title: "depth", unit: "mm", digits: 2, lines: (r) => [["", Float64Array.from(r.depth_m, (d) => 1000 * d), 0]] },
  { title: "turn of the force", unit: "deg per tick", digits: 2, lines: (r) => [["", Array.from(r.turn_deg, (v) => (v < 0 ? null : v)), 0]] },
  { title: "tick cost", unit: "us", note: timesOf, digits: 1, log: true, lines: (r) => [["", micro(r.tick_ns), 0]] },
  { title: "contact zones", unit: "", digits: 0, note: "dashed: areas", steps: true,
    lines: (r) => [["zones", Float64Array.from(r.zones), 0], ["areas", Float64Array.from(r.areas), 1]] },
];

class Plots {
  // seek(seconds) is called while the reader drags.
  constructor(holder, header, data, seek) {
    this.seek = seek;
    this.told = header.replays;
    this.replays = header.replays.map((_, i) => data[`replay${i}`]);
    this.time_s = 0;
    this.end_s = Math.max(...this.replays.map((r) => r.t_s[r.t_s.length - 1]));
    this.panels = PANELS.map((panel) => this.makePanel(holder, panel));
    new ResizeObserver(() => this.fit()).observe(holder);
  }

  makePanel(holder, panel) {
    const box = holder.appendChild(document.createElement("div"));
    box.className = "plot";
    const head = box.appendChild(document.createElement("h2"));
    head.append(panel.unit ? `${panel.title}, ${panel.unit}` : panel.title);
    const note = typeof panel.note === "function" ? panel.note(this.told) : panel.note;
    if (note) head.appendChild(document.createElement("span")).textContent = note;
    const lines = this.replays.map((replay) => panel.lines(replay));
    const series = [{}];
    lines.forEach((own, i) => own.forEach(([, , dash]) => series.push({
      stroke: () => css(`--replay${i}`), width: i === 0 && lines.length > 1 ? 2 : 1.2, dash: DASHES[dash],
      points: { show: false }, spanGaps: false, paths: panel.steps ? uPlot.paths.stepped({ align: 1 }) : undefined,
    })));
    const plot = new uPlot({
      width: box.clientWidth || 300, height: PLOT_HEIGHT, padding: [6, 10, 0, 0], legend: { show: false },
      scales: { x: { time: false, range: (_, low, high) => [low, high > low ? high : low + 1e-3] },
        y: panel.log ? { distr: 3 } : { range: (_, low, high) => wide(low, high) } },
      axes: [axis({ size: 26, values: (_, marks) => marks.map((v) => `${+v.toPrecision(6)}`) }),
        axis({ size: 46, values: (_, marks) => marks.map((v) => (v === null ? "" : `${+v.toPrecision(4)}`)),
          ...(panel.log ? { splits: (_, __, low, high) => decades(low, high) } : {}) })],
      series,
      cursor: { y: false, points: { size: 6 }, drag: { x: false, y: false }, bind: Object.fromEntries(
        ["mousedown", "mouseup", "click", "dblclick", "mousemove", "mouseleave", "mouseenter"].map((kind) => [kind, () => null])) },
      hooks: { draw: [(drawn) => this.point(drawn)] }, // size and scales are the new ones only now
    }, this.align(lines), box);
    this.listen(plot);
    return { ...panel, plot, box };
  }

  // The lines of all replays over common times.
  align(lines) {
    const times = this.replays.map((r) => Array.from(r.t_s));
    const same = times.every((t) => t.length === times[0].length && t.every((v, k) => v === times[0][k]));
    if (same) return [times[0], ...lines.flatMap((own) => own.map(([, values]) => values))];
    const tables = lines.map((own, i) => [times[i], ...own.map(([, values]) => Array.from(values))]);
    return uPlot.join(tables, tables.map((table) => table.map(() => 2))); // 2: gaps are drawn over
  }

  listen(plot) {
    const at = (event) => plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
    const drag = (event) => event.buttons & 1 && this.seek(at(event));
    plot.over.addEventListener("pointerdown", (event) => {
      plot.over.setPointerCapture(event.pointerId);
      drag(event);
    });
    plot.over.addEventListener("pointermove", drag);
    plot.over.addEventListener("dblclick", () => this.zoom(0, this.end_s));
    plot.over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const { min, max } = plot.scales.x, middle = at(event), factor = Math.exp(0.0015 * event.deltaY);
      this.zoom(Math.max(0, middle - (middle - min) * factor), Math.min(this.end_s, middle + (max - middle) * factor));
    }, { passive: false });
  }

  zoom(min, max) {
    if (max - min < 0.004) return;
    for (const { plot } of this.panels) plot.setScale("x", { min, max });
    this.show(this.time_s);
  }

  fit() {
    for (const { plot, box } of this.panels) {
      if (box.clientWidth > 0 && plot.width !== box.clientWidth) plot.setSize({ width: box.clientWidth, height: PLOT_HEIGHT });
    }
    this.show(this.time_s);
  }

  redraw() {
    for (const { plot } of this.panels) plot.redraw(false);
  }

  show(time_s) {
    this.time_s = time_s ?? 0;
    for (const { plot } of this.panels) this.point(plot);
  }

  // Line and dots of the cursor, both.
  point(plot) {
    const { min, max } = plot.scales.x, inside = this.time_s >= min && this.time_s <= max;
    plot.setCursor({ left: inside ? plot.valToPos(this.time_s, "x") : -10, top: inside ? 0 : -10 }, false);
  }
}

const axis = (options) => ({
  stroke: () => css("--soft"), font: "11px system-ui, Arial, sans-serif", gap: 4,
  grid: { stroke: () => css("--grid"), width: 1 }, ticks: { show: false }, ...options,
});

// Marks of a logarithmic axis: 1, 2, 5 in a short one, else powers of ten.
function decades(low, high) {
  const marks = [], parts = high / low < 200 ? [1, 2, 5] : [1];
  for (let ten = Math.floor(Math.log10(low)); ten <= Math.log10(high); ten++) marks.push(...parts.map((part) => part * 10 ** ten));
  return marks.filter((v) => v >= 0.999 * low && v <= 1.001 * high);
}

// A range with some air; never empty.
function wide(low, high) {
  if (low === null || high === null) return [0, 1];
  const least = Math.min(low, 0), most = Math.max(high, 0), air = 0.06 * (most - least || 1);
  return [least < 0 ? least - air : 0, most + air];
}
