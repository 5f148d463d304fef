// One run.

import { Actors } from "./actors.js";
import { Curves } from "./curves.js";
import { h, replace, table, toast } from "./dom.js";
import { ago, clock, counted, duration, fixed, percent, whole } from "./format.js";
import { banner, connection, sayHow } from "./frame.js";
import { icon } from "./icons.js";
import { Learning } from "./learning.js";
import { post, steers, whyNot } from "./session.js";
import { Stream } from "./stream.js";
import { Trains } from "./trains.js";
import { badge, bar, figures } from "./words.js";

const TABS = [["overview", "Overview"], ["trains", "Trains"], ["learning", "Learning"]];

export function show(main, name) {
  const page = new RunPage(main, name);
  new Stream([["run", name]], {
    evaluations: (document) => page.onEvaluations(document.evaluations),
    run: (document) => page.onRun(document),
    curves: (document) => page.curves.update(document),
    metrics: (document) => page.learning.update(document),
    problem: (document) => page.onProblem(document.text),
  }, connection(() => page.drawActions()));
}

class RunPage {
  constructor(main, name) {
    this.main = main;
    this.name = name;
    this.document = null;
    this.scored = [];
    this.curves = new Curves(name);
    this.actors = new Actors(name);
    this.learning = new Learning();
    this.trains = new Trains(name);
    this.head = h("div", { class: "head" });
    this.actions = h("div", { class: "actions" });
    this.evaluations = h("div", { class: "tall", tabindex: 0, "aria-label": "All evaluations" });
    this.processes = h("div");
    this.events = h("ol", { class: "events", tabindex: 0, "aria-label": "Events, the newest first" });
  }

  onProblem(text) {
    sayHow("wrong", "✕", "not there");
    replace(this.main, h("section", { class: "card" }, h("h1", {}, this.name), h("p", {}, text), h("p", {}, h("a", { href: "/" }, "All runs"))));
  }

  onEvaluations(scored) {
    this.scored = scored;
    if (this.document) this.onRun(this.document);
  }

  onRun(document) {
    if (document.wrong) {
      this.document = null;
      this.onProblem(document.wrong);
      return;
    }
    const first = this.document === null;
    this.document = { ...document, evaluations: this.scored };
    if (first) this.build();
    this.drawSource();
    this.drawHead();
    this.drawActions();
    this.actors.update(this.document);
    this.curves.updateRun(this.document);
    this.trains.updateRun(this.document);
    this.drawEvaluations();
    this.drawProcesses();
    this.drawEvents();
    const over = ["finished", "failed"].includes(document.view.state) && !document.view.processes.length;
    for (const card of [this.actors.element, this.processes.parentElement]) card.hidden = over;
  }

  build() {
    const panels = {
      overview: h("div", { class: "columns" },
        h("div", { class: "stack" }, this.curves.element,
          h("section", { class: "card", "aria-labelledby": "evaluations" }, h("header", {}, h("h2", { id: "evaluations" }, "Evaluations")), this.evaluations)),
        h("div", { class: "stack" }, this.actors.element,
          h("section", { class: "card", "aria-labelledby": "processes" }, h("header", {}, h("h2", { id: "processes" }, "Processes")), this.processes),
          h("section", { class: "card", "aria-labelledby": "events" }, h("header", {}, h("h2", { id: "events" }, "Events")), this.events))),
      trains: this.trains.element,
      learning: this.learning.element,
    };
    this.tabs = new Map();
    const list = h("div", { class: "tabs", role: "tablist", "aria-label": "Of this run" });
    for (const [id, label] of TABS) {
      const panel = panels[id];
      panel.id = `panel-${id}`;
      panel.tabIndex = -1;
      panel.setAttribute("role", "tabpanel");
      panel.setAttribute("aria-labelledby", `tab-${id}`);
      const button = h("button", { role: "tab", id: `tab-${id}`, "aria-controls": panel.id, type: "button", onclick: (event) => { this.select(id); if (event.detail > 0) this.enter(id); } }, label);
      this.tabs.set(id, { button, panel });
      list.append(button);
    }
    list.addEventListener("keydown", (event) => this.turnTab(event));
    replace(this.main, this.head, list, [...this.tabs.values()].map((tab) => tab.panel));
    const wanted = location.hash.slice(1);
    this.select(this.tabs.has(wanted) ? wanted : "overview", false);
  }

  select(id, remember = true) {
    for (const [other, { button, panel }] of this.tabs) {
      button.setAttribute("aria-selected", String(other === id));
      button.tabIndex = other === id ? 0 : -1;
      panel.hidden = other !== id;
    }
    this.selected = id;
    if (remember) history.replaceState(null, "", `${location.pathname}${location.search}#${id}`);
    this.trains.setShown(id === "trains");
  }

  /** Who clicked means the keys for what is shown now; who came by keys stays at the tabs. */
  enter(id) {
    this.tabs.get(id).panel.focus({ preventScroll: true });
  }

  turnTab(event) {
    const turn = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (turn === undefined) return;
    event.preventDefault();
    const ids = TABS.map(([id]) => id);
    const next = ids[(ids.indexOf(this.selected) + turn + ids.length) % ids.length];
    this.select(next);
    this.tabs.get(next).button.focus();
  }

  drawSource() {
    const { source, silent_since_unix_s: silent } = this.document;
    if (source === "live") {
      sayHow("good", "●", "live");
      if (this.wasSilent) banner(null);
      this.wasSilent = false;
    } else if (source === "silent") {
      sayHow("waits", "◐", "no answer");
      banner(`The run's supervisor has not answered since ${clock(silent)}. What you see is what its files say.`);
      this.wasSilent = true;
    } else {
      sayHow("", "▤", "from files");
      if (this.wasSilent) banner(null);
      this.wasSilent = false;
    }
  }

  drawHead() {
    const { view, levels, seed, lag, mode } = this.document;
    const { progress } = view;
    const last = this.document.evaluations.at(-1);
    const done = progress?.done ?? 0;
    const left = view.time_left_s ? `${duration(view.time_left_s)} left` : view.starting;
    replace(this.head,
      h("div", { class: "title" },
        h("div", {}, h("h1", {}, this.name),
          h("div", { class: "quiet" }, [view.algorithm, levels.join(" + "), `seed ${seed}`, lag === "free" ? "lag free: corrected for age, not exact" : `lag ${lag}`].join(" · "))),
        badge(view.state, view.tone), this.actions),
      h("div", { class: "progress" }, bar(done, view.episodes, "Episodes"),
        h("div", { class: "text" }, h("span", {}, `${whole(done)} of ${counted(view.episodes, "episode")}`), h("span", {}, this.document.source === "files" && view.state === "stopped" ? this.document.reason : left))),
      view.problems.length > 0 && h("ul", { class: "problems" }, view.problems.map((text) => h("li", {}, h("b", { "aria-hidden": "true" }, "! "), text))),
      progress && figures([
        ["return, last 100", fixed(progress.return_last_100)],
        [`evaluation (${last?.mode ?? mode})`, fixed(last?.return), last ? `after ${whole(last.episode)}` : ""],
        ["all arrived", last ? percent(last.all_arrived_share) : "–", last ? `of ${last.levels} levels` : ""],
        ...(this.document.source === "live" ? [
          ["speed", fixed(progress.episodes_per_s, 1), `episodes/s · ${whole(progress.steps_per_s)} steps/s`],
          ["leased · waiting", `${whole(progress.leased)} · ${whole(progress.waiting)}`, "episodes"],
        ] : []),
        ...(lag !== 0 ? [["staleness, last 100", fixed(progress.staleness_last_100 ?? 0, 1), "versions"]] : []),
        ...(progress.snapshot ? [["snapshot", whole(progress.snapshot), "episodes"]] : []),
      ]));
  }

  drawActions() {
    if (!this.document) return;
    const { view } = this.document;
    const may = steers();
    const lives = !["finished", "stopped", "failed", "unsupervised", "stopping"].includes(view.state);
    const key = JSON.stringify([may, lives, view.state]);
    if (key === this.actionsKey) return;
    this.actionsKey = key;
    const button = (verb, label, allowed, kind = "") => h("button", {
      type: "button", class: kind, disabled: !may || !allowed, title: may ? null : whyNot(), onclick: (event) => this.steer(event.currentTarget, verb),
    }, label);
    replace(this.actions, lives && [
      view.state === "paused" ? button("resume", [icon("play"), "Resume"], true, "main") : button("pause", [icon("pause"), "Pause"], ["running", "starting"].includes(view.state)),
      button("checkpoint", "Checkpoint", ["running", "paused"].includes(view.state)),
      button("down", "Stop …", true),
    ]);
  }

  async steer(button, verb) {
    if (verb === "down" && !confirm(`Stop run ${this.name}? Its learner writes a snapshot first, and railctl up --name ${this.name} goes on.`)) return;
    button.disabled = true;
    try {
      toast((await post("/api/steer", { run: this.name, verb })).text);
    } catch (error) {
      toast(error.message, true);
    }
    this.actionsKey = null;
    this.drawActions();
  }

  drawEvaluations() {
    const rows = [...this.document.evaluations].reverse();
    if (!rows.length) {
      replace(this.evaluations, h("p", { class: "quiet" }, "No checkpoint has been evaluated yet."));
      return;
    }
    const key = rows.length;
    if (key === this.evaluationsKey) return;
    this.evaluationsKey = key;
    const mixed = this.document.levels.length > 1;
    const scored = rows.some((row) => row.score !== null);
    const columns = [
      { name: "checkpoint" }, ...(mixed ? [{ name: "level" }] : []), { name: `${rows[0].mode} return`, number: true }, { name: "trains arrived", number: true },
      { name: "all arrived (95%)", number: true }, { name: "steps", number: true }, ...(scored ? [{ name: "flatland score", number: true }] : []),
    ];
    replace(this.evaluations, table("Evaluations of checkpoints, the newest first", columns, rows.map((row) => [
      h("button", { class: "plain", type: "button", "aria-label": `Watch trains of checkpoint ${row.episode} on ${row.level}`, title: "Watch its trains", onclick: () => this.watch(row) }, icon("play"), whole(row.episode)), ...(mixed ? [row.level] : []), fixed(row.return), percent(row.arrived_share),
      [percent(row.all_arrived_share), h("span", { class: "quiet" }, ` ${Math.round(row.all_arrived_low * 100)}–${Math.round(row.all_arrived_high * 100)}`)],
      whole(row.mean_steps), ...(scored ? [fixed(row.score)] : []),
    ])));
  }

  watch(row) {
    this.select("trains");
    this.enter("trains");
    this.trains.choose(`checkpoint:${row.episode}`, row.level);
  }

  drawProcesses() {
    const { processes } = this.document.view;
    if (!processes.length) {
      replace(this.processes, h("p", { class: "quiet" }, "No process of this run is alive."));
      return;
    }
    replace(this.processes, table("Processes", [{ name: "process" }, { name: "state" }, { name: "restarts", number: true }, { name: "heard", number: true }], processes.map((one) => [
      h("span", { title: one.pid === null ? "" : `pid ${one.pid}` }, one.process), one.state, one.restarts, one.silent_s === null ? "–" : ago(one.silent_s),
    ])));
  }

  drawEvents() {
    const { events } = this.document;
    const key = JSON.stringify([events.length, events[0]?.time]);
    if (key === this.eventsKey) return;
    this.eventsKey = key;
    if (!events.length) replace(this.events, h("li", { class: "quiet" }, h("span"), h("span", {}, "Nothing has been written down.")));
    else replace(this.events, events.map((event) => h("li", {},
      h("time", { datetime: event.time, title: event.time }, clock(Date.parse(event.time) / 1000)), h("span", {}, event.text))));
  }
}
