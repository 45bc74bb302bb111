"use strict";
// What every page's panel is made of: elements, rows, joints within their limits, and the row of the table that is
// chosen.
const panel = (() => {
  const node = document.getElementById("detail"), table = document.getElementById("points");
  const make = (tag, text, attributes = {}) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return made;
  };
  const row = (...cells) => {
    const tr = make("tr");
    cells.forEach((cell, k) => { const td = make(k ? "td" : "th"); if (k && typeof cell === "string") td.className = "n"; td.append(cell); tr.append(td); });
    return tr;
  };
  const minus = (value) => String(value).replace("-", "\u2212");
  const within = (joint, q) => {
    if (!joint.limits) return "";
    const [low, high] = joint.limits, share = (q - low) / (high - low);
    const bar = make("div", undefined, { class: share < 0.03 || share > 0.97 ? "within near" : "within", title: `${low} to ${high} ${joint.unit}` });
    bar.append(make("i", undefined, { style: `left:${(100 * Math.min(Math.max(share, 0), 1)).toFixed(1)}%` }));
    return bar;
  };
  const readings = (q) => {
    const own = make("table");
    data.joints.forEach((joint, j) => own.append(row(joint.name, `${minus(q[j])} ${joint.unit}`, within(joint, q[j]))));
    return own;
  };
  // The row before or after the chosen one, of those that are shown, as the table stands.
  const beside = (chosen, way) => {
    const rows = [...table.tBodies[0].rows].filter((each) => !each.hidden);
    const at = rows.findIndex((each) => Number(each.dataset.i) === chosen);
    if (rows.length) window.choose(Number(rows[(at + way + rows.length) % rows.length].dataset.i));
  };
  const steps = (chosen) => {
    const own = make("div", undefined, { class: "step" });
    for (const [words, way] of [["← previous", -1], ["next →", 1]]) {
      const button = make("button", words, { type: "button" });
      button.addEventListener("click", () => beside(chosen, way));
      own.append(button);
    }
    return own;
  };
  const mark = (i, seen = true) => {
    for (const each of table.querySelectorAll("tr.chosen")) each.classList.remove("chosen");
    const own = table.querySelector(`tr[data-i="${i}"]`);
    if (!own) return;
    own.classList.add("chosen");
    const box = own.closest(".scroll");
    if (seen) box.scrollTop += own.getBoundingClientRect().top - box.getBoundingClientRect().top - box.clientHeight / 2;
  };
  return { make, row, minus, readings, beside, steps, mark, show: (...parts) => node.replaceChildren(...parts) };
})();
