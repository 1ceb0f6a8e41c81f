// Keys of the map while it has the focus: arrows orbit, plus and minus zoom.

/** Angle of one key press, radians, and factor of distance. */
const ANGLE = Math.PI / 24;
const ZOOM = 0.9;

/** Moves the view of `controlsOf()` with the keys of its canvas; `moved` is called after each of them. */
export function listenToMapKeys(canvas, controlsOf, moved) {
  const acts = {
    ArrowLeft: () => controlsOf().rotateLeft(ANGLE),
    ArrowRight: () => controlsOf().rotateLeft(-ANGLE),
    ArrowUp: () => controlsOf().rotateUp(ANGLE),
    ArrowDown: () => controlsOf().rotateUp(-ANGLE),
    "+": () => controlsOf().dollyIn(ZOOM),
    "-": () => controlsOf().dollyOut(ZOOM),
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
