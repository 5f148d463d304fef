// Signs that fonts may lack.

import { s } from "./dom.js";

const SHAPES = {
  play: "M4 2.5L13 8L4 13.5Z", pause: "M3.5 2.5H6.5V13.5H3.5ZM9.5 2.5H12.5V13.5H9.5Z",
  back: "M11 2.5L4 8L11 13.5Z", on: "M5 2.5L12 8L5 13.5Z",
  start: "M3 2.5H5V13.5H3ZM13 2.5L6 8L13 13.5Z", end: "M11 2.5H13V13.5H11ZM3 2.5L10 8L3 13.5Z",
  sun: "M8 4.5A3.5 3.5 0 1 1 8 11.5A3.5 3.5 0 1 1 8 4.5ZM7.3 0H8.7V2.6H7.3ZM7.3 13.4H8.7V16H7.3ZM0 7.3H2.6V8.7H0ZM13.4 7.3H16V8.7H13.4Z",
  moon: "M11.5 10.5A6 6 0 0 1 5.6 2A6.5 6.5 0 1 0 14 10A6 6 0 0 1 11.5 10.5Z",
};

export const icon = (name) => s("svg", { viewBox: "0 0 16 16", width: 14, height: 14, class: "icon", "aria-hidden": "true" },
  s("path", { d: SHAPES[name], fill: "currentColor" }));
