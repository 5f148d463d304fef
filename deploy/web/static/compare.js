// Several runs side by side, chosen from all there are.

import { Chart, swatch } from "./chart.js";
import { h, replace, table } from "./dom.js";
import { fixed, percent, whole } from "./format.js";
import { connection, sayHow } from "./frame.js";
import { get } from "./session.js";
import { Stream } from "./stream.js";
import { badge } from "./words.js";

const MOST = 12;
const MEASURES = [["return", "Return"], ["arrived", "Trains arrived"], ["score", "Flatland score"]];
const OF_EVALUATIONS = { return: "return", arrived: "arrived_share", score: "score" };

export function show(main) {
  new ComparePage(main);
}

class ComparePage {
  constructor(main) {
    this.names = new URLSearchParams(location.search).getAll("run").slice(0, MOST);
    this.runs = new Map();
    this.curves = new Map();
    this.scored = new Map();
    this.styles = new Map();
    this.measure = "return";
    this.chart = new Chart({ label: "Learning curves of the chosen runs; arrow keys read them", height: 380 });
    this.rows = h("div");
    this.list = h("div", { class: "chooser", role: "group", "aria-label": "Runs to compare" });
    const select = h("select", { onchange: (event) => { this.measure = event.target.value; this.draw(); } }, MEASURES.map(([id, text]) => h("option", { value: id }, text)));
    replace(main, h("div", { class: "head" }, h("div", { class: "title" }, h("h1", {}, "Side by side"))),
      h("div", { class: "columns" },
        h("div", { class: "stack" },
          h("section", { class: "card", "aria-labelledby": "curves" }, h("header", {}, h("h2", { id: "curves" }, "Learning curves"), h("span", { class: "grow" }), h("label", { class: "small" }, h("span", { class: "hidden-text" }, "What the curves show"), select)), this.chart.element,
            h("p", { class: "quiet small" }, "Thick lines: moving means of training; dots: evaluations on levels that training never sees.")),
          h("section", { class: "card" }, this.rows)),
        h("section", { class: "card", "aria-labelledby": "choose" }, h("header", {}, h("h2", { id: "choose" }, "Runs")), this.list)));
    this.listen();
    this.drawList();
  }

  async drawList() {
    const { runs } = await get("/api/list").catch(() => ({ runs: [] }));
    const names = [...new Set([...this.names, ...runs.map((run) => run.run).reverse()])];
    replace(this.list, names.map((name) => h("label", {}, h("input", { type: "checkbox", checked: this.names.includes(name), onchange: (event) => this.choose(name, event.target) }), name)));
  }

  choose(name, box) {
    if (box.checked && this.names.length >= MOST) {
      box.checked = false;
      return;
    }
    this.names = box.checked ? [...this.names, name] : this.names.filter((other) => other !== name);
    history.replaceState(null, "", `/compare?${this.names.map((one) => `run=${encodeURIComponent(one)}`).join("&")}`);
    this.listen();
  }

  styleOf(name) { // a run keeps its colour for as long as it is chosen
    for (const other of this.styles.keys()) if (!this.names.includes(other)) this.styles.delete(other);
    if (!this.styles.has(name)) {
      const taken = new Set(this.styles.values());
      this.styles.set(name, [...Array(MOST).keys()].find((style) => !taken.has(style)));
    }
    return this.styles.get(name);
  }

  listen() {
    this.stream?.close();
    this.draw();
    if (!this.names.length) {
      sayHow("", "▤", "none chosen");
      return;
    }
    sayHow("good", "●", "live");
    this.stream = new Stream(this.names.map((name) => ["run", name]), {
      evaluations: (document) => { this.scored.set(document.name, document.evaluations); this.draw(); },
      run: (document) => { this.runs.set(document.name, document); this.draw(); },
      curves: (document) => { this.curves.set(document.name, document); this.draw(); },
      metrics: () => {},
      problem: (document) => { this.runs.set(document.name, { name: document.name, wrong: document.text }); this.draw(); },
    }, connection());
  }

  draw() {
    const shown = this.names.map((name) => ({ name, style: this.styleOf(name), run: this.runs.get(name), scored: this.scored.get(name) ?? [], curves: this.curves.get(name)?.measures[this.measure] ?? {} }));
    const series = [];
    const marks = [];
    for (const { name, style, scored, curves } of shown) {
      for (const [level, curve] of Object.entries(curves)) {
        const label = Object.keys(curves).length > 1 ? `${name}, ${level}` : name;
        series.push({ name: label, style, points: curve.points.map((point) => [point[0], point[4]]) });
      }
      const points = scored.filter((row) => row[OF_EVALUATIONS[this.measure]] !== null).map((row) => ({ x: row.episode, y: row[OF_EVALUATIONS[this.measure]] }));
      if (points.length) marks.push({ name: `${name}, evaluated`, style, points });
    }
    this.chart.options.percent = this.measure === "arrived";
    this.chart.update({ xMax: Math.max(1, ...shown.map(({ run }) => run?.view?.episodes ?? 0)), series, marks, empty: "Choose runs to compare" });
    replace(this.rows, table("The chosen runs", [{ name: "" }, { name: "run" }, { name: "state" }, { name: "algorithm" }, { name: "levels" }, { name: "episodes", number: true }, { name: "return (100)", number: true }, { name: "last evaluation", number: true }, { name: "all arrived", number: true }],
      shown.map(({ name, style, run, scored }) => {
        if (!run || run.wrong) return [swatch(style), name, run?.wrong ?? "…", "", "", "", "", "", ""];
        const last = scored.at(-1);
        return [swatch(style, true), h("a", { href: `/runs/${name.split("/").map(encodeURIComponent).join("/")}` }, name), badge(run.view.state, run.view.tone), run.view.algorithm, run.levels.join(", "),
          `${whole(run.view.progress?.done ?? 0)} / ${whole(run.view.episodes)}`, fixed(run.view.progress?.return_last_100), fixed(last?.return), last ? percent(last.all_arrived_share) : "–"];
      })));
  }
}
