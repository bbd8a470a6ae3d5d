// Drawing: at most once per animation frame, and only the parts that requested it.

const parts = new Set();
let isAsked = false;

/** Has a part's `render(at)` called in the next frame, once however often it asks. */
export function paint(part) {
  parts.add(part);
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame((at) => {
    isAsked = false;
    const now = [...parts];
    parts.clear();
    for (const each of now) each.render(at);
  });
}
