// Moving parts of a page: the viewer of pictures, and helpers of the figures in lanes.js and timeline.js, which precede this
// file in the page's script.
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

const FIGURES = { lanes, timeline };
document.body.classList.add("ready");
document.querySelectorAll(".viewer").forEach(viewer);
for (const root of document.querySelectorAll(".live"))
  FIGURES[root.dataset.kind](root, JSON.parse(root.querySelector("script").textContent));
document.body.dataset.ready = "1";
