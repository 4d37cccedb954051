// What moves on a page: the viewer of pictures, the timeline of a play and the swimlanes of a frame.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";

  /** An SVG element below `parent`; `text` is its content. */
  function draw(parent, name, attributes = {}, text = "") {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.textContent = text;
    return parent.appendChild(element);
  }

  /** An HTML element below `parent`, with these properties. */
  function add(parent, name, properties = {}) {
    return parent.appendChild(Object.assign(document.createElement(name), properties));
  }

  /** An empty SVG of this size in CSS pixels, in the place of what `box` held. */
  function canvas(box, width, height, label) {
    const svg = document.createElementNS(SVG, "svg");
    for (const [key, value] of Object.entries({ width, height, viewBox: `0 0 ${width} ${height}`, role: "img" }))
      svg.setAttribute(key, value);
    svg.setAttribute("aria-label", label);
    box.replaceChildren(svg);
    return svg;
  }

  /** Calls `redraw` with the width of `box` now and whenever it changes. */
  function fit(box, redraw) {
    let last = 0;
    const look = () => {
      const width = Math.floor(box.clientWidth);
      if (width && width !== last) redraw((last = width));
    };
    new ResizeObserver(look).observe(box);
    look();
  }

  /** About `count` round numbers from 0 to `high`. */
  function ticks(high, count) {
    const rough = high / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999);
    return Array.from({ length: Math.floor(high / step + 1e-9) + 1 }, (_, i) => +(i * step).toPrecision(9));
  }

  const ms = (value) => `${value < 10 ? value.toFixed(2) : value.toFixed(1)} ms`;

  function viewer(root) {
    const [left, right, wipe, stage] = [".left", ".right", ".wipe", ".stage"].map((s) => root.querySelector(s));
    const images = [...stage.querySelectorAll("img")];
    const line = add(stage, "div", { className: "line" });
    const captions = [left, right].map(() => add(stage, "div", { className: "caption" }));
    stage.style.aspectRatio = `${images[0].getAttribute("width")} / ${images[0].getAttribute("height")}`;
    right.value = root.dataset.right;
    const show = () => {
      const share = wipe.value;
      images.forEach((image, i) => {
        const [isLeft, isRight] = [i === +left.value, i === +right.value];
        image.classList.toggle("shown", isLeft || isRight);
        image.style.zIndex = isLeft ? 1 : 0;
        image.style.clipPath = isLeft && !isRight ? `inset(0 ${100 - share}% 0 0)` : "none";
      });
      [left, right].forEach((select, i) => (captions[i].textContent = images[select.value].alt));
      Object.assign(line.style, { left: `${share}%`, zIndex: 2, display: left.value === right.value ? "none" : "" });
    };
    const drag = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      const box = stage.getBoundingClientRect();
      wipe.value = Math.round((100 * (event.clientX - box.left)) / box.width);
      show();
    };
    [left, right, wipe].forEach((control) => control.addEventListener("input", show));
    stage.addEventListener("pointerdown", drag);
    stage.addEventListener("pointermove", drag);
    stage.addEventListener("dragstart", (event) => event.preventDefault());
    show();
  }

  // After Tol's light scheme: dark text is readable on all of them. What never meets in a frame may share one.
  const COLOURS = {
    gbuffer: "#99ddff", select: "#dddddd", path_trace: "#ee8866", reproject: "#bbcc33", hole_fill: "#ffaabb",
    accumulate: "#77aadd", variance: "#c9b3e6", svgf: "#44bb99", atrous: "#44bb99", seam_filter: "#aaaa00",
    compose: "#d9b38c", resolve: "#eedd88", tonemap: "#eedd88", tally: "#dddddd", aov: "#dddddd",
  };
  const KINDS = ["", "download", "upload"];
  const KIND_COLOURS = ["", "#8a8a8a", "#5a5a5a"];
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
      const height = top + names.length * LANE_PX + 4;
      const end = Math.max(frame.ms, ...tasks.map((t) => t.begin + t.time));
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

  const INK = { time: "#0072b2", spp: "#e6e6e6", budget: "#009e73", rung: "#d55e00", disturbed: "#cc79a7" };

  // Tol's light scheme. The colours of many devices repeat.
  const DEVICES = ["#77aadd", "#ee8866", "#eedd88", "#44bb99", "#ffaabb", "#99ddff", "#bbcc33", "#dddddd"];

  function timeline(root, data) {
    const devices = Math.max(...data.rows.map((rows) => rows.length));
    const keys = [
      ["time", "frame time"], ["budget", "budget"], ["spp", "samples per pixel (right axis)"], ["rung", "rung"],
      ["disturbed", "disturbance or fault"],
    ];
    const legend = add(root, "ul", { className: "legend" });
    for (const [key, name] of keys.filter(([key]) => key !== "disturbed" || data.disturbed.length)) {
      const item = add(legend, "li");
      add(item, "span").style.background = INK[key];
      item.append(name);
    }
    if (devices > 1) DEVICES.slice(0, devices).forEach((colour, i) => {
      const item = add(legend, "li");
      add(item, "span").style.background = colour;
      item.append(`rows of device ${i}${i + DEVICES.length < devices ? ` and ${i + DEVICES.length}` : ""}`);
    });
    const box = add(root, "div", { tabIndex: 0, role: "slider", ariaLabel: "Frame" });
    box.setAttribute("aria-valuemin", data.index[0]);
    box.setAttribute("aria-valuemax", data.index.at(-1));
    const readout = add(root, "output");
    const count = data.index.length;
    const sorted = [...data.ms].sort((a, b) => a - b);
    const usual = sorted[Math.floor(0.98 * (count - 1))];
    const top = 1.15 * (data.budget[1] < 4 * usual ? Math.max(data.budget[1], usual) : usual);
    let [chosen, marker, x] = [0, null, null];

    /** A path of steps over frames through `y` of each value. */
    const steps = (values, y) => values.map((v, i) => `${i ? "L" : "M"}${x(i)} ${y(v)}H${x(i + 1)}`).join("");

    function paint(width) {
      const [left, right, high, gap, low] = [44, 36, 240, 20, 74];
      const [rowsTop, rowsHigh] = devices > 1 ? [14 + high + gap + low + gap, 90] : [14 + high + gap + low, 0];
      const bottom = rowsTop + rowsHigh;
      const svg = canvas(box, width, bottom + 40, "Frame times, samples, rungs and rows per device over frames");
      x = (at) => +(left + ((width - left - right) * at) / count).toFixed(2);
      const y = (time) => +(14 + high * (1 - Math.min(time, top) / top)).toFixed(2);
      const mostSpp = Math.max(...data.spp);
      const ySpp = (spp) => 14 + high * (1 - spp / mostSpp / 1.15);
      const yRung = (rung) => 14 + high + gap + low * (1 - rung / Math.max(data.rungs - 1, 1));
      draw(svg, "path", { d: `${steps(data.spp, ySpp)}V${14 + high}H${left}Z`, fill: INK.spp });
      const [lo, hi] = data.budget.map(y);
      draw(svg, "rect", { x: left, y: hi, width: x(count) - left, height: lo - hi, fill: INK.budget, opacity: 0.2 });
      if (rowsHigh) bands(svg, left, rowsTop, rowsHigh);
      shades(svg, bottom);
      axes(svg, { width, left, high, y, ySpp, yRung, mostSpp, bottom });
      const at = (i) => x(i + 0.5);
      const path = data.ms.map((time, i) => `${i ? "L" : "M"}${at(i)} ${y(time)}`).join("");
      draw(svg, "path", { d: path, fill: "none", stroke: INK.time, "stroke-width": 1.5 });
      data.ms.forEach((time, i) => {
        if (time > top) draw(svg, "path", { d: `M${at(i) - 4} 13h8l-4 -6z`, fill: INK.time });
      });
      draw(svg, "path", { d: steps(data.rung, yRung), fill: "none", stroke: INK.rung, "stroke-width": 2 });
      captions(svg, width);
      marker = draw(svg, "line", { class: "axis", y1: 8, y2: bottom, "stroke-dasharray": "3 2" });
      mark();
    }

    /** The rows of each device, as bands from the top of the image to its bottom. */
    function bands(svg, left, top, high) {
      const most = Math.max(...data.rows.map((rows) => rows.reduce((a, b) => a + b, 0)), 1);
      for (let device = devices - 1; device >= 0; device--) {
        const upTo = data.rows.map((rows) => rows.slice(0, device + 1).reduce((a, b) => a + b, 0));
        const d = `${steps(upTo, (rows) => +(top + (high * rows) / most).toFixed(2))}V${top}H${left}Z`;
        draw(svg, "path", { d, fill: DEVICES[device % DEVICES.length] });
      }
      draw(svg, "line", { class: "axis", x1: left, x2: left, y1: top, y2: top + high });
      for (const [row, y] of [[0, top + 9], [most, top + high]])
        draw(svg, "text", { x: left - 7, y, "text-anchor": "end" }, row);
      draw(svg, "text", { x: 0, y: top + high / 2 + 4, class: "muted" }, "rows");
    }

    function axes(svg, { width, left, high, y, ySpp, yRung, mostSpp, bottom }) {
      for (const time of ticks(top, 6)) {
        draw(svg, "line", { class: "axis", x1: left - 4, x2: left, y1: y(time), y2: y(time) });
        draw(svg, "text", { x: left - 7, y: y(time) + 4, "text-anchor": "end" }, time);
      }
      for (const spp of ticks(mostSpp, 4).filter((n) => n > 0))
        draw(svg, "text", { x: x(count) + 6, y: ySpp(spp) + 4 }, spp);
      for (const rung of new Set([0, data.rungs - 1]))
        draw(svg, "text", { x: left - 7, y: yRung(rung) + 4, "text-anchor": "end" }, rung);
      for (const [y1, y2] of [[14, 14 + high], [yRung(data.rungs - 1), yRung(0)]])
        draw(svg, "line", { class: "axis", x1: left, x2: left, y1, y2 });
      draw(svg, "line", { class: "axis", x1: left, x2: x(count), y1: 14 + high, y2: 14 + high });
      draw(svg, "line", { class: "axis", x1: left, x2: x(count), y1: bottom + 4, y2: bottom + 4 });
      for (const i of ticks(count - 1, Math.max(Math.min(width / 90, count - 1), 1)).filter(Number.isInteger))
        draw(svg, "text", { x: x(i + 0.5), y: bottom + 18, "text-anchor": "middle" }, data.index[i]);
      draw(svg, "text", { x: (left + x(count)) / 2, y: bottom + 34, "text-anchor": "middle" }, "frame");
      draw(svg, "text", { x: 0, y: 8, class: "muted" }, "ms");
      draw(svg, "text", { x: width, y: 8, "text-anchor": "end", class: "muted" }, "spp");
      draw(svg, "text", { x: 0, y: (yRung(0) + yRung(data.rungs - 1)) / 2 + 4, class: "muted" }, "rung");
    }

    /** The first disturbed place and the one after the last, equal for a moment. Long runs lack some frames. */
    function places({ from, to }) {
      const place = (frame) => data.index.findIndex((index) => index >= frame);
      return [from, to].map(place).map((at) => (at < 0 ? count : at));
    }

    /** Where a disturbance begins and ends, px; a moment is 2 px wide. */
    function extent(what) {
      const [begin, end] = places(what).map(x);
      return [begin, Math.max(end, begin + 2)];
    }

    function shades(svg, bottom) {
      for (const [begin, end] of data.disturbed.map(extent)) {
        const shape = { x: begin, y: 14, width: end - begin, height: bottom - 14 };
        draw(svg, "rect", { ...shape, fill: INK.disturbed, opacity: 0.3 });
      }
    }

    function captions(svg, width) {
      data.disturbed.forEach((what, i) => {
        const [begin, end] = extent(what);
        const place = begin > width / 2 ? { x: end - 4, "text-anchor": "end" } : { x: begin + 4 };
        draw(svg, "text", { ...place, y: 28 + 14 * (i % 4) }, what.name);
      });
    }

    function mark() {
      marker.setAttribute("x1", x(chosen + 0.5));
      marker.setAttribute("x2", x(chosen + 0.5));
      const [late, expected, missed] = [data.late, data.expected, data.missed].map((values) => values[chosen]);
      const covers = (what) => {
        const [begin, end] = places(what);
        return begin <= chosen && chosen < Math.max(end, begin + 1);
      };
      const parts = [
        `frame ${data.index[chosen]}: ${ms(data.ms[chosen])}`,
        expected === null ? "" : `${ms(expected)} expected`,
        `rung ${data.rung[chosen]}`,
        data.setting[chosen],
        devices > 1 ? `rows ${data.rows[chosen].join(" + ")}` : "",
        late > 1 ? `begun ${ms(late)} late` : "",
        missed ? `${missed} display period${missed > 1 ? "s" : ""} missed` : "",
        ...data.disturbed.filter(covers).map((what) => what.name),
      ];
      readout.textContent = parts.filter(Boolean).join("; ");
      box.setAttribute("aria-valuenow", data.index[chosen]);
      box.setAttribute("aria-valuetext", readout.textContent);
    }

    const choose = (place) => {
      const detail = Math.max(0, Math.min(count - 1, place));
      document.dispatchEvent(new CustomEvent("choose", { detail }));
    };
    document.addEventListener("frame", (event) => {
      chosen = event.detail;
      if (marker) mark();
    });
    box.addEventListener("click", (event) => {
      const offset = event.clientX - box.getBoundingClientRect().left;
      choose(Math.floor(((offset - x(0)) / (x(count) - x(0))) * count));
    });
    const moves = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };
    box.addEventListener("keydown", (event) => {
      const ends = { Home: 0, End: count - 1 };
      if (event.key in moves) choose(chosen + moves[event.key]);
      else if (event.key in ends) choose(ends[event.key]);
      else return;
      event.preventDefault();
    });
    fit(box, paint);
  }

  const FIGURES = { lanes, timeline };
  document.body.classList.add("ready");
  document.querySelectorAll(".viewer").forEach(viewer);
  for (const root of document.querySelectorAll(".live"))
    FIGURES[root.dataset.kind](root, JSON.parse(root.querySelector("script").textContent));
  document.body.dataset.ready = "1";
})();
