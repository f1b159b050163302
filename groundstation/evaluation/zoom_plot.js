// Plots that can be zoomed. Each element .zoomable holds a picture and data in JSON; this script draws the data as
// SVG in the picture's place. Without it, and in print, the picture stays.
"use strict";
(() => {
  const NS = document.querySelector(".zoomable > svg").namespaceURI;
  // margins and heights in CSS pixels
  const LEFT = 56, RIGHT = 10, TOP = 6, GAP = 16, STRIP = 12, BOTTOM = 38, ONE_TALL = 220, MANY_TALL = 130;
  // of the visible values, the share at either end that may lie beyond the panel, and the room about the rest
  const TAIL = 0.01, ROOM = 0.12;
  const LEAST_POINTS = 6, STEP = 1.25, PAN = 0.12;
  const HOW = "Drag to move; pinch, or click and turn the wheel, to zoom; double click shows all. " +
    "Keys: + − ← →, ↑ ↓ for the height, 0 for all, Esc to leave.";

  const add = (parent, name, attributes = {}, text = "") => {
    const element = document.createElementNS(name === "svg" ? NS : parent.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const known = (values) => values.filter((v) => v !== null);
  const quantile = (sorted, share) => {
    const at = share * (sorted.length - 1), k = Math.floor(at);
    return sorted[k] + (at - k) * ((sorted[k + 1] ?? sorted[k]) - sorted[k]);
  };
  const signed = (value, digits) => value.toFixed(digits).replace("-", "−");

  // multiples of 1, 2 or 5 powers of ten within a range, at most `most`, and how many decimals they need
  const ticks = ([low, high], most) => {
    const rough = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough * 0.999);
    const digits = Math.min(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), 9);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
    return { found, digits };
  };

  class Plot {
    constructor(holder) {
      this.data = JSON.parse(holder.querySelector("script").textContent);
      [this.stretch, this.cursor, this.hidden, this.pointers] = [1, null, new Set(), new Map()];
      const x = known(this.data.x.values);
      const low = x.reduce((a, b) => Math.min(a, b)), high = x.reduce((a, b) => Math.max(a, b));
      this.all = high > low ? [low, high] : [low - 0.5, high + 0.5];
      this.window = [...this.all];
      this.least = Math.min(LEAST_POINTS / Math.max(x.length - 1, 1), 1) * (this.all[1] - this.all[0]);
      this.build(holder);
      this.listen(this.svg);
      this.draw();
      new ResizeObserver(() => this.ask()).observe(this.box);
    }

    build(holder) {
      this.box = add(holder, "div", { class: "zoom" });
      const bar = add(this.box, "div", { class: "zoom-bar" });
      const { panels, spans, status } = this.data;
      const keys = (kind, look, named) => [...new Map(named.map((s) => [s.name, s.colour]))].map(([name, colour]) => {
        const key = add(bar, kind, kind === "button" ? { type: "button", "aria-pressed": "true" } : {});
        add(key, "span", { class: look, style: `background:${colour}` });
        key.append(name);
        return [key, name];
      });
      for (const [key, name] of keys("button", "swatch", panels.flatMap((panel) => panel.series))) {
        key.addEventListener("click", () => {
          const shown = this.hidden.delete(name) || !this.hidden.add(name);
          key.setAttribute("aria-pressed", String(shown));
          this.ask();
        });
      }
      keys("span", "swatch tint", spans);
      if (status.codes.length) add(bar, "span", { class: "soft" }, "status:");
      keys("span", "swatch", [...new Set(status.codes)].map((code) => status.words[code]));
      const tools = add(bar, "span", { class: "tools" });
      for (const [text, label, act] of [
        ["−", "zoom out", () => this.zoom(STEP ** 2)],
        ["+", "zoom in", () => this.zoom(1 / STEP ** 2)],
        ["all", "show all", () => this.reset()],
      ]) {
        const button = add(tools, "button", { type: "button", "aria-label": label, title: label }, text);
        button.addEventListener("click", act);
      }
      const label = `${holder.querySelector("svg").getAttribute("aria-label")} ${HOW}`;
      this.svg = add(this.box, "svg", { tabindex: 0, role: "application", "aria-label": label });
      this.readout = add(this.box, "p", { class: "zoom-readout" });
      holder.classList.add("active");
    }

    listen(svg) {
      svg.addEventListener("wheel", (event) => {
        // the page scrolls until the plot has been clicked on; a touchpad's pinch comes as wheel with Ctrl
        if (!event.ctrlKey && document.activeElement !== svg) return;
        event.preventDefault();
        const factor = STEP ** (Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY) / 100, 1));
        if (event.shiftKey) this.stretchBy(1 / factor);
        else this.zoom(factor, this.valueAt(event));
      }, { passive: false });
      svg.addEventListener("dblclick", () => this.reset());
      svg.addEventListener("keydown", (event) => this.press(event));
      svg.addEventListener("pointerdown", (event) => {
        svg.focus({ preventScroll: true });
        svg.setPointerCapture(event.pointerId);
        this.pointers.set(event.pointerId, event.clientX);
      });
      svg.addEventListener("pointermove", (event) => this.move(event));
      const released = (event) => this.pointers.delete(event.pointerId);
      for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, released);
      svg.addEventListener("pointerleave", () => this.point(null));
    }

    press(event) {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const span = this.window[1] - this.window[0];
      const act = {
        "+": () => this.zoom(1 / STEP), "=": () => this.zoom(1 / STEP), "-": () => this.zoom(STEP),
        ArrowLeft: () => this.pan(-PAN * span), ArrowRight: () => this.pan(PAN * span),
        ArrowUp: () => this.stretchBy(STEP), ArrowDown: () => this.stretchBy(1 / STEP),
        0: () => this.reset(), Home: () => this.reset(), Escape: () => this.svg.blur(),
      }[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    }

    move(event) {
      const before = this.pointers.get(event.pointerId);
      if (before === undefined) return this.point(this.valueAt(event));
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, x]) => x);
      if (others.length) {
        const apart = Math.abs(event.clientX - others[0]), was = Math.abs(before - others[0]);
        const middle = { clientX: (event.clientX + others[0]) / 2 };
        if (apart > 1 && was > 1) this.zoom(was / apart, this.valueAt(middle));
      } else this.pan((before - event.clientX) / this.scale);
      this.pointers.set(event.pointerId, event.clientX);
    }

    point(value) {
      const apart = (v) => (v === null ? Infinity : Math.abs(v - value));
      const x = this.data.x.values;
      this.cursor = value === null ? null : x.reduce((best, v, k) => (apart(v) < apart(x[best]) ? k : best), 0);
      this.ask();
    }

    valueAt(event) {
      return this.window[0] + (event.clientX - this.svg.getBoundingClientRect().left - LEFT) / this.scale;
    }

    stretchBy(factor) {
      this.stretch = Math.min(Math.max(this.stretch * factor, 0.1), 100);
      this.ask();
    }

    reset() {
      this.stretch = 1;
      this.show(...this.all);
    }

    show(...window) {
      this.window = window;
      this.ask();
    }

    pan(by) {
      const [low, high] = this.window;
      const held = Math.min(Math.max(by, this.all[0] - low), this.all[1] - high);
      this.show(low + held, high + held);
    }

    zoom(factor, about = (this.window[0] + this.window[1]) / 2) {
      const [low, high] = this.window, span = high - low;
      const wanted = Math.min(Math.max(span * factor, this.least), this.all[1] - this.all[0]);
      const from = about - ((about - low) / span) * wanted;
      const first = Math.min(Math.max(from, this.all[0]), this.all[1] - wanted);
      this.show(first, first + wanted);
    }

    // draws before the next frame, however many events come
    ask() {
      if (!this.asked) this.asked = requestAnimationFrame(() => this.draw());
    }

    draw() {
      this.asked = 0;
      const width = this.box.clientWidth, inner = width - LEFT - RIGHT;
      if (inner < 50) return;
      const panels = this.data.panels, tall = panels.length > 1 ? MANY_TALL : ONE_TALL;
      const bottom = TOP + panels.length * (tall + GAP) + STRIP;
      this.scale = inner / (this.window[1] - this.window[0]);
      this.toX = (value) => LEFT + (value - this.window[0]) * this.scale;
      this.svg.replaceChildren();
      for (const [key, value] of Object.entries({ width, height: bottom + BOTTOM })) this.svg.setAttribute(key, value);
      const across = ticks(this.window, Math.min(inner / 80, 12));
      panels.forEach((panel, k) => this.panel(panel, TOP + k * (tall + GAP), tall, inner, across));
      this.strip(bottom - STRIP - GAP / 2, inner);
      for (const value of across.found) {
        const at = { x: this.toX(value), y: bottom + 10, "text-anchor": "middle", class: "tick" };
        add(this.svg, "text", at, signed(value, across.digits));
      }
      add(this.svg, "text", { x: LEFT + inner / 2, y: bottom + 30, "text-anchor": "middle" }, this.data.x.label);
      this.readout.textContent = this.cursor === null ? `${HOW}${this.data.note}` : this.values();
    }

    panel(panel, top, tall, inner, across) {
      const view = add(this.svg, "svg", { x: LEFT, y: top, width: inner, height: tall });
      for (const s of this.data.spans) {
        const x = this.toX(s.from) - LEFT, wide = Math.max((s.to - s.from) * this.scale, 1);
        add(view, "rect", { x, y: 0, width: wide, height: tall, fill: s.colour, "fill-opacity": 0.15 });
      }
      const range = this.fit(panel), up = tall / (range[1] - range[0]);
      const toY = (value) => (range[1] - value) * up;
      const rows = ticks(range, tall / 26);
      for (const value of rows.found) {
        add(view, "line", { x1: 0, x2: inner, y1: toY(value), y2: toY(value), class: "grid" });
        const at = { x: LEFT - 6, y: top + toY(value) + 4, "text-anchor": "end" };
        add(this.svg, "text", at, signed(value, rows.digits));
      }
      const upright = (value, look) => {
        const x = this.toX(value) - LEFT;
        add(view, "line", { x1: x, x2: x, y1: 0, y2: tall, class: look });
      };
      for (const value of across.found) upright(value, "grid");
      for (const s of panel.series) if (!this.hidden.has(s.name)) this.curve(view, s, toY);
      if (this.cursor !== null) upright(this.data.x.values[this.cursor], "cursor");
      add(this.svg, "rect", { x: LEFT, y: top, width: inner, height: tall, class: "frame" });
      const turned = { transform: `translate(11 ${top + tall / 2}) rotate(-90)`, "text-anchor": "middle" };
      add(this.svg, "text", turned, panel.label);
    }

    // the range of what is in view, without the outermost values
    fit(panel) {
      let low = Infinity, high = -Infinity;
      for (const s of panel.series) {
        if (s.kind === "dots" || this.hidden.has(s.name)) continue;
        const x = s.x ?? this.data.x.values;
        const inside = (at) => at !== null && at >= this.window[0] && at <= this.window[1];
        const seen = s.y.filter((v, k) => v !== null && inside(x[k])).sort((a, b) => a - b);
        if (!seen.length) continue;
        const top = quantile(seen, 1 - TAIL);
        low = Math.min(low, s.kind === "band" ? -top : quantile(seen, TAIL));
        high = Math.max(high, top);
      }
      if (low > high) [low, high] = [0, 0];
      const half = Math.max(((high - low) / 2) * (1 + 2 * ROOM), panel.least) / this.stretch;
      return [(low + high) / 2 - half, (low + high) / 2 + half];
    }

    // one path of a series: runs of points in view, or near it, between gaps
    curve(view, s, toY) {
      const x = s.x ?? this.data.x.values, span = this.window[1] - this.window[0];
      const runs = [[]];
      s.y.forEach((value, k) => {
        const near = x[k] !== null && x[k] > this.window[0] - span && x[k] < this.window[1] + span;
        if (value === null || !near) runs.push([]);
        else runs.at(-1).push([(this.toX(x[k]) - LEFT).toFixed(1), value]);
      });
      const through = (run, sign = 1) => run.map(([at, v]) => `${at} ${toY(sign * v).toFixed(1)}`);
      const filled = runs.filter((run) => run.length);
      if (s.kind === "band") {
        const d = filled.map((run) => `M${[...through(run), ...through(run, -1).reverse()].join("L")}Z`).join("");
        add(view, "path", { d, fill: s.colour, "fill-opacity": 0.22 });
      } else if (s.kind === "dots") {
        const d = filled.flatMap((run) => through(run)).map((at) => `M${at}h0`).join("");
        add(view, "path", { d, stroke: s.colour, class: "dots" });
      } else {
        const d = filled.map((run) => `M${through(run.length > 1 ? run : [...run, ...run]).join("L")}`).join("");
        add(view, "path", { d, stroke: s.colour, class: s.wide ? "curve wide" : "curve" });
      }
    }

    // the track's status below the panels; what is not tracked is also lower, for those who see no colours
    strip(top, inner) {
      const view = add(this.svg, "svg", { x: LEFT, y: top, width: inner, height: STRIP });
      const { codes, words } = this.data.status, x = this.data.x.values;
      for (let k = 0; k < codes.length; ) {
        let end = k;
        while (end + 1 < codes.length && codes[end + 1] === codes[k]) end += 1;
        const held = known(x.slice(k, Math.min(end + 2, codes.length)));
        const { colour, height } = words[codes[k]];
        if (held.length) {
          const [from, to] = [held[0], held.at(-1)].map((v) => this.toX(v) - LEFT).sort((a, b) => a - b);
          const width = Math.max(to - from, 1.5), y = STRIP * (1 - height);
          add(view, "rect", { x: from, y, width, height: STRIP * height, fill: colour });
        }
        k = end + 1;
      }
    }

    values() {
      const k = this.cursor, parts = [`${this.data.x.short} ${signed(this.data.x.values[k], 2)} ${this.data.x.unit}`];
      for (const panel of this.data.panels) {
        const own = panel.series.filter((s) => !s.x && s.y[k] !== null && !this.hidden.has(s.name));
        const words = own.map((s) => `${s.name} ${signed(s.y[k], 3)}`);
        if (words.length) parts.push(`${panel.label}: ${words.join(", ")}`);
      }
      return [...parts, this.data.status.words[this.data.status.codes[k]].name].join(" · ");
    }
  }

  for (const holder of document.querySelectorAll(".zoomable")) new Plot(holder);
})();
