// The map: track, truth, buoys with range circles, fixes, the vehicle with its 95 % ellipse.
"use strict";
ilns.views.map = (() => {
  const { store, h, byId, fixed, colour } = ilns;
  const canvas = byId("map");
  const screen = canvas.getContext("2d");
  // What has been is drawn once into a layer of its own: a track of hours is not stroked twice a second.
  const past = { context: document.createElement("canvas").getContext("2d"), key: "", until: -Infinity };
  let context = screen;
  // `mode` is "fit" (everything in sight), "follow" or "free".
  const view = { east: 0, north: 0, scale: 2, mode: "fit" };
  let size = [0, 0];

  const toPixel = (east, north) => [size[0] / 2 + (east - view.east) * view.scale, size[1] / 2 - (north - view.north) * view.scale];
  const toMetres = (x, y) => [view.east + (x - size[0] / 2) / view.scale, view.north - (y - size[1] / 2) / view.scale];

  const ratio = () => window.devicePixelRatio || 1;

  const resize = () => {
    size = [canvas.clientWidth, canvas.clientHeight];
    const [width, height] = size.map((length) => Math.round(length * ratio()));
    for (const each of [canvas, past.context.canvas]) {
      if (each.width !== width || each.height !== height) [each.width, each.height, past.key] = [width, height, ""];
    }
    for (const each of [screen, past.context]) each.setTransform(ratio(), 0, 0, ratio(), 0, 0);
  };

  const buoys = () => (store.now?.buoys ?? []).filter((buoy) => buoy.position_enu != null);

  /** The smallest view that has everything in it. */
  const fit = () => {
    let [west, east, south, north] = [Infinity, -Infinity, Infinity, -Infinity];
    const include = (e, n) => {
      if (e === null || n === null) return;
      [west, east] = [Math.min(west, e), Math.max(east, e)];
      [south, north] = [Math.min(south, n), Math.max(north, n)];
    };
    const { e, n, te, tn } = store.track;
    for (let index = 0; index < e.length; index++) {
      include(e[index], n[index]);
      include(te[index], tn[index]);
    }
    buoys().forEach((buoy) => include(buoy.position_enu[0], buoy.position_enu[1]));
    if (west > east) [west, east, south, north] = [-10, 10, -10, 10];
    [view.east, view.north] = [(west + east) / 2, (south + north) / 2];
    view.scale = Math.min((size[0] - 40) / Math.max(east - west, 4), (size[1] - 40) / Math.max(north - south, 4));
  };

  const grid = () => {
    const wanted = 90 / view.scale;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((length) => length >= wanted);
    const [west, north] = toMetres(0, 0);
    const [east, south] = toMetres(size[0], size[1]);
    context.strokeStyle = colour("grid");
    context.fillStyle = colour("soft");
    context.font = "11px system-ui, sans-serif";
    context.lineWidth = 1;
    context.beginPath();
    for (let e = Math.ceil(west / step) * step; e < east; e += step) {
      const [x] = toPixel(e, 0);
      context.moveTo(x, 0);
      context.lineTo(x, size[1]);
      context.fillText(`${Math.round(e * 100) / 100}`, x + 3, size[1] - 4);
    }
    for (let n = Math.ceil(south / step) * step; n < north; n += step) {
      const [, y] = toPixel(0, n);
      context.moveTo(0, y);
      context.lineTo(size[0], y);
      context.fillText(`${Math.round(n * 100) / 100}`, 3, y - 3);
    }
    context.stroke();
    context.fillText("E, N in m", size[0] - 58, 14);
  };

  /** A point nearer to the last one than this, px, would not be seen: a track of hours is some hundred of them. */
  const SEEN = 0.7;

  const line = (east, north, [begin, end], style) => {
    Object.assign(context, { lineJoin: "round", ...style });
    context.setLineDash(style.dash ?? []);
    context.beginPath();
    let before = null;
    for (let index = begin; index < end; index++) {
      if (east[index] === null) {
        before = null;
        continue;
      }
      const [x, y] = toPixel(east[index], north[index]);
      if (before && index < end - 1 && Math.abs(x - before[0]) < SEEN && Math.abs(y - before[1]) < SEEN) continue;
      if (before) context.lineTo(x, y);
      else context.moveTo(x, y);
      before = [x, y];
    }
    context.stroke();
    context.setLineDash([]);
  };

  /** The track, one stroke per stretch of equal mode. */
  const track = ([first, end]) => {
    const { e, n, mode } = store.track;
    for (let begin = first; begin < end;) {
      let stop = begin + 1;
      while (stop < end && mode[stop] === mode[begin]) stop++;
      const last = Math.min(stop + 1, end);
      const style = { strokeStyle: ilns.MODE_COLOURS[mode[begin]] ?? colour("soft"), lineWidth: mode[begin] > 1 ? 3 : 2 };
      line(e, n, [begin, last], style);
      begin = stop;
    }
  };

  const fateColour = (fate) => (typeof fate === "object" ? "#d55e00" : fate === "used" ? colour("accent") : "#999999");

  const fixes = (after, until) => {
    for (const fix of store.fixes) {
      if (fix.t > until || fix.t <= after) continue;
      const [x, y] = toPixel(fix.position_enu[0], fix.position_enu[1]);
      context.strokeStyle = context.fillStyle = fateColour(fix.fate);
      context.lineWidth = 1.5;
      context.beginPath();
      if (typeof fix.fate === "object") {
        context.moveTo(x - 4, y - 4);
        context.lineTo(x + 4, y + 4);
        context.moveTo(x - 4, y + 4);
        context.lineTo(x + 4, y - 4);
        context.stroke();
      } else {
        context.arc(x, y, 2, 0, 2 * Math.PI);
        if (fix.fate === "used") context.fill();
        else context.stroke();
      }
    }
  };

  const rings = (state) => {
    const newest = state?.rings ?? [];
    for (const ring of newest) {
      if (store.moment() - ring.t > 15) continue;
      const [x, y] = toPixel(ring.buoy_enu[0], ring.buoy_enu[1]);
      context.strokeStyle = fateColour(ring.fate);
      context.globalAlpha = 0.55;
      context.lineWidth = 1;
      context.setLineDash(typeof ring.fate === "object" ? [3, 5] : []);
      context.beginPath();
      context.arc(x, y, Math.max(ring.radius * view.scale, 0), 0, 2 * Math.PI);
      context.stroke();
      context.setLineDash([]);
      context.globalAlpha = 1;
    }
  };

  const buoyMarks = () => {
    for (const buoy of buoys()) {
      const [x, y] = toPixel(buoy.position_enu[0], buoy.position_enu[1]);
      context.fillStyle = "#e69f00";
      context.strokeStyle = colour("ink");
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(x, y - 7);
      context.lineTo(x + 6, y + 5);
      context.lineTo(x - 6, y + 5);
      context.closePath();
      context.fill();
      context.stroke();
      context.fillStyle = colour("ink");
      context.font = "bold 12px system-ui, sans-serif";
      context.fillText(`${buoy.buoy}`, x + 8, y + 4);
    }
  };

  const vehicle = (point) => {
    if (!point || point.e === null) return;
    const [x, y] = toPixel(point.e, point.n);
    const [ee, nn, en] = [point.se ** 2, point.sn ** 2, point.cen ?? 0];
    const mean = (ee + nn) / 2;
    const reach = Math.hypot((ee - nn) / 2, en);
    const axes = [mean + reach, Math.max(mean - reach, 0)].map((square) => Math.sqrt(square * ilns.ELLIPSE95) * view.scale);
    context.save();
    context.translate(x, y);
    // The canvas's y points down.
    context.rotate(-0.5 * Math.atan2(2 * en, ee - nn));
    context.strokeStyle = colour("ink");
    context.fillStyle = colour("band");
    context.lineWidth = 1.5;
    context.beginPath();
    context.ellipse(0, 0, Math.max(axes[0], 0.1), Math.max(axes[1], 0.1), 0, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    context.restore();
    context.save();
    context.translate(x, y);
    context.rotate(((point.heading ?? 0) * Math.PI) / 180);
    context.fillStyle = ilns.MODE_COLOURS[point.mode] ?? colour("soft");
    context.strokeStyle = colour("ink");
    context.lineWidth = 1.2;
    context.beginPath();
    context.moveTo(0, -12);
    context.lineTo(7, 8);
    context.lineTo(0, 4);
    context.lineTo(-7, 8);
    context.closePath();
    context.fill();
    context.stroke();
    context.restore();
  };

  /** Truth, fixes and track from one moment to another. */
  const travelled = (from, until) => {
    const { t, te, tn } = store.track;
    const span = [Math.max(ilns.after(t, from) - 1, 0), ilns.after(t, until)];
    if (store.hasTruth) line(te, tn, span, { strokeStyle: colour("truth"), lineWidth: 1.2, dash: [5, 4] });
    fixes(from - SETTLED, until);
    track(span);
  };

  /** A fix is heard of when its fate is settled, so many s after its time at most: the layer may have been drawn between. */
  const SETTLED = 15;
  /** So much data time, s, is drawn beside the layer before that is drawn anew. */
  const LATELY = 30;

  /** Brings the layer to the view, and near enough to the moment. */
  const drawPast = (moment) => {
    const key = [view.east, view.north, view.scale, colour("ink"), store.track.t[0], store.hasTruth].join();
    const behind = moment - past.until;
    if (key === past.key && behind >= 0 && behind < LATELY) return;
    [past.key, past.until] = [key, moment];
    context = past.context;
    context.fillStyle = colour("card");
    context.fillRect(0, 0, size[0], size[1]);
    grid();
    travelled(-Infinity, moment);
    context = screen;
  };

  const draw = () => {
    if (!ilns.isInSight("map-card")) return;
    resize();
    const point = store.point();
    if (view.mode === "fit") fit();
    if (view.mode === "follow" && point && point.e !== null) [view.east, view.north] = [point.e, point.n];
    byId("follow").setAttribute("aria-pressed", view.mode === "follow");
    byId("fit").setAttribute("aria-pressed", view.mode === "fit");
    drawPast(store.moment());
    screen.drawImage(past.context.canvas, 0, 0, size[0], size[1]);
    travelled(past.until, store.moment());
    rings(store.shown());
    buoyMarks();
    vehicle(point);
  };

  // Moving and zooming. A pointer drags, two of them zoom.
  const pointers = new Map();
  const zoom = (factor, x = size[0] / 2, y = size[1] / 2) => {
    const [east, north] = toMetres(x, y);
    if (view.mode === "fit") view.mode = "free";
    view.scale = Math.min(Math.max(view.scale * factor, 1e-3), 5e3);
    if (view.mode === "follow") return draw();
    view.east = east - (x - size[0] / 2) / view.scale;
    view.north = north + (y - size[1] / 2) / view.scale;
    return draw();
  };
  const move = (dx, dy) => {
    view.mode = "free";
    view.east -= dx / view.scale;
    view.north += dy / view.scale;
    draw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [east, north] = toMetres(event.offsetX, event.offsetY);
    ilns.say(byId("map-readout"), `E ${fixed(east, 1)} N ${fixed(north, 1)} m`);
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const here = [event.offsetX, event.offsetY];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const distance = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
      zoom(distance(here) / Math.max(distance(before), 1), (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
    } else {
      move(here[0] - before[0], here[1] - before[1]);
    }
    pointers.set(event.pointerId, here);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
    if (!steps[event.key]) return;
    event.preventDefault();
    move(...steps[event.key]);
  });
  const setMode = (mode) => {
    view.mode = view.mode === mode && mode === "follow" ? "free" : mode;
    draw();
  };
  byId("zoom-in").addEventListener("click", () => zoom(1.4));
  byId("zoom-out").addEventListener("click", () => zoom(1 / 1.4));
  byId("fit").addEventListener("click", () => setMode("fit"));
  byId("follow").addEventListener("click", () => setMode("follow"));

  byId("map-legend").append(
    ...ilns.MODES.map((name, mode) => ilns.key(ilns.MODE_COLOURS[mode], name)),
    h("span", {}, "▲ buoy, circle: last range"), h("span", {}, "● fix used"), h("span", {}, "○ not named"), h("span", {}, "× refused"),
    h("span", {}, "– – truth"), h("span", {}, "ellipse: 95 %"));

  return { draw, zoom, fit: () => setMode("fit"), follow: () => setMode("follow"), view };
})();
