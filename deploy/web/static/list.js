// All runs and studies.

import { h, replace, table } from "./dom.js";
import { ago, counted, fixed, whole } from "./format.js";
import { banner, sayHow } from "./frame.js";
import { get } from "./session.js";
import { badge, bar, toneOf } from "./words.js";

const EVERY_MS = 4000;
const address = (kind, name) => `/${kind}/${name.split("/").map(encodeURIComponent).join("/")}`;

export function show(main) {
  const chosen = new Set();
  const body = h("div", { class: "stack" });
  replace(main, h("div", { class: "head" }, h("div", { class: "title" }, h("h1", {}, "Runs"))), body);
  const look = async () => {
    if (document.hidden) return;
    try {
      draw(body, chosen, await get("/api/list"));
      sayHow("good", "●", "live");
      banner(null);
    } catch {
      sayHow("wrong", "✕", "no answer");
      banner("railctl watch does not answer. This page goes on by itself once it does.", "wrong");
    }
  };
  look();
  setInterval(look, EVERY_MS);
}

function draw(body, chosen, { runs, studies, folder }) {
  const key = JSON.stringify([runs, studies]);
  if (body.dataset.key === key) return;
  body.dataset.key = key;
  const compare = h("button", { class: "main", type: "button", disabled: chosen.size < 2, onclick: () => {
    location.href = `/compare?${[...chosen].map((name) => `run=${encodeURIComponent(name)}`).join("&")}`;
  } }, "Compare chosen");
  const check = (run) => h("input", { type: "checkbox", "aria-label": `Choose ${run.run}`, checked: chosen.has(run.run), onchange: (event) => {
    if (event.target.checked) chosen.add(run.run);
    else chosen.delete(run.run);
    compare.disabled = chosen.size < 2;
  } });
  const columns = [{ name: h("span", { class: "hidden-text" }, "choose") }, { name: "run" }, { name: "state" }, { name: "algorithm" }, { name: "levels" }, { name: "seed", number: true }, { name: "episodes" }, { name: "return (100)", number: true }, { name: "changed", number: true }];
  replace(body,
    studies.length > 0 && h("section", { class: "card", "aria-labelledby": "studies" }, h("header", {}, h("h2", { id: "studies" }, "Studies")),
      table("Studies", [{ name: "study" }, { name: "contenders" }, { name: "levels" }, { name: "runs", number: true }], studies.map((study) => [
        h("a", { href: address("studies", study.study) }, study.study), study.wrong || study.contenders.join(", "), (study.levels ?? []).join(", "), study.runs ?? "–",
      ]))),
    h("section", { class: "card", "aria-labelledby": "runs" },
      h("header", {}, h("h2", { id: "runs" }, counted(runs.length, "run")), h("span", { class: "quiet small code" }, folder), h("span", { class: "grow" }), runs.length > 1 && compare),
      runs.length ? table("Runs, the newest first", columns, [...runs].reverse().map((run) => [
        check(run), h("a", { href: address("runs", run.run) }, run.run), badge(run.state, toneOf(run.state)), run.algorithm ?? "–", run.levels.join(", ") || "–", run.seed ?? "–",
        run.episodes === null ? run.problem : h("div", {}, bar(run.done, run.episodes, `Episodes of ${run.run}`), h("span", { class: "small quiet" }, `${whole(run.done)} / ${whole(run.episodes)}`)),
        fixed(run.return_last_100), ago(Date.now() / 1000 - run.changed_unix_s),
      ])) : h("p", { class: "quiet" }, "There are none yet: start one with ", h("code", {}, "railctl up"), ".")));
}
