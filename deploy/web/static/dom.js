// Making elements. Text is always text: nothing here takes markup.

const SVG = "http://www.w3.org/2000/svg";

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") for (const [key, part] of Object.entries(value)) element.style.setProperty(key, part);
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const h = (tag, attributes = {}, ...children) => filled(document.createElement(tag), attributes, children);
export const s = (tag, attributes = {}, ...children) => filled(document.createElementNS(SVG, tag), attributes, children);

const FOCUSABLE = "a, button, select, input, summary, [tabindex]";

/** Put other children into an element. What has the focus is told by its place, so that keys go on where they were. */
export function replace(element, ...children) {
  const place = element.contains(document.activeElement) ? [...element.querySelectorAll(FOCUSABLE)].indexOf(document.activeElement) : -1;
  element.replaceChildren(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  if (place >= 0) element.querySelectorAll(FOCUSABLE)[place]?.focus({ preventScroll: true });
}

/** A table; cells that start with a number are right-aligned by their column's heading `{number: true}`. */
export function table(caption, columns, rows) {
  const kind = (column) => (column.number ? "number" : null);
  return h("div", { class: "scroll" },
    h("table", {},
      h("caption", { class: "hidden-text" }, caption),
      h("thead", {}, h("tr", {}, columns.map((column) => h("th", { scope: "col", class: kind(column) }, column.name)))),
      h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell, at) => h("td", { class: kind(columns[at]) }, cell)))))));
}

export function toast(text, wrong = false) {
  const element = h("div", { class: wrong ? "toast wrong" : "toast" }, text);
  document.getElementById("toasts").append(element);
  setTimeout(() => element.remove(), wrong ? 12000 : 5000);
}
