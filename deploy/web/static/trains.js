// An episode that a checkpoint or another policy plays on an evaluation level, step by step.

import { h, replace } from "./dom.js";
import { icon } from "./icons.js";
import { counted, fixed, whole } from "./format.js";
import { Inspector } from "./inspector.js";
import { RailMap } from "./map.js";
import { get } from "./session.js";
import { Timelines } from "./timelines.js";

const SPEEDS = [1, 2, 5, 10, 20, 50, 100];
const LATEST = "latest";
const SLOW_S = 8; // then it says why

export class Trains {
  constructor(name) {
    this.name = name;
    this.player = LATEST;
    this.level = null;
    this.number = 0;
    this.step = 0;
    this.selected = 0;
    this.speed = 10;
    this.shown = false;
    this.map = new RailMap((train) => this.select(train));
    this.inspector = new Inspector((step) => this.seek(step));
    this.timelines = new Timelines((train) => this.select(train), (step) => this.seek(step));
    this.choices = h("div", { class: "rowline" });
    this.said = h("p", { class: "quiet", role: "status" });
    this.result = h("span", { class: "quiet small" });
    this.buildControls();
    this.stage = h("div", { class: "stage", hidden: true }, h("div", { class: "mapbox" }, this.map.element), this.controls);
    this.aside = h("div", { class: "stack", hidden: true }, this.inspector.element);
    this.under = h("div", { hidden: true }, this.timelines.element);
    this.element = h("div", { class: "columns trains" },
      h("div", { class: "stack" }, h("section", { class: "card", "aria-label": "Episode" }, h("header", {}, this.choices, h("span", { class: "grow" }), this.result), this.said, this.stage), this.under), this.aside);
    document.addEventListener("keydown", (event) => this.onKey(event));
  }

  buildControls() {
    const button = (label, words, action, kind = "") => h("button", { type: "button", class: kind, "aria-label": words, title: words, onclick: action }, label);
    this.playButton = button(icon("play"), "Play (space)", () => this.toggle(), "main square");
    this.scrub = h("input", { type: "range", min: 0, max: 0, value: 0, "aria-label": "Step", oninput: (event) => this.seek(Number(event.target.value)) });
    this.place = h("output", { class: "place" });
    this.controls = h("div", { class: "controls" },
      button(icon("start"), "To the start (Home)", () => this.seek(0), "square"), button(icon("back"), "A step back (left arrow)", () => this.seek(this.step - 1), "square"),
      this.playButton,
      button(icon("on"), "A step on (right arrow)", () => this.seek(this.step + 1), "square"), button(icon("end"), "To the end (End)", () => this.seek(Infinity), "square"),
      this.scrub, this.place,
      h("label", { class: "small" }, h("span", { class: "hidden-text" }, "Speed"), h("select", { onchange: (event) => { this.speed = Number(event.target.value); this.tick(); } },
        SPEEDS.map((speed) => h("option", { value: speed, selected: speed === this.speed }, `${speed} step${speed > 1 ? "s" : ""}/s`)))));
  }

  updateRun(run) {
    this.run = run;
    this.level ??= run.levels[0];
    const key = JSON.stringify([run.checkpoints, run.evaluations.length, this.known !== undefined]);
    if (key !== this.runKey) this.drawChoices();
    this.runKey = key;
    if (this.shown && !this.document && !this.loading && this.latest() !== null) this.load();
  }

  async setShown(shown) {
    this.shown = shown;
    if (!shown) {
      this.pause();
      return;
    }
    if (this.known === undefined) {
      try {
        this.known = await get("/api/players", { run: this.name });
      } catch (error) {
        this.say(error.message);
        return;
      }
      this.drawChoices();
    }
    if (!this.document && this.run) this.load();
  }

  choose(player, level) {
    Object.assign(this, { player, level });
    this.drawChoices();
    this.load();
  }

  /** The newest checkpoint that was evaluated, or else the newest. */
  latest() {
    const evaluated = this.run?.evaluations.filter((row) => row.level === this.level).at(-1)?.episode;
    const newest = evaluated ?? this.run?.checkpoints.at(-1);
    return newest === undefined ? null : newest;
  }

  drawChoices() {
    if (!this.run || !this.known) return;
    const option = (value, text) => h("option", { value, selected: value === this.player }, text);
    const latest = this.latest();
    const level = this.known.levels.find((one) => one.name === this.level);
    const select = (label, options, onchange) => h("label", { class: "small" }, h("span", { class: "hidden-text" }, label), h("select", { onchange: (event) => onchange(event.target.value) }, options));
    const number = h("input", { type: "number", min: 0, max: level.count - 1, value: this.number, "aria-label": "Number of the evaluation level", onchange: (event) => this.goTo(Number(event.target.value)) });
    replace(this.choices,
      select("Who plays", [
        h("optgroup", { label: "Checkpoints" }, option(LATEST, latest === null ? "latest checkpoint: none yet" : `latest evaluated: ${whole(latest)}`),
          [...this.run.checkpoints].reverse().map((one) => option(`checkpoint:${one}`, `checkpoint ${whole(one)}`))),
        this.known.pretrained.length > 0 && h("optgroup", { label: "Pretrained" }, this.known.pretrained.map((one) => option(one, one))),
        level.references && h("optgroup", { label: "Reference policies" }, this.known.references.map((one) => option(one, one))),
      ], (player) => { this.player = player; this.load(); }),
      this.run.levels.length > 1 || this.known.levels.length > 1 ? select("Level", this.known.levels.map((one) => h("option", { value: one.name, selected: one.name === this.level }, one.name)), (name) => { this.level = name; this.number = 0; this.drawChoices(); this.load(); }) : h("b", {}, this.level),
      h("span", { class: "rowline numbers" }, h("button", { type: "button", class: "square", "aria-label": "Level before", onclick: () => this.goTo(this.number - 1) }, "‹"), number,
        h("button", { type: "button", class: "square", "aria-label": "Next level", onclick: () => this.goTo(this.number + 1) }, "›"), h("span", { class: "quiet small" }, `of ${whole(level.count)} evaluation levels`)));
  }

  goTo(number) {
    const count = this.known.levels.find((one) => one.name === this.level).count;
    this.number = Math.max(0, Math.min(count - 1, Number.isFinite(number) ? Math.floor(number) : 0));
    this.drawChoices();
    this.load();
  }

  say(text) {
    this.said.textContent = text;
    this.said.hidden = !text;
  }

  async load() {
    const latest = this.latest();
    if (this.player === LATEST && latest === null) {
      this.say("There is no checkpoint yet. Choose a reference policy, or wait: the first checkpoint plays as soon as it is there.");
      return;
    }
    this.pause();
    this.aborting?.abort();
    const aborting = this.aborting = new AbortController();
    this.loading = true;
    const began = Date.now();
    const wait = () => {
      const seconds = Math.floor((Date.now() - began) / 1000);
      this.say(`The level is being played … ${seconds} s${seconds >= SLOW_S ? " (the first time, machine code is made for it, which takes minutes)" : ""}`);
    };
    wait();
    const timer = setInterval(wait, 1000);
    this.element.setAttribute("aria-busy", "true");
    try {
      const player = this.player === LATEST ? `checkpoint:${latest}` : this.player;
      this.take(await get("/api/playback", { run: this.name, player, level: this.level, number: this.number }, aborting.signal));
      this.say("");
    } catch (error) {
      if (error.name !== "AbortError") this.say(error.message);
    } finally {
      clearInterval(timer);
      if (aborting === this.aborting) {
        this.loading = false;
        this.element.removeAttribute("aria-busy");
      }
    }
  }

  take(episode) {
    this.document = episode;
    for (const part of [this.stage, this.aside, this.under]) part.hidden = false; // so that they have a size
    this.map.load(episode);
    this.inspector.load(episode);
    this.timelines.load(episode);
    this.selected = Math.min(this.selected, episode.level.trains.length - 1);
    this.scrub.max = episode.steps.length - 1;
    const { result } = episode;
    this.result.textContent = `${episode.policy}: ${result.arrived} of ${counted(result.trains, "train")} arrived in ${counted(result.steps, "step")} · return ${fixed(result.return)}${result.score === null ? "" : ` · score ${fixed(result.score)}`}`;
    this.seek(0);
  }

  select(train) {
    this.selected = train;
    this.draw(false);
  }

  seek(step, smooth = false) {
    if (!this.document) return;
    this.step = Math.max(0, Math.min(this.document.steps.length - 1, step));
    this.draw(smooth);
  }

  draw(smooth) {
    if (!this.document) return;
    this.map.element.style.setProperty("--step", `${Math.min(400, 900 / this.speed)}ms`);
    this.map.show(this.step, this.selected, smooth);
    this.timelines.show(this.step, this.selected);
    this.inspector.show(this.selected, this.step);
    this.scrub.value = this.step;
    this.scrub.setAttribute("aria-valuetext", `step ${this.step} of ${this.document.steps.length - 1}`);
    this.place.textContent = `step ${this.step} / ${this.document.steps.length - 1}`;
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (!this.document) return;
    if (this.step === this.document.steps.length - 1) this.seek(0);
    this.playing = true;
    this.label("pause", "Pause (space)");
    this.tick();
  }

  tick() {
    clearTimeout(this.timer);
    if (!this.playing) return;
    this.timer = setTimeout(() => {
      this.seek(this.step + 1, true);
      if (this.step === this.document.steps.length - 1) this.pause();
      else this.tick();
    }, 1000 / this.speed);
  }

  pause() {
    this.playing = false;
    clearTimeout(this.timer);
    this.label("play", "Play (space)");
  }

  label(sign, words) {
    replace(this.playButton, icon(sign));
    this.playButton.setAttribute("aria-label", words);
    this.playButton.title = words;
  }

  onKey(event) {
    if (!this.shown || !this.document || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("select, textarea, [role=tab], input[type=number], .chart")) return;
    if (event.key === " " && event.target.closest("button, a, summary") && event.target !== this.playButton) return;
    const far = event.shiftKey ? 10 : 1;
    const turn = (way) => this.inspector.neighbour(this.selected, this.step, way) ?? this.step;
    const trains = this.document.level.trains.length;
    const actions = {
      " ": () => this.toggle(), ArrowLeft: () => this.seek(this.step - far), ArrowRight: () => this.seek(this.step + far),
      Home: () => this.seek(0), End: () => this.seek(Infinity), "[": () => this.seek(turn(-1)), "]": () => this.seek(turn(1)),
      ArrowUp: () => this.select((this.selected + trains - 1) % trains), ArrowDown: () => this.select((this.selected + 1) % trains),
    };
    if (!(event.key in actions)) return;
    event.preventDefault();
    actions[event.key]();
  }
}
