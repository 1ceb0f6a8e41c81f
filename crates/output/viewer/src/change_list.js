// The list of what has changed since the loaded map.

import { counted, element } from "./element.js";

/** Each change as `{ kind, before, after, distance }`; what is gone has no `after`, what is new no `before`. */
export function changesOf(changes) {
  if (!changes) return [];
  return [
    ...changes.gone.map((before) => ({ kind: "gone", before })),
    ...changes.new.map((after) => ({ kind: "new", after })),
    ...changes.moved.map((moved) => ({ kind: "moved", ...moved })),
  ];
}

export class ChangeList {
  /** `actions`: `{ go(change) }`. */
  constructor(run, actions) {
    for (const part of document.querySelectorAll(".changed")) part.hidden = false;
    const { unchanged, not_looked_at: unseen, newly_seen: first } = run.changes;
    const all = changesOf(run.changes);
    const counts = [`${counted(all.length, "change")} since the loaded map`, `${unchanged.toLocaleString("en")} unchanged`];
    if (unseen) counts.push(`${unseen.toLocaleString("en")} not looked at`);
    if (first) counts.push(`${first.toLocaleString("en")} seen for the first time`);
    document.getElementById("changes-counts").textContent = counts.join(", ");
    const list = document.getElementById("changes-list");
    list.replaceChildren(...all.map((change) => row(change, actions)));
    list.hidden = all.length === 0;
  }
}

function row(change, actions) {
  const { kind, before, after, distance } = change;
  const id = after && before ? `#${before.id} → #${after.id}` : `#${(after ?? before).id}`;
  const size = (after ?? before).box.size.map((side) => side.toFixed(2)).join(" × ");
  const where = distance === undefined ? `${size} m` : `by ${distance.toFixed(2)} m`;
  const button = element("button", { type: "button" }, [
    element("span", { className: `kind ${kind}`, textContent: kind }),
    element("span", { textContent: before && after && before.id === after.id ? `#${before.id}` : id }),
    element("span", { className: "where", textContent: where, title: `${size} m` }),
  ]);
  button.addEventListener("click", () => actions.go(change));
  return element("li", {}, [button]);
}
