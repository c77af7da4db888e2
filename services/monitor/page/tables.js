// The tables: state, sensors, latencies, processes, events.
"use strict";
ilns.views.tables = (() => {
  const { store, h, byId, fixed, duration } = ilns;

  /** Fills a table; each row is `{state, data, cells}`, a cell a text, a node or `{text, class}`. */
  const fill = (id, heads, rows) => {
    const cell = (tag) => (content) => {
      if (content instanceof Node) return h(tag, {}, content);
      if (content && typeof content === "object") return h(tag, { class: content.class }, content.text);
      return h(tag, {}, content ?? "");
    };
    const line = (row) => h("tr", { "data-state": row.state, [`data-${row.kind ?? "name"}`]: row.name }, ...row.cells.map(cell("td")));
    const table = byId(id);
    const body = table.tBodies[0];
    // Only what has changed is put anew: laying out a table costs more than filling it.
    if (body && body.rows.length === rows.length) {
      rows.forEach((row, index) => {
        const [old, fresh] = [body.rows[index], line(row)];
        if (!old.isEqualNode(fresh)) old.replaceWith(fresh);
      });
      return;
    }
    table.replaceChildren(h("thead", {}, h("tr", {}, ...heads.map(cell("th")))), h("tbody", {}, ...rows.map(line)));
  };

  const state = (shown) => {
    const { pose, error } = shown ?? {};
    const three = (values, decimals) => [0, 1, 2].map((axis) => fixed(values?.[axis], decimals));
    const sigmas = (values) => [0, 1, 2].map((axis) => {
      const value = values?.[axis];
      return { text: fixed(value, 1), class: Math.abs(value) > 3 ? "bad" : null };
    });
    const blank = ["", "", ""];
    fill("state", ["", "east m", "north m", "up m", "roll °", "pitch °", "heading °"], [
      { name: "estimate", cells: ["estimate", ...three(pose?.position_enu, 3), ...three(pose?.roll_pitch_heading_deg, 2)] },
      { name: "sigma", cells: ["1σ", ...three(pose?.sigma_position_enu, 3), ...three(pose?.sigma_roll_pitch_heading_deg, 3)] },
      ...(error ? [
        { name: "error", cells: ["error", ...three(error.position_enu, 3), ...three(error.roll_pitch_heading_deg, 3)] },
        { name: "in-sigmas", cells: ["error / σ", ...sigmas(error.position_in_sigmas), ...sigmas(error.roll_pitch_heading_in_sigmas)] },
        { name: "rms", cells: ["rms so far", ...three(error.rms_position_enu, 3), ...blank] },
      ] : []),
      { name: "velocity", cells: ["velocity m/s", ...three(pose?.velocity_enu, 3), ...blank] },
    ]);
  };

  /** What the gate lets through: up to so many sigmas, for ranges from too long to too short. */
  const gate = ({ is_gated: is, gate: limits }) => {
    if (is === false) return "off";
    if (!limits) return ilns.UNKNOWN;
    return limits[0] < 0 ? `${fixed(limits[0], 0)}…${fixed(limits[1], 0)}` : fixed(limits[1], 1);
  };

  const sensors = (shown) => {
    const rows = (shown?.sensors ?? []).map((row) => {
      // What came before the start, or is switched off, is not held against the sensor.
      const blame = Object.entries(row.rejected ?? {}).filter(([reason]) => reason !== "before_start" && reason !== "disabled");
      const refused = blame.reduce((sum, [, count]) => sum + count, 0);
      const share = row.received ? (100 * refused) / row.received : null;
      const list = (entries) => entries.map(([reason, count]) => `${reason} ${count}`).join(", ");
      const found = row.calibration;
      const calibration = found ? `${found.name} ${fixed(found.value, 3)} ± ${fixed(found.sigma, 3)} ${found.unit}${blame.length ? ", " : ""}` : "";
      const why = ilns.h("span", { title: list(Object.entries(row.rejected ?? {})) }, calibration + list(blame) + (row.lost ? ` (${row.lost} lost)` : ""));
      const silent = row.is_silent;
      const offset = row.time_offset == null ? ilns.UNKNOWN : `${fixed(1e3 * row.time_offset, 1)} ± ${fixed(1e3 * row.time_offset_sigma, 1)}`;
      return {
        kind: "sensor", name: row.sensor, state: silent ? "silent" : row.received ? "heard" : "none",
        cells: [ilns.key(ilns.SENSOR_COLOURS[row.sensor], row.sensor), { text: silent ? "silent" : fixed(row.rate, 1), class: silent ? "bad" : null },
          fixed(row.age, 1), { text: fixed(row.used_age, 1), class: "wide mid" },
          { text: fixed(row.innovation, 2), class: row.innovation > 3 ? "bad" : null }, gate(row),
          { text: `${row.received}`, class: "narrow" }, { text: fixed(share, 1), class: share > 10 ? "warn" : null }, offset,
          { text: why, class: "text" }],
      };
    });
    fill("sensors", ["", "per s", "age s", { text: "used s", class: "wide mid" }, "innov. σ", "gate σ", { text: "received", class: "narrow" }, "refused %", "offset ms",
      { text: "why refused", class: "text" }], rows);
  };

  // 1 µs to 10 s.
  const place = (seconds) => Math.min(Math.max(((Math.log10(Math.max(seconds, 1e-9)) + 6) / 7) * 100, 0), 100);

  const hops = (shown) => {
    const names = { hop_in: "input hop", work: "work", end_to_end: "end to end" };
    const rows = (shown?.hops ?? []).map((hop) => {
      const bar = h("span", { class: "span" }, h("i"), h("b"));
      const [range, end] = bar.children;
      range.style.left = `${place(hop.p50)}%`;
      range.style.width = `${place(hop.p99) - place(hop.p50)}%`;
      end.style.left = `${place(hop.max)}%`;
      return { name: `${hop.process}-${hop.what}`,
        cells: [`${hop.process} ${names[hop.what] ?? hop.what}`, duration(hop.p50), duration(hop.p99), duration(hop.max), bar] };
    });
    byId("hops").hidden = rows.length === 0;
    fill("hops", ["hop", "p50", "p99", "max", "1 µs … 10 s: p50 to p99, line: max"], rows);
  };

  const HISTOGRAMS = { imu_to_estimate: "IMU sample to estimate", solve: "CPU of a solve" };

  const histograms = (shown) => {
    const box = byId("histograms");
    const all = shown?.histograms ?? [];
    if (box.children.length !== all.length) {
      box.replaceChildren(...all.map((one) => h("div", { class: "chart" }, h("h3", {}, h("b", {}, HISTOGRAMS[one.what] ?? one.what), h("span")), h("canvas"))));
    }
    all.forEach((one, index) => histogram(box.children[index], one));
  };

  const histogram = (box, { counts, first_decade: decade }) => {
    const canvas = box.querySelector("canvas");
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const total = counts.reduce((sum, count) => sum + count, 0);
    const highest = Math.log10(1 + Math.max(...counts));
    const floor = height - 16;
    const x = (exponent) => ((exponent + 6) / 7) * width;
    context.fillStyle = ilns.colour("soft");
    context.strokeStyle = ilns.colour("grid");
    context.font = "11px system-ui, sans-serif";
    for (let exponent = -6; exponent <= 1; exponent++) {
      context.beginPath();
      context.moveTo(x(exponent), 0);
      context.lineTo(x(exponent), floor);
      context.stroke();
      const text = duration(10 ** exponent).replace(/\.0+ /, " ");
      context.fillText(text, Math.min(x(exponent) + 2, width - 30), height - 4);
    }
    context.fillStyle = ilns.colour("accent");
    counts.forEach((count, bin) => {
      if (!count) return;
      const tall = (Math.log10(1 + count) / highest) * (floor - 4);
      const left = x(decade + bin / 10);
      context.fillRect(left, floor - tall, Math.max(width / 70 - 1, 1), tall);
    });
    ilns.say(box.querySelector("span"), `${total} measured; height is log(1 + count), ${Math.max(...counts)} at most in a bin`);
  };

  const processes = (shown) => {
    const rows = (shown?.processes ?? []).map((row) => {
      const well = ["running", "finished"].includes(row.state) && row.silence != null && row.silence < 2;
      return { kind: "process", name: row.name, state: well ? "well" : "bad",
        cells: [row.name, `${row.pid || ilns.UNKNOWN}`, { text: row.state ?? "unknown", class: well ? null : "bad" }, { text: `${row.restarts}`, class: row.restarts ? "warn" : null },
          fixed(row.cpu_percent, 1), row.resident_bytes == null ? ilns.UNKNOWN : fixed(row.resident_bytes / 1e6, 1), { text: `${row.dropped}`, class: row.dropped ? "bad" : null }] };
    });
    fill("processes", ["process", "pid", "state", "restarts", "CPU %", "MB", "dropped"], rows);
  };

  let eventsShown = "";
  const events = () => {
    const list = store.now?.events ?? [];
    const moment = store.moment();
    const seen = store.cursor === null ? list : list.filter((event) => event.t == null || event.t <= moment);
    const key = `${seen.length} ${seen[seen.length - 1]?.t}`;
    if (key === eventsShown) return;
    eventsShown = key;
    byId("events").replaceChildren(...seen.toReversed().map((event) =>
      h("li", { "data-bad": `${event.is_bad}` }, `${fixed(event.t, 1)} s  ${event.what}`)));
  };

  const draw = () => {
    const shown = store.shown();
    state(shown);
    sensors(shown);
    const isFinished = store.kind === "finished";
    byId("latency-card").hidden = isFinished && !(store.now?.histograms ?? []).length;
    byId("processes-card").hidden = isFinished && !(store.now?.processes ?? []).length;
    hops(store.now);
    if (ilns.isInSight("latency-card")) histograms(store.now);
    processes(store.now);
    events();
  };

  return { draw };
})();
