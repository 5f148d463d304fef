// All trains of an episode, each with a strip of what it did when; a strip is also where one goes to a step.

import { h, replace, s } from "./dom.js";
import { ARRIVED, BROKEN, JAMMED, MOVING, STOPPED, WAITING, colour } from "./map.js";

const HEIGHT = 16;
const THICK = { [WAITING]: 2, [MOVING]: 10, [STOPPED]: 5, [BROKEN]: 16, [ARRIVED]: 2 }; // told by height, not colour alone

export class Timelines {
  constructor(onSelect, onSeek) {
    this.onSelect = onSelect;
    this.onSeek = onSeek;
    this.list = h("div", { class: "timelines", role: "listbox", "aria-label": "Trains", tabindex: 0 });
    this.element = h("section", { class: "card", "aria-labelledby": "trains-list" },
      h("header", {}, h("h2", { id: "trains-list" }, "Trains"), h("span", { class: "quiet small" }, "strips, by height: waits or arrived, stands, moves, broken down")), this.list);
  }

  load(document) {
    this.document = document;
    this.rows = document.level.trains.map((_, train) => this.row(train));
    replace(this.list, this.rows.map((row) => row.element));
  }

  row(train) {
    const last = this.document.steps.length - 1;
    const cursor = s("line", { class: "cursor", y1: 0, y2: HEIGHT });
    const strip = s("svg", { class: `strip f${colour(train)}`, viewBox: `0 0 ${Math.max(1, last)} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": "true" }, this.segments(train, last), cursor);
    const state = h("span", { class: "state quiet" });
    const element = h("div", { class: "timeline", role: "option", id: `train-${train}`, onclick: (event) => {
      if (strip.contains(event.target)) {
        const box = strip.getBoundingClientRect();
        this.onSeek(Math.round(((event.clientX - box.left) / box.width) * last));
      }
      this.onSelect(train);
    } }, h("span", { class: `tag b${colour(train)}` }, String(train)), state, strip);
    return { element, cursor, state };
  }

  segments(train, last) {
    const parts = [];
    let from = 0;
    for (let step = 1; step <= last + 1; step++) {
      const before = this.document.steps[step - 1][train][0];
      if (step <= last && this.document.steps[step][train][0] === before) continue;
      const height = THICK[before];
      parts.push(s("rect", { class: `is-${this.document.states[before]}`, x: from, width: Math.max(0.001, step - from), y: (HEIGHT - height) / 2, height }));
      from = step;
    }
    return parts;
  }

  show(step, selected) {
    this.rows.forEach((row, train) => {
      const [state, , , , malfunction, flags] = this.document.steps[step][train];
      row.cursor.setAttribute("x1", step);
      row.cursor.setAttribute("x2", step);
      row.state.textContent = flags & JAMMED ? "jammed" : malfunction ? `broken ${malfunction}` : this.document.states[state];
      row.element.setAttribute("aria-selected", String(train === selected));
    });
    if (selected !== this.selected) this.reveal(this.rows[selected]?.element);
    this.selected = selected;
    this.list.setAttribute("aria-activedescendant", `train-${selected}`);
  }

  reveal(element) { // without moving the page
    if (!element) return;
    const [top, bottom] = [element.offsetTop - this.list.offsetTop, element.offsetTop - this.list.offsetTop + element.offsetHeight];
    if (top < this.list.scrollTop) this.list.scrollTop = top;
    else if (bottom > this.list.scrollTop + this.list.clientHeight) this.list.scrollTop = bottom - this.list.clientHeight;
  }
}
