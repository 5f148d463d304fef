// Which page it is, by its address.

import { frame } from "./frame.js";

const PAGES = [
  [/^\/runs\/(.+)$/, () => import("./run.js")],
  [/^\/studies\/(.+)$/, () => import("./study.js")],
  [/^\/compare$/, () => import("./compare.js")],
  [/^\/$/, () => import("./list.js")],
];

await frame();
for (const [form, load] of PAGES) {
  const found = form.exec(location.pathname);
  if (found === null) continue;
  const name = decodeURIComponent(found[1] ?? "");
  document.title = `${name || "runs"} · railctl`;
  (await load()).show(document.getElementById("main"), name);
  break;
}
