// The learning curve of a run: training, evaluations, and what reference policies reach on the same levels.

import { Chart } from "./chart.js";
import { h, replace, toast } from "./dom.js";
import { counted, whole } from "./format.js";
import { get, post, steers, whyNot } from "./session.js";
import { legend } from "./words.js";

const MEASURES = [["return", "Return"], ["arrived", "Trains arrived"], ["score", "Flatland score"], ["staleness", "Staleness"]];
const OF_EVALUATIONS = { return: "return", arrived: "arrived_share", score: "score" };
const SHOWN_FIRST = ["random", "shortest-path", "planner"];
const OFFERED = ["random", "shortest-path", "deadlock-avoidance", "shortest-path-planned", "planner", "alone"];

export class Curves {
  constructor(name) {
    this.name = name;
    this.measure = "return";
    this.level = null;
    this.document = null;
    this.run = null;
    this.references = {}; // level -> {scores, scorable}
    this.shown = new Set(SHOWN_FIRST);
    this.busy = new Set();
    this.chart = new Chart({ label: "Learning curve; arrow keys read it", height: 330 });
    this.tools = h("div", { class: "rowline" });
    this.legend = h("div");
    this.policies = h("div", { class: "chips", role: "group", "aria-label": "Reference policies to compare with" });
    this.element = h("section", { class: "card", "aria-labelledby": "curve" },
      h("header", {}, h("h2", { id: "curve" }, "Learning curve"), h("span", { class: "grow" }), this.tools),
      this.chart.element, this.legend, h("div", { class: "rowline policies" }, this.policies));
    this.policies.parentElement.style.marginTop = "10px";
  }

  update(document) {
    this.document = document;
    this.draw();
  }

  updateRun(run) {
    const first = this.run === null;
    const key = JSON.stringify([run.evaluations.length, run.view.episodes]);
    this.run = run;
    if (first) {
      this.level = run.levels[0];
      this.load();
    }
    if (key !== this.runKey) this.draw();
    this.runKey = key;
  }

  async load() {
    try {
      this.references = await get("/api/references", { run: this.name });
    } catch (error) {
      toast(error.message, true);
    }
    this.draw();
  }

  draw() {
    if (!this.document || !this.run) return;
    const { measures } = this.document;
    if (!(this.measure in measures)) this.measure = "return";
    const curve = measures[this.measure]?.[this.level];
    const field = OF_EVALUATIONS[this.measure];
    const scored = this.run.evaluations.filter((row) => row.level === this.level && field && row[field] !== null)
      .map((row) => ({ x: row.episode, y: row[field] }));
    const mode = this.run.mode;
    this.chart.options.percent = this.measure === "arrived";
    this.chart.options.digits = this.measure === "staleness" ? 1 : 3;
    this.chart.update({
      xMax: this.run.view.episodes,
      series: curve ? [
        { name: "training, median", style: 0, points: curve.points.map((point) => [point[0], point[1]]), band: curve.points.map((point) => [point[0], point[2], point[3]]), dots: curve.dots },
        { name: "training, mean", style: 0, dash: 1, thin: true, points: curve.points.map((point) => [point[0], point[4]]) },
      ] : [],
      marks: scored.length ? [{ name: `evaluation, ${mode}`, style: 1, points: scored }] : [],
      references: this.referenceLines(),
      range: this.measure === "arrived" ? [0, 1.02] : undefined,
      empty: "No episode has been trained yet",
    });
    this.drawTools(Object.keys(measures));
    this.drawLegend(curve, scored, mode);
    this.drawPolicies();
  }

  referenceLines() {
    if (this.measure !== "return") return [];
    return Object.entries(this.references[this.level]?.scores ?? {})
      .filter(([policy]) => this.shown.has(policy)).map(([policy, score]) => ({ name: policy, y: score.mean }));
  }

  drawTools(measures) {
    const key = JSON.stringify([measures, this.measure, this.level]);
    if (key === this.toolsKey) return;
    this.toolsKey = key;
    const select = (label, options, value, onchange) => h("label", { class: "small" }, h("span", { class: "hidden-text" }, label),
      h("select", { onchange: (event) => onchange(event.target.value) }, options.map(([id, text]) => h("option", { value: id, selected: id === value }, text))));
    replace(this.tools,
      this.run.levels.length > 1 && select("Level", this.run.levels.map((level) => [level, level]), this.level, (level) => this.change({ level })),
      measures.length > 1 && select("What the curve shows", MEASURES.filter(([id]) => measures.includes(id)), this.measure, (measure) => this.change({ measure })));
  }

  change(values) {
    Object.assign(this, values);
    this.draw();
  }

  drawLegend(curve, scored, mode) {
    replace(this.legend, legend([
      ...(curve ? [[0, false, `training: median of ${counted(curve.window, "episode")}; band: middle half; dots: ${curve.every > 1 ? `one episode in ${curve.every}` : "episodes"}`], [0, false, "mean of the same", 1]] : []),
      ...(scored.length ? [[1, true, `evaluation (${mode}): mean of ${this.run.evaluation_levels} levels that training never sees`]] : []),
    ]));
  }

  drawPolicies() {
    const found = this.references[this.level];
    const scores = found?.scores ?? {};
    const key = JSON.stringify([found === undefined, this.level, Object.keys(scores), [...this.shown], [...this.busy], steers(), this.measure]);
    if (key === this.policiesKey) return;
    this.policiesKey = key;
    this.policies.parentElement.hidden = this.measure !== "return" || !found?.scorable;
    replace(this.policies, h("span", { class: "quiet small" }, `On the same ${this.run.evaluation_levels} levels:`),
      OFFERED.map((policy) => this.chip(policy, scores[policy])));
  }

  chip(policy, score) {
    if (score) {
      return h("button", { class: "chip", type: "button", "aria-pressed": String(this.shown.has(policy)), onclick: () => this.toggle(policy),
        title: `${score.mean.toFixed(3)}, 95% interval ${score.low.toFixed(3)} to ${score.high.toFixed(3)}, ${whole(score.levels)} levels` }, policy);
    }
    const busy = this.busy.has(`${this.level} ${policy}`);
    return h("button", { class: "chip quiet", type: "button", disabled: busy || !steers(), title: steers() ? "Have this policy play the evaluation levels" : whyNot(),
      onclick: () => this.score(policy) }, busy ? `${policy} plays …` : `+ ${policy}`);
  }

  toggle(policy) {
    if (!this.shown.delete(policy)) this.shown.add(policy);
    this.draw();
  }

  async score(policy) {
    const level = this.level;
    this.busy.add(`${level} ${policy}`);
    this.draw();
    try {
      const result = await post("/api/references", { run: this.name, policy, level });
      this.references[level].scores[policy] = result.rows[0];
      this.shown.add(policy);
    } catch (error) {
      toast(error.message, true);
    }
    this.busy.delete(`${level} ${policy}`);
    this.draw();
  }
}
