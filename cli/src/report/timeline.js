// Timeline of a play.

const INK = { time: "#0072b2", expected: "#56b4e9", missed: "#c1272d", spp: "#e6e6e6", budget: "#009e73", rung: "#d55e00", disturbed: "#cc79a7" };

const LATE_ROWS = 100;

// Tol's light scheme. The colours of many devices repeat.
const DEVICES = ["#77aadd", "#ee8866", "#eedd88", "#44bb99", "#ffaabb", "#99ddff", "#bbcc33", "#dddddd"];

function timeline(root, data) {
  const devices = Math.max(...data.rows.map((rows) => rows.length));
  const keys = [
    ["time", "frame time"], ["expected", "expected by the loop"], ["missed", "missed refresh"], ["budget", "budget"], ["spp", "samples per pixel (right axis)"], ["rung", "rung"],
    ["disturbed", "disturbance or fault"],
  ];
  const legend = add(root, "ul", { className: "legend" });
  const late = [...data.missed.keys()].filter((i) => data.missed[i]);
  const isShown = { disturbed: data.disturbed.length, missed: late.length };
  for (const [key, name] of keys.filter(([key]) => isShown[key] !== 0)) {
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
  const rungs = [Math.min(...data.rung), Math.max(...data.rung)];
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
    const yRung = (rung) => 14 + high + gap + low * (1 - (rung - rungs[0]) / Math.max(rungs[1] - rungs[0], 1));
    draw(svg, "path", { d: `${steps(data.spp, ySpp)}V${14 + high}H${left}Z`, fill: INK.spp });
    const [lo, hi] = data.budget.map(y);
    draw(svg, "rect", { x: left, y: hi, width: x(count) - left, height: lo - hi, fill: INK.budget, opacity: 0.2 });
    if (rowsHigh) bands(svg, left, rowsTop, rowsHigh);
    shades(svg, bottom);
    axes(svg, { width, left, high, y, ySpp, yRung, mostSpp, bottom });
    const at = (i) => x(i + 0.5);
    const expected = data.expected.map((time, i) => (time === null ? "" : `M${x(i)} ${y(time)}H${x(i + 1)}`)).join("");
    draw(svg, "path", { d: expected, fill: "none", stroke: INK.expected, "stroke-width": 1.5 });
    for (const i of late) draw(svg, "path", { d: `M${at(i)} 14v10`, stroke: INK.missed, "stroke-width": 2 });
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
    for (const rung of new Set(rungs))
      draw(svg, "text", { x: left - 7, y: yRung(rung) + 4, "text-anchor": "end" }, rung);
    for (const [y1, y2] of [[14, 14 + high], [yRung(rungs[1]), yRung(rungs[0])]])
      draw(svg, "line", { class: "axis", x1: left, x2: left, y1, y2 });
    draw(svg, "line", { class: "axis", x1: left, x2: x(count), y1: 14 + high, y2: 14 + high });
    draw(svg, "line", { class: "axis", x1: left, x2: x(count), y1: bottom + 4, y2: bottom + 4 });
    for (const i of ticks(count - 1, Math.max(Math.min(width / 90, count - 1), 1)).filter(Number.isInteger))
      draw(svg, "text", { x: x(i + 0.5), y: bottom + 18, "text-anchor": "middle" }, data.index[i]);
    draw(svg, "text", { x: (left + x(count)) / 2, y: bottom + 34, "text-anchor": "middle" }, "frame");
    draw(svg, "text", { x: 0, y: 8, class: "muted" }, "ms");
    draw(svg, "text", { x: width, y: 8, "text-anchor": "end", class: "muted" }, "spp");
    draw(svg, "text", { x: 0, y: (yRung(rungs[0]) + yRung(rungs[1])) / 2 + 4, class: "muted" }, "rung");
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
      missed && data.cause[chosen] ? `${ms(data.over[chosen])} over the deadline: ${data.cause[chosen]}` : "",
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
  const list = add(root, "details");
  add(list, "summary", { textContent: `Late frames: ${late.length}, the latest first` });
  const table = add(add(list, "div", { className: "wide" }), "table");
  const row = (tag, cells) => cells.forEach((text) => add(table.lastChild, tag, { textContent: text }));
  add(table, "tr");
  row("th", ["frame", "late", "frame time", "expected", "cause"]);
  for (const i of [...late].sort((a, b) => data.over[b] - data.over[a]).slice(0, LATE_ROWS)) {
    add(table, "tr");
    const show = add(add(table.lastChild, "td"), "button", { textContent: data.index[i] });
    show.addEventListener("click", () => {
      choose(i);
      document.querySelector(".lanes").scrollIntoView({ block: "center" });
    });
    const expected = data.expected[i] === null ? "" : ms(data.expected[i]);
    row("td", [data.over[i] === null ? "" : ms(data.over[i]), ms(data.ms[i]), expected, data.cause[i] || ""]);
  }
  list.hidden = !late.length;
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
