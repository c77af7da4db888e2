// The window of the factor graph: one cell per keyframe; a chosen one shows its factors.
"use strict";
ilns.views.graph = (() => {
  const { store, h, byId, fixed, duration } = ilns;
  const strip = byId("window");
  // By time, so that the choice stays with its keyframe while the window moves on. `null`: the newest.
  let chosen = null;
  let cells = new Map();
  let shownFor = "";

  const label = (keyframe) => {
    const refused = keyframe.factors.filter((factor) => factor.refused != null).length;
    return `keyframe at ${fixed(keyframe.t, 2)} s: ${keyframe.factors.length - refused} factors used, ${refused} refused`;
  };

  /** One block per sensor, as tall as it has factors; refused ones in a block of their own. */
  const cell = (keyframe) => {
    const blocks = new Map();
    for (const factor of inOrder(keyframe)) {
      const key = `${factor.sensor} ${factor.refused == null}`;
      const block = blocks.get(key) ?? { factor, count: 0 };
      block.count += 1;
      blocks.set(key, block);
    }
    const parts = [...blocks.values()].map(({ factor, count }) => {
      const part = h("i", { class: factor.refused == null ? null : "refused" });
      part.style.background = ilns.SENSOR_COLOURS[factor.sensor];
      part.style.flexGrow = count;
      return part;
    });
    const hasRefused = keyframe.factors.some((factor) => factor.refused != null);
    const button = h("button", { class: "cell", role: "option", title: label(keyframe), "aria-label": label(keyframe), "data-t": keyframe.t },
      h("div", {}, ...parts), hasRefused ? h("b", {}, "×") : null, h("span", {}, fixed(keyframe.t, 1)));
    button.addEventListener("click", () => choose(keyframe.t));
    return button;
  };

  /** By sensor, then by time. */
  const inOrder = (keyframe) => keyframe.factors.toSorted((a, b) =>
    ilns.AIDING.indexOf(a.sensor) - ilns.AIDING.indexOf(b.sensor) || a.t - b.t || (a.buoy ?? 0) - (b.buoy ?? 0));

  const choose = (t) => {
    chosen = t;
    draw();
  };

  const bars = (whitened) => {
    const box = h("span", { class: "bars", title: `${whitened.map((value) => fixed(value, 2)).join(", ")} σ, of ±5` });
    whitened.forEach((value, index) => {
      if (value == null) return;
      const part = h("i", { class: Math.abs(value) > 3 ? "far" : null });
      const reach = (Math.min(Math.abs(value), 5) / 5) * 50;
      part.style.left = `${value < 0 ? 50 - reach : 50}%`;
      part.style.width = `${reach}%`;
      part.style.top = `${(index / whitened.length) * 100}%`;
      part.style.bottom = `${100 - ((index + 1) / whitened.length) * 100}%`;
      box.append(part);
    });
    return box;
  };

  const row = (factor, keyframe) => {
    const name = h("span", { class: "key" }, ilns.key(ilns.SENSOR_COLOURS[factor.sensor], factor.sensor));
    const far = factor.whitened.some((value) => Math.abs(value) > 3);
    return h("tr", { "data-state": factor.refused == null ? null : "bad", "data-sensor": factor.sensor },
      h("td", {}, name), h("td", {}, factor.buoy == null ? "" : `${factor.buoy}`), h("td", {}, `${fixed(1e3 * (factor.t - keyframe.t), 0)}`),
      h("td", { class: far ? "bad" : null }, factor.whitened.map((value) => fixed(value, 2)).join("  ")), h("td", { class: "wide" }, bars(factor.whitened)),
      h("td", {}, factor.rows ? fixed(factor.nis, 2) : ilns.UNKNOWN), h("td", { class: "wide" }, `${factor.rows || ""}`),
      h("td", { class: factor.refused == null && factor.weight < 0.5 ? "warn" : null }, factor.rows ? fixed(factor.weight, 2) : ilns.UNKNOWN),
      h("td", { class: "text" }, factor.refused == null ? "used" : `refused: ${factor.refused}`));
  };

  const details = (keyframe, isInWindow) => {
    const box = byId("keyframe");
    if (!keyframe) {
      box.replaceChildren(h("p", { class: "empty" }, store.kind === "finished" && !store.keyframes.length
        ? "The files of this run hold no keyframes; open its log to see them." : "No keyframe has been solved yet."));
      return;
    }
    const [before, after] = keyframe.cost;
    const offset = keyframe.left_out ? `, ${keyframe.left_out} factors not listed` : "";
    const summary = `Keyframe at ${fixed(keyframe.t, 3)} s (solution ${keyframe.solution}): ${keyframe.iterations} iterations, `
      + `cost ${fixed(before, 1)} → ${fixed(after, 1)}, ${duration(keyframe.solve)}, ${keyframe.status ?? "status unknown"}${offset}`
      + `${isInWindow ? "" : "; it has left the window"}`;
    const heads = [["sensor", ""], ["buoy", ""], ["Δt ms", ""], ["whitened innovation, σ", ""], ["±5σ", "wide"], ["NIS", ""], ["rows", "wide"], ["weight", ""], ["", "text"]];
    const head = h("tr", {}, ...heads.map(([text, kind]) => h("th", { class: kind || null }, text)));
    const table = h("table", { id: "factors" }, h("thead", {}, head), h("tbody", {}, ...inOrder(keyframe).map((factor) => row(factor, keyframe))));
    box.replaceChildren(h("p", { class: "soft" }, summary), h("div", { class: "scroll factors" }, table));
  };

  const draw = () => {
    const keyframes = store.window();
    const wanted = keyframes.map((keyframe) => keyframe.t);
    // Cells stay the same elements while they are in the window, so that the focus stays.
    const kept = new Map(wanted.map((t, index) => [t, cells.get(t) ?? cell(keyframes[index])]));
    if (wanted.length !== cells.size || wanted.some((t) => !cells.has(t))) {
      for (const [t, element] of cells) if (!kept.has(t)) element.remove();
      let place = null;
      for (const t of [...wanted].reverse()) {
        const element = kept.get(t);
        if (element.nextSibling !== place || element.parentNode !== strip) strip.insertBefore(element, place);
        place = element;
      }
      cells = kept;
    }
    const inWindow = keyframes.find((keyframe) => keyframe.t === chosen);
    const shown = chosen === null ? keyframes[keyframes.length - 1]
      : inWindow ?? store.keyframes.find((keyframe) => keyframe.t === chosen) ?? keyframes[keyframes.length - 1];
    for (const [t, element] of cells) element.setAttribute("aria-selected", t === shown?.t);
    const newest = keyframes[keyframes.length - 1];
    ilns.say(byId("graph-summary"), newest ? `${newest.window} keyframes, newest ${fixed(newest.t, 1)} s; choose one` : "");
    const isInWindow = keyframes.includes(shown);
    const key = `${shown?.t} ${isInWindow} ${store.kind}`;
    if (key !== shownFor) details(shown, isInWindow);
    shownFor = key;
  };

  strip.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: "previousSibling", ArrowRight: "nextSibling" }[event.key];
    const next = step && document.activeElement[step];
    if (!next) return;
    event.preventDefault();
    next.focus();
    choose(Number(next.dataset.t));
  });

  byId("graph-legend").append(...ilns.AIDING.map((sensor) => ilns.key(ilns.SENSOR_COLOURS[sensor], sensor)),
    h("span", {}, "hatched, ×: refused"), h("span", {}, "innovations are those at the keyframe's closing, whitened by their own covariance"));

  return { draw, choose };
})();
