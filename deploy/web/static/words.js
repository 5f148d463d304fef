// Parts that several pages show: badges, bars, legends.

import { h, s } from "./dom.js";
import { swatch } from "./chart.js";

const SIGNS = { // shapes, so that no state is told by its colour alone
  good: () => s("circle", { cx: 6, cy: 6, r: 5, fill: "currentColor" }),
  waits: () => [s("rect", { x: 1.5, y: 1, width: 3.2, height: 10, fill: "currentColor" }), s("rect", { x: 7.3, y: 1, width: 3.2, height: 10, fill: "currentColor" })],
  wrong: () => s("path", { d: "M2 2L10 10M10 2L2 10", stroke: "currentColor", "stroke-width": 2.4 }),
  idle: () => s("rect", { x: 1.5, y: 1.5, width: 9, height: 9, rx: 1.5, fill: "none", stroke: "currentColor", "stroke-width": 2 }),
};
const CHECK = () => s("path", { d: "M1.5 6.5L4.8 10L10.5 2.5", fill: "none", stroke: "currentColor", "stroke-width": 2.2 });

export const badge = (state, tone) => h("span", { class: `badge ${tone}` },
  s("svg", { viewBox: "0 0 12 12", "aria-hidden": "true" }, state === "finished" || state === "done" ? CHECK() : SIGNS[tone]()), state);

export function bar(done, total, label) {
  const share = total ? Math.min(1, done / total) : 0;
  const fill = h("i");
  fill.style.width = `${share * 100}%`;
  return h("div", { class: "bar", role: "progressbar", "aria-label": label, "aria-valuemin": 0, "aria-valuemax": total, "aria-valuenow": done }, fill);
}

export const legend = (entries) => h("div", { class: "legend" },
  entries.map(([style, mark, text, dash]) => h("span", { class: "entry" }, swatch(style, mark, dash), text)));

export const figures = (entries) => h("dl", { class: "figures" },
  entries.map(([name, value, note]) => h("div", {}, h("dt", {}, name), h("dd", {}, value, note && h("small", {}, ` ${note}`)))));

export const toneOf = (state) => ({ running: "good", finishing: "good", finished: "good", done: "good", trained: "good", paused: "waits", failed: "wrong", unsupervised: "wrong", unreadable: "wrong" }[state] ?? "idle");
