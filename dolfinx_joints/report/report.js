// Copyright (C) 2026 The dolfinx_joints developers
// SPDX-License-Identifier: LGPL-3.0-or-later
// Draws the report's plots from the data in the page. Sets data-drawn on the root when done.
"use strict";

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

/** Arrays are stored as {"f4": base64} and {"i4": base64}, little-endian. */
function revive(key, value) {
  if (value && typeof value.f4 === "string") return new Float32Array(bytesOf(value.f4).buffer);
  if (value && typeof value.i4 === "string") return new Int32Array(bytesOf(value.i4).buffer);
  return value;
}

/** Unpack the plotting script; its hash is allowed by the page's content security policy. */
async function unpackPlotly() {
  const packed = bytesOf(document.getElementById("plotly").textContent);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
}

const CONFIG = { responsive: true, displaylogo: false };

function drawPlot(element, plot) {
  const narrow = element.clientWidth < 520;
  const layout = { ...plot.layout, font: { family: "inherit", size: narrow ? 11 : 13 } };
  return Plotly.newPlot(element, plot.data, layout, CONFIG);
}

/** Moving boundary surface, element edges and joints of one run. */
class Scene {
  constructor(figure, runs) {
    this.runs = runs;
    this.plot = figure.querySelector(".plot");
    this.controls = Object.fromEntries(
      [...figure.querySelectorAll("[name]")].map((item) => [item.name, item]),
    );
    for (const name of ["time", "scale", "through"]) {
      this.controls[name].addEventListener("input", () => this.update());
    }
    this.controls.run.addEventListener("input", () => this.choose());
  }

  choose() {
    this.run = this.runs[Number(this.controls.run.value)];
    this.controls.time.max = this.run.frames.length - 1;
    this.controls.time.value = this.run.start;
    this.controls.scale.value = this.run.scale;
    this.controls.through.disabled = this.run.joints.cells.length === 0;
    this.controls.through.checked = false;
    return this.draw();
  }

  frame() {
    const number = Number(this.controls.time.value);
    const frame = this.run.frames[number];
    const text = `${frame.time.toFixed(3)} s`;
    this.controls.moment.textContent = text;
    this.controls.time.setAttribute("aria-valuetext", text);
    return frame;
  }

  /** Coordinates of the displaced nodes, and magnitude of the displacement [mm]. */
  moved(frame) {
    const typed = Number(this.controls.scale.value);
    const scale = Number.isFinite(typed) && typed >= 0 ? typed : this.run.scale;
    const { nodes } = this.run;
    const count = nodes.length / 3;
    const axes = [0, 1, 2].map(() => new Float32Array(count));
    const size = new Float32Array(count);
    for (let node = 0; node < count; node++) {
      let square = 0;
      for (let axis = 0; axis < 3; axis++) {
        const u = frame.displacement[3 * node + axis];
        axes[axis][node] = nodes[3 * node + axis] + scale * u;
        square += u * u;
      }
      size[node] = 1e3 * Math.sqrt(square);
    }
    return { axes, size };
  }

  /** Outlines of all facets as one line with gaps. */
  edges(axes) {
    const { facets, corners } = this.run;
    const lines = [[], [], []];
    for (let start = 0; start < facets.length; start += corners) {
      for (let axis = 0; axis < 3; axis++) {
        for (let corner = 0; corner <= corners; corner++) {
          lines[axis].push(axes[axis][facets[start + (corner % corners)]]);
        }
        lines[axis].push(null);
      }
    }
    return lines;
  }

  traces() {
    const { run } = this;
    const frame = this.frame();
    const { axes, size } = this.moved(frame);
    const [x, y, z] = axes;
    const [ex, ey, ez] = this.edges(axes);
    const through = this.controls.through.checked;
    const bar = (text) => ({
      title: { text }, thickness: 12, len: 0.7, orientation: "h", y: -0.02, yanchor: "top",
    });
    const body = {
      type: "mesh3d", x, y, z, i: run.triangles.i, j: run.triangles.j, k: run.triangles.k,
      intensity: size, cmin: 0, cmax: run.largest, colorscale: run.colours,
      showscale: !through, colorbar: bar("displacement [mm]"), opacity: through ? 0.12 : 1,
      flatshading: true, hovertemplate: "%{intensity:.4g} mm<extra></extra>",
      lighting: { ambient: 0.65, diffuse: 0.6, specular: 0.05 },
    };
    const edges = {
      type: "scatter3d", mode: "lines", x: ex, y: ey, z: ez, hoverinfo: "skip",
      line: { color: "#333", width: 1 }, opacity: through ? 0.3 : 1, showlegend: false,
    };
    const joints = {
      type: "mesh3d", x, y, z, i: run.joints.i, j: run.joints.j, k: run.joints.k,
      intensity: Array.from(run.joints.cells, (cell) => frame.opening[cell]),
      intensitymode: "cell", cmin: 0, cmax: run.widest, visible: through,
      colorscale: run.colours,
      showscale: true, colorbar: bar("joint opening [mm]"), flatshading: true,
      hovertemplate: "%{intensity:.4g} mm<extra></extra>", lighting: { ambient: 1, diffuse: 0 },
    };
    return [body, edges, joints];
  }

  draw() {
    const far = this.plot.clientWidth < 520 ? 2.2 : 1;
    const center = { x: 0, y: 0, z: -0.1 };
    const axis = (text) => ({ title: { text }, showbackground: false, gridcolor: "#ddd" });
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 70 }, uirevision: "kept", paper_bgcolor: "#fff",
      scene: {
        xaxis: axis("x [m], downstream"), yaxis: axis("y [m], left bank"), zaxis: axis("z [m]"), aspectmode: "data",
        camera: { eye: { x: 1.9 * far, y: -1.0 * far, z: 0.9 * far }, center },
      },
    };
    return Plotly.newPlot(this.plot, this.traces(), layout, CONFIG);
  }

  update() {
    return Plotly.react(this.plot, this.traces(), this.plot.layout, CONFIG);
  }
}

/** Make elements that are wider than the page scrollable, with a note. */
function markScrollable() {
  const look = new ResizeObserver((entries) => {
    for (const { target } of entries) {
      target.classList.toggle("hides", target.scrollWidth > target.clientWidth + 1);
    }
  });
  document.querySelectorAll(".scroll").forEach((element) => look.observe(element));
}

/** Unfold all details before printing. */
window.addEventListener("beforeprint", () => {
  document.querySelectorAll("details").forEach((element) => { element.open = true; });
});

async function drawReport() {
  markScrollable();
  const data = JSON.parse(document.getElementById("data").textContent, revive);
  const wanted = Object.keys(data.plots).length + data.scene.length;
  if (wanted) {
    await unpackPlotly();
    for (const [id, plot] of Object.entries(data.plots)) {
      const element = document.getElementById(id);
      const closed = element.closest("details:not([open])");
      const draw = () => drawPlot(element, plot);
      if (closed) closed.addEventListener("toggle", draw, { once: true });
      else await draw();
    }
    if (data.scene.length) {
      await new Scene(document.getElementById("scene"), data.scene).choose();
    }
  }
  document.documentElement.dataset.drawn = String(wanted);
}

drawReport().catch((error) => {
  const alert = document.createElement("div");
  alert.className = "alert";
  alert.setAttribute("role", "alert");
  alert.textContent = `The interactive plots could not be drawn (${error.message}); a newer browser
    may help. The pictures in the folder next to this file show the same plots.`;
  document.querySelector("main").prepend(alert);
  console.error(error);
});
