// What every page has: the line at the top, whether the server answers, and light or dark.

import { h, replace } from "./dom.js";
import { clock } from "./format.js";
import { icon } from "./icons.js";
import { refreshSession, steers, takeKey } from "./session.js";

const THEME = "railctl-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
const pill = h("span", { class: "pill", id: "connection" }, "connecting …");

function applyTheme() {
  const chosen = localStorage.getItem(THEME);
  const theme = chosen ?? (dark.matches ? "dark" : "light");
  document.documentElement.dataset.theme = theme;
  return theme;
}

function themeButton() {
  const button = h("button", { class: "plain", id: "theme", type: "button" });
  const label = () => {
    const theme = applyTheme();
    replace(button, icon(theme === "dark" ? "sun" : "moon"), theme === "dark" ? "Light" : "Dark");
    button.setAttribute("aria-label", theme === "dark" ? "Switch to light colours" : "Switch to dark colours");
  };
  button.addEventListener("click", () => {
    localStorage.setItem(THEME, applyTheme() === "dark" ? "light" : "dark");
    label();
  });
  dark.addEventListener("change", label);
  label();
  return button;
}

export async function frame() {
  applyTheme();
  takeKey();
  replace(document.getElementById("top"),
    h("a", { class: "wordmark", href: "/" }, h("img", { src: "/static/icon.svg", alt: "" }), "railctl"),
    h("a", { href: "/", class: "small" }, "All runs"),
    h("span", { class: "grow" }),
    pill,
    themeButton());
  await refreshSession();
}

/** Say how news come: a tone, a sign and words. */
export function sayHow(tone, sign, text) {
  pill.className = `pill ${tone}`;
  replace(pill, h("span", { "aria-hidden": "true" }, sign), text);
}

export function banner(text, tone = "waits") {
  const element = document.getElementById("banner");
  element.hidden = !text;
  element.className = `banner ${tone}`;
  element.textContent = text ?? "";
}

/** Called by streams: since when nothing comes, or null. */
export function connection(onBack = () => {}) {
  return async (since, isBack) => {
    if (since !== null) {
      sayHow("wrong", "✕", "no answer");
      banner(`Nothing has come from railctl watch since ${clock(since / 1000)}. What you see is from then; this page goes on by itself once it answers.`, "wrong");
      return;
    }
    banner(null);
    if (isBack) {
      const could = steers();
      await refreshSession();
      if (could && !steers()) banner("railctl watch was started again: this page now only shows. Open the address that it printed to steer.");
      onBack();
    }
  };
}
