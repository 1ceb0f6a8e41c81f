// Keys of the map while it has the focus: arrows orbit, plus and minus zoom.

/** Angle of one key press, radians, and factor of distance. */
const ANGLE = Math.PI / 24;
const ZOOM = 0.9;

/** Moves the view of `controls` with the keys of its canvas; `moved` is called after each of them. */
export function listenToMapKeys(canvas, controls, moved) {
  const acts = {
    ArrowLeft: () => controls.rotateLeft(ANGLE),
    ArrowRight: () => controls.rotateLeft(-ANGLE),
    ArrowUp: () => controls.rotateUp(ANGLE),
    ArrowDown: () => controls.rotateUp(-ANGLE),
    "+": () => controls.dollyIn(ZOOM),
    "-": () => controls.dollyOut(ZOOM),
  };
  // A click does not give the focus: arrow keys go on moving the frame.
  canvas.addEventListener("mousedown", (event) => {
    event.preventDefault();
    document.activeElement?.blur();
  });
  canvas.addEventListener("keydown", (event) => {
    const act = acts[event.key];
    if (!act || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    // Elsewhere, arrows move the frame.
    event.stopPropagation();
    act();
    moved();
  });
}
