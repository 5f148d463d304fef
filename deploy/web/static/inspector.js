// One train at one moment: what it is to do, what it decided last, what the policy thought of its choices, what it saw.

import { h, replace } from "./dom.js";
import { fixed, percent, short } from "./format.js";
import { icon } from "./icons.js";
import { JAMMED, LATE, WAITING } from "./map.js";

const HEADINGS = ["north", "east", "south", "west"];

export class Inspector {
  /** @param onSeek called with a step to go to */
  constructor(onSeek) {
    this.onSeek = onSeek;
    this.element = h("section", { class: "card inspector", "aria-label": "The selected train" });
    this.open = new Set(["0"]); // groups of the observation that are unfolded
  }

  load(document) {
    this.document = document;
    this.decisions = document.level.trains.map(() => []);
    for (const decision of document.decisions) this.decisions[decision.train].push(decision);
  }

  /** The decision of a train that counts at a step: the last one up to it. */
  decision(train, step) {
    return this.decisions[train].findLast((one) => one.step <= step) ?? null;
  }

  /** The step of the decision before or after. */
  neighbour(train, step, turn) {
    const all = this.decisions[train];
    const found = turn > 0 ? all.find((one) => one.step > step) : all.findLast((one) => one.step < step);
    return found?.step ?? null;
  }

  show(train, step) {
    const { level, states } = this.document;
    const [state, row, column, heading, malfunction, flags] = this.document.steps[step][train];
    const task = level.trains[train];
    const decision = this.decision(train, step);
    const facts = [
      ["is", [states[state], flags & JAMMED ? "jammed" : "", flags & LATE ? "late" : "", malfunction ? `for ${malfunction} more steps` : ""].filter(Boolean).join(", ")],
      [state === WAITING ? "departs from" : "at", `row ${row}, column ${column}, facing ${HEADINGS[heading]}`],
      ["target", `row ${task.target[0]}, column ${task.target[1]}`],
      ["speed", task.speed === 1 ? "1 cell a step" : `${short(task.speed)} cells a step`],
      ...(task.departs === null ? [] : [["timetable", `departs from step ${task.departs}, due by step ${task.due}`]]),
    ];
    replace(this.element,
      h("header", {}, h("h2", {}, `Train ${train}`), h("span", { class: "grow" }),
        this.jump([icon("back"), "decision"], this.neighbour(train, step, -1)), this.jump(["decision", icon("on")], this.neighbour(train, step, 1))),
      h("dl", { class: "facts" }, facts.map(([name, value]) => [h("dt", {}, name), h("dd", {}, value)])),
      decision === null ? h("p", { class: "quiet" }, "It has not decided anything yet.") : [this.choices(decision, step), this.observation(decision)]);
  }

  jump(label, step) {
    return h("button", { class: "small", type: "button", disabled: step === null, onclick: () => this.onSeek(step) }, label);
  }

  choices(decision, step) {
    const { actions } = this.document;
    const scores = decision.scores;
    const areShares = decision.scores_are === "probabilities";
    const usable = (scores ?? []).filter((_, action) => decision.allowed === null || decision.allowed.includes(action));
    const [low, high] = areShares ? [0, 1] : [Math.min(...usable), Math.max(...usable)];
    const width = (score) => (areShares ? score : high > low ? 0.06 + (0.94 * (score - low)) / (high - low) : 1);
    const when = decision.step === step ? "Decides now" : `Decided at step ${decision.step}`;
    return h("div", { class: "choices" },
      h("h3", {}, `${when}: ${actions[decision.action]}`, scores && h("span", { class: "quiet" }, ` · ${decision.scores_are}`)),
      h("ul", {}, actions.map((action, at) => {
        const allowed = decision.allowed === null || decision.allowed.includes(at);
        const chosen = at === decision.action;
        const fill = h("i");
        if (scores && allowed) fill.style.width = `${Math.max(0, Math.min(1, width(scores[at]))) * 100}%`;
        return h("li", { class: `${chosen ? "chosen" : ""}${allowed ? "" : " refused"}` },
          h("span", { class: "sign", "aria-hidden": "true" }, chosen ? "●" : allowed ? "○" : "✕"),
          h("span", {}, action, h("span", { class: "hidden-text" }, chosen ? ", chosen" : allowed ? "" : ", not allowed")),
          h("span", { class: "gauge" }, fill),
          h("span", { class: "score" }, !allowed ? "not allowed" : !scores ? "" : areShares ? percent(scores[at]) : fixed(scores[at], 2)));
      })),
      decision.value !== null && h("p", { class: "quiet small" }, `The network expects ${fixed(decision.value, 2)} from here on.`),
      !scores && h("p", { class: "quiet small" }, "This policy is no network: it has no opinion of what it did not choose."));
  }

  observation(decision) {
    const { features } = this.document;
    const numbers = decision.observation;
    if (!numbers || !features) return null;
    if (!features.groups.length) return h("p", { class: "quiet small" }, `It saw ${features.count} numbers: ${features.kind} maps, which have no names.`);
    const nothing = [];
    const parts = [];
    let first = 0;
    features.groups.forEach((group, at) => {
      const values = numbers.slice(first, first + group.names.length);
      first += group.names.length;
      if (values.some((value) => value !== 0)) parts.push(this.group(group, values, String(at)));
      else nothing.push(group.name);
    });
    return h("div", { class: "saw" }, h("h3", {}, `What it saw: ${features.kind}, ${features.count} numbers`), parts,
      nothing.length > 0 && h("p", { class: "quiet small" }, `Nothing there: ${nothing.slice(0, 12).join("; ")}${nothing.length > 12 ? ` and ${nothing.length - 12} more` : ""}`));
  }

  group(group, values, key) {
    const rows = group.names.map((name, at) => [name, values[at]]).filter(([, value]) => value !== 0);
    return h("details", { open: this.open.has(key), ontoggle: (event) => { if (event.target.open) this.open.add(key); else this.open.delete(key); } },
      h("summary", {}, group.name, h("span", { class: "quiet" }, ` ${rows.length} of ${values.length}`)),
      h("dl", { class: "facts" }, rows.map(([name, value]) => [h("dt", {}, name), h("dd", {}, short(value))])));
  }
}
