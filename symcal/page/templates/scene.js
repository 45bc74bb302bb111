"use strict";
// The arm in space with what was read, and how far the robot was off it.
const space = (() => {
  const { colors, poses, marks, area } = data;
  const { node, escaped, add, xyz, shown } = stage;
  const count = marks.pose.length;
  const all = Array.from({ length: count }, (_, i) => i);

  const middle = (values) => { const s = values.filter((v) => v > 0).sort((a, b) => a - b); return s.length ? s[s.length >> 1] : 1; };
  const length = (v) => Math.hypot(...v);
  const size = stage.span(poses);
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

  const start = marks.pose[data.worst ?? 0] ?? 0, held = marks.held.some((v) => v !== null) ? "held" : "after";
  const traces = (times) => [
    { ...shown, mode: "lines", visible: false, line: { color: "#b9c1c7", width: 1.5 }, ...arms() },
    ...stage.arm(poses, start, size),
    { ...shown, mode: "lines", name: "residual before", showlegend: vectors.length > 0, line: { color: colors.before, width: 3 }, ...arrows(0, times) },
    { ...shown, mode: "lines", name: "after", showlegend: vectors.length > 0, line: { color: colors.after, width: 5 }, ...arrows(1, times) },
    ...parts.map(({ name, symbol, own }, k) => ({
      type: "scatter3d", mode: "markers", name, showlegend: own.length > 0, hoverinfo: "text", text: own.map(said), customdata: own, ...xyz(own.map((i) => marks.at[i])),
      marker: { size: symbol === "diamond" ? 5.5 : own.length > 300 ? 2.5 : 4.5, symbol, ...colour(held)[k] },
    })),
    { ...shown, mode: "markers", marker: { size: 11, symbol: "circle-open", color: colors.test, line: { width: 3 } }, ...xyz([marks.at[data.worst ?? 0] ?? [0, 0, 0]]) },
    { type: "scatter3d", mode: "markers", visible: false, name: "expected error", hoverinfo: "text", showlegend: false, ...xyz(area ? area.tool : []), text: area ? area.error.map((e) => `expected ${e} mm`) : [], marker: { size: 3, symbol: "circle", opacity: 0.75, color: area ? area.error : [], coloraxis: "coloraxis2" } },
    stage.foot(poses),
  ];

  let times = timesOf(50), slider = 50;
  const draw = () => {
    if (!stage.able()) return;
    slider = Math.round((100 * Math.log(usual)) / Math.log(most));
    slider = Number.isFinite(slider) ? Math.min(Math.max(slider, 0), 100) : 0;
    times = timesOf(slider);
    stage.draw(traces(times), {
      coloraxis: bar(held),
      coloraxis2: area ? { colorscale: "Cividis", showscale: false, colorbar: { title: { text: "expected rms / mm", side: "right" }, thickness: 10, len: 0.6, outlinewidth: 0, x: 1, xanchor: "right" } } : {},
    });
  };
  return {
    draw,
    get slider() { return slider; },
    get times() { return times; },
    arm(pose, mark) { stage.move(1, poses, pose, size, { 9: [marks.at[mark]] }); },
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
