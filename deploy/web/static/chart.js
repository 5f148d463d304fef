// A chart of lines with bands, single dots, marks with whiskers, and levels to compare with. Read by pointer or arrows.

import { h, replace, s } from "./dom.js";
import { fixed, whole } from "./format.js";
import { apart, extent, linear, ticks } from "./scales.js";

const MARGIN = { left: 50, right: 14, top: 10, bottom: 30 };
const LABELS = 138; // pixels beside the plot
const MANY = 24; // marks, which are then smaller
const WIDE = 560; // from here on there is room for them
const path = (points) => points.map(([x, y], at) => `${at ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");

/** How a series is drawn in a legend: colour and dashes, so that neither is needed to tell it from others. */
export const swatch = (style, mark = false, dash = style) => s("svg", { viewBox: "0 0 26 12", width: 26, height: 12, class: "swatch", "aria-hidden": "true" },
  s("line", { x1: 1, x2: 25, y1: 6, y2: 6, class: `c${style % 8} d${dash % 8}` }),
  mark && s("circle", { cx: 13, cy: 6, r: 4, class: `f${style % 8}` }));

export class Chart {
  /** @param options label: what it shows; height; x and y: names of the axes; digits: of values */
  constructor(options) {
    this.options = { height: 300, digits: 3, x: "episode", ...options };
    this.data = null;
    this.at = null;
    this.svg = s("svg", { role: "img", tabindex: 0, "aria-label": options.label });
    this.tip = h("div", { class: "tip", hidden: true });
    this.said = h("div", { class: "hidden-text", "aria-live": "polite" });
    this.element = h("div", { class: "chart" }, this.svg, this.tip, this.said);
    this.svg.addEventListener("pointermove", (event) => this.point(event.offsetX));
    this.svg.addEventListener("pointerleave", () => this.leave());
    this.svg.addEventListener("blur", () => this.leave());
    this.svg.addEventListener("keydown", (event) => this.step(event));
    new ResizeObserver(() => this.draw()).observe(this.element);
  }

  /**
   * @param data xMax; series: [{name, style, dash, thin, points: [[x, y]], band: [[x, low, high]], dots: [[x, y]]}];
   *   marks: [{name, style, points: [{x, y, low, high}]}]; references: [{name, y}]; empty: what to say if there is nothing
   */
  update(data) {
    this.data = data;
    this.draw();
  }

  draw() {
    const width = this.element.clientWidth;
    if (!this.data || !width) return;
    const { series = [], marks = [], references = [] } = this.data;
    const height = this.options.height;
    const labels = references.length && width >= WIDE ? LABELS : 0;
    const right = width - MARGIN.right - labels;
    const values = [
      ...series.flatMap((one) => [...one.points.map((point) => point[1]), ...(one.band ?? []).flatMap((part) => [part[1], part[2]])]),
      ...series.flatMap((one) => (one.points.length ? [] : (one.dots ?? []).map((dot) => dot[1]))),
      ...marks.flatMap((one) => one.points.flatMap((point) => [point.y, point.low ?? point.y, point.high ?? point.y])),
      ...references.map((one) => one.y),
    ];
    const [low, high] = this.data.range ?? extent(values, [-1, 0]);
    const x = linear([0, this.data.xMax || 1], [MARGIN.left, right]);
    const y = linear([low, high], [height - MARGIN.bottom, MARGIN.top]);
    this.scale = { x, y, right, width };
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.setAttribute("height", height);
    replace(this.svg,
      this.axes(x, y, low, high, right, height),
      s("defs", {}, s("clipPath", { id: this.clip() }, s("rect", { x: MARGIN.left, y: 0, width: right - MARGIN.left + 6, height: height - MARGIN.bottom + 3 }))),
      s("g", { "clip-path": `url(#${this.clip()})` },
        series.map((one) => this.backdrop(one, x, y)),
        references.map((one) => s("line", { class: "reference", x1: MARGIN.left, x2: right, y1: y(one.y), y2: y(one.y) })),
        series.map((one) => s("path", { class: `line c${one.style % 8} d${(one.dash ?? one.style) % 8}${one.thin ? " thin" : ""}`, d: path(one.points.map((point) => [x(point[0]), y(point[1])])) })),
        marks.map((one) => this.marks(one, x, y))),
      this.referenceLabels(references, y, right, height, labels),
      values.length === 0 && s("text", { class: "empty", x: (MARGIN.left + right) / 2, y: height / 2 }, this.data.empty ?? "nothing yet"),
      (this.cursor = s("line", { class: "cursor", y1: MARGIN.top, y2: height - MARGIN.bottom, visibility: "hidden" })));
    if (this.at !== null) this.show(this.at);
  }

  clip() {
    this.id ??= `clip-${Math.random().toString(36).slice(2)}`;
    return this.id;
  }

  axes(x, y, low, high, right, height) {
    const bottom = height - MARGIN.bottom;
    return s("g", {},
      ticks(low, high, height / 55).map((value) => [
        s("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(value), y2: y(value) }),
        s("text", { x: MARGIN.left - 8, y: y(value) + 4, "text-anchor": "end" }, this.written(value)),
      ]),
      s("line", { class: "axis", x1: MARGIN.left, x2: right, y1: bottom, y2: bottom }),
      ticks(0, this.data.xMax || 1, (right - MARGIN.left) / 90).filter(Number.isInteger).map((value) =>
        s("text", { x: x(value), y: bottom + 18, "text-anchor": "middle" }, whole(value))));
  }

  written(value) {
    if (this.options.percent) return `${Math.round(value * 100)}%`;
    return fixed(value, Math.abs(value) >= 100 ? 0 : Number.isInteger(value * 10) ? 1 : this.options.digits - 1);
  }

  backdrop(one, x, y) {
    const style = one.style % 8;
    const band = one.band ?? [];
    return [
      one.dots?.length > 0 && s("path", { class: `dots c${style}`, d: one.dots.map((dot) => `M${x(dot[0]).toFixed(1)} ${y(dot[1]).toFixed(1)}h0`).join("") }),
      band.length > 1 && s("path", {
        class: `band f${style}`,
        d: `${path(band.map((part) => [x(part[0]), y(part[2])]))}${path([...band].reverse().map((part) => [x(part[0]), y(part[1])])).replace("M", "L")}Z`,
      }),
    ];
  }

  marks(one, x, y) {
    const style = one.style % 8;
    return [s("path", { class: `line thin c${style} d${style}`, d: path(one.points.map((point) => [x(point.x), y(point.y)])) }), one.points.map((point) => [
      point.low !== undefined && s("line", { class: `c${style}`, "stroke-width": 1.5, x1: x(point.x), x2: x(point.x), y1: y(point.low), y2: y(point.high) }),
      s("circle", { class: `mark f${style}`, cx: x(point.x), cy: y(point.y), r: one.points.length > MANY ? 3 : 5 }),
    ])];
  }

  referenceLabels(references, y, right, height, room) {
    const inside = !room; // a narrow chart has them in the plot
    const places = apart(references.map((one) => y(one.y)), 14, MARGIN.top + (inside ? 8 : 0), height - MARGIN.bottom);
    return references.map((one, at) => s("text", inside ? { class: "inside", x: right - 4, y: places[at] - 4, "text-anchor": "end" } : { x: right + 8, y: places[at] + 4 }, `${one.name} ${fixed(one.y, 2)}`));
  }

  places() {
    const { series = [], marks = [] } = this.data;
    const found = new Set([...series.flatMap((one) => one.points.map((point) => point[0])), ...marks.flatMap((one) => one.points.map((point) => point.x))]);
    return [...found].sort((a, b) => a - b);
  }

  point(offset) {
    if (!this.scale) return;
    let best = null;
    for (const place of this.places()) if (best === null || Math.abs(this.scale.x(place) - offset) < Math.abs(this.scale.x(best) - offset)) best = place;
    if (best !== null) this.show(best);
  }

  step(event) {
    const turn = { ArrowLeft: -1, ArrowRight: 1, PageUp: -20, PageDown: 20 }[event.key];
    if (event.key === "Escape") this.leave();
    if (turn === undefined || !this.data) return;
    event.preventDefault();
    event.stopPropagation();
    const places = this.places();
    if (!places.length) return;
    const now = this.at === null ? places.length - 1 : Math.max(0, places.findIndex((place) => place >= this.at));
    this.show(places[Math.max(0, Math.min(places.length - 1, this.at === null ? now : now + turn))]);
    this.said.textContent = this.tip.textContent;
  }

  show(at) {
    this.at = at;
    const rows = [];
    for (const one of this.data.series ?? []) {
      const point = nearest(one.points, at, (candidate) => candidate[0]);
      if (point) rows.push([one.style, false, one.name, point[1], null, one.dash]);
    }
    for (const one of this.data.marks ?? []) {
      const point = one.points.find((candidate) => candidate.x === at);
      if (point) rows.push([one.style, true, one.name, point.y, point]);
    }
    replace(this.tip,
      h("div", { class: "quiet" }, `${this.options.x} ${whole(at)}`),
      h("table", {}, rows.map(([style, mark, name, value, point, dash]) => h("tr", {},
        h("td", {}, swatch(style, mark, dash)), h("td", {}, name),
        h("td", { class: "number" }, this.value(value)),
        point?.low !== undefined && h("td", { class: "quiet" }, `${this.value(point.low)} to ${this.value(point.high)}`)))));
    const x = this.scale.x(at);
    this.tip.hidden = rows.length === 0;
    for (const [name, place] of [["x1", x], ["x2", x], ["visibility", "visible"]]) this.cursor.setAttribute(name, place);
    const room = this.scale.width - x;
    this.tip.style.left = room > this.tip.offsetWidth + 20 ? `${x + 12}px` : `${Math.max(0, x - this.tip.offsetWidth - 12)}px`;
  }

  value(number) {
    return this.options.percent ? `${(number * 100).toFixed(1)}%` : fixed(number, this.options.digits);
  }

  leave() {
    this.at = null;
    this.tip.hidden = true;
    this.cursor?.setAttribute("visibility", "hidden");
  }
}

function nearest(points, at, place) {
  let best = null;
  for (const point of points) if (best === null || Math.abs(place(point) - at) < Math.abs(place(best) - at)) best = point;
  return best;
}
