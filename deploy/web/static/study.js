// A whole study: how far it is, and the curves of its contenders on every level.

import { Chart, swatch } from "./chart.js";
import { h, replace, table } from "./dom.js";
import { counted, fixed, whole } from "./format.js";
import { connection, sayHow } from "./frame.js";
import { Stream } from "./stream.js";
import { badge, bar } from "./words.js";

const REFERENCES = ["random", "shortest-path", "planner"];

export function show(main, name) {
  const page = new StudyPage(main, name);
  new Stream([["study", name]], {
    study: (document) => page.update(document),
    problem: (document) => page.wrong(document.text),
  }, connection());
}

class StudyPage {
  constructor(main, name) {
    this.main = main;
    this.name = name;
    this.hidden = new Set();
    this.charts = new Map();
    this.head = h("div", { class: "head" });
    this.legend = h("div", { class: "chips", role: "group", "aria-label": "Contenders that are drawn" });
    this.cells = h("div");
  }

  wrong(text) {
    sayHow("wrong", "✕", "not there");
    replace(this.main, h("section", { class: "card" }, h("h1", {}, this.name), h("p", {}, text), h("p", {}, h("a", { href: "/" }, "All runs"))));
  }

  update(document) {
    if (document.wrong) {
      this.document = null;
      this.wrong(document.wrong);
      return;
    }
    if (!this.document) this.build(document);
    this.document = document;
    const running = document.cells.some((cell) => cell.runs.some((run) => run.state === "running"));
    sayHow(running || document.process ? "good" : "", running || document.process ? "●" : "▤", running || document.process ? "live" : "from files");
    this.drawHead(running);
    this.drawCharts();
    this.drawCells();
  }

  build(document) {
    const cards = document.levels.map((level) => {
      const chart = new Chart({ label: `Learning curves on ${level}; arrow keys read them`, height: 290 });
      this.charts.set(level, chart);
      return h("section", { class: "card", "aria-label": `Curves on ${level}` }, h("header", {}, h("h2", {}, level)), chart.element);
    });
    replace(this.legend, document.contenders.map((name, style) => h("button", { class: "chip rowline", type: "button", "aria-pressed": "true", onclick: (event) => this.toggle(name, event.currentTarget) }, swatch(style), name)));
    replace(this.main, this.head, h("section", { class: "card" }, h("div", { class: "rowline" }, this.legend)), h("div", { class: "study-charts" }, cards), this.cells);
    this.main.children[1].style.marginBottom = "16px";
  }

  toggle(name, chip) {
    if (!this.hidden.delete(name)) this.hidden.add(name);
    chip.setAttribute("aria-pressed", String(!this.hidden.has(name)));
    this.drawCharts();
  }

  drawHead(running) {
    const d = this.document;
    const failed = d.cells.flatMap((cell) => cell.runs).filter((run) => run.state === "failed");
    const state = d.runs_done === d.runs_total ? ["done", "good"] : running || d.process ? ["running", "good"] : ["not running", "idle"];
    replace(this.head,
      h("div", { class: "title" }, h("div", {}, h("h1", {}, this.name), h("div", { class: "quiet" }, `study · ${counted(d.contenders.length, "contender")} × ${counted(d.levels.length, "level")} × ${counted(d.seeds.length, "seed")} · ${counted(d.episodes_each, "episode")} each`)), badge(...state)),
      h("div", { class: "progress" }, bar(d.episodes, d.episodes_total, "Episodes of the study"),
        h("div", { class: "text" }, h("span", {}, `${whole(d.runs_done)} of ${counted(d.runs_total, "run")} done, ${whole(d.episodes)} of ${counted(d.episodes_total, "episode")}`),
          h("span", {}, d.read < d.cells.flatMap((cell) => cell.runs).filter((run) => run.episodes > 0).length ? `reading: ${d.read} runs so far` : ""))),
      failed.length > 0 && h("ul", { class: "problems" }, failed.slice(0, 5).map((run) => h("li", {}, `! seed ${run.seed}: ${run.reason}`))));
  }

  drawCharts() {
    const { cells, levels, contenders, references, episodes_each: xMax } = this.document;
    for (const level of levels) {
      const series = cells.filter((cell) => cell.level === level && !this.hidden.has(cell.contender)).map((cell) => ({
        name: cell.contender, style: contenders.indexOf(cell.contender),
        points: cell.curve.map((point) => [point[0], point[1]]), band: cell.curve.some((point) => point[4] > 1) ? cell.curve.map((point) => [point[0], point[2], point[3]]) : [],
      }));
      const alone = series.length <= 3;
      this.charts.get(level).update({
        xMax, series: series.map((one) => (alone ? one : { ...one, band: [] })),
        references: Object.entries(references[level] ?? {}).filter(([policy]) => REFERENCES.includes(policy)).map(([policy, score]) => ({ name: policy, y: score.mean })),
      });
    }
  }

  drawCells() {
    const { cells, contenders, levels, block, final_levels: count } = this.document;
    const columns = [{ name: "contender" }, ...levels.flatMap((level) => [{ name: `${level}: final return`, number: true }, { name: "seeds" }])];
    const at = new Map(cells.map((cell) => [`${cell.contender} ${cell.level}`, cell]));
    replace(this.cells, h("section", { class: "card", "aria-labelledby": "cells" }, h("header", {}, h("h2", { id: "cells" }, "Contenders by level")),
      table("Contenders by level", columns, contenders.map((contender, style) => [
        h("span", { class: "rowline" }, swatch(style), h("b", {}, contender)),
        ...levels.flatMap((level) => {
          const cell = at.get(`${contender} ${level}`);
          if (!cell) return ["–", ""];
          return [cell.final ? [h("b", {}, fixed(cell.final.median)), h("br"), h("span", { class: "quiet small" }, `${fixed(cell.final.low, 2)} to ${fixed(cell.final.high, 2)}`)] : "–", h("div", { class: "seeds" }, cell.runs.map(seed))];
        }),
      ])),
      h("p", { class: "quiet small" }, `Curves: median over seeds of the mean of ${counted(block, "episode")}; with at most three contenders drawn, from the least to the greatest. Final return: median over seeds on ${counted(count, "held-out level")}, least and greatest.`)));
  }
}

const WORDS = { done: "✓", running: "▶", failed: "✕", trained: "✓", waiting: "" };

function seed(run) {
  const title = `seed ${run.seed}: ${run.state}${run.state === "running" ? `, ${run.episodes} episodes` : ""}${run.final === null ? "" : `, ${fixed(run.final)}`}`;
  const text = [String(run.seed), h("span", { class: "hidden-text" }, ` ${run.state}`), run.state === "running" || run.state === "failed" ? ` ${WORDS[run.state]}` : ""];
  const kind = `seed ${run.state === "trained" ? "done" : run.state}`;
  return run.place === null ? h("span", { class: kind, title }, text) : h("a", { class: kind, title, href: `/runs/${run.place.split("/").map(encodeURIComponent).join("/")}` }, text);
}
