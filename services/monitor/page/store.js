// What the page knows of a run: the past as it was fetched, and what has come since. Bounded, however long it stays open.
"use strict";
ilns.store = (() => {
  const TRACK_MAX = 16000;
  const SERIES_MAX = 6000;
  const KEYFRAMES_MAX = 1200;
  const FIXES_MAX = 2000;
  const STATES_MAX = 1200;
  const COLUMNS = ["t", "e", "n", "u", "heading", "speed", "mode", "se", "sn", "su", "cen", "de", "dn", "du", "te", "tn"];
  const NIS = ["t", "nis", "rows", "refused", "largest"];

  const store = { kind: "live", title: "", cursor: null, now: null, hasTruth: false };

  /** Every second point of the older half makes room: far back a thin line is enough. */
  const thin = (columns, limit) => {
    if (columns.t.length <= limit) return;
    const half = columns.t.length >> 1;
    for (const name of Object.keys(columns)) {
      columns[name] = columns[name].filter((_, index) => index >= half || index % 2 === 0);
    }
  };

  const bound = (list, limit) => {
    if (list.length > limit) list.splice(0, list.length - limit);
  };

  const empty = (names) => Object.fromEntries(names.map((name) => [name, []]));

  /** Takes over a history as the server wrote it. */
  store.load = (history) => {
    store.kind = history.kind;
    store.title = history.title || history.now?.prefix || "";
    store.track = { ...empty(COLUMNS), ...history.track };
    store.solutions = history.solutions;
    store.nis = history.nis;
    store.keyframes = history.keyframes;
    store.fixes = history.fixes;
    store.states = history.states;
    store.now = history.now;
    store.hasTruth = store.track.de.some((error) => error !== null);
  };

  store.load({ kind: "live", track: empty(COLUMNS), solutions: { t: [], solve: [], iterations: [] },
    nis: Object.fromEntries(ilns.AIDING.map((sensor) => [sensor, empty(NIS)])), keyframes: [], fixes: [], states: [], now: null });

  /** A new point of the track. */
  store.look = (sample) => {
    const times = store.track.t;
    if (sample.t === null) return;
    // Time begins anew: that is another run, and the server has forgotten the old one.
    if (times.length && sample.t < times[times.length - 1] - 10) return "another";
    if (times.length && sample.t <= times[times.length - 1]) return;
    for (const name of COLUMNS) store.track[name].push(sample[name]);
    store.hasTruth ||= sample.de !== null;
    thin(store.track, TRACK_MAX);
  };

  /** A new state of the tables. */
  store.state = (snapshot) => {
    store.now = snapshot;
    const last = store.states[store.states.length - 1];
    if (snapshot.t != null && (!last || snapshot.t - last.t >= 2)) {
      const { t, mode, pose, error, solver, sensors, rings } = snapshot;
      store.states.push({ t, mode, pose, error, solver, sensors, rings });
      if (store.states.length > STATES_MAX) store.states = store.states.filter((_, index) => index % 2 === 0);
    }
  };

  /** A new keyframe. */
  store.keyframe = (keyframe) => {
    const last = store.keyframes[store.keyframes.length - 1];
    if (last && keyframe.t <= last.t) return;
    store.keyframes.push(keyframe);
    bound(store.keyframes, KEYFRAMES_MAX);
    const { solutions } = store;
    solutions.t.push(keyframe.t);
    solutions.solve.push(keyframe.solve ?? null);
    solutions.iterations.push(keyframe.iterations);
    ilns.AIDING.forEach((sensor, place) => {
      const [offset, sigma] = keyframe.time_offsets[place] ?? [0, 0];
      (solutions[`offset_${sensor}`] ??= []).push(sigma > 0 ? offset : null);
      (solutions[`offset_sigma_${sensor}`] ??= []).push(sigma > 0 ? sigma : null);
      const judged = keyframe.factors.filter((factor) => factor.sensor === sensor && factor.rows > 0);
      if (!judged.length) return;
      const used = judged.filter((factor) => factor.refused == null);
      const sum = (key) => used.reduce((total, factor) => total + (factor[key] ?? 0), 0);
      const largest = Math.max(...judged.map((factor) => Math.sqrt((factor.nis ?? 0) / factor.rows)));
      const row = { t: keyframe.t, nis: sum("nis"), rows: sum("rows"), refused: judged.length - used.length, largest };
      for (const name of NIS) store.nis[sensor][name].push(row[name]);
      thin(store.nis[sensor], SERIES_MAX);
    });
    thin(solutions, SERIES_MAX);
  };

  /** A fix whose fate is settled. */
  store.fix = (fix) => {
    store.fixes.push(fix);
    bound(store.fixes, FIXES_MAX);
  };

  /** First and last moment that is known. */
  store.range = () => {
    const { t } = store.track;
    return t.length ? [t[0], t[t.length - 1]] : [0, 0];
  };

  /** The moment that is shown, s. */
  store.moment = () => store.cursor ?? store.range()[1];

  /** The point of the track at the moment shown; `null` without one. */
  store.point = () => {
    const index = ilns.after(store.track.t, store.moment()) - 1;
    if (index < 0) return null;
    return Object.fromEntries(COLUMNS.map((name) => [name, store.track[name][index]]));
  };

  /** The state of the tables at the moment shown. */
  store.shown = () => {
    if (store.cursor === null) return store.now;
    const index = ilns.after(store.states.map((state) => state.t), store.cursor) - 1;
    return store.states[Math.max(index, 0)] ?? store.now;
  };

  /** The keyframes of the window at the moment shown, oldest first. */
  store.window = () => {
    const end = store.cursor === null ? store.keyframes.length
      : ilns.after(store.keyframes.map((keyframe) => keyframe.t), store.cursor);
    const newest = store.keyframes[end - 1];
    return newest ? store.keyframes.slice(Math.max(0, end - Math.max(newest.window, 1)), end) : [];
  };

  return store;
})();
