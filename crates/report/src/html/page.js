"use strict";
// Moves the strips. Charts and tables work without scripts.
const benchmark = JSON.parse(document.getElementById("benchmark").textContent);

function show(strip, frame) {
  const data = benchmark.strips[Number(strip.dataset.strip)];
  const slider = strip.querySelector("input");
  frame = Math.max(0, Math.min(frame, data.frames.length - 1));
  slider.value = String(frame);
  slider.setAttribute("aria-valuetext", data.frames[frame]);
  strip.querySelector("output").textContent = data.frames[frame];
  strip.querySelectorAll("img").forEach((image, panel) => {
    image.src = data.panels[panel].images[frame] || "data:,";
  });
}

const strips = Array.from(document.querySelectorAll(".strip"));
for (const strip of strips) {
  strip.querySelector("input").addEventListener("input", (event) => show(strip, Number(event.target.value)));
}

// report.html#frame=12 opens at the 13th picture of every strip.
function follow() {
  const wanted = /frame=(\d+)/.exec(location.hash);
  if (wanted) strips.forEach((strip) => show(strip, Number(wanted[1])));
}
window.addEventListener("hashchange", follow);
follow();
document.documentElement.dataset.ready = "yes";
