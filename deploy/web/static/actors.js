// How many actors serve each level, with buttons to change it.

import { h, replace, toast } from "./dom.js";
import { post, steers, whyNot } from "./session.js";

const CALM_MS = 350; // several clicks make one command
const MOST = 256;
const ENDED = ["finished", "stopped", "failed", "unsupervised", "stopping"];

export class Actors {
  constructor(name) {
    this.name = name;
    this.wanted = {}; // what was clicked and is not there yet
    this.rows = new Map();
    this.body = h("div", { class: "actors" });
    this.note = h("p", { class: "quiet small" });
    this.element = h("section", { class: "card", "aria-labelledby": "actors" }, h("header", {}, h("h2", { id: "actors" }, "Actors")), this.body, this.note);
  }

  update(document) {
    this.document = document;
    const levels = [...document.levels, ...(document.actors.any ? ["any"] : [])];
    if (levels.join() !== [...this.rows.keys()].join()) this.build(levels);
    const lives = !ENDED.includes(document.view.state);
    const processes = document.view.processes.filter((one) => one.role === "actor");
    for (const [level, row] of this.rows) {
      const count = document.actors[level] ?? 0;
      if (this.wanted[level] === count) delete this.wanted[level];
      const shown = this.wanted[level] ?? count;
      const waiting = document.view.progress?.waiting_by_level[level] ?? 0;
      const alive = processes.filter((one) => one.serves === level && one.pid !== null).length;
      row.output.textContent = shown;
      row.fewer.disabled = !lives || !steers() || shown === 0;
      row.more.disabled = !lives || !steers() || shown >= MOST;
      for (const button of [row.fewer, row.more]) button.title = steers() ? "" : whyNot();
      row.note.textContent = lives ? [`${alive} alive`, waiting ? `${waiting} episodes wait` : ""].filter(Boolean).join(" · ") : "not running";
    }
    const none = Object.values(document.actors).every((count) => !count);
    this.note.textContent = lives && none ? "With no actors the learner acts itself; the curve is the same to the bit." : "";
    this.note.hidden = !this.note.textContent;
  }

  build(levels) {
    this.rows.clear();
    for (const level of levels) {
      const name = level === "any" ? "any level" : level;
      const button = (sign, words, change) => h("button", { class: "square", type: "button", "aria-label": `${words} for ${name}`, onclick: () => this.change(level, change) }, sign);
      this.rows.set(level, {
        name, note: h("div", { class: "quiet small" }),
        fewer: button("−", "One actor fewer", -1), more: button("+", "One actor more", 1),
        output: h("output", { "aria-label": `Actors for ${name}` }),
      });
    }
    replace(this.body, [...this.rows.values()].map((row) => h("div", { class: "level" },
      h("div", {}, h("b", {}, row.name), row.note), h("div", { class: "stepper" }, row.fewer, row.output, row.more))));
  }

  change(level, by) {
    const now = this.wanted[level] ?? this.document.actors[level] ?? 0;
    this.wanted[level] = Math.max(0, Math.min(MOST, now + by));
    this.update(this.document);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.send(), CALM_MS);
  }

  async send() {
    const actors = { ...this.wanted };
    try {
      toast((await post("/api/steer", { run: this.name, verb: "scale", actors })).text);
    } catch (error) {
      this.wanted = {};
      toast(error.message, true);
    }
    this.update(this.document);
  }
}
