// Draws the replay at the time of the slider. `recorded` are the arrays of the page.
window.replay = (async () => {
  const TRAIL_S = 6 * 3600, TRAIL_POINTS = 36, LINE_KM = 50000;
  const {arrays, facts} = unpackedArrays(await recorded);
  const gd = document.getElementById("{plot_id}"), $ = id => document.getElementById(id);
  const {time, observer, aim, estimate, error, scale, root} = arrays;
  const n = time.shape[0], nObservers = facts.observers.length, nObjects = facts.objects.length;
  const seen = rowsOfDetections(), step = (time[n - 1] - time[0]) / Math.max(1, n - 1);
  const number = Object.fromEntries(facts.traces.map((name, k) => [name, k]));
  const sphere = unitSphere(nObjects > 60 ? 8 : 14);
  const places = ["x", "y", "z"];
  // the spheres of Earth and Moon about their centers at the first time
  const balls = [0, 1].map(b => places.map((axis, c) => Array.from(
    gd._fullData[b][axis], row => Array.from(row, v => v - arrays[["earth", "moon"][b]][c]))));
  let chosen = -1, owners = [], playing = false, drawn = Promise.resolve();

  // ---- arrays -------------------------------------------------------------------------------
  function unpackedArrays(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const bytes = new Uint8Array(buffer, 4 + length), arrays = {};
    let at = 0;
    for (const [name, {shape, resolution, flagged}] of Object.entries(header.arrays)) {
      const rows = shape[0], size = shape.reduce((a, b) => a * b, 1), series = rows ? size / rows : 0;
      const values = new Float64Array(size);
      for (let s = 0, k = at; s < series; s++) {
        let slope = 0, value = 0;
        for (let t = 0; t < rows; t++, k++) {
          const second = bytes[k] | bytes[k + size] << 8 | bytes[k + 2 * size] << 16 | bytes[k + 3 * size] << 24;
          slope = slope + second | 0;
          value = value + slope | 0;
          values[t * series + s] = value * resolution;
        }
      }
      at += 4 * size;
      if (flagged) {
        for (let s = 0; s < series; s++)
          for (let t = 0; t < rows; t++) if (bytes[at + s * rows + t]) values[t * series + s] = NaN;
        at += size;
      }
      values.shape = shape;
      arrays[name] = values;
    }
    return {arrays, facts: header.facts};
  }

  function rowsOfDetections() {
    const found = {from: new Int32Array(n + 1), of: facts.objects.map(() => [])};
    const count = arrays.seen_time.length;
    for (let row = 0, k = 0; k < n; k++) {
      // half of the resolution of the times
      while (row < count && arrays.seen_time[row] <= time[k] + 0.5) row++;
      found.from[k + 1] = row;
    }
    for (let row = 0; row < count; row++) found.of[arrays.seen_object[row]]?.push(row);
    return found;
  }

  // ---- geometry -----------------------------------------------------------------------------
  const three = (array, k, j, width) => {
    const at = 3 * (k * width + j);
    return [array[at], array[at + 1], array[at + 2]];
  };
  const plus = (a, b, factor = 1) => [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]];
  const norm = a => Math.hypot(...a);
  const unit = a => a.map(v => v / norm(a));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const inertial = () => $("frame").value === "inertial";
  // from the rotating frame at time k to the frame that is shown
  const shown = (p, k) => inertial()
    ? [0, 1, 2].map(r => p[0] * arrays.axes[9 * k + 3 * r] + p[1] * arrays.axes[9 * k + 3 * r + 1] + p[2] * arrays.axes[9 * k + 3 * r + 2])
    : p;
  const track = (j, k) => three(estimate, k, j, nObjects);
  const known = (j, k) => !Number.isNaN(estimate[3 * (k * nObjects + j)]);
  // the true position, also of an object without a track, or null
  const truePlace = (j, k) => known(j, k) ? plus(track(j, k), three(error, k, j, nObjects))
    : arrays.untracked ? three(arrays.untracked, k, j, nObjects) : null;
  const truthShown = () => $("truth").checked && facts.truth;

  function unitSphere(across) {
    const points = [], faces = [], down = across / 2;
    for (let a = 0; a <= down; a++)
      for (let b = 0; b < across; b++) {
        const lat = Math.PI * a / down, lon = 2 * Math.PI * b / across;
        points.push([Math.sin(lat) * Math.cos(lon), Math.sin(lat) * Math.sin(lon), Math.cos(lat)]);
        const next = (b + 1) % across;
        if (a < down) faces.push([a * across + b, a * across + next, (a + 1) * across + b],
          [a * across + next, (a + 1) * across + next, (a + 1) * across + b]);
      }
    return {points, faces};
  }

  const rooted = (j, k) => Array.from(root.subarray(6 * (k * nObjects + j), 6 * (k * nObjects + j) + 6));
  const sigmaKm = (j, k) => 2 ** scale[k * nObjects + j] * norm(rooted(j, k));

  // ---- drawing ------------------------------------------------------------------------------
  const lists = () => ({x: [], y: [], z: []});
  const put = (to, p) => places.forEach((axis, c) => to[axis].push(p[c]));
  const gap = to => places.forEach(axis => to[axis].push(null));
  const nothing = () => ({x: [null], y: [null], z: [null]});

  function halfWidth() {
    const view = facts.views[$("view").value];
    if (view) return view[1];
    if ($("view").value === "object" && chosen >= 0) return null;
    return Math.max(...facts.bounds.map(([low, high]) => high - low)) / 2;
  }

  // the largest standard deviation of all but a tenth of the states, km
  const large = (() => {
    const some = [];
    for (let at = 0; at < scale.length; at += Math.ceil(scale.length / 5000)) if (scale[at] > -99) some.push(scale[at]);
    return 2 ** some.sort((a, b) => a - b)[Math.floor(0.9 * some.length)];
  })();

  function enlargement() {
    const stated = Number($("factor").value), half = halfWidth();
    if (stated || half === null) return stated || 1;
    // 1, 2 or 5 times a power of ten, with which few ellipsoids exceed a fifth of the half width
    const most = 0.2 * half / (Number($("sigma").value) * large), ten = 10 ** Math.floor(Math.log10(most));
    return most > 1 ? ten * [5, 2, 1].find(digit => digit * ten <= most) : 1;
  }

  function points(count, place, text) {
    const to = {...lists(), text: []};
    for (let j = 0; j < count; j++) {
      const p = place(j);
      put(to, p && !Number.isNaN(p[0]) ? p : [null, null, null]);
      to.text.push(text(j));
    }
    return to;
  }

  function ellipsoids(k, factor) {
    const to = {...lists(), i: [], j: [], k: []};
    owners = [];
    for (let object = 0; object < nObjects; object++) {
      if (!known(object, k) || Number.isNaN(scale[k * nObjects + object])) continue;
      const size = Number($("sigma").value) * factor * 2 ** scale[k * nObjects + object];
      const l = rooted(object, k), center = track(object, k), first = to.x.length;
      owners.push(object);
      for (const [u, v, w] of sphere.points)
        put(to, shown(plus(center, [l[0] * u, l[1] * u + l[2] * v, l[3] * u + l[4] * v + l[5] * w], size), k));
      for (const [a, b, c] of sphere.faces) { to.i.push(first + a); to.j.push(first + b); to.k.push(first + c); }
    }
    return to;
  }

  function cones(k) {
    const to = {...lists(), i: [], j: [], k: []}, sides = 16;
    for (let o = 0; o < nObservers; o++) {
      const apex = three(observer, k, o, nObservers), way = plus(three(aim, k, o, nObservers), apex, -1);
      if (Number.isNaN(way[0])) continue;
      const along = unit(way), across = unit(cross(along, Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
      const up = cross(along, across), first = to.x.length;
      const radius = norm(way) * Math.tan(Math.min(facts.field_deg[o] / 2, 80) * Math.PI / 180);
      put(to, shown(apex, k));
      for (let s = 0; s < sides; s++) {
        const angle = 2 * Math.PI * s / sides;
        const rim = plus(plus(plus(apex, way), across, radius * Math.cos(angle)), up, radius * Math.sin(angle));
        put(to, shown(rim, k));
        to.i.push(first); to.j.push(first + 1 + s); to.k.push(first + 1 + (s + 1) % sides);
      }
    }
    return to;
  }

  function detections(k) {
    const to = lists(), newest = new Set();
    for (let row = seen.from[k + 1] - 1; row >= seen.from[k]; row--) {
      const object = arrays.seen_object[row], by = arrays.seen_observer[row], pair = `${by} ${object}`;
      if (object >= 0 && newest.has(pair)) continue;
      newest.add(pair);
      const from = three(observer, k, by, nObservers), measured = three(arrays.seen_direction, row, 0, 1);
      const way = object >= 0 && known(object, k) ? plus(track(object, k), from, -1) : null;
      const direction = Number.isNaN(measured[0]) ? way && unit(way) : measured;
      if (!direction) continue;
      put(to, shown(from, k));
      put(to, shown(plus(from, direction, way ? norm(way) : LINE_KM), k));
      gap(to);
    }
    return to.x.length ? to : nothing();
  }

  function path(to, j, k, from) {
    const stride = Math.max(1, Math.ceil((k - from) / TRAIL_POINTS));
    for (let t = k; t >= from; t -= j === chosen ? 1 : stride) if (known(j, t)) put(to, shown(track(j, t), t)); else gap(to);
    gap(to);
  }

  function paths(k) {
    const to = lists();
    for (let j = 0; j < nObjects; j++) if (j !== chosen) path(to, j, k, Math.max(0, k - Math.round(TRAIL_S / step)));
    return to.x.length ? to : nothing();
  }

  const happened = (k, truth) => facts.maneuvers.filter(m => m[3] === truth && m[0] <= time[k]);
  function maneuvers(k, truth) {
    const some = happened(k, truth);
    const at = some.map(m => Math.max(0, frameOf(m[0])));
    const place = (j, t) => known(j, t) ? track(j, t) : truth ? truePlace(j, t) : null;
    return points(some.length, m => { const p = place(some[m][1], at[m]); return p && shown(p, at[m]); },
      m => `${facts.objects[some[m][1]]}, ${words(some[m])}`);
  }
  const frameOf = s => { let k = 0; while (k < n - 1 && time[k] < s) k++; return k; };
  const words = m => `${m[2].toPrecision(2)} m/s on ${dateOf(m[0])}${m[3] ? " (truth)" : " (estimated)"}`;
  const dateOf = (s, letters = 16) => {
    const k = frameOf(s), exact = Date.parse(facts.utc[k]) / 1000 + s - time[k];
    return new Date(1000 * Math.round(exact)).toISOString().slice(0, letters).replace("T", " ");
  };

  function limits(k) {
    const name = $("view").value, view = facts.views[name];
    const cube = (p, half) => p.map(v => [v - half, v + half]);
    if (view) {
      const earth = three(arrays.earth, k, 0, 1), moon = three(arrays.moon, k, 0, 1);
      return cube(shown(plus(earth, plus(moon, earth, -1), view[0]), k), view[1]);
    }
    if (name === "object" && chosen >= 0 && known(chosen, k)) {
      const size = 5 * Number($("sigma").value) * enlargement() * sigmaKm(chosen, k);
      return cube(shown(track(chosen, k), k), Number.isNaN(size) ? 1000 : size);
    }
    if (!inertial()) return facts.bounds;
    return cube([0, 0, 0], Math.max(...facts.bounds.flat().map(Math.abs)));
  }

  function draw() {
    const k = Number($("time").value), factor = enlargement(), truth = truthShown();
    const update = (name, values) => Object.assign(gd.data[number[name]], values);
    const centers = ["earth", "moon"].map(body => shown(three(arrays[body], k, 0, 1), k));
    places.forEach((axis, c) => {
      centers.forEach((center, b) => { gd.data[b][axis] = balls[b][c].map(row => row.map(v => v + center[c])); });
      gd.data[2][axis] = centers.map(center => center[c]);
    });
    update("observers", points(nObservers, o => shown(three(observer, k, o, nObservers), k), o => `observer ${facts.observers[o]}`));
    update("fields of view", cones(k));
    update("detections", detections(k));
    update("tracks", points(nObjects, j => known(j, k) && shown(track(j, k), k), j => facts.objects[j]));
    update("selected object", points(1, () => chosen >= 0 && known(chosen, k) && shown(track(chosen, k), k), () => facts.objects[chosen]));
    update("ellipsoids", ellipsoids(k, factor));
    const enlarged = factor > 1 ? `, enlarged ${factor.toLocaleString("en").replace(/,/g, "\u2009")} times` : ", true size";
    update("ellipsoids", {name: `${$("sigma").value}-sigma ellipsoids${enlarged}`});
    update("paths", paths(k));
    const own = lists();
    if (chosen >= 0) path(own, chosen, k, 0);
    update("path of the selected object", chosen >= 0 ? own : nothing());
    update("maneuvers", maneuvers(k, false));
    update("true maneuvers", truth ? maneuvers(k, true) : nothing());
    update("truth", truth ? points(nObjects, j => { const p = truePlace(j, k); return p && shown(p, k); }, j => `${facts.objects[j]}, truth`) : nothing());
    const errors = lists();
    for (let j = 0; truth && j < nObjects; j++) {
      if (!known(j, k)) continue;
      put(errors, shown(track(j, k), k));
      put(errors, shown(plus(track(j, k), three(error, k, j, nObjects), factor), k));
      gap(errors);
    }
    update("errors", errors.x.length ? errors : nothing());
    update("errors", {name: `errors of the estimates${enlarged}`});
    const empty = {maneuvers: !facts.maneuvers.some(m => !m[3]), "path of the selected object": chosen < 0, "selected object": chosen < 0,
      truth: !truth, errors: !truth, "true maneuvers": !truth || !facts.maneuvers.some(m => m[3])};
    for (const name in empty) gd.data[number[name]].showlegend = !empty[name];
    const range = limits(k), extent = range.map(([low, high]) => high - low), scene = gd.layout.scene;
    const mean = Math.cbrt(extent[0] * extent[1] * extent[2]);
    places.forEach((axis, c) => {
      scene[`${axis}axis`].range = range[c];
      scene[`${axis}axis`].title.text = `${axis}, km, ${inertial() ? "ICRF axes" : "rotating frame"}`;
      scene.aspectratio[axis] = extent[c] / mean;
    });
    gd.layout.datarevision = (gd.layout.datarevision || 0) + 1;
    $("date").textContent = `${dateOf(time[k], 19)} UTC, ${(time[k] / 3600).toFixed(2)} h`;
    tell(k, truth);
    return drawn = Plotly.react(gd, gd.data, gd.layout);
  }

  // ---- panel --------------------------------------------------------------------------------
  const km = v => Number.isNaN(v) ? "unknown" : v >= 100 ? `${v.toFixed(0)} km` : v >= 1 ? `${v.toPrecision(3)} km` : `${(1000 * v).toFixed(0)} m`;

  function tell(k, truth) {
    $("name").textContent = chosen < 0 ? "" : facts.objects[chosen];
    const rows = [], j = chosen, add = (label, text) => rows.push([label, text]);
    if (j >= 0) {
      const own = seen.of[j].filter(row => row < seen.from[k + 1]), last = own[own.length - 1];
      add("detections", `${own.length}`);
      if (own.length) {
        const magnitude = arrays.seen_magnitude[last];
        add("last detection", `${dateOf(arrays.seen_time[last])} by ${facts.observers[arrays.seen_observer[last]]}`
          + (Number.isNaN(magnitude) ? "" : `, ${magnitude.toFixed(1)} mag`));
      }
      add("position, standard deviation", known(j, k) ? km(sigmaKm(j, k)) : "no track");
      if (facts.truth) add("position error", truth ? km(norm(three(error, k, j, nObjects))) : "shown with the truth");
      facts.facts.forEach((fact, f) => {
        if (fact.truth && !truth) return;
        const values = arrays[`fact${f}`], width = values.length / (n * nObjects), at = (k * nObjects + j) * width;
        const own = Array.from(values.subarray(at, at + width));
        add(fact.label, own.some(Number.isNaN) ? "unknown" : fact.names.length ? fact.names[own[0]].replace(/_/g, " ")
          : `${own.map(v => v.toFixed(fact.digits)).join(", ")} ${fact.unit}`);
      });
      const changes = [...happened(k, false), ...truth ? happened(k, true) : []].filter(m => m[1] === j);
      add("maneuvers", changes.length ? changes.map(words).join("; ") : "none known");
    }
    $("known").replaceChildren(...rows.map(cells => {
      const row = document.createElement("tr");
      cells.forEach((text, c) => { row.append(document.createElement(c ? "td" : "th")); row.lastChild.textContent = text; });
      return row;
    }));
    for (const mark of $("marks").children) mark.hidden = mark.className === "true" && !truth;
  }

  function choose(j) {
    chosen = j;
    $("object").value = String(j);
    return draw();
  }

  async function play() {
    playing = !playing;
    $("play").textContent = playing ? "Pause" : "Play";
    while (playing) {
      const k = Number($("time").value);
      $("time").value = String(k + 1 < n ? k + 1 : 0);
      await draw();
      await new Promise(done => setTimeout(done, 60));
    }
  }

  const option = (to, value, text) => { const one = document.createElement("option"); one.value = value; one.textContent = text; to.append(one); };
  facts.objects.forEach((name, j) => option($("object"), j, name));
  for (const name of ["everything", ...Object.keys(facts.views)]) option($("view"), name, name);
  option($("view"), "object", "selected object");
  facts.maneuvers.forEach(m => {
    const mark = document.createElement("span");
    mark.className = m[3] ? "true" : "";
    mark.style.left = `${100 * frameOf(m[0]) / Math.max(1, n - 1)}%`;
    mark.title = `${facts.objects[m[1]]}, ${words(m)}`;
    $("marks").append(mark);
  });
  $("time").max = String(n - 1);
  $("truthful").hidden = !facts.truth;
  // a link can state time, view, frame, sigma, factor, object and truth: #time=20&view=Earth
  for (const [id, value] of new URLSearchParams(location.hash.slice(1))) {
    if (id === "object") chosen = facts.objects.indexOf(value);
    else if (id === "truth") $("truth").checked = true;
    else if (["time", "view", "frame", "sigma", "factor"].includes(id)) $(id).value = value;
  }
  for (const id of ["view", "frame", "sigma", "factor", "truth"]) $(id).addEventListener("change", draw);
  $("time").addEventListener("input", draw);
  $("play").addEventListener("click", play);
  $("object").addEventListener("change", () => choose(Number($("object").value)));
  gd.on("plotly_click", ({points: [point]}) => {
    const of = facts.traces[point.curveNumber], at = point.pointNumber;
    const object = of === "tracks" || of === "truth" ? at
      : of === "ellipsoids" ? owners[Math.floor(at / sphere.points.length)]
      : of?.endsWith("maneuvers") ? happened(Number($("time").value), of !== "maneuvers")[at][1] : chosen;
    // drawing with the button still down clicks again, and must not be interrupted
    if (object !== chosen) setTimeout(() => choose(object));
  });
  await choose(chosen);
  return {draw, choose, shown: () => drawn, arrays, facts, number};
})();
