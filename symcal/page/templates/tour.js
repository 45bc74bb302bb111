"use strict";
// The way through a plan: the arm moves along it, stops where it is told, and says what a pose is expected to tell.
(() => {
  const { poses, tour, colors, around } = data;
  const { make, row, minus } = panel;
  const { node, escaped, xyz, shown } = stage;
  const by = (id) => document.getElementById(id);
  const size = stage.span(tour), last = tour.at.length - 1, whole = tour.at[last];
  const tool = (i) => tour.nodes[i][tour.nodes[i].length - 1];
  let chosen = 0, frame = 0;

  // what is read of the arm, joined to the tool
  const read = (i) => (tour.read ? tour.read[i].flatMap((p) => [tool(i), p, null]) : []);
  // ways of one kind as one line with gaps
  const ways = (kind) => {
    const points = [];
    for (let i = 1; i <= last; i++) if (poses.way[tour.segment[i]] === kind) {
      if (points.at(-1) !== tool(i - 1)) points.push(null, tool(i - 1));
      points.push(tool(i));
    }
    return xyz(points.slice(1));
  };
  const arms = () => {
    const step = Math.ceil(tour.reached.length / 200), points = [];
    for (let k = 0; k < tour.reached.length; k += step) points.push(...tour.nodes[tour.reached[k]], null);
    return xyz(points);
  };
  const number = (value) => minus(Number(value.toPrecision(3)));
  const said = (k) => `pose ${escaped(poses.label[k])}${poses.required[k] ? " (required)" : ""}${poses.touches && poses.touches[k] ? ` · ${escaped(poses.touches[k])}` : ""}<br>worth ${number(poses.worth[k])} %, foretold ${number(poses.foretold[k])} mm`;
  const every = poses.label.map((_, k) => k), some = (must) => every.filter((k) => poses.required[k] === must);
  const colourings = { worth: ["worth / %", poses.worth], foretold: ["foretold / mm", poses.foretold], order: ["order", every.map((k) => k + 1)] };
  const bar = (by) => ({ colorscale: "Cividis", colorbar: { title: { text: colourings[by][0], side: "right" }, thickness: 10, len: 0.6, outlinewidth: 0, x: 1, xanchor: "right" } });
  const marks = (must, name, symbol) => {
    const own = some(must);
    return { type: "scatter3d", mode: "markers", name, showlegend: own.length > 0, hoverinfo: "text", text: own.map(said), customdata: own, ...xyz(own.map((k) => poses.tool[k])), marker: { size: own.length > 300 ? 3 : 5, symbol, color: own.map((k) => colourings.worth[1][k]), coloraxis: "coloraxis" } };
  };
  const thing = (each) => {
    const looks = { plane: { type: "mesh3d", i: [0, 0], j: [1, 2], k: [2, 3], color: colors.test, opacity: 0.12, hoverinfo: "name" }, place: { type: "scatter3d", mode: "markers+text", text: [escaped(each.name)], textposition: "top center", marker: { size: 6, symbol: "diamond", color: colors.train }, hoverinfo: "name" } };
    const line = { type: "scatter3d", mode: "lines", hoverinfo: "name", line: { color: each.kind === "keep out" ? colors.test : colors.train, width: 3 } };
    return { name: escaped(each.name), showlegend: each.kind !== "place", ...(looks[each.kind] ?? line), ...xyz(each.points) };
  };
  const traces = () => [
    { ...shown, mode: "lines", visible: false, line: { color: "#b9c1c7", width: 1.5 }, ...arms() },
    ...stage.arm(tour, frame, size),
    { ...shown, mode: "lines+markers", line: { color: "#8a4f7d", width: 4 }, marker: { size: 3, color: "#8a4f7d" }, ...xyz(read(frame)) },
    { ...shown, mode: "markers", marker: { size: 12, symbol: "circle-open", color: colors.test, line: { width: 3 } }, ...xyz([poses.tool[chosen]]) },
    { ...shown, mode: "lines", name: "straight", showlegend: poses.way.includes("straight"), line: { color: colors.after, width: 5 }, ...ways("straight") },
    { ...shown, mode: "lines", name: "joint motion", showlegend: poses.way.includes("joints"), line: { color: colors.before, width: 2.5 }, ...ways("joints") },
    marks(false, "pose", "circle"),
    marks(true, "required", "square"),
    stage.foot(tour),
    ...around.map(thing),
  ];

  const way = (k) => `${poses.way[k] === "straight" ? "the tool moves straight" : "the joints move linearly"}${poses.time ? `, ${number(poses.time[k])} s at full joint speeds` : ""}${poses.why[k] ? `: ${poses.why[k]}` : ""}`;
  const show = (k) => {
    const facts = make("table"), minusOf = (values, digits) => values.map((v) => minus(v.toFixed(digits))).join(", ");
    facts.append(row("tool at / mm", minusOf(poses.tool[k], 1)), row("its z axis", minusOf(poses.axis[k].map((v) => v / 100), 2)));
    if (poses.touches && poses.touches[k]) facts.append(row("touches", poses.touches[k]));
    facts.append(row("foretold here", `${number(poses.foretold[k])} mm rms`), row("over the region", `${number(data.mean)} mm rms`), row("… without it", `${number(poses.without[k])} mm (+${number(poses.worth[k])} %)`), row("its share", `${number(poses.directions[k])} of ${data.rank} directions`));
    const tells = poses.tells[k].map(([name, more]) => `${name} (+${more})`).join(", ");
    const words = `${poses.required[k] ? "required; " : ""}stop ${k + 1} of ${poses.label.length}${k === data.best ? "; the one that tells most" : ""}`;
    panel.show(panel.steps(k), make("h3", `pose ${poses.label[k]}`), make("p", words, { class: "small" }), panel.readings(poses.q[k]), facts,
      make("p", `Way to it: ${way(k)}.`), make("p", tells ? `Without it the standard deviation grows most of ${tells}.` : "Without it no parameter would be known noticeably less."));
  };

  const slider = by("at"), clock = by("clock"), play = by("play"), speed = by("speed");
  const seconds = (t) => (t < 10 ? t.toFixed(1) : t.toFixed(0));
  const go = (i) => {
    frame = i;
    const at = tour.reached.indexOf(i), k = tour.segment[i];
    const where = at >= 0 ? `at pose ${poses.label[at]}` : i === 0 ? "at the start" : `on the way to pose ${poses.label[k]}`;
    clock.textContent = data.timed ? `${seconds(tour.at[i])} of ${seconds(whole)} s, ${where}` : where;
    slider.value = i;
    slider.setAttribute("aria-valuetext", clock.textContent);
    stage.move(1, tour, i, size, { 4: read(i), 5: [poses.tool[chosen]] });
  };
  const mark = (k) => { chosen = k; show(k); panel.mark(k); };
  const choose = (k) => {
    if (!(k in poses.label)) return;
    stop();
    mark(k);
    go(tour.reached[k]);
  };
  window.choose = choose;

  // Pictures follow the clock: where drawing is slow some are left out, and the arm is as quick as before.
  let running = null;
  const stop = () => {
    if (running === null) return;
    cancelAnimationFrame(running);
    running = null;
    play.textContent = "▶ play";
    play.setAttribute("aria-pressed", "false");
    by("detail").setAttribute("aria-live", "polite");
  };
  const start = () => {
    if (frame === last) go(0);
    by("detail").setAttribute("aria-live", "off");
    play.textContent = "❚❚ pause";
    play.setAttribute("aria-pressed", "true");
    let before = performance.now(), time = tour.at[frame];
    const tick = (now) => {
      time += (Math.max(now - before, 0) / 1000) * Number(speed.value);
      before = now;
      let i = frame;
      while (i < last && tour.at[i + 1] <= time) i++;
      if (i !== frame) {
        const passed = tour.reached.findLastIndex((r) => r <= i);
        if (passed >= 0 && tour.reached[passed] > frame) mark(passed);
        go(i);
      }
      if (i === last) stop();
      else running = requestAnimationFrame(tick);
    };
    running = requestAnimationFrame(tick);
  };
  play.addEventListener("click", () => (running === null ? start() : stop()));
  slider.max = last;
  slider.addEventListener("input", () => { stop(); go(Number(slider.value)); });
  const step = (way) => {
    stop();
    const ahead = way > 0 ? tour.reached.findIndex((r) => r > frame) : tour.reached.findLastIndex((r) => r < frame);
    if (ahead >= 0) choose(ahead);
    else if (way < 0) go(0);
  };
  by("back").addEventListener("click", () => step(-1));
  by("forth").addEventListener("click", () => step(1));
  by("colour").addEventListener("change", ({ target }) => {
    if (node.data) Plotly.update(node, { "marker.color": [false, true].map((must) => some(must).map((k) => colourings[target.value][1][k])) }, { coloraxis: bar(target.value) }, [8, 9]);
  });
  by("show-arms").addEventListener("change", ({ target }) => { if (node.data) Plotly.restyle(node, { visible: target.checked }, [0]); });
  by("show-way").addEventListener("change", ({ target }) => { if (node.data) Plotly.restyle(node, { visible: target.checked }, [6, 7]); });
  by("show-around").closest("label").hidden = !around.length;
  by("show-around").addEventListener("change", ({ target }) => { if (node.data) Plotly.restyle(node, { visible: target.checked }, around.map((_, k) => 11 + k)); });

  show(chosen);
  panel.mark(chosen, false);
  go(0);
  // after the numbers have been painted
  requestAnimationFrame(() => setTimeout(() => { if (stage.able()) stage.draw(traces(), { coloraxis: bar("worth") }); }, 30));
})();
