// Brings it together: where the run comes from (a stream, or this very file), the moment that is shown, keys, and when to draw.
"use strict";
(() => {
  const { store, views, byId, fixed, say } = ilns;
  const dirty = { map: true, tables: true, charts: true, graph: true };
  /**
   * Between two pictures of a live run, ms: numbers that change faster are not read, and what a chart gains in two seconds of its
   * five minutes are some pixels. The rest of the machine is for the navigation.
   */
  const LEAST = { map: 450, tables: 900, charts: 1900, graph: 1900 };
  const drawnAt = {};
  /** Everything, as soon as it is drawn: after what somebody did, or what came into sight. */
  const all = () => {
    for (const name of Object.keys(LEAST)) {
      dirty[name] = true;
      drawnAt[name] = 0;
    }
  };

  const header = () => {
    const point = store.point();
    const mode = point?.mode ?? -1;
    const badge = byId("mode");
    badge.dataset.mode = mode;
    say(badge, ilns.MODES[mode]?.replace("_", " ") ?? "no estimate");
    say(byId("set"), store.title);
    say(byId("t"), fixed(point?.t, 1));
    say(byId("speed"), store.cursor === null && store.kind === "live" ? `${fixed(store.now?.speed, 2)} × real time` : "");
    const off = point && point.de !== null ? `, off ${fixed(Math.hypot(point.de, point.dn), 2)} m` : "";
    say(byId("where"), point && point.e !== null
      ? `E ${fixed(point.e, 2)}  N ${fixed(point.n, 2)}  U ${fixed(point.u, 2)} m  ±${fixed(Math.hypot(point.se, point.sn), 2)} m${off}` : "");
    const title = `${ilns.MODES[mode] ?? "–"} · ilns ${store.title}`;
    if (document.title !== title) document.title = title;
    const [first, last] = store.range();
    const slider = byId("slider");
    slider.min = first;
    slider.max = Math.max(last, first + 1);
    if (document.activeElement !== slider || store.cursor === null) slider.value = store.moment();
    say(byId("slider-t"), `${fixed(store.moment(), 1)} s`);
    byId("end").setAttribute("aria-pressed", store.cursor === null);
  };

  // What is out of sight costs nothing; it is drawn as soon as it comes.
  const seen = "IntersectionObserver" in window && new IntersectionObserver((entries) => {
    let isNew = false;
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting) isNew ||= !ilns.inSight.has(target.id);
      if (isIntersecting) ilns.inSight.add(target.id);
      else ilns.inSight.delete(target.id);
    }
    if (!isNew) return;
    all();
    draw();
  }, { rootMargin: "150px" });

  const isTooSoon = (name) => store.kind === "live" && store.cursor === null && Date.now() - (drawnAt[name] ?? 0) < LEAST[name];

  const draw = () => {
    if (document.hidden) return;
    header();
    for (const name of Object.keys(dirty)) {
      if (!dirty[name] || isTooSoon(name)) continue;
      drawnAt[name] = Date.now();
      dirty[name] = false;
      views[name].draw();
    }
  };

  // The link to the monitor.
  let source = null;
  let heard = 0;
  let waiting = null;
  const link = (state, text) => {
    byId("link").dataset.link = state;
    say(byId("link"), text);
  };
  const linkShown = () => {
    if (store.kind === "finished") link("finished", "finished run");
    else if (source?.readyState !== 1) link("lost", "no connection, trying again");
    else if (store.cursor !== null) link("still", "standing still");
    else link("live", "live");
  };

  const take = {
    look: (sample) => {
      if (store.look(sample) === "another") fetchHistory();
      dirty.map ||= store.cursor === null;
    },
    state: (snapshot) => {
      store.state(snapshot);
      dirty.tables = true;
    },
    keyframe: (keyframe) => {
      store.keyframe(keyframe);
      dirty.graph = true;
    },
    fix: (fix) => store.fix(fix),
  };

  /** Fetches the past; what comes meanwhile waits and is then taken in. */
  const fetchHistory = async () => {
    if (waiting) return;
    waiting = [];
    try {
      const answer = await fetch("api/v1/history");
      if (!answer.ok) throw new Error(`${answer.status}`);
      store.load(await answer.json());
    } catch (error) {
      link("lost", `no history (${error.message})`);
    }
    const late = waiting;
    waiting = null;
    late.forEach(([name, value]) => take[name](value));
    all();
  };

  const connect = () => {
    source?.close();
    heard = Date.now();
    source = new EventSource("api/v1/stream");
    source.onopen = () => {
      heard = Date.now();
      fetchHistory();
    };
    source.onerror = () => linkShown();
    for (const name of Object.keys(take)) {
      source.addEventListener(name, (event) => {
        heard = Date.now();
        const value = JSON.parse(event.data);
        if (waiting) waiting.push([name, value]);
        else take[name](value);
      });
    }
    source.addEventListener("lagged", () => fetchHistory());
  };

  /** A browser gives up after some answers; a sleeping machine leaves a dead connection. */
  const watch = () => {
    if (store.kind === "live" && source && Date.now() - heard > 5000) connect();
    linkShown();
  };

  // The moment that is shown.
  let playing = null;
  const stop = () => {
    clearInterval(playing);
    playing = null;
    say(byId("play"), "play");
  };
  const goTo = (t) => {
    const [first, last] = store.range();
    store.cursor = t >= last && store.kind === "live" ? null : Math.min(Math.max(t, first), last);
    if (store.cursor === null) say(byId("play"), "pause");
    all();
    linkShown();
    draw();
  };
  const play = () => {
    const [first, last] = store.range();
    if (store.moment() >= last) store.cursor = first;
    say(byId("play"), "pause");
    let before = performance.now();
    playing = setInterval(() => {
      const now = performance.now();
      const next = store.moment() + ((now - before) / 1000) * Number(byId("rate").value);
      before = now;
      goTo(next);
      if (store.cursor === null || next >= store.range()[1]) stop();
      if (store.cursor === null) say(byId("play"), "pause");
    }, 100);
  };
  const toggle = () => {
    if (playing) stop();
    else if (store.cursor === null) {
      goTo(store.moment() - 1e-6);
      say(byId("play"), "play");
    } else play();
  };
  const toEnd = () => {
    stop();
    goTo(Infinity);
  };

  byId("slider").addEventListener("input", (event) => {
    if (playing) stop();
    goTo(Number(event.target.value));
    if (store.cursor !== null) say(byId("play"), "play");
  });
  byId("play").addEventListener("click", toggle);
  byId("end").addEventListener("click", toEnd);

  const theme = (wanted) => {
    const isDark = matchMedia("(prefers-color-scheme: dark)").matches;
    const now = document.documentElement.dataset.theme ?? (isDark ? "dark" : "light");
    document.documentElement.dataset.theme = wanted ?? (now === "dark" ? "light" : "dark");
    try {
      localStorage.setItem("ilns-theme", document.documentElement.dataset.theme);
    } catch {
      // A page from a file may not keep anything.
    }
    views.charts.rebuild();
    all();
    draw();
  };
  byId("theme").addEventListener("click", () => theme());
  byId("help").addEventListener("click", () => byId("keys").showModal());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    views.charts.rebuild();
    all();
  });

  const KEYS = {
    " ": toggle, ",": () => goTo(store.moment() - 1), ".": () => goTo(store.moment() + 1), End: toEnd,
    f: () => views.map.follow(), 0: () => views.map.fit(), "+": () => views.map.zoom(1.4), "=": () => views.map.zoom(1.4),
    "-": () => views.map.zoom(1 / 1.4), t: () => theme(), "?": () => byId("keys").showModal(),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select, dialog *")) return;
    if (event.target.matches("button, input") && event.key === " ") return;
    const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
  window.addEventListener("resize", all);
  document.addEventListener("visibilitychange", all);

  try {
    const kept = localStorage.getItem("ilns-theme");
    if (kept) document.documentElement.dataset.theme = kept;
  } catch {
    // As above.
  }
  const begin = async () => {
    const inside = byId("run");
    if (inside) store.load(JSON.parse(inside.textContent));
    else await fetchHistory();
    if (store.kind === "finished") {
      byId("span").value = "0";
      say(byId("end"), "end");
      store.cursor = store.range()[1];
      say(byId("play"), "play");
    } else connect();
    linkShown();
    all();
    draw();
    if (seen) document.querySelectorAll(".card").forEach((card) => seen.observe(card));
    // A few pictures a second are enough for the eye, and leave the machine to the navigation.
    setInterval(draw, 500);
    setInterval(() => {
      dirty.charts ||= store.kind === "live" && store.cursor === null;
      watch();
    }, 1000);
  };
  begin();
})();
