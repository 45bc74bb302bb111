"use strict";
// The stage that every page has: an arm in space within the limits of its joints. All of it was computed with the
// kinematics; here it is only shown.
const data = JSON.parse(document.getElementById("data").textContent);
const stage = (() => {
  const { colors, joints, through } = data;
  const node = document.getElementById("space");
  const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const add = (a, b, k) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const columns = (points) => [0, 1, 2].map((k) => points.map((p) => (p === null ? null : p[k])));
  const xyz = (points) => { const [x, y, z] = columns(points); return { x, y, z }; };
  const unit = (hundredths) => hundredths.map((v) => v / 100);
  const span = (postures) => Math.max(...[0, 1, 2].map((k) => { const v = postures.nodes.flatMap((p) => p.map((n) => n[k])); return v.reduce((a, b) => Math.max(a, b), -1e9) - v.reduce((a, b) => Math.min(a, b), 1e9); }), 1);

  // Limits of each joint about its axis, and where in them it is.
  const limits = (postures, i, size) => {
    const points = [], radius = 0.045 * size, nodes = postures.nodes[i];
    joints.forEach((joint, j) => {
      const axis = unit(postures.axes[i][j]), pointer = unit(postures.pointers[i][j]), at = nodes[through[j]], q = postures.q[i][j];
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
  const along = (postures, i) => ({
    ...xyz(joints.map((_, j) => postures.nodes[i][through[j]])),
    text: joints.map((joint, j) => `${escaped(joint.name)}: ${postures.q[i][j]} ${joint.unit}${joint.limits ? ` (${joint.limits.map((l) => +l.toFixed(2)).join(" to ")})` : ""}`),
  });

  const shown = { hoverinfo: "skip", showlegend: false, type: "scatter3d" };
  // The arm at a posture: its body, its limits, its joints.
  const arm = (postures, i, size) => [
    { ...shown, mode: "lines", line: { color: colors.ink, width: 9 }, ...xyz(postures.nodes[i]) },
    { ...shown, mode: "lines", line: { color: "#8a4f7d", width: 3 }, ...limits(postures, i, size) },
    { type: "scatter3d", mode: "markers", showlegend: false, hoverinfo: "text", marker: { size: 6.5, color: "#ffffff", symbol: joints.map((j) => (j.kind === "revolute" ? "circle" : "square")), line: { color: colors.ink, width: 2 } }, ...along(postures, i) },
  ];
  const foot = (postures) => ({ ...shown, mode: "markers", marker: { size: 9, symbol: "square", color: colors.ink }, ...xyz([postures.nodes[0][0]]) });
  // Traces from `first` on move to the posture, and further ones with them.
  const move = (first, postures, i, size, further = {}) => {
    if (!node.data) return;
    const own = [xyz(postures.nodes[i]), limits(postures, i, size), along(postures, i), ...Object.values(further).map(xyz)];
    const update = Object.fromEntries(["x", "y", "z", "text"].map((key) => [key, own.map((trace) => trace[key])]));
    Plotly.restyle(node, update, [first, first + 1, first + 2, ...Object.keys(further).map(Number)]);
  };

  const axis = (text) => ({ title: { text: `${text} / mm`, font: { size: 11 } }, backgroundcolor: "#fafbfc", showbackground: true, gridcolor: "#e4e7ea", zerolinecolor: "#c9ced2", color: "#5b5b5b", tickfont: { size: 10 } });
  // A click on a point chooses the number that it carries.
  const draw = (traces, further = {}) => {
    const narrow = node.clientWidth < 520;
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#ffffff", showlegend: true, uirevision: "own",
      font: { family: "system-ui, 'DejaVu Sans', sans-serif", size: 12, color: colors.ink },
      legend: { orientation: "h", x: 0.01, y: 0.99, yanchor: "top", bgcolor: "rgba(255,255,255,0.75)", itemsizing: "constant", font: { size: narrow ? 10 : 12 } },
      scene: { aspectmode: "data", xaxis: axis("x"), yaxis: axis("y"), zaxis: axis("z"), camera: { eye: { x: 1.15, y: -1.15, z: 0.6 }, center: { x: 0, y: 0, z: -0.08 } }, dragmode: "orbit" },
      ...further,
    };
    const config = { displaylogo: false, responsive: true, displayModeBar: narrow ? false : "hover", modeBarButtons: [["toImage"], ["zoom3d", "pan3d", "orbitRotation", "tableRotation"], ["resetCameraDefault3d"]] };
    Plotly.newPlot(node, traces, layout, config).then(() => {
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
  // Whether anything can be drawn; where not, the page says so.
  const able = () => {
    if (document.createElement("canvas").getContext("webgl")) return true;
    node.hidden = true;
    document.getElementById("nospace").hidden = false;
    return false;
  };
  return { node, escaped, add, xyz, span, shown, arm, foot, move, draw, able };
})();
