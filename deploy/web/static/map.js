// The map of a level with its trains at one moment.

import { s, replace } from "./dom.js";
import { frameOf, railPath } from "./rails.js";
import { turnedGrid, turnedHeading, turnedPlace } from "./turning.js";

export const [WAITING, MOVING, STOPPED, BROKEN, ARRIVED] = [0, 1, 2, 3, 4];
export const [JAMMED, LATE] = [1, 2]; // flags
export const colour = (train) => train % 8;
const FEW = 12; // trains whose ways and targets are all drawn
const ROOM = 640; // pixels of width from which a high level is turned
const HIGH = 1.25; // height by width from which it is
const TURNS = [-90, 0, 90, 180];
const BODY = "M-.38-.27H.1L.42 0L.1.27H-.38Z";
const FLAG = "M-.2.42V-.42H.36V.08H-.12V.42Z";

export class RailMap {
  /** @param onSelect called with a train that was clicked */
  constructor(onSelect) {
    this.onSelect = onSelect;
    this.svg = s("svg", { class: "map", role: "group", "aria-label": "Map of the level" });
    this.element = this.svg;
  }

  load(document) {
    this.document = document;
    const { grid, trains, width } = document.level;
    const upright = frameOf(grid);
    const turned = upright[3] / upright[2] > HIGH && (this.svg.parentElement?.clientWidth ?? 0) > ROOM;
    this.place = turned ? (row, column) => turnedPlace(row, column, width) : (row, column) => [row, column];
    this.heading = turned ? turnedHeading : (heading) => heading;
    const shown = turned ? turnedGrid(grid) : grid;
    const frame = frameOf(shown);
    this.few = trains.length <= FEW;
    this.svg.setAttribute("viewBox", frame.join(" "));
    this.svg.style.setProperty("aspect-ratio", `${frame[2]} / ${frame[3]}`);
    const rails = railPath(shown);
    this.targets = s("g");
    this.trails = s("g", { class: "trails" });
    this.trains = trains.map((_, train) => this.makeTrain(train));
    replace(this.svg,
      s("path", { class: "sleepers", d: rails }), s("path", { class: "rails", d: rails }), this.compass(frame, turned),
      this.trails, this.targets, s("g", {}, this.trains.map((one) => one.group)));
  }

  compass([left, top], turned) {
    return s("g", { class: "compass", transform: `translate(${left + 0.75} ${top + 0.75})` },
      s("path", { d: "M0-.5L.28.35L0 .18L-.28.35Z", transform: `rotate(${turned ? -90 : 0})` }),
      s("text", turned ? { x: 0.75, y: 0.16 } : { y: 0.85 }, "N"), s("title", {}, turned ? "North is to the left" : "North is up"));
  }

  makeTrain(train) {
    const body = s("path", { class: `body f${colour(train)}`, d: BODY });
    const turn = s("g", {}, body);
    const ring = s("circle", { class: "ring", r: 0.66 });
    const label = s("text", { class: "number", y: 0.14 }, String(train));
    const sign = s("text", { class: "sign", x: 0.4, y: -0.26 });
    const words = s("title");
    const group = s("g", { class: `train c${colour(train)}`, onclick: () => this.onSelect(train) }, ring, turn, label, sign, words);
    return { group, turn, label, sign, words };
  }

  /** @param smooth whether trains glide there */
  show(step, selected, smooth) {
    const { level, steps, states } = this.document;
    const waiting = new Map(); // several may be going to depart from one cell
    this.svg.classList.toggle("smooth", smooth);
    this.trains.forEach((one, train) => {
      const [state, row, column, heading, malfunction, flags] = steps[step][train];
      const [y, x] = this.place(row, column);
      const key = `${row} ${column}`;
      const beside = state === WAITING ? (waiting.get(key) ?? 0) : 0;
      if (state === WAITING) waiting.set(key, beside + 1);
      const faint = state === WAITING && !this.few && train !== selected ? " dim" : "";
      one.group.style.transform = `translate(${x + 0.5 + beside * 0.55}px, ${y + 0.5 - (state === WAITING ? 0.7 : 0)}px) scale(${state === WAITING ? 0.75 : 1})`;
      one.group.setAttribute("class", `train c${colour(train)} is-${states[state]}${train === selected ? " selected" : ""}${faint}`);
      one.turn.setAttribute("transform", `rotate(${TURNS[this.heading(heading)]})`);
      one.sign.textContent = flags & JAMMED ? "✕" : malfunction > 0 ? "!" : flags & LATE ? "L" : "";
      one.words.textContent = `Train ${train}, ${states[state]}${flags & JAMMED ? ", jammed" : ""}${malfunction ? `, broken down for ${malfunction} steps` : ""}`;
    });
    const shown = level.trains.map((_, train) => train).filter((train) => this.few || train === selected);
    replace(this.trails, shown.map((train) => s("path", { class: `trail c${colour(train)}${train === selected ? " selected" : ""}`, d: this.trail(train, step) })));
    this.drawTargets(shown, step, selected);
  }

  drawTargets(shown, step, selected) {
    const beside = new Map();
    replace(this.targets, shown.map((train) => {
      const [row, column] = this.document.level.trains[train].target;
      const key = `${row} ${column}`;
      const at = beside.get(key) ?? 0;
      beside.set(key, at + 1);
      const [y, x] = this.place(row, column);
      const arrived = this.document.steps[step][train][0] === ARRIVED;
      return s("g", { class: `target${train === selected ? " selected" : ""}${arrived ? " reached" : ""}`, transform: `translate(${x + 0.5 + at * 0.66} ${y + 0.5})`, onclick: () => this.onSelect(train) },
        s("path", { class: `flag f${colour(train)}`, d: FLAG }), s("text", { class: "number", x: 0.08, y: -0.06 }, String(train)),
        arrived && s("text", { class: "sign", x: 0.08, y: -0.5 }, "✓"),
        s("title", {}, `Target of train ${train}${arrived ? ", which has arrived" : ""}`));
    }));
  }

  /** Where a train has been up to a step: from the middle of its first cell, over the edges between cells. */
  trail(train, until) {
    const cells = [];
    for (let step = 0; step <= until; step++) {
      const [state, row, column] = this.document.steps[step][train];
      if (state === WAITING) continue;
      const [y, x] = this.place(row, column);
      const last = cells.at(-1);
      if (!last || last[0] !== x + 0.5 || last[1] !== y + 0.5) cells.push([x + 0.5, y + 0.5]);
    }
    if (cells.length < 2) return "";
    const edges = cells.slice(1).map(([x, y], at) => [(x + cells[at][0]) / 2, (y + cells[at][1]) / 2]);
    const bends = edges.slice(1).map(([x, y], at) => `Q${cells[at + 1].join(" ")} ${x} ${y}`);
    return `M${cells[0].join(" ")}L${edges[0].join(" ")}${bends.join("")}L${cells.at(-1).join(" ")}`;
  }
}
