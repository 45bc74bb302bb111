"use strict";
// The chosen reading: its row, the joints within their limits, what is left of it; and what steers the picture.
(() => {
  const { poses, marks } = data;
  const { make, row, minus } = panel;
  const by = (id) => document.getElementById(id);
  let chosen = data.worst;
  const images = new Map();
  for (const each of document.querySelectorAll("#images a")) {
    const { pose } = each.dataset, at = () => marks.pose.findIndex((p) => poses.label[p] === pose);
    images.set(pose, [...(images.get(pose) ?? []), each]);
    each.addEventListener("click", () => choose(at()));
  }

  const show = (i) => {
    const pose = marks.pose[i], unit = marks.unit[i];
    const kind = { train: "training pose", test: "held-out pose" }[marks.part[i]] ?? marks.part[i];
    const sizes = make("table");
    const head = make("tr");
    for (const words of ["residual", `before / ${unit}`, `after / ${unit}`]) head.append(make("th", words, words === "residual" ? {} : { class: "n" }));
    sizes.append(head);
    sizes.append(row("size", minus(marks.size[i][0]), minus(marks.size[i][1])));
    if (marks.names[i].length > 1) marks.names[i].forEach((name, k) => sizes.append(row(name, minus(marks.own[i][0][k]), minus(marks.own[i][1][k]))));
    if (marks.turn[i]) sizes.append(row("turned by / deg", minus(marks.turn[i][0]), minus(marks.turn[i][1])));
    if (marks.held[i] !== null && marks.part[i] !== "test") sizes.append(row("held out", "", minus(marks.held[i])));
    if (marks.largest[i] !== null) sizes.append(row("largest", "", minus(marks.largest[i])));
    const words = `${kind}, ${marks.instrument[i]}${i === data.worst ? `; with the largest ${marks.held[i] === null ? "" : "held-out "}error` : ""}`;
    const parts = [panel.steps(i), make("h3", `pose ${poses.label[pose]}${marks.point[i] ? ` · ${marks.point[i]}` : ""}`), make("p", words, { class: "small" }), sizes, panel.readings(poses.q[pose])];
    for (const each of images.get(poses.label[pose]) ?? []) {
      const figure = make("figure");
      figure.append(make("img", undefined, { src: each.firstChild.src, alt: each.firstChild.alt }), make("figcaption", each.textContent));
      parts.push(figure);
    }
    panel.show(...parts);
  };
  const choose = (i) => {
    if (!(i in marks.pose)) return;
    chosen = i;
    show(i);
    panel.mark(i);
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
    if (timer === null) { timer = setInterval(() => panel.beside(chosen, 1), 900); play.textContent = "❚❚ stop"; } else { clearInterval(timer); timer = null; play.textContent = "▶ tour"; }
  });

  if (chosen !== null) { show(chosen); panel.mark(chosen, false); }
  // after the numbers have been painted
  requestAnimationFrame(() => setTimeout(() => { space.draw(); slider.value = space.slider; times(); }, 30));
})();
