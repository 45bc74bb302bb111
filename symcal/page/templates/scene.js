"use strict";
// The arm in space. What is drawn was computed with the kinematics of the identification; here it is only shown.
const data = JSON.parse(document.getElementById("data").textContent);
const space = (() => {
  const { colors, poses, marks, joints, through, area } = data;
  const node = document.getElementById("space");
  const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const count = marks.pose.length;
  const all = Array.from({ length: count }, (_, i) => i);
  const add = (a, b, k) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const columns = (points) => [0, 1, 2].map((k) => points.map((p) => (p === null ? null : p[k])));
  const xyz = (points) => { const [x, y, z] = columns(points); return { x, y, z }; };
  const unit = (hundredths) => hundredths.map((v) => v / 100);

  const middle = (values) => { const s = values.filter((v) => v > 0).sort((a, b) => a - b); return s.length ? s[s.length >> 1] : 1; };
  const length = (v) => Math.hypot(...v);
  const size = Math.max(...[0, 1, 2].map((k) => { const v = poses.nodes.flatMap((p) => p.map((n) => n[k])); return v.reduce((a, b) => Math.max(a, b), -1e9) - v.reduce((a, b) => Math.min(a, b), 1e9); }), 1);
  const vectors = marks.vector.filter(Boolean);
  const usual = (0.06 * size) / middle(vectors.map((v) => length(v[0])));
  const most = Math.max(10 * usual, 10);
  const timesOf = (slider) => Math.pow(most, slider / 100);

  const arrows = (state, times) => {
    const points = [];
    for (const i of all) if (marks.vector[i]) points.push(marks.at[i], add(marks.at[i], marks.vector[i][state], times), null);
    return xyz(points);
  };
  const arms = () => {
    const step = Math.ceil(poses.nodes.length / 200), points = [];
    for (let i = 0; i < poses.nodes.length; i += step) points.push(...poses.nodes[i], null);
    return xyz(points);
  };
  // Limits of each joint about its axis, and where in them it is.
  const limits = (pose) => {
    const points = [], radius = 0.045 * size, nodes = poses.nodes[pose];
    joints.forEach((joint, j) => {
      const axis = unit(poses.axes[pose][j]), pointer = unit(poses.pointers[pose][j]), at = nodes[through[j]], q = poses.q[pose][j];
      if (joint.kind === "revolute") {
        const side = cross(axis, pointer), rim = (turn) => add(add(at, pointer, radius * Math.cos(turn)), side, radius * Math.sin(turn));
        points.push(at, rim(0), null);
        if (!joint.limits) return;
        const [low, high] = joint.limits.map((l) => Math.min(Math.max((l - q) * joint.sense, -360), 360) * Math.PI / 180);
        for (let k = 0; k <= 36; k++) points.push(rim(low + ((high - low) * k) / 36));
        points.push(null);
      } else if (joint.limits) {
        const next = nodes[j + 1 < through.length ? through[j + 1] : nodes.length - 1];
        const now = add(at, axis, dot(axis, add(next, at, -1)));
        points.push(...joint.limits.map((l) => add(now, axis, (l - q) * joint.sense)), null);
      }
    });
    return xyz(points);
  };
  const along = (pose) => ({
    ...xyz(joints.map((_, j) => poses.nodes[pose][through[j]])),
    text: joints.map((joint, j) => `${escaped(joint.name)}: ${poses.q[pose][j]} ${joint.unit}${joint.limits ? ` (${joint.limits.map((l) => +l.toFixed(2)).join(" to ")})` : ""}`),
  });
  const said = (i) => `${escaped(poses.label[marks.pose[i]])}${marks.point[i] ? ` · ${escaped(marks.point[i])}` : ""}<br>${marks.size[i][0]} → ${marks.size[i][1]} ${marks.unit[i]}`;

  // One unit has one scale of colours: readings in other units are in the table alone. What is not judged has no
  // held-out error and stands apart.
  const main = marks.unit[data.worst ?? 0], drawn = all.filter((i) => marks.unit[i] === main);
  const judged = (part) => drawn.some((i) => marks.part[i] === part && marks.held[i] !== null);
  const apart = (i) => judged(marks.part[i]) && marks.held[i] === null;
  const parts = [["train", "training", "circle"], ["test", "held-out", "diamond"], ["other", "not judged", "cross"]].map(([part, name, symbol]) => ({ part, name, symbol, own: drawn.filter((i) => (apart(i) ? "other" : marks.part[i]) === part) }));
  const colourings = {
    held: (i) => marks.held[i],
    after: (i) => marks.size[i][1],
    before: (i) => marks.size[i][0],
  };
  const colour = (by) => parts.map(({ part, own }) => {
    if (by === "split" || !own.some((i) => colourings[by](i) !== null)) return { color: (by === "split" && colors[part]) || colors.faint };
    return { color: own.map((i) => colourings[by](i) ?? 0), coloraxis: "coloraxis" };
  });
  const ceiling = (by) => {
    const values = by === "split" ? [1] : drawn.map(colourings[by]).filter((v) => v !== null).sort((a, b) => a - b);
    return values.length ? values[Math.min(values.length - 1, Math.floor(0.97 * values.length))] : 1;
  };
  const bar = (by) => ({
    cmin: 0, cmax: ceiling(by), colorscale: "Cividis", showscale: by !== "split",
    colorbar: { title: { text: `error / ${main ?? ""}`, side: "right" }, thickness: 10, len: 0.6, outlinewidth: 0, x: 1, xanchor: "right" },
  });

  const hidden = { hoverinfo: "skip", showlegend: false };
  const shown = { ...hidden, type: "scatter3d" };
  const start = marks.pose[data.worst ?? 0] ?? 0, held = marks.held.some((v) => v !== null) ? "held" : "after";
  const traces = (times) => [
    { ...shown, mode: "lines", visible: false, line: { color: "#b9c1c7", width: 1.5 }, ...arms() },
    { ...shown, mode: "lines", line: { color: colors.ink, width: 9 }, ...xyz(poses.nodes[start]) },
    { ...shown, mode: "lines", line: { color: "#8a4f7d", width: 3 }, ...limits(start) },
    { type: "scatter3d", mode: "markers", showlegend: false, hoverinfo: "text", marker: { size: 6.5, color: "#ffffff", symbol: joints.map((j) => (j.kind === "revolute" ? "circle" : "square")), line: { color: colors.ink, width: 2 } }, ...along(start) },
    { ...shown, mode: "lines", name: "residual before", showlegend: vectors.length > 0, line: { color: colors.before, width: 3 }, ...arrows(0, times) },
    { ...shown, mode: "lines", name: "after", showlegend: vectors.length > 0, line: { color: colors.after, width: 5 }, ...arrows(1, times) },
    ...parts.map(({ name, symbol, own }, k) => ({
      type: "scatter3d", mode: "markers", name, showlegend: own.length > 0, hoverinfo: "text", text: own.map(said), customdata: own, ...xyz(own.map((i) => marks.at[i])),
      marker: { size: symbol === "diamond" ? 5.5 : own.length > 300 ? 2.5 : 4.5, symbol, ...colour(held)[k] },
    })),
    { ...shown, mode: "markers", marker: { size: 11, symbol: "circle-open", color: colors.test, line: { width: 3 } }, ...xyz([marks.at[data.worst ?? 0] ?? [0, 0, 0]]) },
    { type: "scatter3d", mode: "markers", visible: false, name: "expected error", hoverinfo: "text", showlegend: false, ...xyz(area ? area.tool : []), text: area ? area.error.map((e) => `expected ${e} mm`) : [], marker: { size: 3, symbol: "circle", opacity: 0.75, color: area ? area.error : [], coloraxis: "coloraxis2" } },
    { ...shown, mode: "markers", marker: { size: 9, symbol: "square", color: colors.ink }, ...xyz([poses.nodes[start][0]]) },
  ];
  const axis = (text) => ({ title: { text: `${text} / mm`, font: { size: 11 } }, backgroundcolor: "#fafbfc", showbackground: true, gridcolor: "#e4e7ea", zerolinecolor: "#c9ced2", color: "#5b5b5b", tickfont: { size: 10 } });

  let times = timesOf(50), slider = 50;
  const draw = () => {
    if (!document.createElement("canvas").getContext("webgl")) {
      node.hidden = true;
      document.getElementById("nospace").hidden = false;
      return;
    }
    slider = Math.round((100 * Math.log(usual)) / Math.log(most));
    slider = Number.isFinite(slider) ? Math.min(Math.max(slider, 0), 100) : 0;
    times = timesOf(slider);
    const narrow = node.clientWidth < 520;
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#ffffff", showlegend: true, uirevision: "own",
      font: { family: "system-ui, 'DejaVu Sans', sans-serif", size: 12, color: colors.ink },
      legend: { orientation: "h", x: 0.01, y: 0.99, yanchor: "top", bgcolor: "rgba(255,255,255,0.75)", itemsizing: "constant", font: { size: narrow ? 10 : 12 } },
      scene: { aspectmode: "data", xaxis: axis("x"), yaxis: axis("y"), zaxis: axis("z"), camera: { eye: { x: 1.15, y: -1.15, z: 0.6 }, center: { x: 0, y: 0, z: -0.08 } }, dragmode: "orbit" },
      coloraxis: bar(held),
      coloraxis2: area ? { colorscale: "Cividis", showscale: false, colorbar: { title: { text: "expected rms / mm", side: "right" }, thickness: 10, len: 0.6, outlinewidth: 0, x: 1, xanchor: "right" } } : {},
    };
    const config = { displaylogo: false, responsive: true, displayModeBar: narrow ? false : "hover", modeBarButtons: [["toImage"], ["zoom3d", "pan3d", "orbitRotation", "tableRotation"], ["resetCameraDefault3d"]] };
    Plotly.newPlot(node, traces(times), layout, config).then(() => {
      // while a button is down every drawing says so again, and choosing draws: later, and once
      let asked = null;
      node.on("plotly_click", (event) => {
        const i = event.points[0].customdata;
        if (i === undefined || asked !== null) return;
        asked = i;
        setTimeout(() => { window.choose(asked); asked = null; });
      });
      document.documentElement.dataset.space = "ready";
    });
  };
  return {
    draw,
    get slider() { return slider; },
    get times() { return times; },
    arm(pose, mark) {
      if (!node.data) return;
      const own = [xyz(poses.nodes[pose]), limits(pose), along(pose), xyz([marks.at[mark]])];
      Plotly.restyle(node, Object.fromEntries(["x", "y", "z", "text"].map((key) => [key, own.map((trace) => trace[key])])), [1, 2, 3, 9]);
    },
    exaggerate(value) {
      times = timesOf(value);
      if (!node.data) return;
      for (const state of [0, 1]) { const { x, y, z } = arrows(state, times); Plotly.restyle(node, { x: [x], y: [y], z: [z] }, [4 + state]); }
    },
    colour(by) {
      if (!node.data) return;
      const each = colour(by);
      Plotly.update(node, { "marker.color": each.map((m) => m.color), "marker.coloraxis": each.map((m) => m.coloraxis ?? null) }, { coloraxis: bar(by) }, [6, 7, 8]);
    },
    visible(trace, on) { if (node.data) Plotly.restyle(node, { visible: on }, [trace]); },
    area(on) { if (node.data) Plotly.update(node, { visible: on }, { "coloraxis.showscale": !on, "coloraxis2.showscale": on }, [10]); },
  };
})();
