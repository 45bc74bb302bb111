"use strict";
// The chosen reading: its row, the joints within their limits, what is left of it; and what steers the picture.
(() => {
  const { poses, marks, joints } = data;
  const by = (id) => document.getElementById(id);
  const panel = by("detail"), table = by("points");
  let chosen = data.worst;
  const images = new Map();
  for (const each of document.querySelectorAll("#images a")) {
    const { pose } = each.dataset, at = () => marks.pose.findIndex((p) => poses.label[p] === pose);
    images.set(pose, [...(images.get(pose) ?? []), each]);
    each.addEventListener("click", () => choose(at()));
  }

  const make = (tag, text, attributes = {}) => {
    const node = document.createElement(tag);
    if (text !== undefined) node.textContent = text;
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
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
  const step = (by) => {
    const rows = [...table.tBodies[0].rows].filter((each) => !each.hidden);
    const at = rows.findIndex((each) => Number(each.dataset.i) === chosen);
    if (rows.length) choose(Number(rows[(at + by + rows.length) % rows.length].dataset.i));
  };
  const show = (i) => {
    const pose = marks.pose[i], unit = marks.unit[i];
    const steps = make("div", undefined, { class: "step" });
    for (const [words, way] of [["← previous", -1], ["next →", 1]]) {
      const button = make("button", words, { type: "button" });
      button.addEventListener("click", () => step(way));
      steps.append(button);
    }
    const kind = { train: "training pose", test: "held-out pose" }[marks.part[i]] ?? marks.part[i];
    const sizes = make("table");
    const head = make("tr");
    for (const words of ["residual", `before / ${unit}`, `after / ${unit}`]) head.append(make("th", words, words === "residual" ? {} : { class: "n" }));
    sizes.append(head);
    sizes.append(row("size", minus(marks.size[i][0]), minus(marks.size[i][1])));
    if (marks.names[i].length > 1) marks.names[i].forEach((name, k) => sizes.append(row(name, minus(marks.own[i][0][k]), minus(marks.own[i][1][k]))));
    if (marks.turn[i]) sizes.append(row("turned by / deg", minus(marks.turn[i][0]), minus(marks.turn[i][1])));
    if (marks.held[i] !== null && marks.part[i] !== "test") sizes.append(row("held out", "", minus(marks.held[i])));
    const q = make("table");
    joints.forEach((joint, j) => q.append(row(joint.name, `${minus(poses.q[pose][j])} ${joint.unit}`, within(joint, poses.q[pose][j]))));
    panel.replaceChildren(steps, make("h3", `pose ${poses.label[pose]}${marks.point[i] ? ` · ${marks.point[i]}` : ""}`), make("p", `${kind}, ${marks.instrument[i]}${i === data.worst ? `; with the largest ${marks.held[i] === null ? "" : "held-out "}error` : ""}`, { class: "small" }), sizes, q);
    for (const each of images.get(poses.label[pose]) ?? []) {
      const figure = make("figure");
      figure.append(make("img", undefined, { src: each.firstChild.src, alt: each.firstChild.alt }), make("figcaption", each.textContent));
      panel.append(figure);
    }
  };
  const choose = (i) => {
    if (!(i in marks.pose)) return;
    chosen = i;
    show(i);
    for (const each of table.querySelectorAll("tr.chosen")) each.classList.remove("chosen");
    const own = table.querySelector(`tr[data-i="${i}"]`);
    if (own) {
      own.classList.add("chosen");
      const box = own.closest(".scroll");
      box.scrollTop += own.getBoundingClientRect().top - box.getBoundingClientRect().top - box.clientHeight / 2;
    }
    space.arm(marks.pose[i], i);
  };
  window.choose = choose;

  const slider = by("exaggerate"), times = () => { by("times").textContent = space.times >= 10 ? Math.round(space.times) : space.times.toFixed(1); };
  slider.addEventListener("input", () => { space.exaggerate(Number(slider.value)); times(); });
  by("colour").addEventListener("change", (event) => space.colour(event.target.value));
  for (const [id, trace] of [["show-before", 4], ["show-after", 5], ["show-arms", 0]]) by(id).addEventListener("change", (event) => space.visible(trace, event.target.checked));
  by("show-area").addEventListener("change", (event) => space.area(event.target.checked));
  by("area-choice").hidden = !data.area;
  if (!marks.held.some((v) => v !== null)) by("colour").querySelector("[value=held]").remove();
  if (!marks.vector.some(Boolean)) for (const each of [slider, by("show-before"), by("show-after")]) each.closest("label").hidden = true;

  const play = by("play");
  let timer = null;
  play.addEventListener("click", () => {
    play.setAttribute("aria-pressed", String(timer === null));
    if (timer === null) { timer = setInterval(() => step(1), 900); play.textContent = "❚❚ stop"; } else { clearInterval(timer); timer = null; play.textContent = "▶ tour"; }
  });

  if (chosen !== null) { show(chosen); table.querySelector(`tr[data-i="${chosen}"]`)?.classList.add("chosen"); }
  // after the numbers have been painted
  requestAnimationFrame(() => setTimeout(() => { space.draw(); slider.value = space.slider; times(); }, 30));
})();
