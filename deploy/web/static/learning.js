// What learning shows and where its time goes: `metrics.jsonl`.

import { Chart } from "./chart.js";
import { h, replace } from "./dom.js";
import { counted, short } from "./format.js";

const ACTING = ["acting_s", "acting", 0];
const LEARNER = [["learning_s", "learning", 1], ["publishing_s", "publishing", 2], ["learner_waited_s", "waiting", 3]];
const ACTORS = [ACTING, ["actor_waited_s", "waiting", 3]];

export class Learning {
  constructor() {
    this.charts = new Map();
    this.times = h("div");
    this.multiples = h("div", { class: "multiples" });
    this.element = h("div", { class: "stack" },
      h("section", { class: "card", "aria-labelledby": "times" }, h("header", {}, h("h2", { id: "times" }, "Where time goes")), this.times),
      h("section", { class: "card", "aria-labelledby": "metrics" }, h("header", {}, h("h2", { id: "metrics" }, "Learning, by episode")), this.multiples));
  }

  update(document) {
    this.drawTimes(document);
    for (const [name, points] of Object.entries(document.curves)) {
      if (!points.length) continue;
      if (!this.charts.has(name)) this.add(name);
      const { chart, value } = this.charts.get(name);
      value.textContent = short(points.at(-1)[1]);
      chart.update({ xMax: document.episodes, series: [{ name: name.replaceAll("_", " "), style: 0, points }] });
    }
    if (!this.charts.size) replace(this.multiples, h("p", { class: "quiet" }, "Nothing has been learned yet."));
  }

  add(name) {
    if (!this.charts.size) replace(this.multiples);
    const words = name.replaceAll("_", " ");
    const chart = new Chart({ label: `${words} by episode`, height: 130, digits: 4, short: true });
    chart.written = short;
    chart.value = short;
    const value = h("b");
    this.charts.set(name, { chart, value });
    this.multiples.append(h("figure", {}, h("figcaption", {}, words, value), chart.element));
  }

  drawTimes({ seconds, recent }) {
    const haveActors = seconds.actor_waited_s > 0; // else the learner acts itself
    const rows = haveActors ? [["learner", LEARNER], ["actors", ACTORS]] : [["learner", [ACTING, ...LEARNER]]];
    const drawn = rows.map(([who, parts]) => this.strip(who, parts.map(([name, words, style]) => ({ words, style, value: seconds[name] ?? 0 })), recent)).filter(Boolean);
    replace(this.times, drawn.length ? [drawn, h("p", { class: "quiet small" }, `Of an episode, on the mean of the last ${counted(recent, "episode")}.`)] : h("p", { class: "quiet" }, "Nothing has been measured yet."));
  }

  strip(who, parts, recent) {
    const total = parts.reduce((sum, part) => sum + part.value, 0);
    if (!total) return null;
    return h("div", { class: "times" }, h("b", {}, who), h("div", { class: "shares", "aria-hidden": "true" }, parts.map((part) => h("i", { class: `b${part.style}`, title: part.words, style: { flex: `${part.value / total} 0 0` } }))),
      h("div", { class: "legend" }, parts.map((part) => h("span", { class: "entry" }, h("i", { class: `dot b${part.style}` }), `${part.words} ${((part.value * 1000) / recent).toFixed(1)} ms`))));
  }
}
