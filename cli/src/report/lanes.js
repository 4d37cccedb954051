// Swimlanes of a frame.

// After Tol's light scheme, with a colour for each stage; dark text is readable on all of them.
const COLOURS = {
  gbuffer: "#99ddff", select: "#f2f2c2", path_trace: "#ee8866", reproject: "#bbcc33", hole_fill: "#ffaabb",
  accumulate: "#77aadd", accumulate_fitted: "#5f9bd6", gradient: "#b5d8b0", gradient_smooth: "#8fc487",
  variance: "#c9b3e6", svgf: "#44bb99", atrous: "#66c2a5", fit: "#e3a6d8", seam_filter: "#aaaa00", compose: "#d9b38c",
  reproject_filtered: "#dde58a", polar_blur: "#a6e3e0", to_screen: "#c2b280", resolve: "#eedd88", tonemap: "#fff0a8",
  tally: "#cfcfcf", aov: "#e0e0e0", aov_to_screen: "#d4dce6", aov_to_eye: "#c6d4e6", aov_to_later_eye: "#b8cce6",
  radiance_cache: "#9ed9b5", cache_sums: "#cdeac0", skin: "#f4c7ab", refit: "#f0b27a", motion: "#f7dc9f",
};
const KINDS = ["", "download", "upload"];
const KIND_COLOURS = ["", "#8a8a8a", "#5a5a5a"];
const PATH = "path";
const LANE_PX = 22;
const NAMES_PX = 72;

function lanes(root, data) {
  const controls = add(root, "div", { className: "controls" });
  const select = add(add(controls, "label", { textContent: "Frame " }), "select");
  data.frames.forEach((frame, i) => add(select, "option", { value: i, textContent: `${frame.name}: ${ms(frame.ms)}` }));
  const zoom = add(add(controls, "label", { textContent: "Zoom " }), "select");
  for (const times of [1, 2, 4, 8, 16]) add(zoom, "option", { value: times, textContent: `${times}x` });
  const both = add(root, "div", { className: "lanes" });
  const [gutter, box] = ["names", "tasks"].map((className) => add(both, "div", { className }));
  const readout = add(root, "output");
  const legend = add(root, "ul", { className: "legend" });
  const details = add(root, "details");
  add(details, "summary", { textContent: "Tasks of this frame as a table" });
  const table = add(add(details, "div", { className: "wide" }), "table");

  const tasksOf = (frame) => {
    const tasks = [];
    for (let i = 0, at = 0; i < frame.tasks.length; i += 3) {
      const [name, eye, device, kind, from, to, bytes] = data.shapes[frame.tasks[i]];
      at += frame.tasks[i + 1];
      const [begin, time] = [at / 1e3, frame.tasks[i + 2] / 1e3];
      tasks.push({ name: data.names[name], eye: ["left", "right"][eye], device, kind, from, to, bytes, begin, time });
    }
    return tasks;
  };
  /** The parts of a frame's critical path, of which each begins where the one before it ends. */
  const pathOf = (frame) => {
    const parts = [];
    for (let i = 0, begin = 0; i < frame.path.length; i += 4) {
      const [name, device, kind, us] = frame.path.slice(i, i + 4);
      const part = { name: data.names[name], device, kind, begin, time: us / 1e3 };
      parts.push(part);
      begin += part.time;
    }
    return parts;
  };
  const tellPart = (part) => {
    const what = [part.name, `download of ${part.name}`, `upload of ${part.name}`, `wait: ${part.name}`][part.kind];
    return `critical path: ${what} on device ${part.device}: ${ms(part.time)}, from ${ms(part.begin)} on`;
  };
  const colour = (task) => (task.kind ? KIND_COLOURS[task.kind] : COLOURS[task.name] || "#dddddd");
  const laneOf = (task) => (task.kind ? "transfers" : task.eye);
  const laneName = (task) => `${String(task.device).padStart(2)} ${laneOf(task)}`;
  const tell = (task) => {
    const what = task.kind ? `${KINDS[task.kind]} of ${task.name}, ${(task.bytes / 1e3).toFixed(1)} kB` : task.name;
    const where = `${task.eye} eye, device ${task.device}, rows ${task.from} to ${task.to - 1}`;
    return `${what}, ${where}: ${ms(task.time)}, from ${ms(task.begin)} on`;
  };

  function paint() {
    const frame = data.frames[select.value];
    const tasks = tasksOf(frame);
    const names = [...new Set(tasks.map(laneName))].sort();
    const [top, width] = [22, Math.floor(both.clientWidth - NAMES_PX) * zoom.value];
    const path = pathOf(frame);
    if (path.length) names.push(PATH);
    const height = top + names.length * LANE_PX + 4;
    const budget = data.budget || [];
    const shownBudget = budget.filter((at) => at < 2 * frame.ms);
    const end = Math.max(frame.ms, ...shownBudget, ...tasks.map((t) => t.begin + t.time));
    const x = (at) => 8 + ((width - 24) * at) / end;
    paintNames(names, top, height);
    const svg = canvas(box, width, height, `Tasks of ${frame.name} by device and eye`);
    for (const at of ticks(end, width / 90)) {
      draw(svg, "line", { class: "grid", x1: x(at), x2: x(at), y1: top - 4, y2: height });
      draw(svg, "text", { x: x(at), y: top - 8, "text-anchor": "middle" }, at);
    }
    for (const task of tasks) {
      const y = top + names.indexOf(laneName(task)) * LANE_PX + 2;
      const wide = Math.max(x(task.begin + task.time) - x(task.begin), task.kind ? 2 : 0.75);
      const group = draw(svg, "g");
      const edge = wide > 3 ? "#0006" : "none";
      draw(group, "rect", { x: x(task.begin), y, width: wide, height: LANE_PX - 4, fill: colour(task), stroke: edge });
      const isNamed = !task.kind && wide > 7 * task.name.length + 6;
      if (isNamed) draw(group, "text", { x: x(task.begin) + 4, y: y + 13 }, task.name);
      draw(group, "title", {}, tell(task));
      group.addEventListener("pointerenter", () => (readout.textContent = tell(task)));
    }
    const pathY = top + (names.length - 1) * LANE_PX + 2;
    for (const part of path) {
      const wide = Math.max(x(part.begin + part.time) - x(part.begin), 0.75);
      const group = draw(svg, "g");
      const fill = part.kind === 3 ? "#fff" : colour(part);
      const edge = wide > 3 ? "#0006" : "none";
      draw(group, "rect", { x: x(part.begin), y: pathY, width: wide, height: LANE_PX - 4, fill, stroke: edge });
      draw(group, "title", {}, tellPart(part));
      group.addEventListener("pointerenter", () => (readout.textContent = tellPart(part)));
    }
    for (const at of shownBudget)
      draw(svg, "line", { class: "budget", x1: x(at), x2: x(at), y1: top - 4, y2: height });
    draw(svg, "line", { class: "axis", x1: x(frame.ms), x2: x(frame.ms), y1: top - 4, y2: height });
    describe(frame, tasks);
  }

  function paintNames(names, top, height) {
    const svg = canvas(gutter, NAMES_PX, height, "Lanes");
    draw(svg, "text", { x: 0, y: top - 8, class: "muted" }, "ms");
    names.forEach((name, i) => {
      const y = top + i * LANE_PX;
      const isFirst = i === 0 || names[i - 1].slice(0, 2) !== name.slice(0, 2);
      if (isFirst) draw(svg, "line", { class: "axis", x1: 0, x2: NAMES_PX, y1: y, y2: y });
      draw(svg, "text", { x: 0, y: y + 15 }, name.trim());
    });
  }

  function describe(frame, tasks) {
    readout.textContent = tasks.length
      ? `${frame.name}: ${ms(frame.ms)}, ${tasks.length} tasks. Point at a box to read it.`
      : `${frame.name}: ${ms(frame.ms)}; the page holds the tasks of every ${data.stride}th frame only.`;
    const sums = new Map();
    for (const task of tasks) {
      const name = task.kind ? KINDS[task.kind] : task.name;
      const sum = sums.get(name) || { time: 0, colour: colour(task) };
      sums.set(name, { ...sum, time: sum.time + task.time });
    }
    legend.replaceChildren();
    for (const [name, { time, colour }] of [...sums].sort((a, b) => b[1].time - a[1].time)) {
      const item = add(legend, "li");
      add(item, "span").style.background = colour;
      item.append(`${name} ${ms(time)}`);
    }
    fillTable(tasks);
  }

  function fillTable(tasks) {
    table.replaceChildren();
    if (!details.open) return;
    const row = (tag, cells) => cells.forEach((text) => add(table.lastChild, tag, { textContent: text }));
    add(table, "tr");
    row("th", ["device", "lane", "task", "eye", "rows", "begin ms", "ms", "kB"]);
    for (const t of tasks) {
      add(table, "tr");
      const rows = `${t.from}..${t.to}`;
      const size = t.bytes ? (t.bytes / 1e3).toFixed(1) : "";
      row("td", [t.device, laneOf(t), t.name, t.eye, rows, t.begin.toFixed(3), t.time.toFixed(3), size]);
    }
  }

  const choose = (place) => {
    select.value = place;
    if (both.clientWidth) paint();
    document.dispatchEvent(new CustomEvent("frame", { detail: place }));
  };
  select.addEventListener("input", () => choose(+select.value));
  details.addEventListener("toggle", () => fillTable(tasksOf(data.frames[select.value])));
  document.addEventListener("choose", (event) => choose(event.detail));
  select.value = data.shown;
  zoom.addEventListener("input", paint);
  fit(both, paint);
  choose(data.shown);
}
