"use strict";
// Moves the strips and selects their methods. Charts and tables work without scripts.
const benchmark = JSON.parse(document.getElementById("benchmark").textContent);

function show(strip, frame) {
  const data = benchmark.strips[Number(strip.dataset.strip)];
  const slider = strip.querySelector("input");
  frame = Math.max(0, Math.min(frame, data.frames.length - 1));
  slider.value = String(frame);
  slider.setAttribute("aria-valuetext", data.frames[frame]);
  strip.querySelector("output").textContent = data.frames[frame];
  strip.querySelectorAll("figure").forEach((figure, panel) => {
    if (!figure.hidden) figure.querySelector("img").src = data.panels[panel].images[frame] || "data:,";
  });
}

const strips = Array.from(document.querySelectorAll(".strip"));
for (const strip of strips) {
  strip.querySelector("input").addEventListener("input", (event) => show(strip, Number(event.target.value)));
}

const choices = Array.from(document.querySelectorAll(".chooser input"));
function choose() {
  const chosen = new Set(choices.filter((choice) => choice.checked).map((choice) => choice.value));
  for (const strip of strips) {
    for (const figure of strip.querySelectorAll("figure[data-variant]")) {
      figure.hidden = !chosen.has(figure.dataset.variant);
    }
    show(strip, Number(strip.querySelector("input").value));
  }
}
for (const choice of choices) choice.addEventListener("change", choose);
// The browser restores the check boxes when the user navigates back to the page.
if (choices.length > 0) choose();

// report.html#frame=12 opens at the 13th picture of every strip.
function follow() {
  const wanted = /frame=(\d+)/.exec(location.hash);
  if (wanted) strips.forEach((strip) => show(strip, Number(wanted[1])));
}
window.addEventListener("hashchange", follow);
follow();
document.documentElement.dataset.ready = "yes";
