// Strip charts over data time (uPlot), all with one time axis: dragging zooms all of them, a double click goes back.
"use strict";
ilns.views.charts = (() => {
  const { store, h, byId, fixed, colour } = ilns;
  const charts = [];
  let zoomed = null;

  /** From where to where the charts go. */
  const timeRange = () => {
    if (zoomed) return zoomed;
    const [first, last] = store.range();
    const span = Number(byId("span").value);
    const end = store.kind === "finished" && span > 0 ? Math.max(store.moment(), first + span) : last;
    return [span > 0 ? Math.max(first, end - span) : first, Math.max(end, first + 1)];
  };

  /** The stretch of columns that is in sight, with a point more on either side. */
  const inSight = (times, columns) => {
    const [from, to] = timeRange();
    const begin = Math.max(0, ilns.after(times, from) - 1);
    const end = Math.min(times.length, ilns.after(times, to) + 1);
    const cut = (column) => (column ? column.slice(begin, end) : new Array(end - begin).fill(null));
    return [cut(times), ...columns.map(cut)];
  };

  /** Lines end where nothing was heard for long: a point without values stands in each such gap. */
  const withGaps = (data, gap) => {
    const out = data.map(() => []);
    data[0].forEach((t, index) => {
      const before = data[0][index - 1];
      if (index > 0 && t - before > gap) out.forEach((column, place) => column.push(place === 0 ? (t + before) / 2 : null));
      out.forEach((column, place) => column.push(data[place][index]));
    });
    return out;
  };

  /** Longer than this between two points is a gap, s: a fortieth of what is in sight, as far back the points are thin. */
  const longGap = () => Math.max(5, (timeRange()[1] - timeRange()[0]) / 40);

  const cursorLine = (plot) => {
    if (store.cursor === null) return;
    const x = Math.round(plot.valToPos(store.cursor, "x", true));
    if (x < plot.bbox.left || x > plot.bbox.left + plot.bbox.width) return;
    const { ctx } = plot;
    ctx.save();
    ctx.strokeStyle = colour("accent");
    ctx.lineWidth = 2 * (window.devicePixelRatio || 1);
    ctx.beginPath();
    ctx.moveTo(x, plot.bbox.top);
    ctx.lineTo(x, plot.bbox.top + plot.bbox.height);
    ctx.stroke();
    ctx.restore();
  };

  /**
   * A chart into `parent`. `make()` gives its columns, time first; `series` describes the others; `say(columns, index)` is
   * the line above it.
   */
  const add = (parent, { title, height, series, bands, make, say, log, unit, y }) => {
    const readout = h("span", { class: "soft" });
    const heading = h("h3", {}, h("b", {}, title), readout);
    const box = h("div", { class: "chart" }, heading);
    byId(parent).append(box);
    const chart = { box, make, plot: null };
    const axis = () => ({
      stroke: () => colour("soft"), grid: { stroke: () => colour("grid"), width: 1 }, ticks: { show: false },
      font: "11px system-ui, sans-serif",
    });
    const build = () => {
      const data = make();
      chart.plot = new uPlot({
        width: Math.max(box.clientWidth, 200), height,
        legend: { show: false },
        cursor: { sync: { key: "t" }, drag: { x: true, y: false, setScale: false }, points: { show: false } },
        scales: {
          x: { time: false, range: timeRange },
          y: log ? { distr: 3, range: (_, low, high) => [Math.min(low ?? 0.1, 0.1), Math.max(high ?? 10, 10)] } : y ? { range: y } : {},
        },
        axes: [{ ...axis(), size: 22, space: 70, values: (_, ticks) => ticks.map((tick) => `${tick}`) }, { ...axis(), size: 52, space: 22, label: unit, labelSize: 16, labelFont: "11px system-ui, sans-serif" }],
        series: [{}, ...series.map((one) => ({ points: { show: false }, ...one }))],
        bands: bands?.map((band) => ({ ...band, fill: () => colour("band") })),
        hooks: {
          draw: [cursorLine],
          setSelect: [(plot) => {
            if (plot.select.width < 4) return;
            zoomed = [plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x")];
            plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
            draw();
          }],
          setCursor: [(plot) => {
            const index = plot.cursor.idx;
            ilns.say(readout, index === null || index === undefined ? "" : `t ${fixed(plot.data[0][index], 1)} s  ${say(plot.data, index)}`);
          }],
          ready: [(plot) => plot.over.addEventListener("dblclick", () => {
            zoomed = null;
            draw();
          })],
        },
      }, data, box);
    };
    chart.draw = () => {
      if (!chart.plot) return build();
      const width = Math.max(box.clientWidth, 200);
      if (Math.abs(chart.plot.width - width) > 1) chart.plot.setSize({ width, height });
      return chart.plot.setData(make());
    };
    charts.push(chart);
    return chart;
  };

  const LINE = (name, width = 1.4) => ({ stroke: name.startsWith("#") ? name : () => colour(name), width });

  // Error of each axis within its three sigmas; without a truth the sigmas alone.
  for (const [axis, error, sigma] of [["east", "de", "se"], ["north", "dn", "sn"], ["up", "du", "su"]]) {
    add("error-charts", {
      title: axis, height: 118, unit: "m",
      series: [LINE("accent", 0.8), LINE("accent", 0.8), LINE("ink")],
      bands: [{ series: [1, 2] }],
      y: (plot) => {
        // The first seconds of a run must not flatten the rest: of the band all but 2 % is in sight, of the error everything.
        const [, band, , errors] = plot.data;
        const sorted = band.filter((value) => value !== null).sort((a, b) => a - b);
        const reach = errors.reduce((most, error) => Math.max(most, Math.abs(error ?? 0)), 0);
        const most = Math.max(1.15 * (sorted[Math.floor(0.98 * (sorted.length - 1))] ?? 1), 1.1 * reach, 1e-3);
        return [-most, most];
      },
      make: () => {
        const [t, errors, sigmas] = inSight(store.track.t, [store.track[error], store.track[sigma]]);
        const three = (sign) => sigmas.map((one) => (one === null ? null : sign * 3 * one));
        return [t, three(1), three(-1), errors];
      },
      say: (data, index) => `error ${fixed(data[3][index], 3)}  3σ ${fixed(data[1][index], 3)} m`,
    });
  }

  // Squared normalised innovation per row; the band is where 95 of 100 such sums lie.
  for (const sensor of ilns.AIDING) {
    const chart = add("nis-charts", {
      title: sensor, height: 92, log: true,
      series: [LINE("accent", 0.5), LINE("accent", 0.5),
        { stroke: ilns.SENSOR_COLOURS[sensor], width: 0, paths: () => null, points: { show: true, size: 3, fill: ilns.SENSOR_COLOURS[sensor] } },
        { stroke: "#d55e00", width: 0, paths: () => null, points: { show: true, size: 7, width: 2 } }],
      bands: [{ series: [2, 1] }],
      make: () => {
        const { t, nis, rows, refused, largest } = store.nis[sensor];
        const [time, sums, dofs, no, far] = inSight(t, [nis, rows, refused, largest]);
        const bound = (z) => dofs.map((dof) => (dof > 0 ? Math.max(ilns.chiSquare(dof, z) / dof, 0.01) : null));
        const mean = sums.map((sum, index) => (dofs[index] > 0 ? Math.max(sum / dofs[index], 0.01) : null));
        const all = [time, bound(-ilns.Z95), bound(ilns.Z95), mean, no.map((count, index) => (count > 0 ? Math.max(far[index] ** 2, 0.01) : null))];
        return withGaps(all, longGap());
      },
      say: (data, index) => `NIS/row ${fixed(data[3][index], 2)}  band ${fixed(data[1][index], 2)} to ${fixed(data[2][index], 2)}`,
    });
    chart.isEmpty = () => store.nis[sensor].t.length === 0;
  }

  for (const sensor of ilns.AIDING) {
    const chart = add("offset-charts", {
      title: sensor, height: 92, unit: "ms",
      series: [LINE("accent", 0.5), LINE("accent", 0.5),
        { ...LINE(ilns.SENSOR_COLOURS[sensor], 1.8), points: { show: true, size: 3, fill: ilns.SENSOR_COLOURS[sensor] } }],
      y: (_, low, high) => [Math.min(low ?? 0, -5), Math.max(high ?? 0, 5)],
      bands: [{ series: [1, 2] }],
      make: () => {
        const { solutions } = store;
        const [t, offset, sigma] = inSight(solutions.t, [solutions[`offset_${sensor}`], solutions[`offset_sigma_${sensor}`]]);
        const edge = (sign) => offset.map((value, index) => (value === null ? null : 1e3 * (value + sign * 3 * sigma[index])));
        return [t, edge(1), edge(-1), offset.map((value) => (value === null ? null : 1e3 * value))];
      },
      say: (data, index) => `${fixed(data[3][index], 1)} ± ${fixed((data[1][index] - data[2][index]) / 2, 1)} ms`,
    });
    chart.isEmpty = () => !(store.solutions[`offset_${sensor}`] ?? []).some((offset) => offset !== null);
  }

  const solve = add("solve-charts", {
    title: "CPU per keyframe", height: 110, unit: "ms",
    make: () => {
      const [t, times, iterations] = inSight(store.solutions.t, [store.solutions.solve, store.solutions.iterations]);
      return [t, times.map((time) => (time === null ? null : 1e3 * time)), iterations];
    },
    series: [LINE("accent"), { ...LINE("#e69f00", 1), scale: "n", show: false }],
    say: (data, index) => `${fixed(data[1][index], 3)} ms, ${data[2][index] ?? ilns.UNKNOWN} iterations`,
  });
  solve.isEmpty = () => !store.solutions.solve.some((time) => time !== null);

  const nothing = Object.fromEntries([["nis-charts", "No keyframe has been reported."],
    ["offset-charts", "Nothing speaks against the stamps of any sensor."], ["solve-charts", "No solve has been timed."]]
    .map(([parent, text]) => {
      const note = h("p", { class: "empty" }, text);
      byId(parent).append(note);
      return [parent, note];
    }));

  const draw = () => {
    ilns.say(byId("error-title"), store.hasTruth ? "Error within 3σ" : "3σ of position (no truth)");
    const filled = new Set();
    for (const chart of charts) {
      const isEmpty = chart.isEmpty?.() ?? false;
      chart.box.hidden = isEmpty;
      if (isEmpty) continue;
      filled.add(chart.box.parentElement.id);
      if (ilns.isInSight(chart.box.closest(".card").id)) chart.draw();
    }
    for (const [parent, note] of Object.entries(nothing)) note.hidden = filled.has(parent);
  };

  byId("span").addEventListener("change", () => {
    zoomed = null;
    draw();
  });

  /** Colours or sizes have changed. */
  const rebuild = () => {
    for (const chart of charts) {
      chart.plot?.destroy();
      chart.plot = null;
    }
    draw();
  };

  return { draw, rebuild };
})();
