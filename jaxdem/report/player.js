// Plays all runs of the page at the same output time. The frames are described in player.py, `_planes`.
(() => {
  const root = document.getElementById("player");
  const data = JSON.parse(document.getElementById("player-data").textContent);
  const [button, slider, shown, choice] = ["button", "input", "output", "select"].map((tag) => root.querySelector(tag));
  const figures = [...root.querySelectorAll("figure")];
  const water = Uint32Array.from(data.water, (hex) => {
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
    return new DataView(Uint8Array.of(r, g, b, 255).buffer).getUint32(0, true);
  });
  const wall = [1, 3, 5, 7].map((at) => parseInt(data.wall.slice(at, at + 2), 16));
  const kept = data.runs.map(() => new Map());
  let now = 0, timer = null;

  async function unpacked(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  async function pictureOf(solid) {
    const [nx, nz] = solid.points, share = await unpacked(solid.share), image = new ImageData(nx, nz);
    for (let j = 0; j < nz; j++)
      for (let i = 0; i < nx; i++) {
        const at = 4 * ((nz - 1 - j) * nx + i);
        image.data.set(wall, at);
        image.data[at + 3] = (wall[3] * share[j * nx + i]) / 255;
      }
    const canvas = new OffscreenCanvas(nx, nz);
    canvas.getContext("2d").putImageData(image, 0, 0);
    const openings = await Promise.all(
      solid.openings.map(async ({ color, lines }) => ({ color, lines: linesOf(await unpacked(lines)) }))
    );
    return { canvas, lines: linesOf(await unpacked(solid.lines)), over: solid.over, openings };
  }

  // Lines of points as parts of the box, see `_lines` in player.py.
  function linesOf(bytes) {
    const view = new DataView(bytes.buffer), number = view.getUint32(0, true), lines = [];
    for (let k = 0, at = 4 * (number + 1); k < number; k++) {
      const points = [];
      for (let left = view.getUint32(4 * (k + 1), true); left > 0; left--, at += 4)
        points.push([view.getUint16(at, true) / 65535, view.getUint16(at + 2, true) / 65535]);
      lines.push(points);
    }
    return lines;
  }
  // Of each run the sets of walls that it has in turn.
  const walls = Promise.all(data.runs.map((run) => Promise.all(run.walls.map(pictureOf))));

  async function frame(run, number) {
    const text = data.runs[run].frames[number];
    if (text === null) return null;
    if (!kept[run].has(number)) {
      const bytes = await unpacked(text);
      const [count, nx, nz] = [0, 4, 8].map((at) => new DataView(bytes.buffer).getUint32(at, true));
      let at = 12;
      const plane = (length) => bytes.subarray(at, (at += length));
      const x = [plane(count), plane(count)], z = [plane(count), plane(count)], radius = plane(count);
      const values = Object.fromEntries(data.planes.map((name) => [name, count ? plane(count) : null]));
      kept[run].set(number, { count, nx, nz, x, z, radius, values, speed: plane(nx * nz) });
    }
    return kept[run].get(number);
  }

  function drawFluid(pen, f, wide, high) {
    const image = new ImageData(f.nx, f.nz), pixels = new Uint32Array(image.data.buffer);
    for (let j = 0; j < f.nz; j++)
      for (let i = 0; i < f.nx; i++) pixels[(f.nz - 1 - j) * f.nx + i] = water[f.speed[j * f.nx + i]];
    const small = new OffscreenCanvas(f.nx, f.nz);
    small.getContext("2d").putImageData(image, 0, 0);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(small, 0, 0, wide, high);
  }

  function drawGrains(pen, f, number, wide, high) {
    const run = data.runs[number], scale = wide / run.box[0], colour = choice && f.values[choice.value];
    for (let i = 0; i < f.count; i++) {
      const x = ((f.x[0][i] + 256 * f.x[1][i]) / 65535) * wide;
      const y = high - ((f.z[0][i] + 256 * f.z[1][i]) / 65535) * high;
      const r = Math.max(0.5, (f.radius[i] / 255) * run.radius * scale);
      pen.fillStyle = data.grains[colour ? colour[i] : 128];
      if (r < 1) { pen.fillRect(x - r, y - r, 2 * r, 2 * r); continue; }
      pen.beginPath();
      pen.arc(x, y, r, 0, 7);
      pen.fill();
    }
  }

  function pathOf(lines, wide, high) {
    const path = new Path2D();
    for (const points of lines)
      points.forEach(([x, z], k) => path[k ? "lineTo" : "moveTo"](x * wide, (1 - z) * high));
    return path;
  }

  // Over grains with a white edge, so that it shows on dark ones.
  function drawEdges(pen, walls, wide, high) {
    const path = pathOf(walls.lines, wide, high), pixel = window.devicePixelRatio || 1;
    for (const [width, color] of walls.over ? [[3, "#ffffff"], [1.5, data.edge]] : [[1.5, data.edge]]) {
      pen.lineWidth = width * pixel;
      pen.strokeStyle = color;
      pen.stroke(path);
    }
  }

  function drawOpenings(pen, run, walls, wide, high) {
    const scale = wide / run.box[0];
    pen.lineWidth = 4 * (window.devicePixelRatio || 1);
    for (const { color, corners: [x, z, right, top] } of run.openings) {
      pen.strokeStyle = color;
      pen.strokeRect(x * scale, high - top * scale, (right - x) * scale, (top - z) * scale);
    }
    for (const { color, lines } of walls ? walls.openings : []) {
      pen.strokeStyle = color;
      pen.stroke(pathOf(lines, wide, high));
    }
  }

  async function draw() {
    const number = now, solid = await walls;
    const frames = await Promise.all(data.runs.map((_, run) => frame(run, number)));
    if (number !== now) return;
    frames.forEach((f, i) => {
      const run = data.runs[i], canvas = figures[i].querySelector("canvas");
      const wide = Math.round(canvas.clientWidth * (window.devicePixelRatio || 1));
      canvas.width = wide;
      canvas.height = Math.round((wide * run.box[1]) / run.box[0]);
      const pen = canvas.getContext("2d");
      figures[i].querySelector("small").textContent = f ? "" : " no output at this time";
      if (f && f.nx * f.nz) drawFluid(pen, f, canvas.width, canvas.height);
      pen.imageSmoothingEnabled = true;
      const walls = solid[i][run.wall[number]];
      if (f && walls) pen.drawImage(walls.canvas, 0, 0, canvas.width, canvas.height);
      if (f && walls && !walls.over) drawEdges(pen, walls, canvas.width, canvas.height);
      if (f) drawGrains(pen, f, i, canvas.width, canvas.height);
      if (f && walls && walls.over) drawEdges(pen, walls, canvas.width, canvas.height);
      if (f) drawOpenings(pen, run, walls, canvas.width, canvas.height);
    });
    slider.value = number;
    shown.textContent = `t = ${data.times[number]} s`;
    for (const bar of root.querySelectorAll(".scale")) {
      const fluid = bar.dataset.scale === "fluid", name = fluid ? "fluid" : choice.value;
      const colours = (fluid ? data.water : data.grains).filter((_, k) => k % 15 === 0);
      const label = fluid ? "fluid speed [m/s]" : choice.selectedOptions[0].text;
      bar.style.background = `linear-gradient(to right, ${colours.join(",")})`;
      bar.textContent = "";
      for (const text of ["0", label, `${Number(data.tops[name].toPrecision(2))}+`])
        bar.appendChild(document.createElement("span")).textContent = text;
    }
  }

  function stop() {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
  }

  button.addEventListener("click", () => {
    if (timer) return stop();
    button.textContent = "Pause";
    // The whole run in about eight seconds, within what the eye follows.
    const wait = Math.min(500, Math.max(50, 8000 / data.times.length));
    timer = setInterval(() => { now = (now + 1) % data.times.length; draw(); }, wait);
  });
  slider.addEventListener("input", () => { stop(); now = Number(slider.value); draw(); });
  if (choice) choice.addEventListener("change", draw);
  window.addEventListener("resize", draw);
  draw();
})();
