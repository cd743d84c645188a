// The robot in motion, drawn by plotly.js: struts coloured by force, play, pause, rotate.
"use strict";
(function () {
  const INK = "#333a44", PLATE = "#9fb3c4", PATH = "#0b5c8f";
  // Blue pulls, red pushes; both ends are dark enough to be seen on white.
  // What reaches a limit: no colour of a force.
  const LIMIT = "#c2129b";
  const COLOURS = [[0, "#2166ac"], [0.25, "#67a9cf"], [0.5, "#c9c9c9"], [0.75, "#ef8a62"], [1, "#b2182b"]];

  async function plottingLibrary() {
    const packed = document.getElementById("plotting-library").textContent.trim();
    const bytes = Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    return window.Plotly;
  }

  const column = (points, k) => points.map((point) => point[k]);
  const closed = (points) => [...points, points[0]];

  function polygon(points, colour, width, name) {
    const ring = closed(points);
    return {
      type: "scatter3d", mode: "lines", x: column(ring, 0), y: column(ring, 1), z: column(ring, 2),
      line: { color: colour, width }, hoverinfo: "skip", showlegend: false, name,
    };
  }

  function plate(points, colour) {
    return {
      type: "mesh3d", x: column(points, 0), y: column(points, 1), z: column(points, 2),
      i: [0, 0, 0, 0], j: [1, 2, 3, 4], k: [2, 3, 4, 5],
      color: colour, opacity: 0.45, hoverinfo: "skip", flatshading: true,
    };
  }

  const reached = (data, frame) => data.reached[frame].map((k) => data.limits[k]);
  const full = (data, frame) => new Set(reached(data, frame).flatMap((one) => one.struts));

  // One line with gaps: x1 y1 z1, x2 y2 z2, nothing, … of those struts that are wanted.
  function struts(data, frame, wanted) {
    const place = [[], [], []], colour = [], text = [];
    data.base.forEach((base, j) => {
      if (!wanted(j)) return;
      const force = data.force[frame][j];
      for (const point of [base, data.joints[frame][j], [null, null, null]]) {
        for (let k = 0; k < 3; k += 1) place[k].push(point[k]);
        colour.push(force);
        text.push(`strut ${j + 1}: ${force.toFixed(1)} N`);
      }
    });
    return { x: place[0], y: place[1], z: place[2], colour, text };
  }

  // Those below their limits, which show their force, and those that reach one.
  function parted(data, frame) {
    const at = full(data, frame);
    return [struts(data, frame, (j) => !at.has(j)), struts(data, frame, (j) => at.has(j))];
  }

  const plateColour = (data, frame) => (reached(data, frame).some((one) => one.platform) ? LIMIT : PLATE);

  // "strut speed (strut 2, strut 5); tilt of the platform"
  function words(data, frame) {
    const rows = new Map();
    for (const { title, row } of reached(data, frame)) {
      rows.set(title, [...(rows.get(title) ?? []), ...(row ? [row] : [])]);
    }
    const named = [...rows].map(([title, of]) => (of.length ? `${title} (${of.join(", ")})` : title));
    return named.length ? `At its limit now: ${named.join("; ")}.` : "No limit is reached now.";
  }

  // When a limit is reached: a bar of the period, as stops of a gradient.
  function moments(data) {
    const share = (frame) => `${(100 * frame) / data.reached.length}%`;
    const stops = data.reached.map((rows, frame) => {
      const colour = rows.length ? LIMIT : "transparent";
      return `${colour} ${share(frame)}, ${colour} ${share(frame + 1)}`;
    });
    return `linear-gradient(to right, ${stops.join(", ")})`;
  }

  function traces(data) {
    const [now, at] = parted(data, 0), tool = closed(data.tool);
    return [
      {
        type: "scatter3d", mode: "lines", x: now.x, y: now.y, z: now.z, text: now.text,
        hoverinfo: "text", showlegend: false,
        line: {
          color: now.colour, width: 11, colorscale: COLOURS, cmin: -data.largest, cmax: data.largest,
          showscale: true,
          colorbar: { title: { text: "force [N]", side: "top" }, thickness: 14, len: 0.7, outlinewidth: 0 },
        },
      },
      polygon(data.joints[0], INK, 5, "platform"),
      plate(data.joints[0], plateColour(data, 0)),
      {
        type: "scatter3d", mode: "markers", x: [data.tool[0][0]], y: [data.tool[0][1]],
        z: [data.tool[0][2]], marker: { size: 5, color: PATH }, hoverinfo: "skip", showlegend: false,
      },
      polygon(data.base, INK, 5, "base"),
      {
        type: "scatter3d", mode: "lines", x: column(tool, 0), y: column(tool, 1), z: column(tool, 2),
        line: { color: PATH, width: 2 }, hoverinfo: "skip", showlegend: false,
      },
      {
        type: "scatter3d", mode: "text", x: column(data.base, 0), y: column(data.base, 1),
        z: column(data.base, 2), text: data.base.map((_, j) => String(j + 1)),
        textposition: "top center", textfont: { size: 13, color: INK }, hoverinfo: "skip", showlegend: false,
      },
      {
        type: "scatter3d", mode: "lines", x: at.x, y: at.y, z: at.z, text: at.text, hoverinfo: "text",
        showlegend: false, line: { color: LIMIT, width: 11 },
      },
    ];
  }

  // Ranges that hold for the whole motion, so that nothing jumps; equal scales on all axes.
  function ranges(data) {
    const points = [...data.base, ...data.tool, ...data.joints.flat()];
    const lows = [0, 1, 2].map((k) => points.reduce((least, p) => Math.min(least, p[k]), Infinity));
    const highs = [0, 1, 2].map((k) => points.reduce((most, p) => Math.max(most, p[k]), -Infinity));
    const widest = Math.max(...highs.map((high, k) => high - lows[k])) || 1;
    return lows.map((low, k) => [low - 0.06 * widest, highs[k] + 0.06 * widest]);
  }

  function layout(data) {
    const spans = ranges(data);
    const largest = Math.max(...spans.map(([low, high]) => high - low));
    const axis = (name, k) => ({
      title: { text: `${name} [mm]` }, range: spans[k], autorange: false, showbackground: false,
      gridcolor: "#e3e7ec", zeroline: false, nticks: 6, tickfont: { size: 11 },
    });
    const [x, y, z] = spans.map(([low, high]) => (high - low) / largest);
    return {
      scene: {
        xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2),
        aspectmode: "manual", aspectratio: { x, y, z },
        camera: CAMERA,
      },
      margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "#ffffff",
      font: { family: "Helvetica Neue, Arial, sans-serif", color: INK },
      uirevision: "kept",
    };
  }

  const LAST = 7; // The struts that reach a limit, among the traces.
  const CAMERA = { eye: { x: 1.06, y: -1.2, z: 0.72 }, center: { x: 0, y: 0, z: -0.1 } };

  async function start(figure) {
    const data = JSON.parse(figure.querySelector("script.data").textContent);
    const stage = figure.querySelector(".stage"), play = figure.querySelector(".play");
    const position = figure.querySelector(".position"), clock = figure.querySelector(".clock");
    const speed = figure.querySelector(".speed"), snapshot = figure.querySelector(".snapshot");
    const told = figure.querySelector(".reached");
    told.textContent = words(data, 0);
    figure.querySelector(".moments").style.backgroundImage = moments(data);
    const Plotly = await plottingLibrary();
    await Plotly.newPlot(stage, traces(data), layout(data), {
      displayModeBar: false, responsive: true, scrollZoom: true,
    });
    const scene = stage._fullLayout.scene._scene;
    // It sets what the mouse does, for every picture anew, and ignores the mouse for half a second.
    scene.updateFx = () => {};
    let shown = 0, wanted = 0, busy = false, running = false, last = null, time = 0;

    async function show() {
      if (busy) return;
      busy = true;
      while (shown !== wanted) {
        const frame = wanted, [now, at] = parted(data, frame), joints = data.joints[frame];
        const ring = closed(joints), tool = data.tool[frame];
        // With the camera as it is: that of a turn under way is not in the layout yet.
        await Plotly.update(stage, {
          x: [now.x, column(ring, 0), column(joints, 0), [tool[0]], at.x],
          y: [now.y, column(ring, 1), column(joints, 1), [tool[1]], at.y],
          z: [now.z, column(ring, 2), column(joints, 2), [tool[2]], at.z],
          "line.color": [now.colour, INK, undefined, undefined, LIMIT],
          color: [undefined, undefined, plateColour(data, frame), undefined, undefined],
          text: [now.text, undefined, undefined, undefined, at.text],
        }, { "scene.camera": scene.getCamera() }, [0, 1, 2, 3, LAST]);
        shown = frame;
        figure.dataset.frame = String(frame);
      }
      busy = false;
    }

    function go(frame) {
      wanted = frame;
      position.value = String(frame);
      clock.textContent = `t = ${data.time[frame].toFixed(3)} s`;
      told.textContent = words(data, frame);
      show();
    }

    function step(stamp) {
      if (!running) return;
      // The stamp of the first picture may be older than the click that asked for it.
      const passed = last === null ? 0 : Math.max(stamp - last, 0);
      time = (time + (Number(speed.value) * passed) / 1000) % data.period;
      last = stamp;
      go(Math.min(Math.floor((time / data.period) * data.time.length), data.time.length - 1));
      requestAnimationFrame(step);
    }

    async function picture() {
      snapshot.src = await Plotly.toImage(stage, { format: "png", width: 900, height: 560, scale: 2 });
      snapshot.hidden = true;
    }

    play.addEventListener("click", () => {
      running = !running;
      play.textContent = running ? "Pause" : "Play";
      if (!running) { picture(); return; }
      last = null;
      time = data.time[wanted];
      requestAnimationFrame(step);
    });
    position.addEventListener("input", () => {
      running = false;
      play.textContent = "Play";
      go(Number(position.value));
    });
    position.addEventListener("change", picture);
    figure.querySelector(".home").addEventListener("click", () => {
      Plotly.relayout(stage, { "scene.camera": CAMERA });
    });
    await picture();
    figure.dataset.frame = "0";
    figure.dataset.ready = "yes";
  }

  for (const figure of document.querySelectorAll("figure.view")) {
    start(figure).catch((error) => {
      figure.querySelector(".unavailable").hidden = false;
      figure.querySelector(".stage").hidden = true;
      figure.querySelector(".controls").hidden = true;
      figure.dataset.ready = "no";
      console.error(error);
    });
  }
})();
